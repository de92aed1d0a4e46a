//! The folder of a run: what is in it, and the lock that keeps two runs apart.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, flock};

use super::checkpoint::Checkpoint;
use super::layer::Layer;
use crate::base::error::{Error, Result};
use crate::base::file::PART_OF_FILE;
use crate::usage;

const CHECKPOINT: &str = "checkpoint.safetensors";
const CONFIG: &str = "config.toml";
const METRICS: &str = crate::metrics::FILE;
const POLICY: &str = "policy.safetensors";

/// How long a lock may outlive a run that was killed: a process that it had just forked, to become an agent,
/// has the lock, too, until it executes the program.
const LOCK_DEADLINE: Duration = Duration::from_secs(1);

/// The folder of a run, locked as long as this lives.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// The folder itself carries the lock, which the kernel takes back however the process ends.
    _lock: File,
}

impl RunFolder {
    /// Makes the folder, if it is not there, and locks it.
    ///
    /// # Errors
    /// `Usage` if another run uses it; `Failed` if it cannot be made or locked.
    pub fn open(path: &Path) -> Result<RunFolder> {
        fs::create_dir_all(path).map_err(|e| Error::io("create the folder", path, e))?;
        let lock = File::open(path).map_err(|e| Error::io("open", path, e))?;
        let deadline = Instant::now() + LOCK_DEADLINE;
        let mut locked = flock(&lock, FlockOperation::NonBlockingLockExclusive);
        while locked == Err(rustix::io::Errno::WOULDBLOCK) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
            locked = flock(&lock, FlockOperation::NonBlockingLockExclusive);
        }
        locked.map_err(|e| match e {
            rustix::io::Errno::WOULDBLOCK => {
                usage!(
                    "{} is in use by a run that is still going on; wait for it, or choose another --out",
                    path.display()
                )
            }
            other => Error::io("lock", path, other),
        })?;
        let folder = RunFolder { path: path.to_owned(), _lock: lock };
        folder.remove_parts();
        Ok(folder)
    }

    /// Removes what a killed run was writing: nobody else writes here while we have the lock.
    fn remove_parts(&self) {
        let names = fs::read_dir(&self.path).into_iter().flatten().flatten().map(|entry| entry.file_name());
        for name in names.filter(|name| name.to_string_lossy().starts_with(PART_OF_FILE)) {
            // What cannot be removed is in nobody's way.
            let _ = fs::remove_file(self.path.join(name));
        }
    }

    /// Whether there is a run in the folder at `path`.
    pub fn has_run(path: &Path) -> bool {
        path.join(CHECKPOINT).exists()
    }

    /// The settings of the run in the folder at `path`: those in `config.toml`, which are ahead of the
    /// checkpoint's when a run has just been told to take more steps, or, where a run was killed before it had
    /// written them there, those of the checkpoint.
    pub fn settings(path: &Path) -> Result<Layer> {
        let config = path.join(CONFIG);
        if config.exists() {
            return Layer::read(&config);
        }
        let checkpoint = path.join(CHECKPOINT);
        Layer::parse(&Checkpoint::open(&checkpoint)?.config.to_toml(), &checkpoint.display().to_string())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Every setting of the run.
    pub fn config(&self) -> PathBuf {
        self.path.join(CONFIG)
    }

    /// Everything the run needs in order to go on.
    pub fn checkpoint(&self) -> PathBuf {
        RunFolder::checkpoint_in(&self.path)
    }

    /// The checkpoint in the folder at `path`.
    pub fn checkpoint_in(path: &Path) -> PathBuf {
        path.join(CHECKPOINT)
    }

    /// What agents load.
    pub fn policy(&self) -> PathBuf {
        self.path.join(POLICY)
    }

    /// The return at each level over training.
    pub fn curves(&self) -> PathBuf {
        self.path.join("curves.svg")
    }

    /// What was measured, row by row.
    pub fn metrics(&self) -> PathBuf {
        self.path.join(METRICS)
    }

    /// An error if a new run would find something of another one in the folder at `path`.
    pub fn check_free(path: &Path) -> Result<()> {
        let shown = path.display();
        if RunFolder::has_run(path) {
            return Err(usage!(
                "{shown} already holds a run: continue it with --resume, or choose another --out"
            ));
        }
        match [METRICS, POLICY, CONFIG].iter().find(|name| path.join(name).exists()) {
            Some(name) => Err(usage!(
                "{shown} already holds a {name}, but no checkpoint to continue from; move it away, or choose another \
                 --out"
            )),
            None => Ok(()),
        }
    }

    /// An error if there is no run in the folder at `path` to go on with.
    pub fn check_run(path: &Path) -> Result<()> {
        if RunFolder::has_run(path) {
            Ok(())
        } else {
            Err(usage!("there is no run to resume in {}: it has no {CHECKPOINT}", path.display()))
        }
    }
}
