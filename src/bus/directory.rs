//! Where a swarm lives on this machine, and how everything of it goes away.
//!
//! A swarm has a tag of eight hex digits, a directory `/tmp/vamaro-swarm-<uid>/<tag>` for iceoryx2's
//! sockets and bookkeeping, and shared memory named `vs_<tag>_..`. As long as its supervisor lives it holds
//! a lock on the directory and one on the file `vs_<tag>_lock` in shared memory, so a swarm without a lock is
//! dead. There are two because containers may share either place and not the other.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::hash::{BuildHasher, RandomState};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{AtFlags, CWD, FlockOperation, Mode, OFlags, flock, linkat, open, statvfs};

use crate::base::error::{Error, Result};
use crate::failed;

const SHARED_MEMORY: &str = "/dev/shm";
const TAG_DIGITS: usize = 8;

/// The directory of a living swarm. Dropping it removes all the swarm left on the machine.
#[derive(Debug)]
pub struct SwarmDirectory {
    tag: String,
    /// Keeps the locks.
    _locks: [File; 2],
}

impl SwarmDirectory {
    /// Cleans up after dead swarms and makes a directory for a new one.
    pub fn create() -> Result<SwarmDirectory> {
        make_base()?;
        let base = base_directory();
        let _base_lock = lock_base(&base)?;
        for leftover in dead_swarms()? {
            leftover.remove();
        }
        let tag = format!("{:08x}", RandomState::new().hash_one(std::process::id()) as u32);
        let path = base.join(&tag);
        fs::create_dir(&path).map_err(|e| Error::io("create the directory", &path, e))?;
        let locked = open_locked(&path)?.ok_or_else(|| failed!("{} is in use", path.display()))?;
        let in_memory = lock_file_of(&tag);
        let in_memory = create_locked(&in_memory).map_err(|e| Error::io("create", &in_memory, e))?;
        Ok(SwarmDirectory { tag, _locks: [locked, in_memory] })
    }

    /// The swarm's tag.
    pub fn tag(&self) -> &str {
        &self.tag
    }

    /// Where files of the swarm can be put; they go when it goes.
    pub fn path(&self) -> PathBuf {
        root_of(&self.tag)
    }
}

impl Drop for SwarmDirectory {
    fn drop(&mut self) {
        remove_swarm(&self.tag);
    }
}

/// What a swarm whose supervisor died has left behind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leftover {
    /// The tag of the swarm.
    pub tag: String,
    /// Its files in shared memory.
    pub files: usize,
    /// The shared memory they hold, in bytes.
    pub bytes: u64,
}

impl Leftover {
    fn remove(&self) {
        remove_swarm(&self.tag);
    }
}

/// The leftovers of this user's dead swarms, which are removed if `clean` is set.
pub fn leftovers(clean: bool) -> Result<Vec<Leftover>> {
    make_base()?;
    let _base_lock = lock_base(&base_directory())?;
    let dead = dead_swarms()?;
    if clean {
        dead.iter().for_each(Leftover::remove);
    }
    Ok(dead)
}

/// An error if a swarm could not put its files where they belong.
pub fn check_writable() -> Result<()> {
    make_base()?;
    for folder in [Path::new(SHARED_MEMORY), &base_directory()] {
        tempfile::tempfile_in(folder)
            .map_err(|e| Error::io("write to", folder, std::io::Error::from(e.kind())))?;
    }
    Ok(())
}

/// Free and total bytes of shared memory.
pub fn shared_memory_free() -> Result<(u64, u64)> {
    let path = Path::new(SHARED_MEMORY);
    let stat = statvfs(path).map_err(|e| Error::io("look at", path, e))?;
    Ok((stat.f_bavail * stat.f_frsize, stat.f_blocks * stat.f_frsize))
}

/// Where the directories of this user's swarms are.
fn base_directory() -> PathBuf {
    // Not the configurable temporary directory: a socket's path may have no more than 107 bytes.
    PathBuf::from(format!("/tmp/vamaro-swarm-{}", rustix::process::geteuid().as_raw()))
}

fn make_base() -> Result<()> {
    let base = base_directory();
    let made = fs::DirBuilder::new().mode(0o700).recursive(true).create(&base);
    made.map_err(|e| Error::io("create the directory", &base, e))
}

fn lock_file_of(tag: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(format!("{}lock", prefix_of(tag)))
}

pub(super) fn root_of(tag: &str) -> PathBuf {
    base_directory().join(tag)
}

/// The prefix of a swarm's shared memory: of fixed length and not ending in a digit, so that no
/// swarm's prefix is the beginning of another's.
pub(super) fn prefix_of(tag: &str) -> String {
    format!("vs_{tag}_")
}

