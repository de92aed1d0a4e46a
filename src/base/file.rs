//! Files that appear whole or not at all.

use std::fs::Permissions;
use std::io::{BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::base::error::{Error, Result};

/// What the names of files begin with that are not complete yet.
pub const PART_OF_FILE: &str = ".vamaro-swarm-";

/// A file that is written beside its path and renamed when complete. Dropped before that, it leaves
/// nothing, and an older file at the path stays as it was. (A process that is killed leaves the part it
/// has written, under a name that begins with [`PART_OF_FILE`].)
#[derive(Debug)]
pub struct AtomicFile {
    writer: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl AtomicFile {
    /// Starts a file that will be at `path`, or where a link at `path` leads. Fails early if the folder
    /// cannot be written, or if there is something that a file must not replace.
    pub fn create(path: &Path) -> Result<AtomicFile> {
        let path = &path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
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
        let file = tempfile::Builder::new()
            .prefix(PART_OF_FILE)
            // What the user's umask leaves of it.
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder)
            .map_err(|e| Error::io("write", path, without_path(e)))?;
        Ok(AtomicFile { writer: BufWriter::new(file), path: path.to_owned() })
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

    /// Puts the complete file in its place.
    pub fn commit(self) -> Result<()> {
        let AtomicFile { writer, path } = self;
        let file = writer
            .into_inner()
            .map_err(|e| Error::io("write", &path, std::io::Error::from(e.error().kind())))?;
        file.as_file().sync_all().map_err(|e| Error::io("write", &path, std::io::Error::from(e.kind())))?;
        file.persist(&path)
            .map(drop)
            .map_err(|e| Error::io("write", &path, std::io::Error::from(e.error.kind())))
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
