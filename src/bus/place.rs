//! Where a user's swarms have their directories: under `XDG_RUNTIME_DIR`, or in `/tmp`.
//!
//! Whoever may write there could put a swarm of his own in our way, so a place counts only if it belongs to this user
//! and nobody else may write to it.

use std::fs::{self, DirBuilder, File};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};

use crate::base::error::{Error, Result};
use crate::failed;

/// The variable that names a folder of this user, which goes when the user logs out.
const VARIABLE: &str = "XDG_RUNTIME_DIR";

/// The longest path of a place: a socket's has at most 107 bytes, of which its swarm and its port take 67.
const LONGEST: usize = 40;

/// A folder in which the directories of swarms are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    path: PathBuf,
    /// Why it is not under `XDG_RUNTIME_DIR`, although that is set.
    pub(crate) instead: Option<String>,
}

impl Place {
    /// The one for new swarms. Agents find the same, since they have the environment of their supervisor.
    pub(crate) fn for_new() -> Place {
        let variable = std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty());
        let Some(folder) = variable.map(PathBuf::from) else { return Place::in_tmp(None) };
        match under(&folder) {
            Ok(path) => Place { path, instead: None },
            Err(why) => Place::in_tmp(Some(format!("{VARIABLE} is {}, which {why}", folder.display()))),
        }
    }

    /// All in which swarms of this user can be, whatever the environment of those who started them: this one first.
    pub(super) fn and_others(&self) -> Vec<Place> {
        let (mut places, user) = (vec![self.clone()], user());
        let usual = under(Path::new(&format!("/run/user/{user}"))).map(|path| Place { path, instead: None });
        for other in usual.into_iter().chain([Place::in_tmp(None)]) {
            if places.iter().all(|place| place.path != other.path) {
                places.push(other);
            }
        }
        places
    }

    // Not the configurable temporary directory: its path may be too long for a socket.
    fn in_tmp(instead: Option<String>) -> Place {
        Place { path: PathBuf::from(format!("/tmp/vamaro-swarm-{}", user())), instead }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Makes the folder, where there is none.
    pub(crate) fn make(&self) -> Result<()> {
        match DirBuilder::new().mode(0o700).create(&self.path) {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                Err(Error::io("create the directory", &self.path, e))
            }
            _ => self.check(),
        }
    }

    /// An error if the folder is not ours alone.
    pub(super) fn check(&self) -> Result<()> {
        let found = fs::symlink_metadata(&self.path).map_err(|e| Error::io("look at", &self.path, e))?;
        let (shown, remedy) =
            (self.path.display(), format!("or set {VARIABLE} to a folder of your own (mode 700)"));
        if !found.is_dir() {
            return Err(failed!(
                "{shown} is no folder but a link or a file, made by user {}; have it removed, {remedy}",
                found.uid()
            ));
        }
        if found.uid() != user() {
            return Err(failed!(
                "{shown} belongs to user {}, who would see your swarms; have it removed, {remedy}",
                found.uid()
            ));
        }
        if found.mode() & 0o077 != 0 {
            return Err(failed!(
                "{shown} has mode {:o}, so others could get at your swarms; remove it, {remedy}",
                found.mode() & 0o777
            ));
        }
        Ok(())
    }

    /// Held while swarms are created or cleaned up here, so that nobody takes one in the making for dead.
    pub(super) fn lock(&self) -> Result<File> {
        self.check()?;
        let deadline = Instant::now() + Duration::from_secs(10);
        loop {
            match locked(&self.path)? {
                Lock::Free(lock) => return Ok(lock),
                _ if Instant::now() > deadline => {
                    return Err(failed!("{} has been locked for 10 s by another swarm", self.path.display()));
                }
                _ => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }
}

/// What a look at a lock finds.
#[derive(Debug)]
pub(super) enum Lock {
    /// It was free, and is ours now.
    Free(File),
    /// Somebody holds it.
    Held,
    /// It is not there, or something that this user has not made as a lock.
    None,
}

/// Takes the lock on a folder or file. Nothing that lies there, such as a pipe, makes this wait.
pub(super) fn locked(path: &Path) -> Result<Lock> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let file = match open(path, flags, Mode::empty()) {
        Ok(file) => File::from(file),
        Err(rustix::io::Errno::NOENT | rustix::io::Errno::LOOP | rustix::io::Errno::NXIO) => {
            return Ok(Lock::None);
        }
        Err(_) if !is_ours(path) => return Ok(Lock::None),
        Err(e) => return Err(Error::io("open", path, e)),
    };
    let about = file.metadata().map_err(|e| Error::io("look at", path, e))?;
    if about.uid() != user() || !(about.is_dir() || about.is_file()) {
        return Ok(Lock::None);
    }
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Lock::Free(file)),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(Lock::Held),
        Err(e) => Err(Error::io("lock", path, e)),
    }
}

