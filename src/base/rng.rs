//! Addressed randomness: a draw is found by *what it is for*, never by how many came before it.
//!
//! Every draw has the address (seed, purpose, episode, step, receiver, sender). ChaCha8 is a counter
//! mode cipher, so any address is reached without computing the ones before it: seed, purpose and
//! episode form the key, together with a part where several draw for one purpose; the step is the stream,
//! and receiver and sender are a position in the stream. Two runs that agree on the address agree on the
//! draw, whatever else they did.

use std::f64::consts::TAU;

use glam::{DVec2, dvec2};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The most agents a swarm can have: a row of the communication matrix is one `u64`.
pub const MAX_AGENTS: usize = 64;

/// What a draw decides. The discriminants are part of the address and must not change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Where an episode starts.
    Reset = 1,
    /// The level p of an episode (mode `uniform`).
    Level = 2,
    /// The communication matrix (modes `asymmetric` and `dynamic`).
    Matrix = 3,
    /// Whether one observation is delivered.
    Link = 4,
    /// Which action is sampled from the policy.
    Action = 5,
    /// The initial weights of a network; the "episode" is the tensor's number.
    Weights = 6,
    /// Which remembered episodes a predictor learns from; the "episode" is the update, the "step" the
    /// predictor's step in it.
    Replay = 7,
    /// Which episodes a bootstrap resample consists of; the "episode" is the stratum, the "step" the resample.
    Bootstrap = 8,
    /// How many ticks one observation takes.
    Delay = 9,
    /// How far a motor's force is off.
    Motor = 10,
    /// What an agent imagines a teammate to do.
    Imagination = 11,
    /// Which agents are killed or stopped on purpose.
    Chaos = 12,
    /// Whether one observation is lost in the state that its link is in.
    Loss = 13,
    /// How far the power that one observation is received with is off.
    Fading = 14,
    /// Where in a log of a radio an episode begins.
    Log = 15,
    /// How the wind changes.
    Wind = 16,
    /// Where somebody who is not of the team turns.
    Turn = 17,
}

/// The draws of one (seed, purpose, episode, step).
#[derive(Clone, Debug)]
pub struct Draws(ChaCha8Rng);

impl Draws {
    /// The draws at this address, positioned at receiver 0 and sender 0.
    pub fn new(seed: u64, purpose: Purpose, episode: u64, step: u64) -> Draws {
        Draws::of_part(0, seed, purpose, episode, step)
    }

    /// The same for part `part` of several that draw for one purpose, such as links in a chain. Part 0 has the draws of
    /// [`Draws::new`].
    pub(crate) fn of_part(part: u64, seed: u64, purpose: Purpose, episode: u64, step: u64) -> Draws {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&(purpose as u64).to_le_bytes());
        key[16..24].copy_from_slice(&episode.to_le_bytes());
        key[24..].copy_from_slice(&part.to_le_bytes());
        let mut rng = ChaCha8Rng::from_seed(key);
        rng.set_stream(step);
        Draws(rng)
    }

    /// Moves to the draw of (receiver, sender); the draws after it are those of the following senders.
    pub fn at(&mut self, receiver: usize, sender: usize) -> &mut Draws {
        const WORDS_PER_DRAW: u128 = 2;
        self.0.set_word_pos((receiver * MAX_AGENTS + sender) as u128 * WORDS_PER_DRAW);
        self
    }

    /// The next draw, uniform on `[0, 1)` with 53 random bits.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// The next draw, uniform on `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// The next two draws make two normal ones, independent, of mean 0 and standard deviation 1, after Box and Muller.
    pub fn normal(&mut self) -> DVec2 {
        // Never the logarithm of 0.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (sin, cos) = (TAU * self.uniform()).sin_cos();
        radius * dvec2(cos, sin)
    }

    /// The next draw, uniform over `0..n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_draw_depends_on_its_address_only() {
        let mut in_order = Draws::new(7, Purpose::Link, 3, 5);
        let row: Vec<f64> = (0..MAX_AGENTS).map(|_| in_order.at(2, 0).uniform()).collect();
        assert!(row.iter().all(|&u| u == row[0]));
        let mut walk = Draws::new(7, Purpose::Link, 3, 5);
        walk.at(2, 0);
        let walked: Vec<f64> = (0..4).map(|_| walk.uniform()).collect();
        for sender in (0..4).rev() {
            let direct = Draws::new(7, Purpose::Link, 3, 5).at(2, sender).uniform();
            assert_eq!(direct, walked[sender]);
        }
    }

    #[test]
    fn every_part_of_the_address_matters() {
        let draw = |seed, purpose, episode, step, receiver, sender| {
            Draws::new(seed, purpose, episode, step).at(receiver, sender).uniform()
        };
        let base = draw(1, Purpose::Link, 1, 1, 1, 1);
        for other in [
            draw(2, Purpose::Link, 1, 1, 1, 1),
            draw(1, Purpose::Action, 1, 1, 1, 1),
            draw(1, Purpose::Link, 2, 1, 1, 1),
            draw(1, Purpose::Link, 1, 2, 1, 1),
            draw(1, Purpose::Link, 1, 1, 2, 1),
            draw(1, Purpose::Link, 1, 1, 1, 2),
            Draws::of_part(1, 1, Purpose::Link, 1, 1).at(1, 1).uniform(),
        ] {
            assert_ne!(base, other);
        }
        assert_eq!(base, Draws::of_part(0, 1, Purpose::Link, 1, 1).at(1, 1).uniform());
    }

    #[test]
    fn draws_cover_their_range_evenly() {
        let mut draws = Draws::new(0, Purpose::Reset, 0, 0);
        let n = 100_000;
        let mean = (0..n).map(|_| draws.between(-1.0, 1.0)).sum::<f64>() / n as f64;
        // Standard error of the mean is 1/sqrt(3 n) = 0.0018.
        assert!(mean.abs() < 0.01, "mean {mean}");
        let mut seen = [0usize; 3];
        (0..n).for_each(|_| seen[draws.below(3)] += 1);
        assert!(seen.iter().all(|&s| s.abs_diff(n / 3) < n / 50), "{seen:?}");
    }
}
