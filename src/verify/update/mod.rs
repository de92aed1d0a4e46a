//! Recorded updates of the paper's published code: the same batches from the same start, all the way to the
//! weights.
//!
//! `config.json` holds the hyperparameters; `update-1.safetensors`, `update-2.safetensors` and so on are one
//! sequence. Weights are taken from the first file only: from there on weights, target critics and the moments
//! of Adam are our own.

mod file;

use std::path::Path;

use self::file::{Config, UpdateFile};
use super::{Comparison, Deviations, FileKind};
use crate::agent::dims;
use crate::base::error::{Error, Result};
use crate::environment::{Spec, Task};
use crate::train::{Learner, Parameters};

/// Largest deviation of an advantage: a difference of two sums in f32 that add in another order.
const ADVANTAGES: f64 = 1e-4;

/// Largest deviation of a predictor's loss, a sum over some 250 steps in f32.
const PREDICTOR_LOSS: f64 = 1e-4;

/// Largest error of a tensor, as a part of how far it has come since the first update began.
const WEIGHTS: f64 = 1e-3;

/// Verifies the updates beside the `config.json` at `config_file`.
pub(super) fn compare(config_file: &Path) -> Result<Vec<Comparison>> {
    let config = Config::read(config_file)?;
    let task = Task::parse(&config.task)?;
    let spec = task.spec();
    let folder =
        config_file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let files =
        (1..=count_updates(folder)?).map(|number| folder.join(format!("update-{number}.safetensors")));
    let mut files = files.map(UpdateFile::read);
    let mut file = files.next().expect("a folder without updates was refused")?;

    let (mut team, start) = team(&config, spec, &file)?;
    let mut comparisons = Vec::new();
    loop {
        comparisons.extend(compare_update(&mut team, &start, spec, &file)?);
        match files.next() {
            Some(next) => file = next?,
            None => return Ok(comparisons),
        }
    }
}

/// How many updates a folder holds. They are numbered from 1 without a gap.
fn count_updates(folder: &Path) -> Result<usize> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io("read", folder, e))?;
    let count = entries.flatten().filter(|entry| has_update_name(&entry.path())).count();
    let name = |number: usize| format!("update-{number}.safetensors");
    match (1..=count.max(1)).map(name).find(|name| !folder.join(name).exists()) {
        Some(missing) => Err(Error::io("verify", folder, format!("there is no {missing}"))),
        None => Ok(count),
    }
}

fn has_update_name(file: &Path) -> bool {
    let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.starts_with("update-") && name.ends_with(".safetensors")
}

/// Whether a file is verified along with the `config.json` beside it.
pub(super) fn is_update(file: &Path) -> bool {
    let config = file.with_file_name("config.json");
    has_update_name(file) && FileKind::of(&config).is_ok_and(|kind| kind == FileKind::Updates)
}

/// The networks of a team, with what the files call their kind.
fn networks(team: &mut Learner) -> impl Iterator<Item = (&'static str, &mut Parameters)> {
    let actors = team.actors.iter_mut().map(|actor| ("actor", &mut actor.parameters));
    let critics = team.critics.iter_mut().map(|critic| ("critic", &mut critic.parameters));
    let predictors = team.predictors.iter_mut().map(|predictor| ("predictor", &mut predictor.parameters));
    actors.chain(critics).chain(predictors)
}

/// The team before the first update, and its weights, tensor by tensor.
fn team(config: &Config, spec: &Spec, file: &UpdateFile) -> Result<(Learner, Vec<Vec<f32>>)> {
    let (settings, dims) = (config.settings(), dims(spec));
    // The file bounds the sizes before memory is asked for.
    for tensor in settings.networks.tensors(&dims) {
        let kind = if tensor.name.starts_with("actors") { "actor" } else { "predictor" };
        file.weights(&format!("before.{kind}"), &tensor)?;
    }
    let available: Vec<usize> = (0..spec.n_agents()).map(|agent| spec.available_actions(agent)).collect();
    let mut team = Learner::untrained(settings, &dims, spec.padded_obs_dim(), &available, 0, 1);
    let mut start = Vec::new();
    for (kind, parameters) in networks(&mut team) {
        for at in 0..parameters.specs.len() {
            let values = file.weights(&format!("before.{kind}"), &parameters.specs[at])?;
            parameters.values.tensor_mut(at).copy_from_slice(&values);
            start.push(values);
        }
    }
    for critic in &mut team.critics {
        for (at, spec) in critic.parameters.specs.iter().enumerate() {
            let values = file.weights("before.target_critic", spec)?;
            critic.target.tensor_mut(at).copy_from_slice(&values);
        }
    }
    Ok((team, start))
}

/// One update, and what it came to.
fn compare_update(
    team: &mut Learner,
    start: &[Vec<f32>],
    spec: &Spec,
    file: &UpdateFile,
) -> Result<Vec<Comparison>> {
    let batch = file.batch(spec)?;
    let losses = team.update(&batch, &[]).predictors.first().copied().flatten();
    let loss = losses.map_or(f64::NAN, |losses| losses.loss);

    let (mut advantages, mut losses) = (Deviations::default(), Deviations::default());
    advantages.add_all(team.advantages(), &file.advantages(&batch, spec.n_agents())?);
    losses.add(loss, file.predictor_loss()?);
    let mut comparisons = vec![
        advantages.largest(&file.path, "advantages", ADVANTAGES),
        losses.largest(&file.path, "predictor loss", PREDICTOR_LOSS),
    ];

    let mut start = start.iter();
    let what = ["weights of actors", "weights of critics", "weights of the predictor"];
    for (kind, what) in ["actor", "critic", "predictor"].into_iter().zip(what) {
        let (mut values, mut deviations) = (0, Deviations::default());
        for (_, parameters) in networks(team).filter(|(of, _)| *of == kind) {
            for ((spec, found), start) in parameters.tensors().zip(start.by_ref()) {
                let recorded = file.weights(&format!("after.{kind}"), spec)?;
                deviations.add(relative_error(found, &recorded, start), 0.0);
                values += spec.n_values();
            }
        }
        comparisons.push(Comparison { values, ..deviations.largest(&file.path, what, WEIGHTS) });
    }
    Ok(comparisons)
}

/// The norm of the error as a part of the norm of the change since the start.
fn relative_error(found: &[f32], recorded: &[f32], start: &[f32]) -> f64 {
    let distance = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>().sqrt()
    };
    match distance(found, recorded) {
        0.0 => 0.0,
        error => error / distance(recorded, start),
    }
}
