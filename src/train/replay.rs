//! Remembered episodes, which MARO learns from.

use super::batch::{Batch, Trajectories};
use super::ends::blank;
use super::memory::Buffer;
use crate::base::rng::{Draws, Purpose};

/// The joint observations of the last episodes, everything delivered.
#[derive(Clone, Debug)]
pub struct Replay {
    capacity: usize,
    /// Joint observations of the longest episode that predictors learn from: all but the one after the last action.
    observations: usize,
    joint: usize,
    /// `[slots, observations, joint]`, zero behind an episode's end; episode e is in slot e modulo the capacity.
    episodes: Vec<f32>,
    /// The steps played in each slot's episode.
    lengths: Vec<usize>,
    /// What was sampled for each step of an update.
    samples: Vec<Sample>,
}

/// Episodes that were sampled, ordered by time.
#[derive(Clone, Debug, Default)]
struct Sample {
    joint: Buffer,
    lengths: Vec<usize>,
}

impl Replay {
    /// Remembers up to `capacity` episodes of `steps` steps; with 0 none.
    pub fn new(capacity: usize, steps: usize, joint: usize) -> Replay {
        Replay {
            capacity,
            observations: steps,
            joint,
            episodes: Vec::new(),
            lengths: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// Remembers the episode numbered `episode`, which is in this column of the batch.
    pub fn push(&mut self, episode: u64, batch: &Batch, column: usize) {
        if self.capacity == 0 {
            return;
        }
        let slot = (episode % self.capacity as u64) as usize;
        let (joint, length) = (self.joint, self.observations * self.joint);
        if self.episodes.len() < (slot + 1) * length {
            self.episodes.resize((slot + 1) * length, 0.0);
            self.lengths.resize(slot + 1, self.observations);
        }
        self.lengths[slot] = batch.ends.lengths()[column];
        let to = &mut self.episodes[slot * length..][..length];
        let from = batch.joint.chunks_exact(joint).skip(column).step_by(batch.episodes);
        to.chunks_exact_mut(joint).zip(from).for_each(|(to, from)| to.copy_from_slice(from));
        blank(to, self.observations, 1, |_| self.lengths[slot]);
    }

    /// How many episodes are remembered.
    pub fn len(&self) -> usize {
        self.episodes.len() / (self.observations * self.joint)
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.episodes.is_empty()
    }

    /// Different episodes, `rows` of them, for each of the `steps` of the predictors in update number
    /// `update`. None as long as fewer are remembered.
    pub fn sample(&mut self, seed: u64, update: u64, steps: usize, rows: usize) -> Vec<Trajectories<'_>> {
        if self.len() < rows {
            return Vec::new();
        }
        let Replay { observations, joint, .. } = *self;
        self.samples.resize_with(steps, Sample::default);
        for step in 0..steps {
            let draws = Draws::new(seed, Purpose::Replay, update, step as u64);
            let chosen = distinct(draws, self.len(), rows);
            let sample = &mut self.samples[step];
            sample.lengths.clear();
            sample.lengths.extend(chosen.iter().map(|&episode| self.lengths[episode]));
            let sample = sample.joint.resize(observations * rows * joint);
            for (at, to) in sample.chunks_exact_mut(joint).enumerate() {
                let from = chosen[at % rows] * observations + at / rows;
                to.copy_from_slice(&self.episodes[from * joint..][..joint]);
            }
        }
        let samples = self.samples.iter();
        samples.map(|Sample { joint, lengths }| Trajectories { rows, observations, lengths, joint }).collect()
    }

    /// All that is remembered, `[slots, observations, joint]`, for a checkpoint.
    pub fn episodes(&self) -> &[f32] {
        &self.episodes
    }

    /// The steps played in each remembered episode, for a checkpoint.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// Takes over what [`Replay::episodes`] and [`Replay::lengths`] gave; false if that does not fit. Without lengths
    /// all episodes are whole.
    pub fn restore(&mut self, episodes: &[f32], lengths: Option<Vec<usize>>) -> bool {
        let length = self.observations * self.joint;
        let slots = episodes.len() / length;
        let lengths = lengths.unwrap_or_else(|| vec![self.observations; slots]);
        let fits = episodes.len() == slots * length
            && slots <= self.capacity
            && lengths.len() == slots
            && lengths.iter().all(|length| (1..=self.observations).contains(length));
        if fits {
            self.episodes = episodes.to_vec();
            self.lengths = lengths;
        }
        fits
    }
}

/// `k` different numbers below `n`, every choice alike (Floyd's algorithm).
fn distinct(mut draws: Draws, n: usize, k: usize) -> Vec<usize> {
    let mut chosen = Vec::with_capacity(k);
    for last in n - k..n {
        let drawn = draws.below(last + 1);
        chosen.push(if chosen.contains(&drawn) { last } else { drawn });
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Ends;

    /// Two episodes of three steps; every value tells episode, time and dim.
    fn batch(first: u64) -> Batch {
        let value = |t: usize, e: usize, d: usize| ((first as usize + e) * 100 + t * 10 + d) as f32;
        let at = |i: usize| value(i / 4, i / 2 % 2, i % 2);
        let joint = (0..16).map(at).collect();
        Batch { episodes: 2, steps: 3, joint, ends: Ends::truncated(2, 3), ..Batch::default() }
    }

    #[test]
    fn samples_are_whole_episodes_ordered_by_time() {
        let mut replay = Replay::new(4, 3, 2);
        assert!(replay.is_empty());
        for episode in 0..6 {
            replay.push(episode, &batch(episode / 2 * 2), (episode % 2) as usize);
            assert_eq!(replay.len(), (episode as usize + 1).min(4));
        }
        assert!(replay.sample(1, 1, 1, 5).is_empty());
        let samples = replay.sample(1, 1, 3, 4);
        assert_eq!(samples.len(), 3);
        for sample in samples {
            assert_eq!((sample.rows, sample.observations), (4, 3));
            let episode = |t: usize, row: usize| sample.joint[(t * 4 + row) * 2] as usize / 100;
            let mut seen: Vec<usize> = (0..4).map(|row| episode(0, row)).collect();
            for (at, value) in sample.joint.iter().enumerate() {
                let (t, row, dim) = (at / 8, at / 2 % 4, at % 2);
                assert_eq!(*value as usize, seen[row] * 100 + t * 10 + dim);
            }
            // The first two have been forgotten.
            seen.sort_unstable();
            assert_eq!(seen, [2, 3, 4, 5]);
        }
    }

    #[test]
    fn short_episodes_are_remembered_as_far_as_they_went() {
        let mut replay = Replay::new(2, 3, 2);
        let mut short = batch(0);
        short.ends.set(0, 2, true);
        replay.push(0, &short, 0);
        replay.push(1, &short, 1);
        assert_eq!(
            (replay.lengths(), &replay.episodes()[..6]),
            (&[2, 3][..], &[0.0, 1.0, 10.0, 11.0, 0.0, 0.0][..])
        );
        for update in 0..10 {
            let sample = replay.sample(7, update, 1, 2)[0];
            let whole: Vec<bool> = (0..2).map(|row| sample.joint[row * 2] == 100.0).collect();
            assert_eq!(
                sample.lengths,
                whole.iter().map(|&whole| if whole { 3 } else { 2 }).collect::<Vec<_>>()
            );
        }
        // A whole episode takes the place of the short one.
        replay.push(2, &batch(0), 0);
        assert_eq!((replay.lengths(), &replay.episodes()[4..6]), (&[3, 3][..], &[20.0, 21.0][..]));
    }

    #[test]
    fn every_choice_is_alike() {
        let mut counts = [0; 10];
        for update in 0..6_000 {
            let chosen = distinct(Draws::new(3, Purpose::Replay, update, 0), 5, 2);
            assert_ne!(chosen[0], chosen[1]);
            let (a, b) = (chosen[0].min(chosen[1]), chosen[0].max(chosen[1]));
            counts[b * (b - 1) / 2 + a] += 1;
        }
        // 600 each, standard deviation 23.
        assert!(counts.iter().all(|&count: &i32| count.abs_diff(600) < 120), "{counts:?}");
    }

    #[test]
    fn what_is_remembered_can_be_restored() {
        let mut replay = Replay::new(4, 3, 2);
        replay.push(0, &batch(0), 0);
        replay.push(1, &batch(0), 1);
        let mut other = Replay::new(4, 3, 2);
        assert!(other.restore(replay.episodes(), Some(replay.lengths().to_vec())));
        assert_eq!(other.sample(1, 2, 1, 2)[0].joint, replay.sample(1, 2, 1, 2)[0].joint);
        assert!(!other.restore(&[0.0; 7], None));
        assert!(!other.restore(&[0.0; 30], None));
        assert!(!other.restore(replay.episodes(), Some(vec![3])));
        assert!(!other.restore(replay.episodes(), Some(vec![3, 4])));
        assert!(!other.restore(replay.episodes(), Some(vec![0, 3])));
        assert_eq!(other.lengths(), [3, 3]);
        // As long as no episode could end early, no lengths were kept.
        assert!(other.restore(replay.episodes(), None));
        assert_eq!(other.lengths(), [3, 3]);
    }
}
