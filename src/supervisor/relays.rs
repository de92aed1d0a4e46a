//! What each agent holds of every other where agents relay, given which messages arrive.

use crate::bus::NOT_ARRIVED;
use crate::link::LONGEST_DELAY;

/// What has reached whom in one world.
///
/// A message tells what its sender held when the step began: of itself what it observes now, of others what had arrived by
/// the step before. So what is relayed is a tick older with each hop, and older still by the delays of links. Agents work
/// this out from the messages themselves; this is the same from what the links do alone.
#[derive(Clone, Debug)]
pub(crate) struct Relays {
    agents: usize,
    /// How old what is told in the messages of the last steps was then, `[longest delay + 1, sender, origin]`, a step at
    /// its number modulo their number.
    told: Vec<u8>,
    /// How old the newest that an agent holds of each other is, `[agent, origin]`.
    held: Vec<u8>,
    /// Steps that have begun.
    steps: usize,
}

impl Relays {
    /// Of a team of `agents`, none of whom holds anything, and whose messages are under way for at most so long.
    pub(crate) fn new(agents: usize, longest_delay: u8) -> Relays {
        let links = agents * agents;
        Relays {
            agents,
            told: vec![NOT_ARRIVED; (usize::from(longest_delay) + 1) * links],
            held: vec![NOT_ARRIVED; links],
            steps: 0,
        }
    }

    /// An episode begins: nobody holds anything.
    pub(crate) fn begin(&mut self) {
        self.told.fill(NOT_ARRIVED);
        self.held.fill(NOT_ARRIVED);
        self.steps = 0;
    }

    /// The next step begins: what is held is a tick older, and told.
    pub(crate) fn tell(&mut self) {
        let (agents, kept) = (self.agents, self.kept());
        for (at, age) in self.held.iter_mut().enumerate() {
            *age = match *age {
                _ if at / agents == at % agents => 0,
                // What nobody holds is no older.
                age if age < LONGEST_DELAY => age + 1,
                _ => NOT_ARRIVED,
            };
        }
        self.told[self.steps % kept * agents * agents..][..agents * agents].copy_from_slice(&self.held);
        self.steps += 1;
    }

    /// Messages arrive at an agent, by the age of that of each sender, or [`NOT_ARRIVED`]. Writes how old what is new to it of
    /// each agent is.
    pub(crate) fn receive(&mut self, receiver: usize, messages: &[u8], arrived: &mut [u8]) {
        for (origin, arrived) in arrived.iter_mut().enumerate() {
            if origin == receiver {
                *arrived = messages[origin];
                continue;
            }
            let heard = messages.iter().enumerate().filter(|(_, age)| **age != NOT_ARRIVED);
            let newest = heard.filter_map(|(sender, age)| self.arrives(sender, origin, *age)).min();
            let held = &mut self.held[receiver * self.agents + origin];
            *arrived = newest.filter(|age| age < held).unwrap_or(NOT_ARRIVED);
            *held = (*held).min(*arrived);
        }
    }

    /// How old what a message of this age tells of an agent is now.
    fn arrives(&self, sender: usize, origin: usize, age: u8) -> Option<u8> {
        let step = self.steps - 1 - usize::from(age);
        let when_sent = self.of_step(step)[sender * self.agents + origin];
        age.checked_add(when_sent).filter(|age| *age <= LONGEST_DELAY)
    }

    /// An agent has come by no more than this at this step, since somebody was lost in it.
    pub(crate) fn settle(&mut self, receiver: usize, arrived: &[u8]) {
        let (before, row) = (self.steps - 1, receiver * self.agents..(receiver + 1) * self.agents);
        let links = self.agents * self.agents;
        let before = &self.told[before % self.kept() * links..][..links];
        for ((held, before), arrived) in self.held[row.clone()].iter_mut().zip(&before[row]).zip(arrived) {
            *held = *before.min(arrived);
        }
    }

    /// Forgets what an agent holds that is not there.
    pub(crate) fn forget(&mut self, agent: usize) {
        self.held[agent * self.agents..][..self.agents].fill(NOT_ARRIVED);
    }

    /// How old the newest that an agent can hold of each is.
    pub(crate) fn held(&self, agent: usize) -> &[u8] {
        &self.held[agent * self.agents..][..self.agents]
    }

    /// How old what the message of this step tells of each agent is.
    pub(crate) fn told(&self, sender: usize) -> &[u8] {
        &self.of_step(self.steps - 1)[sender * self.agents..][..self.agents]
    }

    fn of_step(&self, step: usize) -> &[u8] {
        let links = self.agents * self.agents;
        &self.told[step % self.kept() * links..][..links]
    }

    fn kept(&self) -> usize {
        self.told.len() / (self.agents * self.agents)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Address, Context, Fates, LinkSpec};

    const NO: u8 = NOT_ARRIVED;

    /// The ages of what is new to each agent at each step, if the links between agents have these ages.
    fn ages(longest_delay: u8, steps: &[[[u8; 3]; 3]]) -> Vec<[[u8; 3]; 3]> {
        let mut relays = Relays::new(3, longest_delay);
        let mut step = |messages: &[[u8; 3]; 3]| {
            relays.tell();
            let mut arrived = [[NO; 3]; 3];
            for (receiver, arrived) in arrived.iter_mut().enumerate() {
                relays.receive(receiver, &messages[receiver], arrived);
            }
            arrived
        };
        steps.iter().map(&mut step).collect()
    }

    const SILENCE: [[u8; 3]; 3] = [[0, NO, NO], [NO, 0, NO], [NO, NO, 0]];

