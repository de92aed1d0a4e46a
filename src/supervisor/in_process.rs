//! A team without processes: the same agents, phase by phase, in this thread.

use super::{ActionDraws, Decisions, Event, Order, Team, Tick, check_weights};
use crate::agent::{Agent, AgentSettings, Member, Sensed};
use crate::base::error::Result;
use crate::bus::{AgentPort, Header, Kind, Layout, LocalHub, LocalPort, LocalSample, PROTOCOL, Sample};
use crate::environment::Spec;
use crate::failed;
use crate::nn::Policy;

/// The agents of a team in this process. `P` is their port, by default the plain in-process one.
pub struct InProcess<P: AgentPort = LocalPort> {
    spec: Spec,
    hub: LocalHub,
    members: Vec<Member<P>>,
    /// Makes an agent anew, which has been started so often before.
    make: Box<dyn Fn(usize, u32) -> Result<Member<P>>>,
    /// The agents that are not there, bit by bit, and those of them that were killed.
    absent: u64,
    killed: u64,
    /// Those that have not decided since they were made anew.
    anew: u64,
    /// How often each agent was killed.
    incarnations: Vec<u32>,
    layout: Layout,
    draws: ActionDraws,
    longest_delay: u8,
    /// The number of weights of the policy.
    policy_weights: usize,
    /// Which weights are in force.
    weights: u64,
}

impl InProcess {
    /// Makes the agents of a team, which share the weights of `policy`.
    pub fn new(settings: &AgentSettings, policy: &Policy) -> Result<InProcess> {
        InProcess::with_ports(settings, policy, |port| port)
    }
}

impl<P: AgentPort> InProcess<P> {
    /// Makes the agents of a team, each behind what `wrap` makes of its port.
    pub fn with_ports(
        settings: &AgentSettings,
        policy: &Policy,
        wrap: impl Fn(LocalPort) -> P + 'static,
    ) -> Result<InProcess<P>> {
        let (spec, layout) = (settings.spec.clone(), settings.layout());
        let hub = LocalHub::new(spec.n_agents());
        let (own_settings, own_policy, own_hub) = (settings.clone(), policy.clone(), hub.clone());
        let make = move |index, incarnation| {
            let agent = Agent::with_policy(&own_settings, &own_policy, index)?;
            Ok(Member::new(agent, wrap(own_hub.port(index)), layout, 0, incarnation))
        };
        let members = (0..spec.n_agents()).map(|index| make(index, 0)).collect::<Result<_>>()?;
        Ok(InProcess {
            hub,
            members,
            make: Box::new(make),
            absent: 0,
            killed: 0,
            anew: 0,
            incarnations: vec![0; spec.n_agents()],
            spec,
            layout,
            draws: ActionDraws::of(settings),
            longest_delay: settings.longest_delay,
            policy_weights: policy.n_values(),
            weights: 0,
        })
    }
}

impl<P: AgentPort> Team for InProcess<P> {
    fn muster(&mut self, orders: &[Order]) -> Result<u64> {
        for Order { agent, event } in orders {
            let bit = 1 << agent;
            match event {
                Event::Kill => (self.absent, self.killed) = (self.absent | bit, self.killed | bit),
                Event::Stop => self.absent |= bit,
                Event::Return => {
                    if self.killed & bit != 0 {
                        self.incarnations[*agent] += 1;
                        self.members[*agent] = (self.make)(*agent, self.incarnations[*agent])?;
                        self.anew |= bit;
                    }
                    (self.absent, self.killed) = (self.absent & !bit, self.killed & !bit);
                }
            }
        }
        Ok(self.absent)
    }

    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        let (layout, worlds) = (self.layout, tick.worlds);
        decisions.resize(self.members.len(), worlds, &layout);
        decisions.leave_out(tick.absent);
        decisions.anew = self.anew & !tick.absent;
        self.anew &= tick.absent;
        self.draws.draw(tick);
        for (agent, member) in there(&mut self.members, tick.absent) {
            let header = Header {
                protocol: PROTOCOL,
                kind: Kind::Sensor as u32,
                sender: agent as u32,
                weights: self.weights,
                ..tick.header(layout.sensor_words(worlds))
            };
            let write = |words: &mut [u32]| tick.write(agent, &layout, &self.draws, words);
            self.hub.send_sensor(agent, LocalSample::new(header, write));
            let sensed = member.sense()?;
            debug_assert_eq!(sensed, Sensed::Tick);
            member.publish()?;
        }
        for (_, member) in there(&mut self.members, tick.absent) {
            let complete = member.collect()?;
            debug_assert!(complete, "in-process, nobody is late");
            member.decide()?;
        }
        while let Some(decision) = self.hub.receive_decision() {
            let agent = decision.header().sender as usize;
            let decision = layout.decision(decision.words(), worlds);
            if let Some(fault) = Decisions::fault_of(&self.spec, agent, &decision) {
                return Err(failed!("agent-{agent} {fault}"));
            }
            decisions.take(agent, &decision);
        }
        there(&mut self.members, tick.absent).for_each(|(_, member)| member.predict());
        decisions.check_nobody_late(tick)
    }

    fn longest_delay(&self) -> u8 {
        self.longest_delay
    }

    fn relays(&self) -> bool {
        self.layout.relay
    }

    fn renew(&mut self, weights: &[f32]) -> Result<()> {
        check_weights(self.policy_weights, weights)?;
        self.weights += 1;
        let header = Header {
            protocol: PROTOCOL,
            kind: Kind::Weights as u32,
            weights: self.weights,
            length: weights.len() as u64,
            ..Header::default()
        };
        self.hub.publish_weights(header, |words| words.copy_from_slice(bytemuck::cast_slice(weights)));
        Ok(())
    }
}

/// The members that are there.
fn there<M>(members: &mut [M], absent: u64) -> impl Iterator<Item = (usize, &mut M)> {
    members.iter_mut().enumerate().filter(move |(agent, _)| absent >> agent & 1 == 0)
}
