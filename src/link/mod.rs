//! Links: who receives whom, and with what probability.
//!
//! A link model turns an address (episode, step) into one row per receiver: bit `j` of row `i` says
//! that agent `i` receives agent `j`. The supervisor computes the rows and sends each agent its own,
//! so that masks can be reproduced from the seed alone and no agent learns of other links.

mod matrix;

pub use matrix::CommunicationMatrix;

use crate::base::rng::{Draws, Purpose};

/// In mode `dynamic` the matrix holds for this many steps: t = 1-5, 6-10, ..
pub const DYNAMIC_PERIOD: u64 = 5;

/// How delivery probabilities come about, see "Modes" in the method's evaluation protocol.
#[derive(Clone, Debug, PartialEq)]
pub enum Links {
    /// Every link delivers with this probability p.
    Level(f64),
    /// A fixed communication matrix C, `C[i][j]` the probability that i receives j.
    Matrix(CommunicationMatrix),
    /// One p ~ U(0, 1) per episode, the same for every link.
    Uniform,
    /// A matrix with entries ~ U(0, 1) per episode.
    Asymmetric,
    /// The matrix of `Asymmetric`, redrawn every [`DYNAMIC_PERIOD`] steps.
    Dynamic,
}

/// 1 - p without the noise of the subtraction, so that a drop of 0.8 is a p of 0.2 and no neighbour of it.
pub fn complement(p: f64) -> f64 {
    const DIGITS: f64 = 1e12;
    ((1.0 - p) * DIGITS).round() / DIGITS
}

impl Links {
    /// The name of the mode.
    pub fn name(&self) -> &'static str {
        match self {
            Links::Level(_) => "level",
            Links::Matrix(_) => "matrix",
            Links::Uniform => "uniform",
            Links::Asymmetric => "asymmetric",
            Links::Dynamic => "dynamic",
        }
    }

    /// The fixed matrix, row by row, where there is one.
    pub fn matrix(&self) -> Option<Vec<Vec<f64>>> {
        match self {
            Links::Matrix(matrix) => Some(matrix.rows().map(<[f64]>::to_vec).collect()),
            _ => None,
        }
    }
}

/// Decides which observations are delivered, by addressed draws.
///
/// A link is up if and only if `U < p` with `U` drawn at (seed, episode, step, receiver, sender). The
/// draw does not depend on p or on the mode, so masks are nested: what is delivered at p is delivered
/// at every higher p, and two methods can be compared on equal masks.
#[derive(Clone, Debug)]
pub struct LinkModel {
    links: Links,
    seed: u64,
    share_at_start: bool,
}

impl LinkModel {
    /// A model of `links` with draws from `seed`. With `share_at_start` everything is delivered at
    /// t = 0 (the paper's `comm_at_t0`).
    pub fn new(links: Links, seed: u64, share_at_start: bool) -> LinkModel {
        LinkModel { links, seed, share_at_start }
    }

    /// Whether every observation is delivered, always.
    pub fn is_lossless(&self) -> bool {
        self.links == Links::Level(1.0)
    }

    /// The rows of the team at (episode, step): bit j of `rows[i]` is set if i receives j. Every agent
    /// has its own observation, so bit i of `rows[i]` is always set.
    pub fn rows(&self, episode: u64, step: u64, rows: &mut [u64]) {
        if step == 0 && self.share_at_start {
            rows.fill(u64::MAX >> (u64::BITS - rows.len() as u32));
            return;
        }
        let agents = rows.len();
        let level = self.level(episode);
        let mut link = Draws::new(self.seed, Purpose::Link, episode, step);
        let mut entry = Draws::new(self.seed, Purpose::Matrix, episode, self.redraw(step));
        for (receiver, row) in rows.iter_mut().enumerate() {
            *row = 1 << receiver;
            link.at(receiver, 0);
            if level.is_none() {
                entry.at(receiver, 0);
            }
            for sender in 0..agents {
                let p = match (&self.links, level) {
                    (_, Some(level)) => level,
                    (Links::Matrix(matrix), _) => matrix.p(receiver, sender),
                    _ => entry.uniform(),
                };
                if link.uniform() < p {
                    *row |= 1 << sender;
                }
            }
        }
    }

    /// The p that all links share in this episode, if they do.
    pub fn level(&self, episode: u64) -> Option<f64> {
        match self.links {
            Links::Level(p) => Some(p),
            Links::Uniform => Some(Draws::new(self.seed, Purpose::Level, episode, 0).uniform()),
            _ => None,
        }
    }

