//! Scores over tasks.

use super::bootstrap::{Bootstrap, Stratum};
use super::condition::Condition;
use super::grouping::distinct;
use super::study::Study;
use super::summary::Aggregate;
use super::weighted::{Ordered, weighted_mean};
use crate::base::error::Result;
use crate::base::stats::mean;

/// One per label, condition and imputer with scores in at least two tasks.
pub(super) fn aggregates(studies: &[Study], seed: u64, threads: usize) -> Result<Vec<Aggregate>> {
    let tasks = distinct(studies.iter().map(|study| study.group.task));
    let kinds = distinct(studies.iter().flat_map(|study| {
        study.group.cells.iter().map(|cell| (&study.group.label[..], cell.condition, cell.imputer))
    }));
    let aggregate = |kind: &(&str, &Condition, &str)| aggregate(studies, &tasks, *kind, seed, threads);
    kinds.iter().filter_map(|kind| aggregate(kind).transpose()).collect()
}

fn aggregate(
    studies: &[Study],
    tasks: &[&str],
    (label, condition, imputer): (&str, &Condition, &str),
    seed: u64,
    threads: usize,
) -> Result<Option<Aggregate>> {
    let (mut played, mut strata, mut scores) = (Vec::new(), Vec::new(), Vec::new());
    for study in studies.iter().filter(|study| study.group.label == label) {
        let cell = study.group.find(imputer, condition);
        let Some(runs) = cell.and_then(|cell| study.scores(cell)) else { continue };
        let task = tasks.iter().position(|task| *task == study.group.task);
        strata.push(Stratum::runs(task.expect("the group's task is one of all"), runs.len()));
        played.push(study.group.task.to_owned());
        scores.extend(runs);
    }
    if played.len() < 2 {
        return Ok(None);
    }
    let ordered = Ordered::new(scores.iter().copied().enumerate());
    let mean_of_tasks = |counts: &[f64]| {
        let mut first = 0;
        let means = strata.iter().map(|stratum| {
            let runs = first..first + stratum.len;
            first = runs.end;
            weighted_mean(&scores[runs.clone()], &counts[runs])
        });
        mean(&means.collect::<Vec<_>>())
    };
    let look = |counts: &[f64]| (mean_of_tasks(counts), ordered.iqm(counts));
    let bootstrap = Bootstrap::new(seed, &strata, threads, look)?;
    Ok(Some(Aggregate {
        label: label.to_owned(),
        condition: condition.clone(),
        imputer: imputer.to_owned(),
        tasks: played,
        runs: scores.len(),
        mean: bootstrap.interval(|(mean, _)| *mean),
        iqm: bootstrap.interval(|(_, iqm)| *iqm),
    }))
}
