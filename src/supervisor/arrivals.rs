//! Which observation arrives when, given what the links decided when it was sent.

use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::failed;
use crate::link::Fates;

/// What is under way in one world.
///
/// An observation that is sent at step t and postponed by k ticks arrives at t + k. Observations may overtake each
/// other. If several from one sender arrive at once, only the newest is shown. One that is older than what its receiver
/// has already seen of that sender is not shown. What is under way when the episode ends is lost.
#[derive(Clone, Debug)]
pub(crate) struct Arrivals {
    agents: usize,
    /// The age at which the newest observation arrives at each of the steps to come, `[longest delay + 1, receiver,
    /// sender]`, the present step at `step` modulo their number.
    arriving: Vec<u8>,
    /// How many arrive beside a newer one, at each of these steps.
    overtaken: Vec<u64>,
    /// How old the newest that a receiver has seen of each sender is, `[receiver, sender]`.
    seen: Vec<u8>,
    step: usize,
    /// Observations that arrived at this step and are not shown, because newer ones have been seen. What was sent at
    /// t = 0 is in no statistics.
    outdated: u64,
}

impl Arrivals {
    /// Nothing is under way in a team of `agents`, and nothing will be for longer than this.
    pub(crate) fn new(agents: usize, longest_delay: u8) -> Arrivals {
        let links = agents * agents;
        Arrivals {
            agents,
            arriving: vec![NOT_ARRIVED; (usize::from(longest_delay) + 1) * links],
            overtaken: vec![0; usize::from(longest_delay) + 1],
            seen: vec![NOT_ARRIVED; links],
            step: 0,
            outdated: 0,
        }
    }

    /// An episode begins: nothing is under way, and nothing has been seen.
    pub(super) fn begin(&mut self) {
        self.arriving.fill(NOT_ARRIVED);
        self.overtaken.fill(0);
        self.seen.fill(NOT_ARRIVED);
        self.step = 0;
    }

    /// Sends the observations of the next step with these fates, and tells what arrives at that step:
    /// `arrived(receiver, ages)` gets an age per sender, or [`NOT_ARRIVED`].
    ///
    /// # Errors
    /// `Failed` if something is postponed by more than the longest delay.
    pub(crate) fn send(&mut self, fates: &Fates, mut arrived: impl FnMut(usize, &[u8])) -> Result<()> {
        let links = self.agents * self.agents;
        let steps = self.overtaken.len();
        for (link, fate) in fates.ticks().iter().enumerate().filter(|(_, fate)| **fate != NOT_ARRIVED) {
            let ticks = usize::from(*fate);
            if ticks >= steps {
                return Err(failed!(
                    "links postponed an observation by {ticks} ticks, but their longest delay is {}; correct \
                     `longest_delay`",
                    steps - 1
                ));
            }
            let then = (self.step + ticks) % steps;
            // What is sent later is younger on arrival.
            let before = std::mem::replace(&mut self.arriving[then * links + link], *fate);
            let counts = before != NOT_ARRIVED && self.step + ticks > usize::from(before);
            self.overtaken[then] += u64::from(counts);
        }
        let now = self.step % steps;
        self.outdated = std::mem::take(&mut self.overtaken[now]);
        let now = &mut self.arriving[now * links..][..links];
        for (age, seen) in now.iter_mut().zip(&mut self.seen) {
            if *seen != NOT_ARRIVED {
                *seen = seen.saturating_add(1).min(NOT_ARRIVED - 1);
            }
            if *age < *seen {
                *seen = *age;
            } else if *age != NOT_ARRIVED {
                self.outdated += u64::from(self.step > usize::from(*age));
                *age = NOT_ARRIVED;
            }
        }
        now.chunks_exact(self.agents).enumerate().for_each(|(receiver, ages)| arrived(receiver, ages));
        now.fill(NOT_ARRIVED);
        self.step += 1;
        Ok(())
    }

    /// Forgets what is under way to an agent that is not there, and what it has seen.
    pub(crate) fn forget_receiver(&mut self, receiver: usize) {
        let agents = self.agents;
        for ages in self.arriving.chunks_exact_mut(agents * agents).chain([&mut self.seen[..]]) {
            ages[receiver * agents..][..agents].fill(NOT_ARRIVED);
        }
    }

