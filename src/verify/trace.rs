//! Recorded agents: joint estimates and logits from the recorded observations and deliveries; of a compact trace, whether the
//! same actions come of them.

use std::path::Path;

use super::{Comparison, Deviations};
use crate::agent::PolicySource;
use crate::base::error::{Error, Result};
use crate::recording::{Episode, Reader, Rerun};

/// Largest deviation of a joint estimate or logit: networks in f32 that add in another order.
const LARGEST: f64 = 1e-4;

/// Their median deviation.
const MEDIAN: f64 = 1e-5;

/// Share of actions that may differ: where two are as probable, the order of a sum decides.
const ACTIONS: f64 = 1e-3;

/// The agents of a trace, and how far they are from what was recorded.
pub(super) struct Agents {
    team: Rerun,
    /// Discrete actions of each agent.
    available: Vec<usize>,
    estimates: Deviations,
    logits: Deviations,
    /// 1 where another action comes out than was recorded, of compact traces.
    actions: Deviations,
    is_compact: bool,
    /// Decisions that cannot be made again.
    left_out: usize,
}

impl Agents {
    /// The agents of the trace in `file`.
    pub(super) fn of(file: &Path, trace: &Reader, source: Option<&PolicySource>) -> Result<Agents> {
        let team = Rerun::new(file, &trace.header, source)?;
        let available =
            (0..team.spec().n_agents()).map(|agent| team.spec().available_actions(agent)).collect();
        Ok(Agents {
            team,
            available,
            estimates: Deviations::with_median(),
            logits: Deviations::with_median(),
            actions: Deviations::default(),
            is_compact: trace.is_compact(),
            left_out: 0,
        })
    }

    /// Compares an episode, the so-manieth of the file.
    pub(super) fn compare(&mut self, file: &Path, number: usize, episode: &Episode) -> Result<()> {
        let failed = |what| Error::io("verify", file, format!("episode {number}: {what}"));
        let Agents { team, available, estimates, logits, actions, is_compact, left_out } = self;
        if !*is_compact {
            check_lengths(episode, team.spec().joint_dim()).map_err(failed)?;
        }
        let played = team.play(episode, |step, agent| {
            let index = agent.index();
            if *is_compact {
                let done = episode.actions[step][index].words(1);
                actions.at(number, step).add(f64::from(u8::from(agent.actions() != done)), 0.0);
                return;
            }
            estimates.at(number, step).add_all(agent.estimates(), &episode.joint_estimate[step][index]);
            logits
                .at(number, step)
                .add_all(&agent.logits()[..available[index]], &episode.logits[step][index]);
        });
        *left_out += played.map_err(failed)?;
        Ok(())
    }

    /// What was compared, and how many decisions could not be made again.
    pub(super) fn compared(&self, file: &Path) -> (Vec<Comparison>, usize) {
        let comparisons = if self.is_compact {
            vec![self.actions.mean(file, "actions, share that differs", ACTIONS)]
        } else {
            vec![
                self.estimates.largest(file, "joint estimates", LARGEST),
                self.estimates.median(file, "joint estimates, median", MEDIAN),
                self.logits.largest(file, "logits", LARGEST),
                self.logits.median(file, "logits, median", MEDIAN),
            ]
        };
        (comparisons, self.left_out)
    }
}

fn check_lengths(episode: &Episode, joint: usize) -> std::result::Result<(), String> {
    let steps = episode.joint_estimate.iter().enumerate();
    let mut all = steps.flat_map(|(step, agents)| agents.iter().enumerate().map(move |of| (step, of)));
    let wrong = all.find(|(step, (agent, estimate))| {
        let expected = if episode.presence(*step, *agent).decided() { joint } else { 0 };
        estimate.len() != expected
    });
    match wrong {
        None => Ok(()),
        Some((step, (agent, estimate))) => Err(format!(
            "the joint estimate of agent {agent} at step {step} has {} values: they have {joint}, or none where the agent \
             did not decide",
            estimate.len()
        )),
    }
}
