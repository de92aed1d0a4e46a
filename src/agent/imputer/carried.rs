//! What most imputers remember: a value for everything that could be lost.

use super::{JointLayout, Setup};
use crate::agent::Inbox;
use crate::bus::NOT_ARRIVED;

/// What stands for the unique parts that are not received at the next step.
#[derive(Clone, Debug)]
pub struct Carried {
    layout: JointLayout,
    agent: usize,
    /// `[worlds, predicted]`. Zero when an episode starts: then nothing is known.
    values: Vec<f32>,
}

impl Carried {
    /// Nothing is known yet.
    pub fn new(setup: &Setup) -> Carried {
        let layout = JointLayout::of(setup.spec);
        Carried { layout, agent: setup.agent, values: vec![0.0; setup.worlds * layout.predicted()] }
    }

    /// Where the parts of the joint observation are.
    pub fn layout(&self) -> JointLayout {
        self.layout
    }

    /// Nothing is known any more.
    pub fn forget(&mut self) {
        self.values.fill(0.0);
    }

    /// Writes the joint estimate of one world: the own observation and the delivered ones as they are, however late,
    /// and what was carried for the others.
    pub fn fuse(&self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        let JointLayout { unique, .. } = self.layout;
        let carried = &self.values[world * self.layout.predicted()..];
        let known = |sender: usize| match inbox.from(sender) {
            _ if sender == self.agent => own,
            Some(received) => received.observation,
            None => &carried[sender * unique..],
        };
        self.layout.join(known, own, estimate);
    }

    /// Who is heard of only now, by what it observed so many steps ago: the sender and the age.
    pub fn late(&self, inbox: &Inbox) -> impl Iterator<Item = (usize, u8)> {
        let ages = (0..self.layout.agents).map(|sender| (sender, inbox.age(sender)));
        ages.filter(|(sender, age)| *sender != self.agent && ![0, NOT_ARRIVED].contains(age))
    }

    /// What is carried of an agent in one world.
    pub fn of(&self, world: usize, agent: usize) -> &[f32] {
        &self.values[world * self.layout.predicted()..][self.layout.part(agent)]
    }

    /// World by world, what is carried to the next step, and the joint estimate that it follows from.
    pub fn follow<'a>(
        &'a mut self,
        estimates: &'a [f32],
    ) -> impl Iterator<Item = (&'a mut [f32], &'a [f32])> {
        let JointLayout { agents, unique, .. } = self.layout;
        let carried = self.values.chunks_exact_mut(agents * unique);
        carried.zip(estimates.chunks_exact(self.layout.joint()))
    }
}
