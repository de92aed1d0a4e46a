//! The imputer: completes what was received to an estimate of the joint observation.
//!
//! One file per imputer and one line each in the [`Registry`], which is where a name becomes one.

mod actors;
mod carried;
mod dynamics;
mod hold;
mod imagined;
mod law;
mod layout;
mod motion;
mod particles;
mod past;
mod predictor;
mod registry;
mod slopes;
mod teammates;
mod velocity;
mod zero;

pub use carried::Carried;
pub use layout::JointLayout;
pub use registry::{PREFERRED, Registry};

use super::Inbox;
use crate::environment::Spec;
use crate::nn::Policy;

/// One agent's imputer, with its memory in each parallel world.
///
/// ```text
/// begin_episodes, then step by step: fuse in each world, predict, and revise if something else was carried out
/// ```
///
/// Nothing of it may allocate once an episode of as many worlds has been played, and no world's result may depend on
/// what other worlds there are.
pub trait Imputer: std::fmt::Debug + Send {
    /// Forgets everything: an episode starts in each of so many worlds.
    fn begin_episodes(&mut self, worlds: usize);

    /// Writes the joint estimate of one world, in the order of a [`JointLayout`]: what the agent itself observes
    /// (`own`) and what it is just told of others as it is, its best guess for the rest. [`Carried::fuse`] does that for a
    /// guess that is carried from step to step; what is made of observations that [arrive late](Carried::late) is left
    /// to each imputer.
    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]);

    /// Guesses what the next step will bring. The action is already out, so this may take longer than `fuse`.
    fn predict(&mut self, step: &Step);

    /// What the last `predict` was told of actions is not what was carried out; this is. Whoever looks at actions
    /// takes that call back and does it again.
    fn revise(&mut self, _step: &Step) {}

    /// Takes new weights: of all those of the policy, in the order of its tensors, a copy of its own.
    fn renew(&mut self, _weights: &[f32]) {}

    /// How many multiply-adds its networks take in a step of one world.
    fn multiply_adds(&self) -> usize {
        0
    }
}

/// What an imputer is made for.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// The environment.
    pub spec: &'a Spec,
    /// The policy, which may have predictors.
    pub policy: &'a Policy,
    /// Whose imputer it is.
    pub agent: usize,
    /// The most parallel worlds.
    pub worlds: usize,
    /// The most ticks ago that an observation which arrives may have been made.
    pub longest_delay: u8,
    /// The seed of all draws, which are addressed by the episode and step of a [`Step`].
    pub seed: u64,
    /// Whether the team takes the most probable actions instead of sampling.
    pub greedy: bool,
}

#[cfg(test)]
impl<'a> Setup<'a> {
    /// One world, links that postpone nothing, sampled actions.
    fn of(spec: &'a Spec, policy: &'a Policy, agent: usize) -> Setup<'a> {
        Setup { spec, policy, agent, worlds: 1, longest_delay: 0, seed: 0, greedy: false }
    }
}

/// What an agent made of a step, in each world.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Episode of world 0; world w plays episode + w.
    pub episode: u64,
    /// Step within the episode.
    pub step: u32,
    /// The joint estimates it acted on, `[worlds, joint]`.
    pub estimates: &'a [f32],
    /// Its own actions, `[worlds]`.
    pub actions: &'a [u32],
}

impl<'a> Step<'a> {
    /// What was made of the step at `moment`, by episode and step, with room for more worlds behind the estimates.
    pub(super) fn of(moment: (u64, u32), estimates: &'a [f32], joint: usize, actions: &'a [u32]) -> Step<'a> {
        let (episode, step) = moment;
        Step { episode, step, estimates: &estimates[..actions.len() * joint], actions }
    }
}