/// Whether this user has made what is at `path`; a link is what it is, not where it leads.
pub(super) fn is_ours(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|about| about.uid() == user())
}

fn user() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// The place in a folder that was named as this user's; or what it is that forbids it.
fn under(folder: &Path) -> std::result::Result<PathBuf, String> {
    let path = folder.join("vamaro-swarm");
    if !folder.is_absolute() {
        return Err("is no absolute path".to_owned());
    }
    if path.as_os_str().len() > LONGEST {
        return Err(format!(
            "is longer than {} bytes, too long for a socket in it",
            LONGEST - "/vamaro-swarm".len()
        ));
    }
    let about = fs::metadata(folder).map_err(|e| format!("cannot be used: {e}"))?;
    match about {
        about if !about.is_dir() => Err("is no folder".to_owned()),
        about if about.uid() != user() => Err(format!("belongs to user {}", about.uid())),
        about if about.mode() & 0o022 != 0 => Err("others may write to".to_owned()),
        _ => Ok(path),
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use rustix::fs::{CWD, FileType, mknodat};

    use super::*;

    fn at(path: PathBuf) -> Place {
        Place { path, instead: None }
    }

    #[test]
    fn a_place_is_ours_alone() {
        let folder = tempfile::tempdir().unwrap();
        let place = at(folder.path().join("place"));
        place.make().unwrap();
        assert_eq!(fs::metadata(place.path()).unwrap().mode() & 0o777, 0o700);
        assert!(place.lock().is_ok());
        fs::set_permissions(place.path(), fs::Permissions::from_mode(0o777)).unwrap();
        for error in [place.make().unwrap_err(), place.lock().map(drop).unwrap_err()] {
            let error = error.to_string();
            assert!(error.contains("mode 777") && error.contains(VARIABLE), "{error}");
        }
        let link = at(folder.path().join("link"));
        std::os::unix::fs::symlink(folder.path(), link.path()).unwrap();
        assert!(link.make().unwrap_err().to_string().contains("have it removed"));
    }

    #[test]
    fn what_a_variable_names_must_be_fit_for_it() {
        let folder = tempfile::Builder::new().prefix("vs-").tempdir_in("/tmp").unwrap();
        assert_eq!(under(folder.path()), Ok(folder.path().join("vamaro-swarm")));
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o770)).unwrap();
        assert!(under(folder.path()).unwrap_err().contains("others may write"));
        assert!(under(&folder.path().join("none")).unwrap_err().contains("cannot be used"));
        assert!(under(Path::new("/tmp/as/long/as/a/path/should/not/be")).unwrap_err().contains("too long"));
        assert!(under(Path::new("run")).unwrap_err().contains("absolute"));
    }

    #[test]
    fn what_is_no_lock_is_none_and_nobody_waits_for_it() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(folder.path(), &link).unwrap();
        for path in [pipe, link, folder.path().join("nothing")] {
            assert!(matches!(locked(&path), Ok(Lock::None)), "{}", path.display());
        }
        let Ok(Lock::Free(held)) = locked(folder.path()) else { panic!("nobody else holds it") };
        assert!(matches!(locked(folder.path()), Ok(Lock::Held)));
        drop(held);
    }
}
