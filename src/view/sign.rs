//! What a swarm says of itself to those who look for one to watch.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Facts;
use crate::base::error::Result;
use crate::base::file::AtomicFile;
use crate::base::regular;
use crate::base::rng::MAX_AGENTS;
use crate::bus::Living;
use crate::{failed, usage};

/// Version of the sign and of the pictures: facts, and how a scene is laid out in bytes. Whoever changes these counts it up.
const VIEW: u32 = 1;

/// A file in the directory of a swarm, from when it can be watched until it ends.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Sign {
    /// [`VIEW`].
    view: u32,
    /// Version of the program.
    program: String,
    /// The process of the supervisor.
    pub(crate) process: u32,
    /// When it was put up, in seconds since 1970.
    since: u64,
    /// [`Facts`], of this version or another.
    facts: Value,
}

/// Larger than any.
const LONGEST: u64 = 1 << 16;

impl Sign {
    /// Puts one up in the directory of this process's swarm.
    pub(super) fn put_up(directory: &Path, facts: &Facts) -> Result<()> {
        let sign = Sign {
            view: VIEW,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            process: std::process::id(),
            since: now(),
            facts: serde_json::to_value(facts).map_err(|e| failed!("cannot say what a swarm plays: {e}"))?,
        };
        AtomicFile::write(&place_in(directory), format!("{:#}\n", serde_json::json!(sign)).as_bytes())
    }

    /// Takes down that in the directory of this process's swarm, which can no longer be watched.
    pub(super) fn take_down(directory: &Path) {
        let _ = std::fs::remove_file(place_in(directory));
    }

    /// That of a swarm; `None` if it has none.
    pub(crate) fn of(swarm: &Living) -> Option<Sign> {
        serde_json::from_slice(&regular::read(&place_in(&swarm.root), LONGEST).ok()?).ok()
    }

    /// What the swarm plays.
    ///
    /// # Errors
    /// `Usage` if another version of the program says it.
    pub(crate) fn facts(&self) -> Result<Facts> {
        let facts =
            Facts::deserialize(&self.facts).ok().filter(|facts| (1..=MAX_AGENTS).contains(&facts.agents));
        match facts {
            Some(facts) if self.view == VIEW => Ok(facts),
            _ => Err(usage!(
                "process {} runs vamaro-swarm {}, whose view has version {}, and this is {}, with version {VIEW}; watch it \
                 with the same program",
                self.process,
                self.program,
                self.view,
                env!("CARGO_PKG_VERSION")
            )),
        }
    }

    /// How long it has been there.
    pub(crate) fn age(&self) -> Duration {
        Duration::from_secs(now().saturating_sub(self.since))
    }
}

fn place_in(directory: &Path) -> PathBuf {
    directory.join("view.json")
}

fn now() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;
    use crate::environment::Task;

    #[test]
    fn a_sign_is_read_as_it_was_put_up_and_one_of_another_version_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let swarm = Living { tag: String::new(), root: folder.path().to_owned() };
        assert!(Sign::of(&swarm).is_none());
        let facts = Facts { level: Some(0.2), ..Facts::of(Task::parse("spread-xy-4").unwrap().spec()) };
        Sign::put_up(folder.path(), &facts).unwrap();
        let sign = Sign::of(&swarm).unwrap();
        assert_eq!((sign.process, sign.facts().unwrap()), (std::process::id(), facts));
        assert!(sign.age() < Duration::from_secs(60));
        let text = std::fs::read_to_string(place_in(folder.path())).unwrap();
        for (now, then) in [("\"view\": 1", "\"view\": 2"), ("\"agents\": 4", "\"agents\": 65")] {
            assert!(text.contains(now), "{text}");
            std::fs::write(place_in(folder.path()), text.replace(now, then)).unwrap();
            let refused = Sign::of(&swarm).unwrap().facts();
            assert!(matches!(refused, Err(Error::Usage(words)) if words.contains("same program")), "{then}");
        }
        std::fs::write(place_in(folder.path()), "{").unwrap();
        assert!(Sign::of(&swarm).is_none());
    }
}
