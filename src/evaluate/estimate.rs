//! From an evaluation to its summary.

use super::aggregate::aggregates;
use super::bootstrap::Stratum;
use super::claims::Scope;
use super::evaluation::Evaluation;
use super::grouping::groups;
use super::study::Study;
use super::summary::{Claims, Summary};
use crate::base::error::Result;

impl Summary {
    /// The statistics of an evaluation. Imputers of a group are compared with the first of `baselines` that
    /// all of it was played with. Computed on so many threads, which makes no difference to them.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop.
    pub fn of(evaluation: &Evaluation, baselines: &[&str], threads: usize) -> Result<Summary> {
        let Evaluation { settings, axes, contenders, .. } = evaluation;
        let episodes = Stratum::episodes(settings.episodes as usize);
        let study = |group| Study::new(group, baselines, settings.seed, episodes, threads);
        let studies: Vec<Study> = groups(evaluation).into_iter().map(study).collect::<Result<_>>()?;
        let mut summary = Summary {
            settings: settings.clone(),
            contenders: contenders.clone(),
            axes: axes.clone(),
            groups: studies.iter().map(|study| study.summary(axes)).collect(),
            aggregates: aggregates(&studies, settings.seed, threads)?,
            claims: Vec::new(),
        };
        summary.claims = Claims::of(&summary, &Scope::default());
        Ok(summary)
    }
}
