//! An agent on the bus: the phases of its tick by name.

use super::{Agent, Holdings, Mailbox};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::scheduling::Granted;
use crate::bus::{AgentPort, DecisionTimes, Header, Kind, Layout, PROTOCOL, Sample, join, now_ns};
use crate::failed;

/// One agent and its port. The same code runs as a process and in-process.
///
/// A tick is `sense`, `publish`, `collect` until true or until its deadline, `decide`, `predict`.
pub struct Member<P: AgentPort> {
    agent: Agent,
    port: P,
    layout: Layout,
    /// Who it is, and which weights it runs with.
    identity: Header,
    mailbox: Mailbox<P::Sample>,
    /// What it passes on, where agents relay.
    holdings: Option<Holdings>,
    sensor: Option<P::Sample>,
    /// The tick of the last decision.
    decided: Option<u64>,
    /// That of world 0.
    episode: Option<u64>,
    /// How old what reached the agent is, `[worlds, agents]`.
    ages: Vec<u8>,
    /// By which actions are sampled, `[worlds]`.
    draws: Vec<f64>,
}

/// What the supervisor wants of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensed {
    /// No message yet.
    Nothing,
    /// A tick.
    Tick,
    /// The agent shall leave.
    Shutdown,
}

impl<P: AgentPort> Member<P> {
    /// Puts an agent behind a port of the swarm with this number.
    pub fn new(agent: Agent, port: P, layout: Layout, swarm: u64, incarnation: u32) -> Member<P> {
        let identity = Header {
            protocol: PROTOCOL,
            swarm,
            incarnation,
            sender: agent.index() as u32,
            ..Header::default()
        };
        let mailbox = Mailbox::new(layout, swarm, agent.longest_delay());
        let holdings = layout.relay.then(|| Holdings::new(layout, agent.index(), agent.worlds()));
        Member {
            agent,
            port,
            layout,
            identity,
            mailbox,
            holdings,
            sensor: None,
            decided: None,
            episode: None,
            ages: Vec::new(),
            draws: Vec::new(),
        }
    }

    /// The agent's port.
    pub fn port(&self) -> &P {
        &self.port
    }

    /// Tells the supervisor that the agent can be spoken to, and what the kernel has granted it.
    pub(crate) fn report_ready(&mut self, granted: Granted) -> Result<()> {
        let header = Header { kind: Kind::Ready as u32, length: 1, sent_ns: now_ns(), ..self.identity };
        self.port.publish_decision(header, |words| words[0] = granted.bits())
    }

    /// Reads the own sensor, if its message is there: the newest, since in real time an agent may have missed some.
    pub fn sense(&mut self) -> Result<Sensed> {
        let (mut sensed, swarm) = (Sensed::Nothing, self.identity.swarm);
        while let Some(sample) = self.port.receive_sensor()? {
            let (header, words) = (*sample.header(), sample.words().len());
            if header.fits(Kind::Shutdown, swarm, 0) {
                return Ok(Sensed::Shutdown);
            }
            // It is told again whom to wait for, but has decided.
            if header.fits(Kind::Sensor, swarm, words)
                && header.incarnation > 0
                && self.decided == Some(header.tick)
            {
                continue;
            }
            if !header.fits(Kind::Sensor, swarm, words)
                || words != self.layout.sensor_words(header.worlds as usize)
                || header.worlds as usize > self.agent.worlds()
            {
                return Err(failed!("agent-{} got a message it cannot read: {header:?}", self.agent.index()));
            }
            self.sensor = Some(sample);
            sensed = Sensed::Tick;
        }
        if sensed == Sensed::Tick {
            self.begin_tick()?;
        }
        Ok(sensed)
    }

    /// When the observations of the tick have to be in, nanoseconds of the monotonic clock; `None` in lockstep, where
    /// all of them are waited for.
    pub(crate) fn deadline_ns(&self) -> Option<u64> {
        let deadline_ns = self.sensor.as_ref().expect("the deadline follows sense").header().deadline_ns;
        (deadline_ns > 0).then_some(deadline_ns)
    }

    /// Publishes the own observation to the peers.
    pub fn publish(&mut self) -> Result<()> {
        let sensor = self.sensor.as_ref().expect("publish follows sense");
        let worlds = sensor.header().worlds as usize;
        let own = self.layout.sensor(sensor.words(), worlds).observations;
        let header = self.answer(Kind::Observation, sensor.header(), self.layout.observation_words(worlds));
        let holdings = &mut self.holdings;
        self.port.publish_observation(header, |words| match holdings {
            Some(holdings) => holdings.write(own, words),
            None => words.copy_from_slice(bytemuck::cast_slice(own)),
        })
    }

    /// Takes in what has arrived; true once the observations of all peers at this tick are in.
    pub fn collect(&mut self) -> Result<bool> {
        while let Some(sample) = self.port.receive_observation()? {
            self.mailbox.accept(sample);
        }
        let Header { tick, absent, .. } = *self.sensor.as_ref().expect("collect follows sense").header();
        Ok(self.mailbox.complete(tick, absent | 1 << self.agent.index()))
    }

