//! What was observed, against which is held what agents pass on.

use super::Tick;
use crate::bus::{NOT_ARRIVED, Told};

/// The observations of the last ticks.
#[derive(Debug)]
pub(super) struct Chronicle {
    /// `[kept, agents, worlds, observation]`, a tick at its number modulo those that are kept.
    observations: Vec<f32>,
    kept: usize,
}

impl Chronicle {
    /// For ticks with so many values of observations at most, none older than this.
    pub(super) fn new(values: usize, longest_age: u8) -> Chronicle {
        let kept = usize::from(longest_age) + 1;
        Chronicle { observations: vec![0.0; kept * values], kept }
    }

    /// Notes what is observed at a tick.
    pub(super) fn note(&mut self, tick: &Tick) {
        let place = self.place(tick.tick);
        self.observations[place..][..tick.observations.len()].copy_from_slice(tick.observations);
    }

    /// What is wrong with what an agent tells at this tick: it may be nothing but what was observed, and no newer than what
    /// its links have let through.
    pub(super) fn fault_of(&self, told: &Told, sender: usize, tick: &Tick) -> Option<String> {
        let each = tick.observations.len() / (tick.agents * tick.worlds);
        let all = (0..tick.worlds).flat_map(|world| (0..tick.agents).map(move |origin| (world, origin)));
        for (world, origin) in all {
            let newest = tick.told(sender, world)[origin];
            let Some((age, observation)) = told.of(world, origin) else {
                if origin == sender {
                    return Some("nothing of what it observes".to_owned());
                }
                continue;
            };
            let of_episode = u32::from(age) <= tick.step && usize::from(age) < self.kept;
            if !of_episode || newest == NOT_ARRIVED || age < newest {
                return Some(format!(
                    "what agent-{origin} observed {age} ticks ago, which had not reached it"
                ));
            }
            let then = self.place(tick.tick - u64::from(age)) + (origin * tick.worlds + world) * each;
            let observed = &self.observations[then..][..each];
            if bytemuck::cast_slice::<f32, u32>(observation) != bytemuck::cast_slice::<f32, u32>(observed) {
                return Some(format!("of agent-{origin} something that it did not observe {age} ticks ago"));
            }
        }
        None
    }

    fn place(&self, tick: u64) -> usize {
        (tick % self.kept as u64) as usize * (self.observations.len() / self.kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::Layout;

    const NO: u8 = NOT_ARRIVED;
    const LAYOUT: Layout = Layout { agents: 2, observation: 1, action: 1, joint: 2, logits: 0, relay: true };

    /// What is wrong with what agent 1 tells at the third step, where agents observe ten times the step, plus their number,
    /// and the newest that it can hold of agent 0 is a step old.
    fn fault(ages: [u8; 2], observations: [f32; 2]) -> Option<String> {
        let mut chronicle = Chronicle::new(2, 2);
        let mut fault = None;
        for step in 0..3u8 {
            let seen = [0, 1].map(|agent| f32::from(10 * step + agent));
            let tick = Tick {
                episode: 0,
                step: step.into(),
                tick: 7 + u64::from(step),
                agents: 2,
                worlds: 1,
                absent: 0,
                carried_out: &[0; 2],
                observations: &seen,
                ages: &[0; 4],
                messages: &[0; 4],
                held: &[0; 4],
                told: &[0, NO, 1, 0],
            };
            chronicle.note(&tick);
            let mut words = vec![0; LAYOUT.observation_words(1)];
            LAYOUT.write_relayed(&mut words, &ages, &observations);
            fault = chronicle.fault_of(&LAYOUT.told(&words, 1, 1), 1, &tick);
        }
        fault
    }

    #[test]
    fn only_what_was_observed_and_let_through_is_passed_on() {
        assert_eq!(fault([1, 0], [10.0, 21.0]), None);
        assert_eq!(fault([2, 0], [0.0, 21.0]), None, "something older may be told");
        assert_eq!(fault([NO, 0], [0.0, 21.0]), None);
        for (ages, observations, says) in [
            ([1, 0], [11.0, 21.0], "of agent-0 something that it did not observe 1 ticks ago"),
            ([1, 0], [10.0, 20.0], "of agent-1 something that it did not observe 0 ticks ago"),
            ([0, 0], [20.0, 21.0], "what agent-0 observed 0 ticks ago, which had not reached it"),
            ([3, 0], [0.0, 21.0], "which had not reached it"),
            ([200, 0], [0.0, 21.0], "which had not reached it"),
            ([1, NO], [10.0, 21.0], "nothing of what it observes"),
        ] {
            let found = fault(ages, observations).unwrap_or_default();
            assert!(found.contains(says), "{ages:?}, {observations:?}: {found}");
        }
    }
}