    /// Only one message arrives.
    fn only(receiver: usize, sender: usize, age: u8) -> [[u8; 3]; 3] {
        let mut messages = SILENCE;
        messages[receiver][sender] = age;
        messages
    }

    #[test]
    fn every_hop_takes_a_tick() {
        // From 0 to 1, from there to 2.
        assert_eq!(ages(0, &[only(1, 0, 0), only(2, 1, 0)])[1][2], [1, 0, 0]);
        assert_eq!(ages(0, &[only(1, 0, 0), SILENCE, SILENCE, only(2, 1, 0)])[3][2], [3, 0, 0]);
        // Both in one step: the message was sent before the other arrived.
        let mut both = only(1, 0, 0);
        both[2][1] = 0;
        assert_eq!(ages(0, &[both])[0][2], [NO, 0, 0]);
    }

    #[test]
    fn delays_add_to_the_age() {
        // Sent at 1, after what was observed at 0 had arrived; it arrives at 4.
        let steps = [only(1, 0, 0), SILENCE, SILENCE, SILENCE, only(2, 1, 3)];
        assert_eq!(ages(3, &steps)[4][2], [4, 3, 0]);
        // Sent at 0.
        assert_eq!(ages(3, &[only(1, 0, 0), SILENCE, only(2, 1, 2)])[2][2], [NO, 2, 0]);
    }

    #[test]
    fn an_older_one_never_replaces_a_newer() {
        let mut second = only(2, 1, 0);
        second[2][0] = 0;
        let found = ages(0, &[only(1, 0, 0), second, only(2, 1, 0)]);
        assert_eq!((found[1][2], found[2][2]), ([0, 0, 0], [NO, 0, 0]));
    }

    #[test]
    fn what_comes_back_is_nothing_new() {
        assert_eq!(ages(0, &[only(1, 0, 0), only(0, 1, 0)])[1][0], [0, 0, NO]);
    }

    #[test]
    fn what_is_very_old_is_forgotten() {
        for (silent, found) in [(99, 100), (100, NO)] {
            let mut steps = vec![only(1, 0, 0)];
            steps.extend(vec![SILENCE; silent]);
            steps.push(only(2, 1, 0));
            assert_eq!(ages(0, &steps)[silent + 1][2][0], found);
        }
    }

    #[test]
    fn who_was_lost_told_nothing() {
        let mut relays = Relays::new(3, 0);
        relays.tell();
        relays.receive(1, &only(1, 0, 0)[1], &mut [NO; 3]);
        relays.tell();
        relays.receive(2, &only(2, 1, 0)[2], &mut [NO; 3]);
        assert_eq!(relays.held(2), [1, 0, 0]);
        relays.settle(2, &[NO, NO, 0]);
        assert_eq!((relays.held(2), relays.told(1)), (&[NO, NO, 0][..], &[1, 0, NO][..]));
        relays.forget(1);
        assert_eq!(relays.held(1), [NO; 3]);
    }

    /// How often an agent of a team of so many holds what another observed at most 0, 1 and 2 steps ago, if each message
    /// arrives with probability p: 25 steps of 200 episodes after the first five.
    fn shares_held(agents: usize, p: f64) -> [f64; 3] {
        let mut links = LinkSpec::level(p).unwrap().build().sharing_at_start(false);
        let (mut fates, mut relays) = (Fates::new(agents), Relays::new(agents, 0));
        let (mut held, mut all, mut arrived) = ([0u32; 3], 0u32, vec![NO; agents]);
        for (episode, step) in (0..200).flat_map(|episode| (0..30).map(move |step| (episode, step))) {
            if step == 0 {
                relays.begin();
            }
            let address = Address { seed: 5, position: 0, episode, step };
            let context = Context { address, world: 0, bytes: 1, positions: None };
            links.deliveries(&context, &mut fates).unwrap();
            relays.tell();
            for receiver in 0..agents {
                relays.receive(receiver, &fates.ticks()[receiver * agents..][..agents], &mut arrived);
            }
            let pairs = (0..agents * agents).map(|at| (at / agents, at % agents));
            for (agent, origin) in pairs.filter(|(agent, origin)| agent != origin && step >= 5) {
                let age = usize::from(relays.held(agent)[origin]);
                held.iter_mut().skip(age).for_each(|count| *count += 1);
                all += 1;
            }
        }
        held.map(|count| f64::from(count) / f64::from(all))
    }

    #[test]
    fn several_paths_are_as_good_as_they_are_in_theory() {
        for (agents, p) in [(2, 0.5), (3, 0.3), (3, 0.5), (5, 0.3), (5, 0.5)] {
            let q: f64 = 1.0 - p;
            // At most one step old: neither of the last two direct ones was lost, or somebody else had the last but one,
            // and was heard. Each of the others is a path of its own.
            let at_most_one = 1.0 - q * q * (1.0 - p * p).powi(agents - 2);
            // At most two steps old, of three: by the third, heard now of either of the two steps before, or heard a step
            // ago of the one before that.
            let neither = p * q * q + q * (1.0 - p * p);
            let at_most_two = (agents == 3).then(|| 1.0 - q.powi(3) * neither);
            let found = shares_held(agents as usize, p);
            for (age, expected) in [Some(p), Some(at_most_one), at_most_two].into_iter().enumerate() {
                // Without relaying it would be less by 0.04 or more.
                let close = expected.is_none_or(|expected| (found[age] - expected).abs() < 0.025);
                assert!(close, "{agents} agents, p = {p}, age {age}: {found:?}, not {expected:?}");
            }
        }
    }
}
