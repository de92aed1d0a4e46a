//! Files from outside, read whole: no device that never ends, no pipe that keeps us waiting, no more bytes than a limit.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;

use crate::base::error::{Error, Result};

/// How long the writer of a pipe may take.
const PATIENCE: Duration = Duration::from_secs(1);

/// The bytes of the regular file at `path`, which may have `limit` of them.
///
/// # Errors
/// `Usage` if there is no such file; `File` if it is something else, larger, or cannot be read.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let mut file = open(path)?;
    check(&file, path)?;
    read_up_to(&mut file, path, limit)
}

/// The first bytes of the regular file at `path`, at most so many.
pub(crate) fn beginning(path: &Path, bytes: u64) -> Result<Vec<u8>> {
    let file = open(path)?;
    check(&file, path)?;
    let mut beginning = Vec::new();
    file.take(bytes).read_to_end(&mut beginning).map_err(|e| Error::io("read", path, e))?;
    Ok(beginning)
}

/// The text of the regular file at `path`, which may have `limit` bytes.
pub(crate) fn read_text(path: &Path, limit: u64) -> Result<String> {
    text(read(path, limit)?, path)
}

/// As [`read_text`]; the file may also be a pipe whose other end is written and closed at once.
pub(crate) fn read_text_or_pipe(path: &Path, limit: u64) -> Result<String> {
    let mut file = open(path)?;
    let about = file.metadata().map_err(|e| Error::io("read", path, e))?;
    let bytes = if about.file_type().is_fifo() {
        read_pipe(&mut file, path, limit)?
    } else {
        check(&file, path)?;
        read_up_to(&mut file, path, limit)?
    };
    text(bytes, path)
}

/// Opens the regular file at `path` to read and to append; creates it if it is missing.
pub(crate) fn append(path: &Path) -> Result<File> {
    let mut options = OpenOptions::new();
    let file = options.read(true).append(true).create(true).custom_flags(at_once()).open(path);
    let file = file.map_err(|e| Error::io("write", path, e))?;
    check(&file, path)?;
    Ok(file)
}

/// An error if what is open is not a regular file.
pub(crate) fn check(file: &File, path: &Path) -> Result<()> {
    let about = file.metadata().map_err(|e| Error::io("read", path, e))?;
    match about.file_type() {
        kind if kind.is_file() => Ok(()),
        kind if kind.is_dir() => Err(Error::io("read", path, "it is a folder; name a file")),
        _ => Err(Error::io("read", path, "it is a device or a pipe; name a regular file")),
    }
}

/// Opens without waiting for the other end of a pipe.
pub(crate) fn open(path: &Path) -> Result<File> {
    let file = OpenOptions::new().read(true).custom_flags(at_once()).open(path);
    file.map_err(|e| Error::open(path, e))
}

fn at_once() -> i32 {
    (OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32
}

fn read_up_to(file: &mut File, path: &Path, limit: u64) -> Result<Vec<u8>> {
    let unreadable = |e| Error::io("read", path, e);
    let size = file.metadata().map_err(unreadable)?.len();
    // It may grow while it is read.
    let mut bytes = Vec::with_capacity(size.min(limit) as usize);
    file.take(limit + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > limit {
        return Err(too_large(path, limit));
    }
    Ok(bytes)
}

fn read_pipe(pipe: &mut File, path: &Path, limit: u64) -> Result<Vec<u8>> {
    let (mut bytes, mut part, deadline) = (Vec::new(), [0; 4096], Instant::now() + PATIENCE);
    while bytes.len() as u64 <= limit {
        let left = deadline.saturating_duration_since(Instant::now());
        let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
        match poll(&mut [PollFd::new(pipe, PollFlags::IN)], Some(&left)) {
            Ok(0) => {
                return Err(Error::io("read", path, format!("the pipe has not ended after {PATIENCE:?}")));
            }
            Err(rustix::io::Errno::INTR) => continue,
            Err(e) => return Err(Error::io("read", path, e)),
            Ok(_) => {}
        }
        match pipe.read(&mut part) {
            Ok(0) => return Ok(bytes),
            Ok(read) => bytes.extend(&part[..read]),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(e) => return Err(Error::io("read", path, e)),
        }
    }
    Err(too_large(path, limit))
}

fn too_large(path: &Path, limit: u64) -> Error {
    Error::io("read", path, format!("it is larger than {limit} bytes, the most that such a file may have"))
}

fn text(bytes: Vec<u8>, path: &Path) -> Result<String> {
    String::from_utf8(bytes).map_err(|_| Error::io("read", path, "it is not text in UTF-8"))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        for path in [&pipe, Path::new("/dev/zero"), folder.path()] {
            let error = read(path, 10).unwrap_err().to_string();
            assert!(error.contains(&path.display().to_string()) && error.contains("it is a"), "{error}");
        }
        assert!(append(&pipe).is_err() && append(Path::new("/dev/full")).is_err());
        assert!(read_text_or_pipe(Path::new("/dev/zero"), 10).is_err());
        assert!(matches!(read(&folder.path().join("nothing"), 10), Err(Error::Usage(_))));
    }

    #[test]
    fn files_have_a_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "0123456789").unwrap();
        assert_eq!(read_text(&path, 10).unwrap(), "0123456789");
        assert_eq!(read_text_or_pipe(&path, 10).unwrap(), "0123456789");
        assert!(read(&path, 9).unwrap_err().to_string().contains("larger than 9 bytes"));
        std::fs::write(&path, b"\xff").unwrap();
        assert!(read_text(&path, 10).unwrap_err().to_string().contains("UTF-8"));
    }

    #[test]
    fn pipes_are_read_to_their_end() {
        use std::os::fd::AsRawFd;
        let read_from = |keep: bool, content: &'static [u8]| {
            let (reader, mut writer) = std::io::pipe().unwrap();
            writer.write_all(content).unwrap();
            let kept = keep.then_some(writer);
            let path = format!("/proc/self/fd/{}", reader.as_raw_fd());
            let text = read_text_or_pipe(Path::new(&path), 10);
            drop(kept);
            text.map_err(|e| e.to_string())
        };
        assert_eq!(read_from(false, b"a = 1"), Ok("a = 1".to_owned()));
        assert!(read_from(false, b"more than ten").unwrap_err().contains("larger than 10 bytes"));
        assert!(read_from(true, b"a = 1").unwrap_err().contains("has not ended"));
    }
}
