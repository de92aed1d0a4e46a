//! Links: which observations reach whom, and when.
//!
//! A [`Link`] decides over everything that is sent at one step in one world. Its draws are addressed by the seed, the
//! episode, the step, the receiver and the sender, so fates can be reproduced from the seed alone. The supervisor asks
//! it, and tells each agent only what arrives at that agent.
//!
//! Each model has one file and one line in the registry, from which [`LinkSpec`] reads
//! `gilbert(0.1, 0.3) + level(0.9)`. Links of your own need no such line: [`Links::chain`] takes any.

mod asymmetric;
mod budget;
mod delay;
mod fates;
mod gemodel;
mod gilbert;
mod jam;
mod latency;
mod level;
mod links;
mod matrix;
mod netem;
mod network;
mod part;
mod range;
mod registry;
mod spec;
mod tdma;
mod trace;
mod uniform;

use glam::DVec2;

pub use asymmetric::Asymmetric;
pub use budget::Budget;
pub use delay::Delay;
pub use fates::Fates;
pub use gemodel::Gemodel;
pub use gilbert::Gilbert;
pub use jam::Jam;
pub use latency::Latency;
pub use level::Level;
pub(crate) use level::complement;
pub(crate) use links::longest_age;
pub use links::{LONGEST_DELAY, Links};
pub use matrix::{CommunicationMatrix, Matrix};
pub use range::Range;
#[cfg(feature = "cli")]
pub(crate) use registry::help;
use registry::{Domain, Model, Parameter};
pub use spec::{LinkSpec, Site};
pub use tdma::Tdma;
pub use trace::{RadioLog, Trace};
pub use uniform::Uniform;

use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::usage;

/// A model of links.
///
/// It may keep a state in each world. It is asked at every step of an episode, in order. Its answers must follow from
/// the address and the episode alone, not from what other worlds do.
pub trait Link: std::fmt::Debug + Send {
    /// An episode begins in this world: forget the last one there.
    fn begin(&mut self, _world: usize, _episode: u64) {}

    /// Loses and postpones what is sent at this step in this world.
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()>;

    /// The most ticks by which it postpones anything. Messages are kept for so long.
    fn longest_delay(&self) -> u8 {
        0
    }

    /// The one probability p with which every link delivers in the episode at this address, if there is one: it is
    /// written into recordings.
    fn level(&self, _address: &Address) -> Option<f64> {
        None
    }

    /// The probability of delivery, if it is one for all links that may be changed between steps: somebody watches, and
    /// turns it.
    fn dial(&mut self) -> Option<&mut f64> {
        None
    }
}

/// Where the draws of a link are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// Seed of all draws.
    pub seed: u64,
    /// The link's position in its chain.
    pub position: u64,
    /// Number of the episode.
    pub episode: u64,
    /// Step within the episode.
    pub step: u64,
}

impl Address {
    /// The draws for a purpose, by receiver and sender.
    pub fn draws(&self, purpose: Purpose) -> Draws {
        Draws::of_part(self.position, self.seed, purpose, self.episode, self.step)
    }

    /// The address of another step of the episode.
    pub(crate) fn at_step(self, step: u64) -> Address {
        Address { step, ..self }
    }
}

/// What a link may know of the step it decides over.
#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    /// Where its draws are.
    pub address: Address,
    /// The world, counted from 0 among those that are played side by side.
    pub world: usize,
    /// Bytes of one message: an observation, and where agents relay what else it carries.
    pub bytes: usize,
    /// Where the agents are, where the environment has places.
    pub positions: Option<&'a [DVec2]>,
}

impl<'a> Context<'a> {
    /// Where the agents are, for a link that cannot do without.
    ///
    /// # Errors
    /// `Usage` if the environment has no places.
    pub fn places(&self) -> Result<&'a [DVec2]> {
        self.positions.ok_or_else(|| {
            usage!(
                "these links depend on where the agents are, but this environment has no places; take links \
                 without distances, such as level(0.5)"
            )
        })
    }
}

#[cfg(test)]
mod testing;
