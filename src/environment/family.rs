//! A family of tasks: what they are called, and how to make them.

use super::{Environment, PhysicsSpec, Spec};
use crate::base::rng::MAX_AGENTS;

/// Tasks that play by the same rules.
#[derive(Debug)]
pub(super) struct Family {
    /// What the team does, in one line.
    pub(super) summary: &'static str,
    /// Those with names of their own, smallest team first.
    pub(super) named: &'static [Named],
    /// The others, if there are tasks for teams of other sizes.
    pub(super) any_size: Option<AnySize>,
    /// Describes the task of this id for so many agents.
    pub(super) spec: fn(id: &str, n_agents: usize) -> Spec,
    /// Makes so many worlds of a task.
    pub(super) worlds: MakeWorlds,
    /// Standard deviation of the force that pushes an agent along an axis by chance if no physics says so, in units of a
    /// full push.
    pub(super) chance: f64,
}

/// Makes so many worlds of a task with this physics.
pub(super) type MakeWorlds = fn(spec: &Spec, physics: &PhysicsSpec, worlds: usize) -> Box<dyn Environment>;

/// A task with a name of its own.
#[derive(Debug)]
pub(super) struct Named {
    pub(super) n_agents: usize,
    pub(super) id: &'static str,
    /// The paper's name where it has one, then that of the reference environment.
    pub(super) aliases: &'static [&'static str],
    /// Whether it is what a team of its size plays where no task is named.
    pub(super) default_for_its_size: bool,
}

/// Tasks that are called by a prefix and the size of the team.
#[derive(Debug)]
pub(super) struct AnySize {
    pub(super) prefix: &'static str,
    /// Teams are made of groups of so many agents.
    pub(super) group: usize,
}

/// A task that is nobody's default.
pub(super) const fn named(n_agents: usize, id: &'static str, aliases: &'static [&'static str]) -> Named {
    Named { n_agents, id, aliases, default_for_its_size: false }
}

impl Named {
    pub(super) fn names(&self) -> impl Iterator<Item = &'static str> + use<> {
        std::iter::once(self.id).chain(self.aliases.iter().copied())
    }
}

impl AnySize {
    pub(super) fn allowed(&self) -> String {
        let even = if self.group == 2 { "even, " } else { "" };
        format!("{even}from {} to {MAX_AGENTS}", self.group)
    }
}