/// Held while swarms are created or cleaned up, so that nobody takes one in the making for dead.
fn lock_base(base: &Path) -> Result<File> {
    let found = fs::symlink_metadata(base).map_err(|e| Error::io("look at", base, e))?;
    if !found.is_dir() || found.uid() != rustix::process::geteuid().as_raw() {
        return Err(failed!("{} is not a folder of this user; remove it", base.display()));
    }
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        match open_locked(base)? {
            Some(lock) => return Ok(lock),
            None if Instant::now() > deadline => {
                return Err(failed!("{} has been locked for 10 s by another swarm", base.display()));
            }
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

/// Opens and locks a directory; `None` if somebody else holds the lock.
fn open_locked(path: &Path) -> Result<Option<File>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(file)),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(e) => Err(Error::io("lock", path, e)),
    }
}

/// Makes a file that is locked before anybody can see it: those who look may hold another base lock.
fn create_locked(path: &Path) -> rustix::io::Result<File> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(open(folder, flags, Mode::RUSR | Mode::WUSR)?);
    flock(&file, FlockOperation::NonBlockingLockExclusive)?;
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    linkat(CWD, nameless, CWD, path, AtFlags::SYMLINK_FOLLOW)?;
    Ok(file)
}

/// Needs the lock of the base directory.
fn dead_swarms() -> Result<Vec<Leftover>> {
    let mut tags = BTreeSet::new();
    for name in names_in(&base_directory()) {
        if is_tag(&name) {
            tags.insert(name);
        }
    }
    for name in names_in(Path::new(SHARED_MEMORY)) {
        let tag = name.strip_prefix("vs_").and_then(|rest| rest.split('_').next());
        let ours = |tag: &&str| is_tag(tag) && name.starts_with(&prefix_of(tag)) && is_mine(&name);
        if let Some(tag) = tag.filter(ours) {
            tags.insert(tag.to_owned());
        }
    }
    let mut dead = Vec::new();
    for tag in tags {
        if is_alive(&tag)? {
            continue;
        }
        let files = shared_memory_of(&tag);
        let bytes = files.iter().filter_map(|file| fs::metadata(file).ok()).map(|m| m.blocks() * 512).sum();
        // Its supervisor may have removed it in the meantime.
        if !files.is_empty() || root_of(&tag).exists() {
            dead.push(Leftover { tag, files: files.len(), bytes });
        }
    }
    Ok(dead)
}

/// One of the two locks is enough.
fn is_alive(tag: &str) -> Result<bool> {
    Ok(is_locked(&root_of(tag))? || is_locked(&lock_file_of(tag))?)
}

/// What is not there, or has just gone, is not locked.
fn is_locked(path: &Path) -> Result<bool> {
    match open_locked(path) {
        Ok(lock) => Ok(lock.is_none()),
        Err(_) if !path.exists() => Ok(false),
        Err(e) => Err(e),
    }
}

fn is_tag(name: &str) -> bool {
    name.len() == TAG_DIGITS && name.bytes().all(|b| b.is_ascii_hexdigit())
}

fn is_mine(shared_memory: &str) -> bool {
    let owner = fs::metadata(Path::new(SHARED_MEMORY).join(shared_memory)).map(|m| m.uid());
    owner.is_ok_and(|uid| uid == rustix::process::geteuid().as_raw())
}

fn names_in(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

fn shared_memory_of(tag: &str) -> Vec<PathBuf> {
    let directory = Path::new(SHARED_MEMORY);
    let ours = |name: &String| name.starts_with(&prefix_of(tag));
    names_in(directory).into_iter().filter(ours).map(|name| directory.join(name)).collect()
}

/// Best effort: a file that cannot be removed now is found again by the next start.
fn remove_swarm(tag: &str) {
    for file in shared_memory_of(tag) {
        let _ = fs::remove_file(file);
    }
    let _ = fs::remove_dir_all(root_of(tag));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_living_swarm_is_no_leftover_and_a_dropped_one_is_gone() {
        let swarm = SwarmDirectory::create().unwrap();
        let (tag, root) = (swarm.tag().to_owned(), root_of(swarm.tag()));
        let file = Path::new(SHARED_MEMORY).join(format!("{}test", prefix_of(&tag)));
        fs::write(&file, [0; 100]).unwrap();
        assert!(root.is_dir());
        assert!(leftovers(false).unwrap().iter().all(|dead| dead.tag != tag));
        drop(swarm);
        assert!(!root.exists() && !file.exists());
    }

    #[test]
    fn one_of_two_locks_keeps_a_swarm_alive() {
        let swarm = SwarmDirectory::create().unwrap();
        assert!(is_alive(&swarm.tag).unwrap());
        // As another container sees it that shares only one of the two places.
        fs::remove_dir_all(root_of(&swarm.tag)).unwrap();
        assert!(is_alive(&swarm.tag).unwrap());
        assert!(leftovers(false).unwrap().iter().all(|dead| dead.tag != swarm.tag));
        fs::remove_file(lock_file_of(&swarm.tag)).unwrap();
        assert!(!is_alive(&swarm.tag).unwrap());
    }

    #[test]
    fn tags_are_told_from_other_names() {
        assert!(is_tag("0123abcd"));
        assert!(!is_tag("0123abc") && !is_tag("0123abcdz") && !is_tag("0123abcx"));
    }
}
