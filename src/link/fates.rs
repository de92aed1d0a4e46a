//! What becomes of the observations that are sent.

/// The fates of all observations that are sent at one step in one world, from each sender to each receiver.
///
/// All begin as delivered at once, and links only take away from that: they lose an observation, or postpone it. What is
/// lost stays lost, and delays add up, which is why links can stand in a chain. An agent's own observation needs no link:
/// it is there at once, whatever a link says of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fates {
    agents: usize,
    /// Ticks from sending to arrival, `[receiver, sender]`, or [`LOST`].
    ticks: Vec<u8>,
}

/// The fate of what never arrives.
const LOST: u8 = u8::MAX;

impl Fates {
    /// Everything is delivered at once in a team of `agents`.
    pub fn new(agents: usize) -> Fates {
        Fates { agents, ticks: vec![0; agents * agents] }
    }

    /// Begins anew: everything is delivered at once.
    pub(crate) fn deliver_all(&mut self) {
        self.ticks.fill(0);
    }

    /// Size of the team.
    pub fn agents(&self) -> usize {
        self.agents
    }

    /// After how many ticks `receiver` receives what `sender` sends now; `None` for never.
    pub fn delay(&self, receiver: usize, sender: usize) -> Option<u8> {
        let ticks = self.ticks[receiver * self.agents + sender];
        (ticks != LOST).then_some(ticks)
    }

    /// `receiver` never receives it.
    pub fn lose(&mut self, receiver: usize, sender: usize) {
        if receiver != sender {
            self.ticks[receiver * self.agents + sender] = LOST;
        }
    }

    /// Nobody receives what these send.
    pub(super) fn silence(&mut self, is_silent: impl Fn(usize) -> bool) {
        for sender in (0..self.agents).filter(|sender| is_silent(*sender)) {
            (0..self.agents).for_each(|receiver| self.lose(receiver, sender));
        }
    }

    /// Neither of these two receives anything of the other.
    pub(crate) fn cut(&mut self, one: usize, other: usize) {
        self.lose(one, other);
        self.lose(other, one);
    }

    /// `receiver` receives it so many ticks later than it would have otherwise.
    pub fn postpone(&mut self, receiver: usize, sender: usize, ticks: u8) {
        if let Some(before) = self.delay(receiver, sender).filter(|_| receiver != sender) {
            self.ticks[receiver * self.agents + sender] = before.saturating_add(ticks).min(LOST - 1);
        }
    }

    /// All of them, `[receiver, sender]`: ticks from sending to arrival, or 255 for what never arrives.
    pub fn ticks(&self) -> &[u8] {
        &self.ticks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_only_take_away() {
        let mut fates = Fates::new(3);
        fates.postpone(0, 1, 2);
        fates.postpone(0, 1, 3);
        fates.lose(2, 1);
        fates.postpone(2, 1, 1);
        assert_eq!([fates.delay(0, 1), fates.delay(2, 1), fates.delay(1, 0)], [Some(5), None, Some(0)]);
        assert_eq!(fates.ticks(), [0, 5, 0, 0, 0, 0, 0, LOST, 0]);
        fates.postpone(0, 1, 254);
        assert_eq!(fates.delay(0, 1), Some(254), "late beyond counting is not lost");
        fates.deliver_all();
        assert_eq!(fates, Fates::new(3));
    }

    #[test]
    fn an_own_observation_needs_no_link() {
        let mut fates = Fates::new(2);
        fates.lose(1, 1);
        fates.postpone(0, 0, 4);
        assert_eq!(fates, Fates::new(2));
    }
}
