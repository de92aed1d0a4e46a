//! A team without processes: the same agents, phase by phase, in this thread.

use super::{Decisions, Team, Tick};
use crate::agents::{Agent, AgentSettings, Member, Sensed};
use crate::bus::{AgentPort, Header, Kind, Layout, LocalHub, LocalPort, LocalSample, PROTOCOL, Sample};
use crate::error::Result;

/// The agents of a team in this process. `P` is their port, by default the plain in-process one.
pub struct InProcess<P: AgentPort = LocalPort> {
    hub: LocalHub,
    members: Vec<Member<P>>,
    layout: Layout,
}

impl InProcess {
    /// Makes the agents of a team.
    pub fn new(settings: &AgentSettings) -> Result<InProcess> {
        InProcess::with_ports(settings, |port| port)
    }
}

impl<P: AgentPort> InProcess<P> {
    /// Makes the agents of a team, each behind what `wrap` makes of its port.
    pub fn with_ports(settings: &AgentSettings, wrap: impl Fn(LocalPort) -> P) -> Result<InProcess<P>> {
        let layout = settings.layout()?;
        let agents = settings.task()?.n_agents();
        let hub = LocalHub::new(agents);
        let member = |index| {
            let agent = Agent::new(settings, index)?;
            Ok(Member::new(agent, wrap(hub.port(index)), layout, 0, 0))
        };
        let members = (0..agents).map(member).collect::<Result<_>>()?;
        Ok(InProcess { hub, members, layout })
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
            decisions.take(decision.header().sender as usize, worlds, &layout, decision.words());
        }
        self.members.iter_mut().for_each(Member::predict);
        Ok(())
    }
}
