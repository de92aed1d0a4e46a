//! How many processes and threads this user may have.

use std::os::unix::fs::MetadataExt;

use rustix::process::{Resource, getrlimit, getuid};
use rustix::thread::{CapabilitySet, capabilities};

/// The processes and threads of this user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tasks {
    /// How many there may be (`ulimit -u`).
    pub limit: u64,
    /// How many of them there are.
    pub running: u64,
}

impl Tasks {
    /// `None` where nothing limits them.
    pub(crate) fn of_this_user() -> Option<Tasks> {
        let limit = getrlimit(Resource::Nproc).current?;
        // The kernel lets these pass.
        let exempt = CapabilitySet::SYS_RESOURCE | CapabilitySet::SYS_ADMIN;
        let may_exceed = capabilities(None).is_ok_and(|sets| sets.effective.intersects(exempt));
        (!getuid().is_root() && !may_exceed).then(|| Tasks { limit, running: running() })
    }

    /// How many more there may be.
    pub(crate) fn free(&self) -> u64 {
        self.limit.saturating_sub(self.running)
    }
}

/// The threads of all processes of this user, as far as /proc shows them.
fn running() -> u64 {
    let user = getuid().as_raw();
    let folders = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let own = folders.filter(|folder| folder.metadata().is_ok_and(|data| data.uid() == user));
    // A folder has two links, and one for each folder in it: here one for each thread.
    let threads =
        own.filter_map(|folder| Some(folder.path().join("task").metadata().ok()?.nlink().saturating_sub(2)));
    threads.sum()
}
