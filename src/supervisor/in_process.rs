//! A team without processes: the same agents, phase by phase, in this thread.

use super::{Decisions, Team, Tick, check_weights};
use crate::agent::{Agent, AgentSettings, Member, Sensed};
use crate::base::error::Result;
use crate::bus::{AgentPort, Header, Kind, Layout, LocalHub, LocalPort, LocalSample, PROTOCOL, Sample};
use crate::environment::Spec;
use crate::nn::Policy;

/// The agents of a team in this process. `P` is their port, by default the plain in-process one.
pub struct InProcess<P: AgentPort = LocalPort> {
    spec: Spec,
    hub: LocalHub,
    members: Vec<Member<P>>,
    layout: Layout,
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
        wrap: impl Fn(LocalPort) -> P,
    ) -> Result<InProcess<P>> {
        let (spec, layout) = (settings.spec.clone(), settings.layout());
        let hub = LocalHub::new(spec.n_agents());
        let member = |index| {
            let agent = Agent::with_policy(settings, policy, index)?;
            Ok(Member::new(agent, wrap(hub.port(index)), layout, 0, 0))
        };
        let members = (0..spec.n_agents()).map(member).collect::<Result<_>>()?;
        Ok(InProcess {
            spec,
            hub,
            members,
            layout,
            longest_delay: settings.longest_delay,
            policy_weights: policy.n_values(),
            weights: 0,
        })
    }
}

impl<P: AgentPort> Team for InProcess<P> {
    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        let (layout, worlds) = (self.layout, tick.worlds);
        decisions.resize(self.members.len(), worlds, &layout);
        for (agent, member) in self.members.iter_mut().enumerate() {
            let header = Header {
                protocol: PROTOCOL,
                kind: Kind::Sensor as u32,
                sender: agent as u32,
                weights: self.weights,
                ..tick.header(layout.sensor_words(worlds))
            };
            self.hub.send_sensor(agent, LocalSample::new(header, |words| tick.write(agent, &layout, words)));
            let sensed = member.sense()?;
            debug_assert_eq!(sensed, Sensed::Tick);
            member.publish()?;
        }
        for member in &mut self.members {
            let complete = member.collect()?;
            debug_assert!(complete, "in-process, nobody is late");
            member.decide()?;
        }
        while let Some(decision) = self.hub.receive_decision() {
            let agent = decision.header().sender as usize;
            decisions.take(&self.spec, tick, agent, &layout.decision(decision.words(), worlds))?;
        }
        self.members.iter_mut().for_each(Member::predict);
        decisions.check_nobody_late(tick)
    }

    fn longest_delay(&self) -> u8 {
        self.longest_delay
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
