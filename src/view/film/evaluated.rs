//! The page of an episode that an evaluation found.

use super::{Film, page};
use crate::base::error::Result;
use crate::evaluate::Replay;

/// The page that plays it, beside the same episode where everything is delivered.
pub(crate) fn evaluated(replay: &Replay) -> Result<String> {
    let which = if replay.is_best { "best" } else { "worst" };
    let names = [format!("{} of {}", which, replay.imputer), "the same episode at p = 1".to_owned()];
    let films = names.into_iter().zip(&replay.takes).map(|(name, (header, episode))| {
        let mut film = Film::of(name, header.clone())?;
        film.push(0, episode)?;
        Ok(film)
    });
    Ok(page(&films.collect::<Result<Vec<_>>>()?, 0))
}
