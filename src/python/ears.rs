//! What agents have whose policies are elsewhere: what their links deliver, and what their imputers make of the rest.

use crate::agent::imputer::{Setup, Step};
use crate::agent::{AgentSettings, Holdings, Imputer, JointLayout, Mailbox, Registry};
use crate::base::error::Result;
use crate::bus::{Header, Kind, Layout, LocalSample, NOT_ARRIVED, PROTOCOL};
use crate::supervisor::Tick;

/// The mailboxes and imputers of all agents, in each world: agents without actors.
#[derive(Debug)]
pub(super) struct Ears {
    layout: JointLayout,
    /// Of messages.
    messages: Layout,
    agents: Vec<Ear>,
    /// Padded values of an observation.
    observation: usize,
    /// `[agents, worlds, joint]`.
    estimates: Vec<f32>,
    /// How many steps ago what an agent knows of each sender was observed, or [`NEVER`], `[agents, worlds, agents]`.
    ages: Vec<i32>,
    /// 1 for what arrives now, else 0, `[agents, worlds, agents]`.
    mask: Vec<u8>,
    /// What agents do that act by values, as far as imputers are told, `[worlds]`.
    nothing: Vec<u32>,
}

#[derive(Debug)]
struct Ear {
    mailbox: Mailbox<LocalSample>,
    /// What the agent passes on, where agents relay.
    holdings: Option<Holdings>,
    imputer: Box<dyn Imputer>,
}

/// The age of what was never received.
const NEVER: i32 = -1;

impl Ears {
    /// Those of a team, with imputers that `registry` has under this name. The setup may be anybody's.
    ///
    /// # Errors
    /// `Usage` if there is no such imputer.
    pub(super) fn new(setup: &Setup, registry: &Registry, imputer: &str, relay: bool) -> Result<Ears> {
        let (spec, worlds) = (setup.spec, setup.worlds);
        let (layout, observation) = (JointLayout::of(spec), spec.padded_obs_dim());
        let settings = AgentSettings { relay, longest_delay: setup.longest_delay, ..AgentSettings::of(spec) };
        let (messages, longest_delay) = (settings.layout(), settings.longest_age());
        let ear = |agent| {
            let mailbox = Mailbox::new(messages, 0, setup.longest_delay);
            let holdings = relay.then(|| Holdings::new(messages, agent, worlds));
            let imputer = registry.make(imputer, &Setup { agent, longest_delay, ..*setup })?;
            Ok(Ear { mailbox, holdings, imputer })
        };
        let rows = layout.agents * worlds;
        Ok(Ears {
            agents: (0..layout.agents).map(ear).collect::<Result<_>>()?,
            layout,
            messages,
            observation,
            estimates: vec![0.0; rows * layout.joint()],
            ages: vec![NEVER; rows * layout.agents],
            mask: vec![0; rows * layout.agents],
            nothing: vec![0; worlds],
        })
    }

    /// An episode begins in each world.
    pub(super) fn begin_episodes(&mut self) {
        let worlds = self.nothing.len();
        for Ear { holdings, imputer, .. } in &mut self.agents {
            imputer.begin_episodes(worlds);
            holdings.iter_mut().for_each(Holdings::forget);
        }
        self.ages.fill(NEVER);
    }

    /// Takes in what is sent and what arrives at a tick.
    pub(super) fn hear(&mut self, tick: &Tick) {
        self.exchange(tick);
        let now = Header { tick: tick.tick, ..Header::default() };
        let (joint, agents) = (self.layout.joint(), self.layout.agents);
        let observations = tick.observations.chunks_exact(self.observation);
        let known = self.ages.chunks_exact_mut(agents).zip(self.mask.chunks_exact_mut(agents));
        let rows = observations.zip(self.estimates.chunks_exact_mut(joint)).zip(known);
        for (row, ((own, estimate), (ages, mask))) in rows.enumerate() {
            let (agent, world) = (row / tick.worlds, row % tick.worlds);
            let Ear { mailbox, holdings, imputer } = &mut self.agents[agent];
            let arriving = tick.messages(agent, world);
            let inbox = match holdings {
                Some(holdings) => {
                    let inbox = mailbox.deliver_relayed(world, arriving, &now, holdings);
                    holdings.take(world, &inbox);
                    inbox
                }
                None => mailbox.deliver(world, arriving, &now),
            };
            imputer.fuse(world, own, &inbox, estimate);
            for (sender, (age, mask)) in ages.iter_mut().zip(mask).enumerate() {
                let arrived = if sender == agent { 0 } else { inbox.age(sender) };
                *mask = u8::from(arrived != NOT_ARRIVED);
                *age = match (arrived, *age) {
                    (NOT_ARRIVED, NEVER) => NEVER,
                    (NOT_ARRIVED, age) => age + 1,
                    (arrived, _) => arrived.into(),
                };
            }
        }
    }

    /// Everybody sends to everybody: loss is applied to what arrives.
    fn exchange(&mut self, tick: &Tick) {
        let each = tick.worlds * self.observation;
        for (sender, observations) in tick.observations.chunks_exact(each).enumerate() {
            let header = Header {
                protocol: PROTOCOL,
                kind: Kind::Observation as u32,
                sender: sender as u32,
                tick: tick.tick,
                worlds: tick.worlds as u32,
                length: self.messages.observation_words(tick.worlds) as u64,
                ..Header::default()
            };
            let holdings = &mut self.agents[sender].holdings;
            let message = LocalSample::new(header, |words| match holdings {
                Some(holdings) => {
                    holdings.begin_tick(tick.tick);
                    holdings.write(observations, words);
                }
                None => words.copy_from_slice(bytemuck::cast_slice(observations)),
            });
            let others = self.agents.iter_mut().enumerate().filter(|(agent, _)| *agent != sender);
            others.for_each(|(_, ear)| ear.mailbox.accept(message.clone()));
        }
    }

    /// Carries the estimates over to the next step, given what is done at this one, `[agents, worlds, width]`.
    pub(super) fn predict(&mut self, tick: &Tick, actions: &[u32]) {
        let (worlds, each) = (tick.worlds, tick.worlds * self.layout.joint());
        let by_values = actions.len() > self.agents.len() * worlds;
        for (agent, ear) in self.agents.iter_mut().enumerate() {
            let actions = if by_values { &self.nothing[..] } else { &actions[agent * worlds..][..worlds] };
            let estimates = &self.estimates[agent * each..][..each];
            ear.imputer.predict(&Step { episode: tick.episode, step: tick.step, estimates, actions });
        }
    }

    /// The joint estimates, `[agents, worlds, joint]`.
    pub(super) fn estimates(&self) -> &[f32] {
        &self.estimates
    }

    /// The same, for somebody who knows better.
    pub(super) fn estimates_mut(&mut self) -> &mut [f32] {
        &mut self.estimates
    }

    /// How many steps ago what an agent knows of each sender was observed, or -1, `[agents, worlds, agents]`.
    pub(super) fn ages(&self) -> &[i32] {
        &self.ages
    }

    /// 1 for what arrives now, else 0, `[agents, worlds, agents]`.
    pub(super) fn mask(&self) -> &[u8] {
        &self.mask
    }
}
