//! Processes on cores of their own.

use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::base::scheduling::{allowed_cores, only};

/// This thread and other processes, each on a core of its own. Dropping it sets this thread free again.
pub(super) struct Pinned {
    before: CpuSet,
}

impl Pinned {
    /// Pins this thread and these processes; `None` if there are not enough cores for all, or it is not allowed.
    pub(super) fn new(processes: &[u32]) -> Option<Pinned> {
        let before = sched_getaffinity(None).ok()?;
        let cores = allowed_cores();
        if cores.len() < processes.len() + 1 {
            return None;
        }
        let pinned = Pinned { before };
        let this = std::iter::once(None);
        let others = processes.iter().map(|process| Pid::from_raw(*process as i32));
        for (process, core) in this.chain(others).zip(cores) {
            sched_setaffinity(process, &only(core)).ok()?;
        }
        Some(pinned)
    }
}

impl Drop for Pinned {
    fn drop(&mut self) {
        // It was allowed before.
        let _ = sched_setaffinity(None, &self.before);
    }
}