    /// Forgets what an agent was to send at the last step: it did not come to that.
    pub(super) fn forget_sent(&mut self, sender: usize) {
        let (agents, steps) = (self.agents, self.overtaken.len());
        self.seen
            .iter_mut()
            .skip(sender)
            .step_by(agents)
            .filter(|seen| **seen == 0)
            .for_each(|seen| *seen = NOT_ARRIVED);
        // What arrives k steps after the last one and is k steps old then was sent at it.
        for ticks in 1..steps {
            let then =
                &mut self.arriving[(self.step - 1 + ticks) % steps * agents * agents..][..agents * agents];
            for age in then.iter_mut().skip(sender).step_by(agents).filter(|age| usize::from(**age) == ticks)
            {
                *age = NOT_ARRIVED;
            }
        }
    }

    /// Observations that turned out at this step to be older than what their receivers see.
    pub(super) fn outdated(&self) -> u64 {
        self.outdated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What agent 0 sees of agent 1 at each step, if what is sent there has these fates; and what it does not.
    fn ages(longest: u8, fates_of: &[Option<u8>]) -> (Vec<u8>, Vec<u64>) {
        let mut arrivals = Arrivals::new(2, longest);
        let (mut seen, mut outdated) = (Vec::new(), Vec::new());
        // An episode before leaves nothing behind.
        for episode in 0..2 {
            arrivals.begin();
            seen.clear();
            outdated.clear();
            for fate in fates_of {
                let mut fates = Fates::new(2);
                match fate {
                    Some(ticks) => fates.postpone(0, 1, *ticks),
                    None => fates.lose(0, 1),
                }
                let see = |receiver: usize, ages: &[u8]| match receiver {
                    0 => seen.push(ages[1]),
                    _ => assert_eq!(ages, [0, 0], "episode {episode}"),
                };
                arrivals.send(&fates, see).unwrap();
                outdated.push(arrivals.outdated());
            }
        }
        (seen, outdated)
    }

    const NO: u8 = NOT_ARRIVED;

    #[test]
    fn what_is_postponed_arrives_later_and_never_after_the_end() {
        let two = Some(2);
        assert_eq!(ages(2, &[two, two, None, two, two, two]).0, [NO, NO, 2, 2, NO, 2]);
        assert_eq!(ages(0, &[Some(0), None, Some(0)]).0, [0, NO, 0]);
    }

    #[test]
    fn what_is_overtaken_is_counted_and_not_shown() {
        // Sent at 1 for 3, at 2 for 1: the second arrives at 3, the first at 4.
        let (seen, outdated) = ages(3, &[None, Some(3), Some(1), None, None, None]);
        assert_eq!((&seen[..], &outdated[..]), (&[NO, NO, NO, 1, NO, NO][..], &[0, 0, 0, 0, 1, 0][..]));
    }

    #[test]
    fn what_is_sent_at_the_start_is_not_counted() {
        let (seen, outdated) = ages(3, &[Some(3), Some(1), None, None]);
        assert_eq!((&seen[..], &outdated[..]), (&[NO, NO, 1, NO][..], &[0; 4][..]));
        assert_eq!(ages(2, &[Some(2), None, Some(0)]).1, [0; 3]);
    }

    #[test]
    fn of_several_at_once_the_newest_is_shown() {
        let (seen, outdated) = ages(2, &[None, Some(2), Some(1), Some(0), Some(1), Some(0)]);
        // Three arrive at step 3, two at step 5.
        assert_eq!((&seen[..], &outdated[..]), (&[NO, NO, NO, 0, NO, 0][..], &[0, 0, 0, 2, 0, 1][..]));
    }

    #[test]
    fn links_that_break_their_word_are_told_so() {
        let mut fates = Fates::new(2);
        fates.postpone(1, 0, 3);
        let error = Arrivals::new(2, 2).send(&fates, |_, _| {}).unwrap_err().to_string();
        assert!(error.contains("by 3 ticks, but their longest delay is 2"), "{error}");
    }
}
