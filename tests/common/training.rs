//! Training runs of the real binary, small enough for tests.

use std::fs;
use std::path::{Path, PathBuf};

use super::succeed;

/// Networks and tests that are small, so that a run takes a second.
pub const SMALL: &str = "--set hidden=32 --set predictor_hidden=16 --set test_episodes=4 --set test_interval=2000 \
                     --set replay_batch=8";

/// A folder for runs, gone when it is dropped.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A run that must succeed, in a folder of this name.
    pub fn train(&self, name: &str, words: &str) -> PathBuf {
        succeed(&format!("train {SMALL} --out {} {words}", self.path(name).display()));
        self.path(name)
    }
}

/// What must be the same in two runs of the same settings.
pub fn result(run: &Path) -> (String, Vec<u8>) {
    let read = |name: &str| fs::read(run.join(name)).unwrap();
    (String::from_utf8(read("metrics.csv")).unwrap(), read("policy.safetensors"))
}

pub fn assert_same(a: &Path, b: &Path) {
    let ((metrics, policy), (others, other)) = (result(a), result(b));
    assert_eq!(metrics, others);
    assert!(policy == other, "{} and {} have different policies", a.display(), b.display());
}
