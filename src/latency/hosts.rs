//! How long hops to other machines take, ticks of teams that are spread over them, and policies to get there.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::{Played, Setup, repeat};
use crate::base::distribution::Distribution;
use crate::base::error::{Error, Result};
use crate::bus::{Header, Wait};
use crate::hosts::{Answering, Hosts, Over, Partner, Plan};
use crate::supervisor::{AgentTimes, Conduct, Deadlines, Processes};

/// What is compared is measured in turn, so often: whatever else the machine does falls on all of it.
const ROUNDS: u32 = 5;

/// How long messages to a host take.
#[derive(Clone, Debug)]
pub(crate) struct HostHop {
    /// What the plan calls it.
    pub(crate) host: String,
    /// What they went over.
    pub(crate) over: Over,
    /// Their bytes.
    pub(crate) payload: usize,
    /// Half of the time there and back.
    pub(crate) hop: Distribution,
}

impl HostHop {
    /// Times messages of this size to each host, over all ways; for so long each.
    pub(crate) fn measure(plan: &Plan, payload: usize, longest: Duration) -> Result<Vec<HostHop>> {
        let mut hops = Vec::new();
        for partner in Partner::connect(plan, plan.len())? {
            let empty = |over| HostHop {
                host: partner.name().to_owned(),
                over,
                payload,
                hop: Distribution::default(),
            };
            let mut measured = Over::ALL.map(empty);
            for _ in 0..ROUNDS {
                for HostHop { over, hop, .. } in &mut measured {
                    let mut answering = partner.answering(*over)?;
                    repeat(longest / ROUNDS, |counts| {
                        let began = Instant::now();
                        answering.send(payload, payload);
                        if answering.is_answered()? && counts {
                            hop.record(began.elapsed().as_nanos() as u64 / 2);
                        }
                        Ok(())
                    })?;
                }
            }
            hops.extend(measured);
        }
        Ok(hops)
    }
}

/// How long ticks of a team take that is spread evenly over hosts.
#[derive(Clone, Debug)]
pub(crate) struct HostTick {
    /// How many hosts.
    pub(crate) hosts: usize,
    /// Size of the team.
    pub(crate) agents: usize,
    /// From the first sensor message sent to the last decision received.
    pub(crate) tick: Distribution,
    /// The exchange of frames of the same sizes over plain Zenoh.
    pub(crate) exchange: Distribution,
    /// An agent's decision: from having received everything to publishing the action.
    pub(crate) decision: Distribution,
    /// Frames of all hosts in a tick, both ways.
    pub(crate) frames: f64,
    /// Bytes of the policy.
    pub(crate) policy: u64,
    /// Until the first host has it.
    pub(crate) shipping: Distribution,
}

impl HostTick {
    /// Plays for so long over the first hosts of a plan, and exchanges frames for so long.
    pub(crate) fn measure(plan: &Plan, hosts: usize, setup: &Setup, longest: Duration) -> Result<HostTick> {
        let (plan, agents) = (plan.of_first(hosts), setup.task().spec().n_agents());
        let [tick, exchange, decision, shipping] = [(); 4].map(|()| Distribution::default());
        let policy = std::fs::read(setup.policy()).map_err(|e| Error::open(setup.policy(), e))?;
        let mut measured = HostTick {
            hosts,
            agents,
            tick,
            exchange,
            decision,
            frames: 0.0,
            policy: policy.len() as u64,
            shipping,
        };
        let sizes = Sizes::of(&plan, setup)?;
        for _ in 0..ROUNDS {
            measured.play(&plan, setup, longest / ROUNDS)?;
            let partners = Partner::connect(&plan, hosts)?;
            measured.shipping.record(partners[0].ship(&policy)?.as_nanos() as u64);
            let over_zenoh = partners.iter().map(|partner| partner.answering(Over::Zenoh));
            let mut answering = over_zenoh.collect::<Result<Vec<_>>>()?;
            repeat(longest / ROUNDS, |counts| {
                let began = Instant::now();
                sizes.exchange(&mut answering)?;
                if counts {
                    measured.exchange.record(began.elapsed().as_nanos() as u64);
                }
                Ok(())
            })?;
        }
        Ok(measured)
    }

    fn play(&mut self, plan: &Plan, setup: &Setup, longest: Duration) -> Result<()> {
        let hosts = Hosts::connect(plan, self.agents, false)?;
        let frames = hosts.frames();
        let answer = Deadlines::default().answer + plan.patience.silence();
        let deadlines = Deadlines { answer, ..Deadlines::default() };
        let conduct = Conduct { deadlines, ..Conduct::from(Wait::Block) };
        let mut played = Played::of(setup, 1, |settings, policy| {
            Processes::start_also(Box::new(hosts), settings, policy, conduct)
        })?;
        let (mut ticks, mut first) = (0, None);
        played.play(longest, |times, elapsed| {
            self.tick.record(elapsed.as_nanos() as u64);
            self.record(times);
            first.get_or_insert_with(|| frames.load(Ordering::Relaxed));
            ticks += 1;
        })?;
        // All but the first of them.
        let frames = frames.load(Ordering::Relaxed) - first.unwrap_or_default();
        self.frames = frames as f64 / f64::from(ticks - 1);
        Ok(())
    }

    fn record(&mut self, times: &[AgentTimes]) {
        // Both are of the same agent, and so of the same clock.
        let took = times.iter().map(|times| times.decided_ns.saturating_sub(times.decision.received_ns));
        took.for_each(|ns| self.decision.record(ns));
    }

    /// What a tick cannot do without if all agents share so many cores: the exchange and the decisions, in microseconds.
    pub(crate) fn needed_us(&self, cores: usize) -> f64 {
        let turns = (self.agents as f64 / cores as f64).max(1.0);
        self.exchange.quantile_us(0.5) + turns * self.decision.quantile_us(0.5)
    }
}

/// The bytes of the messages of one agent in one world, and how many agents each host has.
struct Sizes {
    sensor: usize,
    observation: usize,
    decision: usize,
    team: usize,
    agents: Vec<usize>,
}

impl Sizes {
    fn of(plan: &Plan, setup: &Setup) -> Result<Sizes> {
        let (layout, header) = (setup.settings(1).layout(), size_of::<Header>());
        let places = plan.place(layout.agents)?;
        Ok(Sizes {
            sensor: header + 4 * layout.sensor_words(1),
            observation: header + 4 * layout.observation_words(1),
            decision: header + 4 * layout.decision_words(1),
            team: layout.agents,
            agents: places.iter().map(|agents| agents.count_ones() as usize).collect(),
        })
    }

    /// The frames of a tick: sensors there and observations back, the observations of the others there and decisions back.
    fn exchange(&self, hosts: &mut [Answering]) -> Result<()> {
        for (host, agents) in hosts.iter_mut().zip(&self.agents) {
            host.send(agents * self.sensor, agents * self.observation);
        }
        hosts.iter().try_for_each(|host| host.is_answered().map(drop))?;
        for (host, agents) in hosts.iter_mut().zip(&self.agents) {
            host.send((self.team - agents) * self.observation, agents * self.decision);
        }
        hosts.iter().try_for_each(|host| host.is_answered().map(drop))
    }
}

/// The bytes of the frame with the observations that a host is sent, of a team that is spread over the first hosts.
pub(crate) fn frame_of_observations(plan: &Plan, setup: &Setup) -> Result<usize> {
    let sizes = Sizes::of(&plan.of_first(2), setup)?;
    Ok((sizes.team - sizes.agents[0]).max(1) * sizes.observation)
}
