//! How episodes ended: when, and whether something was left to earn.

/// The ends of the episodes of a batch.
///
/// An episode is *terminated* if its world came to an end: nothing is left to earn. Otherwise it is *truncated*: time
/// was up, or somebody cut it off, and the rest would have been worth something.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ends {
    /// Steps played, by episode.
    lengths: Vec<usize>,
    terminated: Vec<bool>,
}

impl Ends {
    /// Episodes that were all truncated after so many steps.
    pub fn truncated(episodes: usize, steps: usize) -> Ends {
        Ends { lengths: vec![steps; episodes], terminated: vec![false; episodes] }
    }

    /// Notes how an episode ended: after so many steps, at least one, and whether it was terminated.
    pub fn set(&mut self, episode: usize, length: usize, terminated: bool) {
        self.lengths[episode] = length;
        self.terminated[episode] = terminated;
    }

    /// The steps played in each episode.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// Whether each episode was terminated.
    pub fn terminated(&self) -> &[bool] {
        &self.terminated
    }

    /// Whether an episode has this step.
    pub fn played(&self, step: usize, episode: usize) -> bool {
        step < self.lengths[episode]
    }

    /// The steps of all episodes.
    pub(crate) fn steps_played(&self) -> usize {
        self.lengths.iter().sum()
    }

    /// How many observations of an episode have a value: those that were acted on and, if it was truncated, the one
    /// that follows on the last action.
    pub(super) fn valued(&self, episode: usize) -> usize {
        self.lengths[episode] + usize::from(!self.terminated[episode])
    }

    /// The values that belong to steps played, of `values` `[T, E]`.
    pub(super) fn of_played<T>(&self, values: impl Iterator<Item = T>) -> impl Iterator<Item = T> {
        let episodes = self.lengths.len();
        values
            .enumerate()
            .filter(move |(at, _)| self.played(at / episodes, at % episodes))
            .map(|(_, value)| value)
    }
}

/// Makes zeros of what `values` `[steps, episodes, width]` hold of each episode from step `first(episode)` on: what
/// comes after an end may be anything, and nothing times zero is something if it is infinite.
pub(super) fn blank(values: &mut [f32], steps: usize, episodes: usize, first: impl Fn(usize) -> usize) {
    let width = values.len() / (steps * episodes);
    for episode in 0..episodes {
        for step in first(episode)..steps {
            values[(step * episodes + episode) * width..][..width].fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_played_and_what_has_a_value() {
        let mut ends = Ends::truncated(3, 4);
        assert_eq!((ends.steps_played(), ends.valued(0)), (12, 5));
        ends.set(0, 2, true);
        ends.set(2, 1, false);
        assert_eq!((ends.lengths(), ends.terminated()), (&[2, 4, 1][..], &[true, false, false][..]));
        assert_eq!([0, 1, 2].map(|episode| ends.valued(episode)), [2, 5, 2]);
        assert_eq!(ends.steps_played(), 7);
        let played: Vec<usize> = ends.of_played(0..12).collect();
        assert_eq!(played, [0, 1, 2, 3, 4, 7, 10]);

        let mut values = [f32::NAN; 16];
        blank(&mut values, 4, 2, |episode| 2 + episode);
        let zero = |at: usize| (at >= 12) || [8, 9].contains(&at);
        (0..16).for_each(|at| assert_eq!(values[at] == 0.0, zero(at), "{at}"));
    }
}