    /// Applies the links, fuses, acts and publishes the decision.
    pub fn decide(&mut self) -> Result<()> {
        let received_ns = now_ns();
        let sample = self.sensor.as_ref().expect("decide follows sense");
        let Header { episode, step, tick, worlds, .. } = *sample.header();
        let worlds = worlds as usize;
        self.decided = Some(tick);
        let sensor = self.layout.sensor(sample.words(), worlds);
        if step > 0 {
            self.agent.correct(episode, step - 1, sensor.carried_out)?;
        }
        self.ages.clear();
        let arriving = sensor.ages.chunks_exact(self.layout.agents);
        for (world, ages) in arriving.enumerate() {
            let own = &sensor.observations[world * self.layout.observation..][..self.layout.observation];
            let inbox = match &mut self.holdings {
                Some(holdings) => {
                    let inbox = self.mailbox.deliver_relayed(world, ages, sample.header(), holdings);
                    holdings.take(world, &inbox);
                    inbox
                }
                None => self.mailbox.deliver(world, ages, sample.header()),
            };
            self.agent.fuse(world, own, &inbox);
            if self.agent.is_oracle() {
                let everything = self.mailbox.deliver(world, &[0; MAX_AGENTS], sample.header());
                self.agent.substitute(world, &everything)?;
            }
            let (agent, senders) = (self.agent.index(), 0..self.layout.agents);
            self.ages.extend(senders.map(|sender| if sender == agent { 0 } else { inbox.age(sender) }));
        }
        let times = DecisionTimes { received_ns, fused_ns: now_ns() };
        self.draws.clear();
        self.draws.extend(sensor.draws.iter().map(|draw| f64::from_bits(join(*draw))));
        self.agent.act(episode, step, &self.draws)?;
        let header = self.answer(Kind::Decision, sample.header(), self.layout.decision_words(worlds));
        let (agent, layout, ages) = (&self.agent, &self.layout, &self.ages);
        self.port.publish_decision(header, |words| {
            let logits = &agent.logits()[..worlds * layout.logits];
            layout.write_decision(words, agent.actions(), ages, agent.estimates(), logits, times);
        })
    }

    /// Advances the imputer; the action is already out.
    pub fn predict(&mut self) {
        self.agent.predict();
    }

    /// Begins an episode, if this is the first tick of it that the agent sees.
    fn begin_tick(&mut self) -> Result<()> {
        let Header { episode, step, tick, worlds, weights, .. } =
            *self.sensor.as_ref().expect("begin follows sense").header();
        self.holdings.iter_mut().for_each(|holdings| holdings.begin_tick(tick));
        if step > 0 && self.episode == Some(episode) {
            return Ok(());
        }
        self.take_weights(weights)?;
        self.agent.begin_episode(worlds as usize);
        self.holdings.iter_mut().for_each(Holdings::forget);
        self.episode = Some(episode);
        Ok(())
    }

    /// Takes the weights that are in force in the episode that begins. They were published before the message
    /// that says so, so there is nothing to wait for.
    fn take_weights(&mut self, in_force: u64) -> Result<()> {
        if self.identity.weights == in_force {
            return Ok(());
        }
        let expected = self.agent.policy_weights();
        while let Some(sample) = self.port.receive_weights()? {
            let (header, words) = (sample.header(), sample.words());
            let fits = header.fits(Kind::Weights, self.identity.swarm, expected) && words.len() == expected;
            if fits && header.weights == in_force {
                self.agent.renew(bytemuck::cast_slice(words));
                self.identity.weights = in_force;
            }
        }
        if self.identity.weights == in_force {
            return Ok(());
        }
        Err(failed!(
            "agent-{} shall act with weights {in_force}, but has {} and did not get them; ending the swarm",
            self.agent.index(),
            self.identity.weights
        ))
    }

