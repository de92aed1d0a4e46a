//! Where a swarm lives on this machine, and how everything of it goes away.
//!
//! A swarm has a tag of eight hex digits, a directory of that name in a [`Place`] for iceoryx2's sockets and
//! bookkeeping, and shared memory named `vs_<tag>_..`, that of its guests `vs_<tag>-..`. As long as its supervisor lives it holds a lock on the directory
//! and one on the file `vs_<tag>_lock` in shared memory, so a swarm without a lock is dead. There are two because
//! containers may share either place and not the other.

use std::collections::BTreeSet;
use std::fs::{self, DirBuilder, File, Permissions};
use std::hash::{BuildHasher, RandomState};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use rustix::fs::{AtFlags, CWD, FlockOperation, Mode, OFlags, flock, linkat, open};

use super::place::{Lock, Place, is_ours, locked};
use crate::base::error::{Error, Result};
use crate::failed;

pub(super) const SHARED_MEMORY: &str = "/dev/shm";
const TAG_DIGITS: usize = 8;

/// The directory of a living swarm. Dropping it removes all the swarm left on the machine.
#[derive(Debug)]
pub struct SwarmDirectory {
    tag: String,
    /// Keeps the lock.
    _locked: File,
    /// Keeps the other lock. Its length says how much shared memory the swarm may come to use.
    pub(super) in_memory: File,
}

impl SwarmDirectory {
    /// Cleans up after dead swarms and makes a directory for a new one.
    pub fn create() -> Result<SwarmDirectory> {
        let places = LockedPlaces::take()?;
        for leftover in places.dead_swarms()? {
            places.remove(&leftover.tag);
        }
        let tag = format!("{:08x}", RandomState::new().hash_one(std::process::id()) as u32);
        let path = root_of(&tag);
        let made = DirBuilder::new().mode(0o700).create(&path);
        made.map_err(|e| Error::io("create the directory", &path, e))?;
        let Lock::Free(locked) = locked(&path)? else {
            return Err(failed!("{} is in use", path.display()));
        };
        let in_memory = lock_file_of(&tag);
        let in_memory = create_locked(&in_memory).map_err(|e| Error::io("create", &in_memory, e))?;
        Ok(SwarmDirectory { tag, _locked: locked, in_memory })
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
        remove_shared_memory(&self.tag);
        // Best effort: what cannot be removed now is found again by the next start.
        let _ = fs::remove_dir_all(self.path());
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

/// The leftovers of this user's dead swarms, which are removed if `clean` is set.
pub fn leftovers(clean: bool) -> Result<Vec<Leftover>> {
    let places = LockedPlaces::take()?;
    let dead = places.dead_swarms()?;
    if clean {
        dead.iter().for_each(|leftover| places.remove(&leftover.tag));
    }
    Ok(dead)
}

/// An error if a swarm could not put its files where they belong.
pub fn check_writable() -> Result<()> {
    place().make()?;
    for folder in [Path::new(SHARED_MEMORY), place().path()] {
        tempfile::tempfile_in(folder)
            .map_err(|e| Error::io("write to", folder, std::io::Error::from(e.kind())))?;
    }
    Ok(())
}

/// Where the directories of the swarms are that this process starts or belongs to. It does not move.
pub(crate) fn place() -> &'static Place {
    static PLACE: OnceLock<Place> = OnceLock::new();
    PLACE.get_or_init(Place::for_new)
}

pub(super) fn root_of(tag: &str) -> PathBuf {
    place().path().join(tag)
}

/// The prefix of a swarm's shared memory: of fixed length and not ending in a digit, so that no
/// swarm's prefix is the beginning of another's.
pub(super) fn prefix_of(tag: &str) -> String {
    format!("vs_{tag}_")
}

/// That of its guests, which is not the beginning of the swarm's either.
pub(super) fn guests_prefix_of(tag: &str) -> String {
    format!("vs_{tag}-")
}

/// Takes from others what iceoryx2 gives them: it lets every user count up its nodes, with us as with everybody.
pub(super) fn keep_to_this_user(tag: &str) -> Result<()> {
    for path in shared_memory_of(tag) {
        let others = fs::metadata(&path).map(|about| about.mode() & 0o077).unwrap_or_default();
        if others != 0 {
            let closed = fs::set_permissions(&path, Permissions::from_mode(0o600));
            closed.map_err(|e| Error::io("keep others from", &path, e))?;
        }
    }
    Ok(())
}

/// The places of this user that are there, all locked, so that no swarm in the making is taken for dead.
pub(super) struct LockedPlaces {
    places: Vec<Place>,
    _locks: Vec<File>,
}

impl LockedPlaces {
    pub(super) fn take() -> Result<LockedPlaces> {
        place().make()?;
        let mut places = place().and_others();
        // What is not ours in another place is nobody's swarm that we could clean up after.
        places.retain(|other| other == place() || other.check().is_ok());
        // Everybody in the same order.
        places.sort_by(|a, b| a.path().cmp(b.path()));
        let locks = places.iter().map(Place::lock).collect::<Result<_>>()?;
        Ok(LockedPlaces { places, _locks: locks })
    }

