//! What is counted while episodes are played.

use std::time::Duration;

use crate::base::distribution::Distribution;
use crate::base::rng::MAX_AGENTS;
use crate::base::stats::Running;

/// One finished episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EpisodeStatistics {
    /// Undiscounted sum of the team rewards.
    pub episode_return: f64,
    /// Observations delivered, over i != j and t >= 1.
    pub delivered: u64,
    /// Those of them that links had postponed.
    pub delayed: u64,
    /// Observations that arrived after a newer one from the same sender, at t >= 1, and so were not passed on.
    pub outdated: u64,
    /// Observations that were new to their receiver and came through others than their sender, at t >= 1. There are none
    /// where nobody relays.
    pub relayed: u64,
    /// Observations sent, over i != j and t >= 1, by agents that were there to agents that decided in time.
    pub sent: u64,
    /// Observations that the links delivered but the agents did not have when they decided, over i != j and t >= 1.
    /// There are none in lockstep.
    pub late: u64,
    /// Decisions that were due.
    pub due: u64,
    /// Decisions that were not made in time, by agents that were there. There are none in lockstep.
    pub missed: u64,
    /// Decisions that were not made because the agent was not there: it had died, hung or was stopped.
    pub absent: u64,
    /// Sum of the squared errors of all imputed values.
    pub squared_error: f64,
    /// Imputed values.
    pub imputed: u64,
}

/// What was counted of all episodes of a session.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    /// In the order of their numbers, unless it forgets them.
    episodes: Vec<EpisodeStatistics>,
    forgets: bool,
    returns: Running,
    /// Sums over the episodes, in their order.
    total: EpisodeStatistics,
    /// By sender, of all ticks. For any team, so that no tick allocates.
    late: Late,
    tick_times: Distribution,
    elapsed: Duration,
}

/// Observations that were late, by sender.
#[derive(Clone, Debug)]
struct Late([u64; MAX_AGENTS]);

impl Default for Late {
    fn default() -> Late {
        Late([0; MAX_AGENTS])
    }
}

impl Statistics {
    /// Statistics that do not grow: they forget the single episodes.
    pub(super) fn forgetful() -> Statistics {
        Statistics { forgets: true, ..Statistics::default() }
    }

    pub(super) fn push_episode(&mut self, episode: EpisodeStatistics) {
        let total = &mut self.total;
        total.episode_return += episode.episode_return;
        total.delivered += episode.delivered;
        total.sent += episode.sent;
        total.delayed += episode.delayed;
        total.outdated += episode.outdated;
        total.relayed += episode.relayed;
        total.late += episode.late;
        total.due += episode.due;
        total.missed += episode.missed;
        total.absent += episode.absent;
        total.squared_error += episode.squared_error;
        total.imputed += episode.imputed;
        self.returns.push(episode.episode_return);
        if !self.forgets {
            self.episodes.push(episode);
        }
    }

    /// Notes that an observation was late.
    pub(super) fn push_late(&mut self, sender: usize) {
        self.late.0[sender] += 1;
    }

    pub(super) fn push_tick(&mut self, time: Duration) {
        self.tick_times.record(time.as_nanos() as u64);
    }

    pub(super) fn set_elapsed(&mut self, elapsed: Duration) {
        self.elapsed = elapsed;
    }

    /// How many episodes were played.
    pub fn finished(&self) -> u64 {
        self.returns.count()
    }

    /// The episodes: none in the summary of a command, which does not keep them.
    pub fn episodes(&self) -> &[EpisodeStatistics] {
        &self.episodes
    }

    /// Mean return; NaN before the first episode.
    pub fn return_mean(&self) -> f64 {
        self.total.episode_return / self.finished() as f64
    }

    /// Half the width of the 95 % confidence interval of the mean return.
    pub fn return_ci95(&self) -> Option<f64> {
        self.returns.ci95()
    }

    /// Realised share of observations that were delivered, over i != j and t >= 1; `None` for a team
    /// of one.
    pub fn delivery_rate(&self) -> Option<f64> {
        let EpisodeStatistics { delivered, sent, .. } = self.total;
        (sent > 0).then(|| delivered as f64 / sent as f64)
    }

    /// Share of observations that were delivered after links had postponed them, over i != j and t >= 1; `None` for a
    /// team of one.
    pub fn delayed_rate(&self) -> Option<f64> {
        let EpisodeStatistics { delayed, sent, .. } = self.total;
        (sent > 0).then(|| delayed as f64 / sent as f64)
    }

    /// Share of observations that arrived after a newer one from the same sender, over i != j and t >= 1; `None` for a
    /// team of one.
    pub fn outdated_rate(&self) -> Option<f64> {
        let EpisodeStatistics { outdated, sent, .. } = self.total;
        (sent > 0).then(|| outdated as f64 / sent as f64)
    }

    /// Observations that were new to their receiver and came through others than their sender, as a share of all sent, over
    /// i != j and t >= 1; `None` for a team of one.
    pub fn relayed_rate(&self) -> Option<f64> {
        let EpisodeStatistics { relayed, sent, .. } = self.total;
        (sent > 0).then(|| relayed as f64 / sent as f64)
    }

    /// Share of observations that the links dropped, over i != j and t >= 1; `None` for a team of one. What was under
    /// way when an episode ended is dropped.
    pub fn dropped_rate(&self) -> Option<f64> {
        let EpisodeStatistics { delivered, outdated, late, sent, .. } = self.total;
        (sent > 0).then(|| sent.saturating_sub(delivered + outdated + late) as f64 / sent as f64)
    }

    /// Share of observations that were late, over i != j and t >= 1; `None` for a team of one.
    pub fn late_rate(&self) -> Option<f64> {
        let EpisodeStatistics { late, sent, .. } = self.total;
        (sent > 0).then(|| late as f64 / sent as f64)
    }

    /// Observations of an agent that were late, over i != j and t >= 1: of all ticks, also those of an episode that was not
    /// finished.
    pub fn late_from(&self, sender: usize) -> u64 {
        self.late.0[sender]
    }

    /// Decisions that were not made in time, and all that were due.
    pub fn missed_of_due(&self) -> (u64, u64) {
        (self.total.missed, self.total.due)
    }

    /// Decisions that were not made because the agent was not there.
    pub fn absent(&self) -> u64 {
        self.total.absent
    }

    /// Share of decisions that were not made in time, of those of agents that were there; NaN before the first.
    pub fn missed_rate(&self) -> f64 {
        self.total.missed as f64 / (self.total.due - self.total.absent) as f64
    }

    /// Share of decisions that were not made because the agent was not there; NaN before the first.
    pub fn absent_rate(&self) -> f64 {
        self.total.absent as f64 / self.total.due as f64
    }

    /// Root mean squared error of the imputed values, in units of the observation; `None` if nothing
    /// was imputed.
    pub fn imputation_rmse(&self) -> Option<f64> {
        let EpisodeStatistics { squared_error, imputed, .. } = self.total;
        (imputed > 0).then(|| (squared_error / imputed as f64).sqrt())
    }

    /// Ticks played.
    pub fn ticks(&self) -> u64 {
        self.tick_times.count()
    }

    /// Tick times, from the sensors sent to the last decision received.
    pub fn tick_times(&self) -> &Distribution {
        &self.tick_times
    }

    /// Time spent playing.
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }
}