    fn answer(&self, kind: Kind, to: &Header, words: usize) -> Header {
        let Header { protocol, swarm, incarnation, sender, .. } = self.identity;
        let (kind, length, sent_ns) = (kind as u32, words as u64, now_ns());
        Header { protocol, swarm, incarnation, sender, kind, length, sent_ns, ..*to }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{AgentSettings, PolicySource, dims};
    use crate::bus::{LocalHub, LocalPort, LocalSample, NOT_ARRIVED, Sensor};
    use crate::environment::Task;
    use crate::nn::{ActorKind, Input, Networks, Policy, PredictorSpec};

    /// A member that is told which weights are in force at the beginning of an episode.
    fn told(in_force: u64) -> (LocalHub, Member<LocalPort>, usize) {
        let task = Task::parse("hear-see").unwrap();
        let policy = PolicySource::Untrained(1);
        let settings = AgentSettings { policy, ..AgentSettings::of(task.spec()) };
        let (agent, layout) = (Agent::new(&settings, 0).unwrap(), settings.layout());
        let (hub, weights) = (LocalHub::new(2), agent.policy_weights());
        let header = message(Kind::Sensor, in_force, layout.sensor_words(1));
        hub.send_sensor(0, LocalSample::new(header, |_| {}));
        let member = Member::new(agent, hub.port(0), layout, 7, 0);
        (hub, member, weights)
    }

    fn message(kind: Kind, weights: u64, words: usize) -> Header {
        let (kind, length) = (kind as u32, words as u64);
        Header { protocol: PROTOCOL, swarm: 7, kind, weights, length, worlds: 1, ..Header::default() }
    }

    #[test]
    fn no_agent_acts_with_other_weights_than_those_in_force() {
        let (hub, mut member, weights) = told(2);
        hub.publish_weights(message(Kind::Weights, 2, weights), |_| {});
        assert_eq!(member.sense().unwrap(), Sensed::Tick);
        let of_others = Header { swarm: 8, ..message(Kind::Weights, 2, weights) };
        let (older, shorter) = (message(Kind::Weights, 1, weights), message(Kind::Weights, 2, weights - 1));
        for misfit in [of_others, older, shorter] {
            let (hub, mut member, _) = told(2);
            hub.publish_weights(misfit, |_| {});
            let error = member.sense().unwrap_err().to_string();
            assert!(error.contains("agent-0") && error.contains("weights 2"), "{error}");
        }
        let (_hub, mut member, _) = told(1);
        assert!(member.sense().is_err());
    }

    #[test]
    fn an_agent_that_missed_ticks_goes_on_with_the_newest_in_the_episode_it_is_of() {
        let (hub, mut member, _) = told(0);
        assert_eq!(member.sense().unwrap(), Sensed::Tick);
        assert_eq!(member.deadline_ns(), None);
        let words = member.layout.sensor_words(1);
        let tick = |episode, step, deadline_ns| Header {
            episode,
            step,
            tick: 100 * episode + u64::from(step),
            deadline_ns,
            ..message(Kind::Sensor, 0, words)
        };
        // Steps 1 to 24 of episode 0 and the first two of episode 1 passed by.
        for step in [2, 3] {
            hub.send_sensor(0, LocalSample::new(tick(1, step, 7000 + u64::from(step)), |_| {}));
        }
        assert_eq!(member.sense().unwrap(), Sensed::Tick);
        assert_eq!((member.deadline_ns(), member.episode), (Some(7003), Some(1)));
        assert_eq!(member.sense().unwrap(), Sensed::Nothing);
    }

    /// What an agent that sees its own action estimates at the second step, if it is told there that it did this at the
    /// first; and what it did as far as it knows.
    fn second_estimate(told: Option<u32>) -> Result<(Vec<u32>, u32)> {
        let task = Task::parse("spread-xy-2").unwrap();
        let inputs = vec![Input::Estimate, Input::OwnAction];
        let predictors = vec![PredictorSpec { inputs, ..PredictorSpec::paper("acting") }];
        let networks = Networks { predictors, ..Networks::paper(ActorKind::Mlp) };
        let policy = Policy::untrained(&dims(task.spec()), 1, networks).unwrap();
        let settings = AgentSettings { imputer: "acting".to_owned(), ..AgentSettings::of(task.spec()) };
        let (agent, layout) = (Agent::with_policy(&settings, &policy, 0).unwrap(), settings.layout());
        let hub = LocalHub::new(2);
        let mut member = Member::new(agent, hub.port(0), layout, 7, 0);
        let mut carried_out = 0;
        for step in 0..2 {
            let header =
                Header { step, tick: step.into(), ..message(Kind::Sensor, 0, layout.sensor_words(1)) };
            let (ages, draws) = (&[NOT_ARRIVED; 2], &[[0; 2]]);
            let sensor = Sensor { carried_out: &[carried_out], ages, draws, observations: &[0.5; 8] };
            hub.send_sensor(0, LocalSample::new(header, |words| layout.write_sensor(words, &sensor)));
            assert_eq!(member.sense()?, Sensed::Tick);
            member.decide()?;
            if step == 0 {
                member.predict();
                carried_out = told.unwrap_or(member.agent.actions()[0]);
            }
        }
        Ok((member.agent.estimates().iter().map(|value| value.to_bits()).collect(), carried_out))
    }

    #[test]
    fn an_agent_whose_decision_came_too_late_goes_on_from_what_was_carried_out() {
        let (known, action) = second_estimate(None).unwrap();
        let told: Vec<Vec<u32>> = (0..5).map(|told| second_estimate(Some(told)).unwrap().0).collect();
        for (at, estimate) in told.iter().enumerate() {
            assert_eq!(*estimate == known, at == action as usize, "told {at}, did {action}");
        }
        let error = second_estimate(Some(5)).unwrap_err().to_string();
        assert!(error.contains("agent-0") && error.contains("[5]"), "{error}");
    }
}
