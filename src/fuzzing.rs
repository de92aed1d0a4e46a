//! What the fuzz targets of `fuzz/` call: each parser of the program, on bytes from anywhere. None may panic, hang or take
//! memory beyond a bound; an error is fine.

use std::io::Write;
use std::path::Path;

use crate::agent::{PolicySource, dims};
use crate::bus::{Header, Kind, Layout, PROTOCOL};
use crate::environment::{PhysicsSpec, Task};
use crate::evaluate::{Record, Settings};
use crate::link::{CommunicationMatrix, LinkSpec, RadioLog, Site};
use crate::metrics::{Metrics, MetricsLog};
use crate::nn::{Meta, PolicyFile, import};
use crate::recording::Recording;
use crate::train::{Checkpoint, Config, Layer, Preset, Trainer};
use crate::verify::verify;

/// A policy file: its description, and its weights for the task it names.
pub fn policy(bytes: &[u8]) {
    with_file(bytes, |path| {
        let Ok(file) = PolicyFile::read(path) else { return };
        if let Ok(task) = Task::parse(&file.meta.task) {
            let _ = PolicySource::File(path.to_owned()).load(task.spec());
        }
    });
}

/// A checkpoint, and the run that would go on from it if that is small enough to be tried often.
pub fn checkpoint(bytes: &[u8]) {
    with_file(bytes, |path| {
        let Ok(checkpoint) = Checkpoint::open(path) else { return };
        let config = checkpoint.config.clone();
        if config.hidden <= 64 && config.batch_episodes <= 64 && config.replay_episodes <= 256 {
            let _ = Trainer::restore(config, 1, &checkpoint);
        }
    });
}

/// A state dict of PyTorch.
pub fn pickle(bytes: &[u8]) {
    let task = Task::parse("hear-see").expect("there is such a task");
    with_file(bytes, |path| drop(import(path, &[], &dims(task.spec()), Meta::new("hear-see", 0))));
}

/// A recording or a trace, which is verified if it can be read.
pub fn recording(bytes: &[u8]) {
    with_file(bytes, |path| {
        if Recording::read(path).is_ok() {
            let _ = verify(&[path.to_owned()], Some(&PolicySource::Builtin));
        }
    });
}

/// The finished cells of an evaluation.
pub fn cells(bytes: &[u8]) {
    let folder = tempfile::tempdir_in("/dev/shm").expect("there is memory for a folder");
    std::fs::write(folder.path().join("cells.jsonl"), bytes).expect("there is memory for a file");
    let _ = Record::open(folder.path(), &Settings { episodes: 2, comm_at_t0: true, ..Settings::default() });
}

/// The metrics of a run that goes on; the first byte says after how many rows.
pub fn metrics(bytes: &[u8]) {
    let Some((rows, text)) = bytes.split_first() else { return };
    let folder = tempfile::tempdir_in("/dev/shm").expect("there is memory for a folder");
    let csv = folder.path().join("metrics.csv");
    std::fs::write(&csv, text).expect("there is memory for a file");
    std::fs::write(folder.path().join("events.out.tfevents.vamaro-swarm"), text)
        .expect("there is memory for a file");
    let columns = Metrics::read(&csv).map(|metrics| metrics.columns).unwrap_or_default();
    let columns: Vec<String> = columns.into_iter().map(|column| column.name).collect();
    if let Ok(mut log) = MetricsLog::resume(folder.path(), &columns, (*rows).into()) {
        let next = log.last().map_or(0, |last| last.saturating_add(1));
        let _ = log.push(next, &vec![None; columns.len()]);
    }
}

/// A communication matrix for a team of four, or the log of its radio.
pub fn matrix(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = CommunicationMatrix::parse(text, 4);
        let _ = RadioLog::parse(text, 4);
    }
}

/// An expression for links, without a file in it.
pub fn links(bytes: &[u8]) {
    let text = std::str::from_utf8(bytes).unwrap_or_default();
    // A matrix is in a file, which may be any.
    if !text.contains('/') {
        let _ = LinkSpec::parse(text, Site { agents: 4, tick: Some(0.1) }).map(|links| links.build());
    }
}

/// A configuration.
pub fn config(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(layer) = Layer::parse(text, "config.toml") {
        let _ = Config::resolve(Preset::Paper, &[layer]).map(|config| config.to_toml());
    }
}

/// Physics, and a task that has them.
pub fn physics(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(physics) = text.parse::<PhysicsSpec>() {
        let _ = Task::parse("hear-see").and_then(|task| task.with_physics(physics));
    }
}

/// A message as it stands in shared memory, whatever its header says.
pub fn message(bytes: &[u8]) {
    let mut words =
        bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")));
    let mut next = || words.next().unwrap_or_default();
    let header = Header {
        protocol: PROTOCOL,
        kind: next() % 8,
        length: next().into(),
        worlds: next(),
        ..Header::default()
    };
    let words: Vec<u32> = words.collect();
    let layout = Layout { agents: 3, observation: 5, action: 1, joint: 9, logits: 5, relay: false };
    // As receivers do: how many worlds there are they know themselves.
    for worlds in [1, 2, 3] {
        for (kind, length) in [
            (Kind::Sensor, layout.sensor_words(worlds)),
            (Kind::Observation, layout.observation_words(worlds)),
            (Kind::Decision, layout.decision_words(worlds)),
        ] {
            if header.fits(kind, 0, length) && words.len() == length {
                match kind {
                    Kind::Sensor => {
                        let _ = layout.sensor(&words, worlds);
                    }
                    Kind::Decision => {
                        let _ = layout.decision(&words, worlds);
                    }
                    _ => {}
                }
            }
        }
    }
}

fn with_file(bytes: &[u8], then: impl FnOnce(&Path)) {
    let mut file = tempfile::NamedTempFile::new_in("/dev/shm").expect("there is memory for a file");
    file.write_all(bytes).expect("there is memory for a file");
    then(file.path());
}
