//! Remembered episodes, which MARO learns from.

use super::batch::{Batch, Trajectories};
use super::memory::Buffer;
use crate::base::rng::{Draws, Purpose};

/// The joint observations of the last episodes, everything delivered, and what the agents did if predictors see that.
#[derive(Clone, Debug)]
pub struct Replay {
    capacity: usize,
    /// Joint observations of the longest episode that predictors learn from: all but the one after the last action.
    observations: usize,
    joint: usize,
    /// How many agents' actions are remembered: those of all, or of none.
    agents: usize,
    /// `[slots, observations, joint]`, zero behind an episode's end; episode e is in slot e modulo the capacity.
    episodes: Vec<f32>,
    /// The steps played in each slot's episode.
    lengths: Vec<usize>,
    /// `[slots, observations, agents]`, zero behind an episode's end.
    actions: Vec<u8>,
    /// What was sampled for each step of an update.
    samples: Vec<Sample>,
}

/// Episodes that were sampled, ordered by time.
#[derive(Clone, Debug, Default)]
struct Sample {
    lengths: Vec<usize>,
    joint: Buffer,
    actions: Vec<u8>,
}

impl Replay {
    /// Remembers up to `capacity` episodes of `steps` steps, with what so many agents did; with capacity 0 none.
    pub fn new(capacity: usize, steps: usize, joint: usize, agents: usize) -> Replay {
        Replay {
            capacity,
            observations: steps,
            joint,
            agents,
            episodes: Vec::new(),
            lengths: Vec::new(),
            actions: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// Remembers the episode numbered `episode`, which is in this column of the batch.
    pub fn push(&mut self, episode: u64, batch: &Batch, column: usize) {
        if self.capacity == 0 {
            return;
        }
        let slot = (episode % self.capacity as u64) as usize;
        let length = batch.ends.lengths()[column];
        self.lengths.resize(self.lengths.len().max(slot + 1), 0);
        self.lengths[slot] = length;
        let (joint, agents, observations) = (self.joint, self.agents, self.observations);
        let row = |step: usize| step * batch.episodes + column;
        let to = slot_of(&mut self.episodes, slot, observations * joint).chunks_exact_mut(joint);
        let from = (0..length).map(|step| &batch.joint[row(step) * joint..][..joint]);
        to.zip(from).for_each(|(to, from)| to.copy_from_slice(from));
        if agents > 0 {
            let to = slot_of(&mut self.actions, slot, observations * agents).chunks_exact_mut(agents);
            let from = (0..length).map(|step| &batch.actions[row(step) * agents..][..agents]);
            to.zip(from).for_each(|(to, from)| to.copy_from_slice(from));
        }
    }

    /// How many episodes are remembered.
    pub fn len(&self) -> usize {
        self.lengths.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.lengths.is_empty()
    }

    /// Different episodes, `rows` of them, for each of the `steps` of the predictors in update number
    /// `update`. None as long as fewer are remembered.
    pub fn sample(&mut self, seed: u64, update: u64, steps: usize, rows: usize) -> Vec<Trajectories<'_>> {
        if self.len() < rows {
            return Vec::new();
        }
        let Replay { observations, joint, agents, .. } = *self;
        self.samples.resize_with(steps, Sample::default);
        for step in 0..steps {
            let draws = Draws::new(seed, Purpose::Replay, update, step as u64);
            let chosen = distinct(draws, self.len(), rows);
            let from = |at: usize| chosen[at % rows] * observations + at / rows;
            let sample = &mut self.samples[step];
            sample.lengths.clear();
            sample.lengths.extend(chosen.iter().map(|&episode| self.lengths[episode]));
            let to = sample.joint.resize(observations * rows * joint).chunks_exact_mut(joint).enumerate();
            to.for_each(|(at, to)| to.copy_from_slice(&self.episodes[from(at) * joint..][..joint]));
            sample.actions.clear();
            let actions = (0..observations * rows).map(|at| &self.actions[from(at) * agents..][..agents]);
            actions.for_each(|actions| sample.actions.extend_from_slice(actions));
        }
        let samples = self.samples.iter();
        let trajectories = samples.map(|Sample { lengths, joint, actions }| Trajectories {
            rows,
            observations,
            lengths,
            joint,
            estimates: &[],
            ages: &[],
            actions,
        });
        trajectories.collect()
    }

    /// All that is remembered, `[slots, observations, joint]`, for a checkpoint.
    pub fn episodes(&self) -> &[f32] {
        &self.episodes
    }

    /// The steps played in each remembered episode, for a checkpoint.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// What agents did, `[slots, observations, agents]`, for a checkpoint; empty where nobody sees that.
    pub fn actions(&self) -> &[u8] {
        &self.actions
    }

    /// Takes over what [`Replay::episodes`], [`Replay::lengths`] and [`Replay::actions`] gave; false if that does not
    /// fit. Without lengths all episodes are whole.
    pub(crate) fn restore(
        &mut self,
        episodes: &[f32],
        lengths: Option<Vec<usize>>,
        actions: Vec<u8>,
    ) -> bool {
        let length = self.observations * self.joint;
        let slots = episodes.len() / length;
        let lengths = lengths.unwrap_or_else(|| vec![self.observations; slots]);
        let fits = episodes.len() == slots * length
            && slots <= self.capacity
            && lengths.len() == slots
            && lengths.iter().all(|length| (1..=self.observations).contains(length))
            && actions.len() == slots * self.observations * self.agents;
        if fits {
            self.episodes = episodes.to_vec();
            (self.lengths, self.actions) = (lengths, actions);
        }
        fits
    }
}

/// The values of a slot, zero, in a list that grows as slots are filled.
fn slot_of<T: Copy + Default>(all: &mut Vec<T>, slot: usize, length: usize) -> &mut [T] {
    all.resize(all.len().max((slot + 1) * length), T::default());
    let values = &mut all[slot * length..][..length];
    values.fill(T::default());
    values
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
        // So do the actions of two agents.
        let action = |i: usize| (first as usize + i / 2 % 2) * 30 + i / 4 * 10 + i % 2;
        let actions = (0..12).map(|i| action(i) as u8).collect();
        Batch { episodes: 2, steps: 3, joint, actions, ends: Ends::truncated(2, 3), ..Batch::default() }
    }

