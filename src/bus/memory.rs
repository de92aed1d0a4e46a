//! Shared memory: how much there is, and how much is promised to swarms that have not taken it yet.
//!
//! Pages are taken when they are first written. Where there are none left the writer gets SIGBUS, so a swarm starts only
//! if all that it may come to use is free and not promised to another. Its promise is the length of its lock file, which
//! takes no memory itself. Once all its segments are there they are filled with pages, and the promise is kept.

use std::fs::File;
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate, statvfs};

use super::directory::{
    SHARED_MEMORY, SwarmDirectory, bytes_of, lock_file_of, named, place, prefix_of, tags_in_memory,
};
use super::place::{Lock, locked};
use crate::base::error::{Error, Result};
use crate::failed;

/// Shared memory, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SharedMemory {
    /// What nobody has taken.
    pub(crate) free: u64,
    /// What of that is promised to living swarms of this user.
    pub(crate) promised: u64,
    /// All there is.
    pub(crate) total: u64,
}

impl SharedMemory {
    /// How it is now.
    pub(crate) fn look() -> Result<SharedMemory> {
        let stat = statvfs(SHARED_MEMORY).map_err(|e| Error::io("look at", SHARED_MEMORY.as_ref(), e))?;
        let mut promised = 0;
        for tag in tags_in_memory() {
            let path = lock_file_of(&tag);
            if matches!(locked(&path)?, Lock::Held) {
                let promise = path.symlink_metadata().map_or(0, |about| about.len());
                promised += promise.saturating_sub(bytes_of(&tag));
            }
        }
        Ok(SharedMemory {
            free: stat.f_bavail * stat.f_frsize,
            promised,
            total: stat.f_blocks * stat.f_frsize,
        })
    }

    /// What a new swarm may take.
    pub(crate) fn available(&self) -> u64 {
        self.free.saturating_sub(self.promised)
    }
}

impl SwarmDirectory {
    /// Has so many bytes promised to this swarm, if they are there; or says how much is.
    pub(crate) fn promise(&self, bytes: u64) -> Result<std::result::Result<(), SharedMemory>> {
        let _lock = place().lock()?;
        // Others see it before we look: swarms of another place do not wait for our lock, but do the same.
        self.set_promise(bytes)?;
        let memory = SharedMemory::look()?;
        if memory.promised <= memory.free {
            return Ok(Ok(()));
        }
        self.set_promise(0)?;
        Ok(Err(SharedMemory { promised: memory.promised - bytes, ..memory }))
    }

    /// Has so many bytes promised besides what the swarm has taken, to be taken at any time in its life.
    #[cfg(feature = "view")]
    pub(crate) fn promise_more(&self, bytes: u64) -> Result<std::result::Result<(), SharedMemory>> {
        self.promise(bytes_of(self.tag()) + bytes)
    }

    /// Takes all pages of the swarm's segments, so that none can be missing later, and with that keeps the promise.
    pub(crate) fn take_pages(&self) -> Result<()> {
        take_pages_of(&prefix_of(self.tag()))?;
        self.set_promise(0)
    }

    fn set_promise(&self, bytes: u64) -> Result<()> {
        self.in_memory.set_len(bytes).map_err(|e| Error::io("write to", &lock_file_of(self.tag()), e))
    }
}

/// Takes all pages of the segments whose names begin with `prefix`.
pub(super) fn take_pages_of(prefix: &str) -> Result<()> {
    let lock_file = Path::new(SHARED_MEMORY).join(format!("{prefix}lock"));
    for path in named(prefix).into_iter().filter(|path| *path != lock_file) {
        let file = File::options().read(true).write(true).open(&path);
        let file = file.map_err(|e| Error::io("open", &path, e))?;
        let length = file.metadata().map_err(|e| Error::io("look at", &path, e))?.len();
        fallocate(&file, FallocateFlags::empty(), 0, length.max(1)).map_err(|e| {
            failed!(
                "shared memory ran out while the swarm started, since somebody else took it ({e}); see what \
                 `vamaro-swarm doctor` finds"
            )
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_promised_is_not_there_for_others() {
        let swarm = SwarmDirectory::create().unwrap();
        let bytes = 3 << 20;
        swarm.promise(bytes).unwrap().unwrap();
        assert_eq!(bytes_of(swarm.tag()), 0, "a promise takes nothing");
        assert!(SharedMemory::look().unwrap().promised >= bytes);
        let other = SwarmDirectory::create().unwrap();
        let all = SharedMemory::look().unwrap();
        let refused = other.promise(all.total).unwrap().unwrap_err();
        assert!(refused.promised >= bytes && refused.available() < all.total);
        assert_eq!(std::fs::metadata(lock_file_of(other.tag())).unwrap().len(), 0);
    }

    #[test]
    fn pages_that_are_taken_are_the_swarms() {
        let swarm = SwarmDirectory::create().unwrap();
        let segment = std::path::Path::new(SHARED_MEMORY).join(format!("vs_{}_test", swarm.tag()));
        File::create(segment).unwrap().set_len(1 << 20).unwrap();
        assert_eq!(bytes_of(swarm.tag()), 0);
        swarm.take_pages().unwrap();
        assert!(bytes_of(swarm.tag()) >= 1 << 20);
    }
}
