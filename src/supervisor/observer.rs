//! Observers: they look on while episodes are played.

use std::time::Duration;

use super::{Decisions, Stage};
use crate::base::error::Result;

/// Looks on while a [`Session`](super::Session) plays: a ledger, an audit, a recorder, a batch to learn from, a
/// stopwatch.
///
/// ```text
/// begin_episodes, then step by step: ticked, stepped; then last_ticked if somebody wants it, end_episodes
/// ```
///
/// An error ends the play.
pub trait Observer {
    /// An episode begins in each world of the stage.
    fn begin_episodes(&mut self, _stage: &Stage) -> Result<()> {
        Ok(())
    }

    /// The team has decided, which took `exchange` from its observations on. The worlds have not taken the step yet.
    fn ticked(&mut self, _stage: &Stage, _decisions: &Decisions, _exchange: Duration) -> Result<()> {
        Ok(())
    }

    /// The worlds have taken the step.
    fn stepped(&mut self, _stage: &Stage, _decisions: &Decisions) -> Result<()> {
        Ok(())
    }

    /// Whether to give the team the observations after the last step as well. What it then decides is not carried out.
    fn wants_last_tick(&self) -> bool {
        false
    }

    /// The team has decided after the last step.
    fn last_ticked(&mut self, _stage: &Stage, _decisions: &Decisions) -> Result<()> {
        Ok(())
    }

    /// The episodes are over, and the observations of the stage are those after the last step.
    fn end_episodes(&mut self, _stage: &Stage) -> Result<()> {
        Ok(())
    }

    /// Whether to end the play before the next tick, even if episodes are unfinished.
    fn has_seen_enough(&self) -> bool {
        false
    }
}