    #[test]
    fn samples_are_whole_episodes_ordered_by_time() {
        let mut replay = Replay::new(4, 3, 2, 2);
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
            for (at, &action) in sample.actions.iter().enumerate() {
                assert_eq!(usize::from(action), seen[at / 2 % 4] * 30 + at / 8 * 10 + at % 2);
            }
            // The first two have been forgotten.
            seen.sort_unstable();
            assert_eq!(seen, [2, 3, 4, 5]);
        }
    }

    #[test]
    fn short_episodes_are_remembered_as_far_as_they_went() {
        let mut replay = Replay::new(2, 3, 2, 2);
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
        let mut replay = Replay::new(4, 3, 2, 2);
        replay.push(0, &batch(0), 0);
        replay.push(1, &batch(0), 1);
        let mut other = Replay::new(4, 3, 2, 2);
        let actions = || replay.actions().to_vec();
        assert!(other.restore(replay.episodes(), Some(replay.lengths().to_vec()), actions()));
        for lengths in [vec![3], vec![3, 4], vec![0, 3]] {
            assert!(!other.restore(replay.episodes(), Some(lengths), actions()));
        }
        assert!(!other.restore(replay.episodes(), None, Vec::new()), "agents did something");
        assert_eq!(other.lengths(), [3, 3]);
        // As long as no episode could end early, no lengths were kept.
        assert!(other.restore(replay.episodes(), None, actions()));
        assert_eq!(other.lengths(), [3, 3]);
        let [found, expected] = [&mut other, &mut replay].map(|replay| {
            let sample = replay.sample(1, 2, 1, 2)[0];
            (sample.joint.to_vec(), sample.actions.to_vec())
        });
        assert_eq!(found, expected);
        let mut blind = Replay::new(4, 3, 2, 0);
        assert!(!blind.restore(&[0.0; 7], None, Vec::new()));
        assert!(!blind.restore(&[0.0; 30], None, Vec::new()));
        assert!(blind.restore(&[0.0; 24], None, Vec::new()));
    }
}