    /// How often the matrix has been redrawn at this step.
    fn redraw(&self, step: u64) -> u64 {
        match self.links {
            Links::Dynamic => step.saturating_sub(1) / DYNAMIC_PERIOD,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEPS: u64 = 25;

    fn rows(links: &Links, episode: u64, step: u64, agents: usize) -> Vec<u64> {
        let mut rows = vec![0; agents];
        LinkModel::new(links.clone(), 11, true).rows(episode, step, &mut rows);
        rows
    }

    /// Counts deliveries over i != j and t >= 1 and holds them to a five-sigma binomial bound.
    fn check_rate(links: &Links, expected: f64) {
        let (agents, episodes) = (4, 400);
        let mut delivered = 0u32;
        let mut total = 0u32;
        for episode in 0..episodes {
            for step in 1..STEPS {
                for (i, row) in rows(links, episode, step, agents).into_iter().enumerate() {
                    delivered += (row & !(1 << i)).count_ones();
                    total += agents as u32 - 1;
                }
            }
        }
        let rate = f64::from(delivered) / f64::from(total);
        let sigma = (expected * (1.0 - expected) / f64::from(total)).sqrt();
        assert!((rate - expected).abs() <= 5.0 * sigma, "{links:?}: {rate} is not {expected}");
    }

    #[test]
    fn a_drop_is_the_p_it_means() {
        assert_eq!([0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0].map(complement), [1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.0]);
    }

    #[test]
    fn realised_rates_are_the_level() {
        for p in [0.0, 0.2, 0.5, 0.8, 1.0] {
            check_rate(&Links::Level(p), p);
        }
    }

    #[test]
    fn realised_rates_follow_the_matrix() {
        let text = "1 0.9 0\n0.1 1 0.5\n1 0.3 1\n";
        let matrix = CommunicationMatrix::parse(text, 3).unwrap();
        let (mut delivered, n) = ([[0u32; 3]; 3], 400 * 24);
        for episode in 0..400 {
            for step in 1..STEPS {
                for (i, row) in rows(&Links::Matrix(matrix.clone()), episode, step, 3).iter().enumerate() {
                    (0..3).for_each(|j| delivered[i][j] += (row >> j & 1) as u32);
                }
            }
        }
        for (i, row) in delivered.iter().enumerate() {
            for (j, count) in row.iter().enumerate() {
                let (p, rate) = (matrix.p(i, j), f64::from(*count) / f64::from(n));
                let sigma = (p * (1.0 - p) / f64::from(n)).sqrt();
                assert!((rate - p).abs() <= 5.0 * sigma, "C[{i}][{j}] = {p}, realised {rate}");
            }
        }
    }

    #[test]
    fn masks_are_nested_across_p() {
        let levels = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
        for episode in 0..20 {
            for step in 0..STEPS {
                for pair in levels.windows(2) {
                    let low = rows(&Links::Level(pair[0]), episode, step, 12);
                    let high = rows(&Links::Level(pair[1]), episode, step, 12);
                    assert!(low.iter().zip(&high).all(|(l, h)| l & !h == 0));
                }
            }
        }
    }

    #[test]
    fn masks_do_not_depend_on_call_order_or_team_size() {
        let links = Links::Dynamic;
        let forward: Vec<_> = (0..STEPS).map(|t| rows(&links, 3, t, 6)).collect();
        let backward: Vec<_> = (0..STEPS).rev().map(|t| rows(&links, 3, t, 6)).collect();
        assert!(forward.iter().eq(backward.iter().rev()));
        for (t, large) in forward.iter().enumerate().skip(1) {
            let small = rows(&links, 3, t as u64, 4);
            assert!(small.iter().zip(large).all(|(s, l)| *s == l & 0b1111));
        }
    }

    #[test]
    fn modes_redraw_when_they_should() {
        let uniform = LinkModel::new(Links::Uniform, 5, true);
        let levels: Vec<f64> = (0..200).map(|e| uniform.level(e).unwrap()).collect();
        assert!(levels.iter().all(|p| (0.0..1.0).contains(p)));
        // Standard error of the mean of 200 uniforms is 0.02.
        assert!((levels.iter().sum::<f64>() / 200.0 - 0.5).abs() < 0.1);
        let dynamic = LinkModel::new(Links::Dynamic, 5, true);
        let redraws: Vec<u64> = [1, 5, 6, 10, 11, 24].map(|t| dynamic.redraw(t)).to_vec();
        assert_eq!(redraws, [0, 0, 1, 1, 2, 4]);
        // Entries ~ U(0, 1) deliver half of the time on average, but unevenly between links.
        for links in [Links::Asymmetric, Links::Dynamic] {
            let one_link =
                |episode| (1..STEPS).filter(|&t| rows(&links, episode, t, 2)[0] >> 1 & 1 == 1).count() as f64;
            let counts: Vec<f64> = (0..300).map(one_link).collect();
            let mean = counts.iter().sum::<f64>() / 300.0;
            let variance = counts.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 299.0;
            assert!((mean - 12.0).abs() < 2.0, "{links:?}: mean {mean}");
            // A fair coin would give 24 / 4 = 6; a p drawn per episode (or per 5 steps) gives more.
            assert!(variance > 8.0, "{links:?}: variance {variance}");
        }
    }

    #[test]
    fn sharing_at_the_start_can_be_turned_off() {
        let start = |share| {
            let mut rows = [0; 3];
            LinkModel::new(Links::Level(0.0), 0, share).rows(0, 0, &mut rows);
            rows
        };
        assert_eq!(start(true), [0b111; 3]);
        assert_eq!(start(false), [0b001, 0b010, 0b100]);
    }
}
