//! Checkpoints of episodes that ended early.

use super::*;
use crate::train::checkpoint::State;
use crate::train::trainer::Trainer;
use safetensors::SafeTensors;
use std::path::{Path, PathBuf};

/// A run with three episodes played, none of which went to its end, and its checkpoint in `folder`.
fn begun(folder: &Path) -> (Trainer, PathBuf) {
    let mut layer = Layer::new("test");
    for (key, value) in [("hidden", "4"), ("update_every", "1"), ("predictors", "[\"maro\"]")] {
        layer.set(key, value);
    }
    let mut trainer = Trainer::new(Config::resolve(Preset::Paper, &[layer]).unwrap(), 1).unwrap();
    let state = &mut trainer.state;
    let joint = numbers(1, state.batch.joint.len());
    state.batch.joint.copy_from_slice(&joint);
    for (episode, (length, terminated)) in [(3, true), (24, false), (1, true)].into_iter().enumerate() {
        state.batch.ends.set(episode, length, terminated);
        state.replay.push(episode as u64, &state.batch, episode);
    }
    state.progress.episodes = 3;
    let path = folder.join("checkpoint.safetensors");
    trainer.state.save(&trainer.config, &path).unwrap();
    (trainer, path)
}

fn restored(of: &Trainer, path: &Path) -> crate::base::error::Result<Trainer> {
    Trainer::restore(of.config.clone(), 1, &Checkpoint::open(path)?)
}

/// Writes the checkpoint again, with `change` made to a tensor's values; `None` leaves it out.
fn rewrite(path: &Path, change: impl Fn(&str, Vec<f32>) -> Option<Vec<f32>>) {
    let bytes = std::fs::read(path).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let words = header.metadata().clone().unwrap();
    let words = words.iter().map(|(key, value)| (&key[..], value.clone())).collect();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let changed: Vec<(String, Vec<usize>, Vec<f32>)> = tensors
        .iter()
        .filter_map(|(name, view)| {
            let values = view.data().as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
            Some((name.to_owned(), view.shape().to_vec(), change(name, values)?))
        })
        .collect();
    let changed: Vec<_> =
        changed.iter().map(|(name, shape, values)| (&name[..], &shape[..], &values[..])).collect();
    crate::nn::write_tensors(path, &words, crate::nn::Precision::Full, &changed).unwrap();
}

#[test]
fn ends_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (trainer, path) = begun(folder.path());
    let restored = restored(&trainer, &path).unwrap();
    assert_eq!(restored.state.batch, trainer.state.batch);
    assert_eq!(restored.state.replay.lengths(), [3, 24, 1]);
    assert_eq!(restored.state.replay.episodes(), trainer.state.replay.episodes());
}

#[test]
fn checkpoints_from_before_episodes_could_end_early_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (trainer, path) = begun(folder.path());
    let new = ["replay.lengths", "batch.lengths", "batch.terminated"];
    rewrite(&path, |name, values| (!new.contains(&name)).then_some(values));
    let State { batch, replay, .. } = restored(&trainer, &path).unwrap().state;
    assert_eq!(batch.ends, Ends::truncated(batch.episodes, batch.steps));
    assert_eq!(replay.lengths(), [batch.steps; 3]);
}

#[test]
fn ends_that_cannot_be_are_refused() {
    for (tensor, value) in [
        ("replay.lengths", 0.0),
        ("replay.lengths", 26.0),
        ("batch.lengths", 0.0),
        ("batch.lengths", 26.0),
        ("batch.lengths", f32::NAN),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (trainer, path) = begun(folder.path());
        rewrite(&path, |name, mut values| {
            values.iter_mut().take(usize::from(name == tensor)).for_each(|first| *first = value);
            Some(values)
        });
        let said = restored(&trainer, &path).unwrap_err().to_string();
        assert!(said.contains("is damaged") && said.contains(tensor), "{said}");
    }
}