    fn dead_swarms(&self) -> Result<Vec<Leftover>> {
        let mut dead = Vec::new();
        for tag in self.tags() {
            if self.is_alive(&tag)? {
                continue;
            }
            let files = shared_memory_of(&tag);
            // Its supervisor may have removed it in the meantime.
            if !files.is_empty() || self.roots(&tag).any(|root| root.exists()) {
                dead.push(Leftover { bytes: bytes_of(&tag), tag, files: files.len() });
            }
        }
        Ok(dead)
    }

    /// The tags of all swarms of which there is anything.
    pub(super) fn tags(&self) -> BTreeSet<String> {
        let names = self.places.iter().flat_map(|place| names_in(place.path()));
        let tags = names.filter(|name| is_tag(name));
        tags.chain(tags_in_memory()).collect()
    }

    /// One of the locks is enough.
    fn is_alive(&self, tag: &str) -> Result<bool> {
        for path in self.roots(tag).chain([lock_file_of(tag)]) {
            if matches!(locked(&path)?, Lock::Held) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Where its directory can be.
    pub(super) fn roots(&self, tag: &str) -> impl Iterator<Item = PathBuf> {
        self.places.iter().map(move |place| place.path().join(tag))
    }

    /// Best effort: what cannot be removed now is found again by the next start.
    fn remove(&self, tag: &str) {
        remove_shared_memory(tag);
        for root in self.roots(tag) {
            let _ = fs::remove_dir_all(root);
        }
    }
}

pub(super) fn lock_file_of(tag: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(format!("{}lock", prefix_of(tag)))
}

/// Makes a file that is locked before anybody can see it: those who look may hold the lock of another place.
fn create_locked(path: &Path) -> rustix::io::Result<File> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(open(folder, flags, Mode::RUSR | Mode::WUSR)?);
    flock(&file, FlockOperation::NonBlockingLockExclusive)?;
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    linkat(CWD, nameless, CWD, path, AtFlags::SYMLINK_FOLLOW)?;
    Ok(file)
}

/// The tags of this user's swarms that have shared memory.
pub(super) fn tags_in_memory() -> BTreeSet<String> {
    let names = names_in(Path::new(SHARED_MEMORY)).into_iter();
    let ours = |name: &String| is_ours(&Path::new(SHARED_MEMORY).join(name));
    names.filter(ours).filter_map(|name| tag_in(&name).map(str::to_owned)).collect()
}

/// The tag in the name of a swarm's shared memory.
pub(super) fn tag_in(name: &str) -> Option<&str> {
    let tag = name.strip_prefix("vs_")?.split_once(['_', '-'])?.0;
    Some(tag).filter(|tag| is_tag(tag))
}

/// Whether a name can be the tag of a swarm.
pub(crate) fn is_tag(name: &str) -> bool {
    name.len() == TAG_DIGITS && name.bytes().all(|b| b.is_ascii_hexdigit())
}

pub(super) fn names_in(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

/// The files of a swarm in shared memory, those of its guests included.
pub(super) fn shared_memory_of(tag: &str) -> Vec<PathBuf> {
    [prefix_of(tag), guests_prefix_of(tag)].iter().flat_map(|prefix| named(prefix)).collect()
}

/// The files of this user in shared memory whose names begin with `prefix`.
pub(super) fn named(prefix: &str) -> Vec<PathBuf> {
    let directory = Path::new(SHARED_MEMORY);
    let names = names_in(directory).into_iter().filter(|name| name.starts_with(prefix));
    names.map(|name| directory.join(name)).filter(|path| is_ours(path)).collect()
}

/// The shared memory that a swarm takes, in bytes.
pub(super) fn bytes_of(tag: &str) -> u64 {
    let files = shared_memory_of(tag).into_iter().filter_map(|file| fs::symlink_metadata(file).ok());
    files.map(|about| about.blocks() * 512).sum()
}

fn remove_shared_memory(tag: &str) {
    for file in shared_memory_of(tag) {
        let _ = fs::remove_file(file);
    }
}

#[cfg(test)]
mod tests {
    use rustix::fs::{FileType, mknodat};

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
        let is_alive = |tag: &str| LockedPlaces::take().unwrap().is_alive(tag).unwrap();
        assert!(is_alive(&swarm.tag));
        // As another container sees it that shares only one of the two places.
        fs::remove_dir_all(root_of(&swarm.tag)).unwrap();
        assert!(is_alive(&swarm.tag));
        assert!(leftovers(false).unwrap().iter().all(|dead| dead.tag != swarm.tag));
        fs::remove_file(lock_file_of(&swarm.tag)).unwrap();
        assert!(!is_alive(&swarm.tag));
    }

    #[test]
    fn a_pipe_in_the_place_of_a_lock_is_a_leftover() {
        let tag = "00f1f000";
        let path = lock_file_of(tag);
        mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert!(leftovers(false).unwrap().iter().any(|dead| dead.tag == tag));
        drop(SwarmDirectory::create().unwrap());
        assert!(!path.exists());
    }

    #[test]
    fn tags_are_told_from_other_names() {
        assert!(is_tag("0123abcd"));
        assert!(!is_tag("0123abc") && !is_tag("0123abcdz") && !is_tag("0123abcx"));
    }
}
