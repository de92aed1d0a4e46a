//! Chaos: agents that are killed and stopped on purpose, by addressed draws.

use std::time::Duration;

use super::{ChaosSpec, Injection};
use crate::base::rng::{Draws, Purpose};

/// The plan of who meets which fault when. It depends on seed, episode and step alone: everybody is back when an
/// episode begins.
#[derive(Clone, Debug)]
pub(super) struct Chaos {
    spec: ChaosSpec,
    seed: u64,
    /// How long a tick is.
    tick: Duration,
    /// The ticks for which each agent is still absent.
    absent: Vec<u32>,
    orders: Vec<Order>,
    injected: Injected,
}

/// How often agents were killed and stopped on purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Injected {
    /// Kills.
    pub kills: u64,
    /// Stops.
    pub stops: u64,
}

/// What is to happen to an agent before a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// The agent.
    pub agent: usize,
    /// What.
    pub event: Event,
}

/// What can happen to an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// It is killed.
    Kill,
    /// It is stopped.
    Stop,
    /// Its absence is over: one that was killed is started anew, one that was stopped goes on.
    Return,
}

impl Chaos {
    /// The plan for a team of `agents` whose ticks are so long.
    pub(super) fn new(spec: ChaosSpec, seed: u64, agents: usize, tick: Duration) -> Chaos {
        Chaos { spec, seed, tick, absent: vec![0; agents], orders: Vec::new(), injected: Injected::default() }
    }

    /// How often something was injected so far.
    pub(super) fn injected(&self) -> Injected {
        self.injected
    }

    /// What is to happen before this tick. Steps are asked for one after the other.
    pub(super) fn orders(&mut self, episode: u64, step: u32) -> &[Order] {
        self.orders.clear();
        let mut draws = Draws::new(self.seed, Purpose::Chaos, episode, step.into());
        let ChaosSpec { kill, stop } = self.spec;
        for (agent, absent) in self.absent.iter_mut().enumerate() {
            if *absent > 0 {
                *absent = if step == 0 { 0 } else { *absent - 1 };
                if *absent > 0 {
                    continue;
                }
                self.orders.push(Order { agent, event: Event::Return });
            }
            for (kind, (event, injection)) in
                [(Event::Kill, kill), (Event::Stop, stop)].into_iter().enumerate()
            {
                let meets = |injection: &Injection| draws.at(agent, kind).uniform() < injection.probability;
                if let Some(injection) = injection.filter(meets) {
                    *absent = injection.ticks(self.tick);
                    let Injected { kills, stops } = &mut self.injected;
                    *if event == Event::Kill { kills } else { stops } += 1;
                    self.orders.push(Order { agent, event });
                    break;
                }
            }
        }
        &self.orders
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chaos(text: &str) -> Chaos {
        Chaos::new(text.parse().unwrap(), 1, 3, Duration::from_millis(100))
    }

    /// Who is absent at each of so many steps, bit by bit, and what was ordered.
    fn absences(chaos: &mut Chaos, episode: u64, steps: u32) -> (Vec<u64>, Vec<Order>) {
        let (mut absent, mut all) = (0u64, Vec::new());
        let steps = (0..steps).map(|step| {
            for order in chaos.orders(episode, step) {
                all.push(*order);
                match order.event {
                    Event::Return => absent &= !(1 << order.agent),
                    Event::Kill | Event::Stop => absent |= 1 << order.agent,
                }
            }
            absent
        });
        (steps.collect(), all)
    }

    #[test]
    fn the_plan_of_an_episode_does_not_depend_on_what_was_before() {
        let text = "kill=0.05:300ms,stop=0.1:200ms";
        let alone = absences(&mut chaos(text), 7, 25).0;
        let mut after_others = chaos(text);
        absences(&mut after_others, 5, 25);
        absences(&mut after_others, 6, 3);
        // Who was still absent then returns first.
        for order in after_others.clone().orders(7, 0) {
            assert!(order.event == Event::Return || alone[0] >> order.agent & 1 == 1);
        }
        let again: Vec<u64> = absences(&mut after_others, 7, 25).0;
        assert_eq!(again[1..], alone[1..]);
        assert!(alone.iter().any(|absent| *absent != 0));
    }

    #[test]
    fn faults_are_as_frequent_and_absences_as_long_as_the_plan_says() {
        let mut chaos = chaos("kill=0.01:500ms,stop=0.02:200ms");
        let (mut there, mut kills, mut stops, mut missed) = (0.0, 0.0, 0.0, 0.0);
        for episode in 0..2000 {
            let (absent, orders) = absences(&mut chaos, episode, 25);
            missed += absent.iter().map(|absent| f64::from(absent.count_ones())).sum::<f64>();
            there += 3.0 * 25.0;
            kills += orders.iter().filter(|order| order.event == Event::Kill).count() as f64;
            stops += orders.iter().filter(|order| order.event == Event::Stop).count() as f64;
        }
        // Whoever is absent meets no fault, but at the tick at which it returns.
        let chances = there - missed + kills + stops;
        assert!((kills / chances - 0.01).abs() < 0.001 && (stops / chances - 0.02).abs() < 0.001);
        assert!(missed < 5.0 * kills + 2.0 * stops, "some are back early, when an episode ends");
        assert!(missed > 0.85 * (5.0 * kills + 2.0 * stops));
    }

    #[test]
    fn certain_faults_keep_an_agent_absent_at_every_tick() {
        let (absent, orders) = absences(&mut chaos("stop=1:100ms"), 0, 3);
        assert_eq!(absent, [0b111; 3]);
        assert_eq!(orders.len(), 3 + 2 * 6, "each returns, and is stopped again");
    }
}
