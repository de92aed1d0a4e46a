//! Files that appear whole or not at all; and those that others read while they grow.

use std::fs::{File, Permissions};
use std::io::{BufWriter, ErrorKind, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, CWD, Mode, OFlags, linkat, open};
use tempfile::TempPath;

use crate::base::error::{Error, Result};

/// What the names of files begin with that are not complete yet.
pub const PART_OF_FILE: &str = ".vamaro-swarm-";

/// A file that is put in its place when it is complete. Dropped before that, it leaves nothing, and an older file at
/// the path stays as it was. Nor does a process that is killed: until then the file has no name. (Where a file system
/// knows no files without a name it leaves the part it has written, under a name that begins with [`PART_OF_FILE`].)
#[derive(Debug)]
pub struct AtomicFile {
    writer: BufWriter<File>,
    /// The name of the part, where it must have one.
    part: Option<TempPath>,
    path: PathBuf,
}

impl AtomicFile {
    /// Starts a file that will be at `path`, or where a link at `path` leads. Fails early if the folder
    /// cannot be written, or if there is something that a file must not replace.
    pub fn create(path: &Path) -> Result<AtomicFile> {
        let path = &path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let folder = folder_of(path);
        match path.symlink_metadata() {
            Ok(there) if there.is_dir() => return Err(Error::io("write", path, "it is a folder")),
            Ok(there) if !there.is_file() => {
                return Err(Error::io("write", path, "it is a device, pipe, socket or broken link"));
            }
            _ => {}
        }
        if !folder.is_dir() {
            return Err(Error::io("write", path, format!("there is no folder {}", folder.display())));
        }
        let (file, part) = match nameless(folder) {
            Ok(file) => (file, None),
            // The error of the second attempt is the one that counts.
            Err(_) => {
                let named = named(folder).map_err(|e| Error::io("write", path, without_path(e)))?;
                (named.0, Some(named.1))
            }
        };
        Ok(AtomicFile { writer: BufWriter::new(file), part, path: path.to_owned() })
    }

    /// Writes a whole file at once.
    pub fn write(path: &Path, content: &[u8]) -> Result<()> {
        let mut file = AtomicFile::create(path)?;
        file.write_all(content).map_err(|e| Error::io("write", path, e))?;
        file.commit()
    }

    /// Where the file will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts the complete file in its place. It is there when this returns, even if the machine loses power.
    pub fn commit(self) -> Result<()> {
        self.appear().map(drop)
    }

    /// Puts the file in its place as it is, to go on writing where everybody sees it: for formats whose readers know what
    /// is not complete yet.
    pub fn appear(self) -> Result<File> {
        let path = self.path.clone();
        self.put_in_place().map_err(|e| Error::io("write", &path, without_path(e)))
    }

    fn put_in_place(self) -> std::io::Result<File> {
        let AtomicFile { writer, part, path } = self;
        let (file, folder) = (writer.into_inner().map_err(|e| e.into_error())?, folder_of(&path));
        file.sync_all()?;
        match part {
            Some(part) => part.persist(&path).map_err(|e| e.error)?,
            None => match name(&file, &path) {
                // A name cannot be given to another file but by a rename.
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {
                    let part = with_prefix().make_in(folder, |part| name(&file, part))?;
                    part.into_temp_path().persist(&path).map_err(|e| e.error)?;
                }
                named => named?,
            },
        }
        sync_folder(folder)?;
        Ok(file)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.writer.write(bytes).map_err(without_path)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.writer.flush().map_err(without_path)
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file without a name, which goes with the process.
fn nameless(folder: &Path) -> std::io::Result<File> {
    let flags = OFlags::TMPFILE | OFlags::WRONLY | OFlags::CLOEXEC;
    // What the user's umask leaves of it.
    Ok(File::from(open(folder, flags, Mode::from_raw_mode(0o666))?))
}

fn named(folder: &Path) -> std::io::Result<(File, TempPath)> {
    let file = with_prefix().permissions(Permissions::from_mode(0o666)).tempfile_in(folder)?;
    Ok(file.into_parts())
}

fn with_prefix() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PART_OF_FILE);
    builder
}

/// Gives a nameless file its first name, which nothing else may have.
fn name(file: &File, path: &Path) -> std::io::Result<()> {
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    Ok(linkat(CWD, nameless, CWD, path, AtFlags::SYMLINK_FOLLOW)?)
}

/// Has the new name on the disk. A folder that may not be listed, or a file system that does not know this, does
/// without.
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    let Ok(folder) = File::open(folder) else { return Ok(()) };
    match folder.sync_all() {
        Err(e) if e.kind() == ErrorKind::InvalidInput => Ok(()),
        synced => synced,
    }
}

/// The words alone: the name of the temporary file is of no use to anybody.
fn without_path(error: std::io::Error) -> std::io::Error {
    error.kind().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unfinished_file_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"new").unwrap();
        file.commit().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_may_grow_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "an older one").unwrap();
        let mut file = AtomicFile::create(&path).unwrap().appear().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
        file.write_all(b"more").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "more");
    }

    #[test]
    fn a_part_has_no_name_or_one_that_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let names = || std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        let mut file = AtomicFile::create(&path).unwrap();
        assert_eq!(names().count(), usize::from(file.part.is_some()));
        // As on a file system that knows no nameless files.
        let (part, name) = named(folder.path()).unwrap();
        (file.writer, file.part) = (BufWriter::new(part), Some(name));
        assert!(names().all(|name| name.to_string_lossy().starts_with(PART_OF_FILE)));
        file.write_all(b"whole").unwrap();
        file.commit().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole");
        assert_eq!(names().count(), 1);
    }

    #[test]
    fn links_are_followed_and_what_is_no_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), "old").unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        let mut file = AtomicFile::create(&at("link")).unwrap();
        file.write_all(b"new").unwrap();
        file.commit().unwrap();
        assert!(at("link").is_symlink());
        assert_eq!(std::fs::read_to_string(at("file")).unwrap(), "new");
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        assert!(AtomicFile::create(&at("socket")).is_err());
        std::os::unix::fs::symlink(at("nowhere"), at("broken")).unwrap();
        assert!(AtomicFile::create(&at("broken")).is_err());
    }

    #[test]
    fn places_that_cannot_be_written_are_found_early() {
        let folder = tempfile::tempdir().unwrap();
        assert!(AtomicFile::create(&folder.path().join("no/such/folder")).is_err());
        assert!(AtomicFile::create(folder.path()).is_err());
    }
}
