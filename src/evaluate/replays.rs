//! Episodes to see: for each imputer the best and the worst where the links deliver least, each beside the same episode
//! where they deliver everything.

use super::evaluation::Evaluation;
use super::grouping::{Alike, Played, groups};
use super::play::play_again;
use super::sweep::Sweep;
use super::{Condition, Entrant};
use crate::agent::Truth;
use crate::base::error::Result;
use crate::failed;
use crate::recording::{Episode, FORMAT_VERSION, RecordingHeader};

/// An episode of an evaluation, played again.
#[derive(Debug)]
pub struct Replay {
    /// Index into [`Summary::groups`](super::Summary::groups).
    pub group: usize,
    /// The imputer.
    pub imputer: String,
    /// The level at which it was played.
    pub p: f64,
    /// Whether it is the best of all episodes, or the worst.
    pub is_best: bool,
    /// Who played it: index into [`Evaluation::contenders`].
    pub contender: usize,
    /// Its number, as in `episodes.csv`.
    pub episode: usize,
    /// What came of it.
    pub episode_return: f64,
    /// What was played at that level, and where everything is delivered.
    pub takes: [(RecordingHeader, Episode); 2],
}

impl Replay {
    /// The name of its page, beside those of all others of an evaluation.
    pub fn file(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.()+".contains(c) { c } else { '-' };
        let task: String = self.takes[0].0.task.chars().map(plain).collect();
        let imputer: String = self.imputer.chars().map(plain).collect();
        let which = if self.is_best { "best" } else { "worst" };
        format!("{}-{task}-{imputer}-{which}.html", self.group + 1)
    }
}

/// An episode that was found.
#[derive(Clone, Copy)]
struct Found {
    episode_return: f64,
    /// Index into [`Evaluation::contenders`].
    contender: usize,
    episode: usize,
}

impl Sweep {
    /// The best and the worst episode of each group and imputer at the lowest level that was played, if one was at which
    /// something is lost. Every random draw has an address, so each is played alone, and comes out as it did.
    ///
    /// # Errors
    /// `Failed` if one does not; whatever a team fails with.
    pub fn replays(&self, evaluation: &Evaluation) -> Result<Vec<Replay>> {
        let mut replays = Vec::new();
        for (group, alike) in groups(evaluation).iter().enumerate() {
            let levels = alike.cells.iter().filter_map(|cell| cell.condition.p());
            let Some(p) = levels.filter(|p| *p < 1.0).reduce(f64::min) else { continue };
            let of_level = alike.cells.iter().filter(|cell| cell.condition.p() == Some(p));
            for cell in of_level.filter(|cell| Truth::split(cell.imputer).1.is_none()) {
                for (is_best, found) in extremes(alike, cell) {
                    let takes = self.play_again(&found, cell)?;
                    let Found { episode_return, contender, episode } = found;
                    let imputer = cell.imputer.to_owned();
                    replays.push(Replay {
                        group,
                        imputer,
                        p,
                        is_best,
                        contender,
                        episode,
                        episode_return,
                        takes,
                    });
                }
            }
        }
        Ok(replays)
    }

    /// An episode of a cell, and the same where everything is delivered.
    fn play_again(&self, found: &Found, cell: &Played) -> Result<[(RecordingHeader, Episode); 2]> {
        let (entrant, imputer) = (&self.entrants[found.contender], cell.imputer);
        let take = |condition: &Condition| -> Result<(RecordingHeader, Episode)> {
            let agents = self.agents(entrant, condition, imputer, 1);
            let mut played = play_again(&self.settings, &agents, entrant, condition, found.episode as u64)?;
            // As the tables count them.
            played.episode = Some(found.episode as u64);
            Ok((self.header(entrant, imputer), played))
        };
        let takes = [take(cell.condition)?, take(&Condition::level(1.0)?)?];
        let (before, again) = (found.episode_return, takes[0].1.episode_return);
        if before.to_bits() != again.to_bits() {
            return Err(failed!(
                "episode {} of {} with {imputer} at {} returned {before}, and {again} when it was played again: the report \
                 would show another one; remove cells.jsonl from the folder of the report, and play everything again",
                found.episode,
                entrant.contender.name,
                cell.condition
            ));
        }
        Ok(takes)
    }

    fn header(&self, entrant: &Entrant, imputer: &str) -> RecordingHeader {
        let spec = entrant.task.spec();
        RecordingHeader {
            task: spec.id.clone(),
            n_agents: spec.n_agents(),
            n_landmarks: spec.landmarks,
            episode_steps: spec.episode_steps,
            actor: None,
            imputer: Some(imputer.to_owned()),
            policy: Some(entrant.contender.name.clone()),
            seed: Some(self.settings.seed),
            greedy: Some(self.settings.greedy),
            links: None,
            relay: self.settings.relay,
            logs: Vec::new(),
            matrix: None,
            physics: self.settings.physics,
            comm_at_t0: Some(self.settings.comm_at_t0),
            rate: None,
            longest_delay: 0,
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            format_version: Some(FORMAT_VERSION),
        }
    }
}

/// The best and the worst episode of a cell, over all who played it; of equals the first.
fn extremes(alike: &Alike, cell: &Played) -> impl Iterator<Item = (bool, Found)> {
    let outcomes = alike.contenders.iter().zip(&cell.outcomes);
    let episodes = outcomes.flat_map(|(contender, outcome)| {
        let returns = outcome.iter().flat_map(|outcome| outcome.returns.iter().copied().enumerate());
        returns.map(|(episode, episode_return)| Found { episode_return, contender: *contender, episode })
    });
    let best = episodes.clone().min_by(|a, b| b.episode_return.total_cmp(&a.episode_return));
    let worst = episodes.min_by(|a, b| a.episode_return.total_cmp(&b.episode_return));
    [(true, best), (false, worst)].into_iter().filter_map(|(is_best, found)| Some((is_best, found?)))
}
