//! What a file is, told by its content.

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::base::error::{Error, Result};
use crate::base::regular;
use crate::nn::PolicyFile;
use crate::recording;

/// The kinds of file the program knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A recording or a trace.
    Recording,
    /// What the updates beside it were made with.
    Updates,
    /// A policy file.
    Policy,
    /// A state dict of PyTorch, which `import` reads.
    StateDict,
    /// Other JSON, and what it says it is.
    Json(Option<String>),
    /// Other tensors.
    Tensors,
    /// Anything else.
    Unknown,
}

impl FileKind {
    /// The kind of the file at `path`.
    pub fn of(path: &Path) -> Result<FileKind> {
        // Opening a pipe would wait for somebody to write.
        if path.metadata().map_err(|e| Error::open(path, e))?.file_type().is_fifo() {
            return Ok(FileKind::Unknown);
        }
        let mut beginning = [0; 9];
        let read = File::open(path).and_then(|mut file| read_up_to(&mut file, &mut beginning));
        let beginning = &beginning[..read.map_err(|e| Error::open(path, e))?];
        Ok(match beginning {
            _ if recording::has_magic(beginning) => FileKind::Recording,
            [b'P', b'K', 3, 4, ..] => FileKind::StateDict,
            // The length of a safetensors header, then the header.
            [length @ .., b'{'] if is_header_length(length) => match PolicyFile::read(path) {
                Ok(_) => FileKind::Policy,
                Err(_) => FileKind::Tensors,
            },
            _ if beginning.trim_ascii_start().first() == Some(&b'{') => FileKind::of_json(path)?,
            // A description of ONNX files is a text.
            _ if PolicyFile::read(path).is_ok() => FileKind::Policy,
            _ => FileKind::Unknown,
        })
    }

    fn of_json(path: &Path) -> Result<FileKind> {
        #[derive(Deserialize)]
        struct Probe {
            kind: Option<String>,
            episodes: Option<IgnoredAny>,
        }
        let bytes = regular::read(path, recording::LARGEST)?;
        let probe: Probe = serde_json::from_slice(&bytes)
            .map_err(|e| Error::io("read", path, format!("damaged JSON: {e}")))?;
        Ok(match probe {
            Probe { episodes: Some(_), .. } => FileKind::Recording,
            Probe { kind, .. } if kind.as_deref() == Some("update") => FileKind::Updates,
            Probe { kind, .. } => FileKind::Json(kind),
        })
    }
}

/// Whether these are the eight bytes of a length that a safetensors header may have.
fn is_header_length(bytes: &[u8]) -> bool {
    const LONGEST: u64 = 100_000_000;
    bytes.try_into().is_ok_and(|bytes| u64::from_le_bytes(bytes) <= LONGEST)
}

fn read_up_to(file: &mut File, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    loop {
        match file.read(&mut buffer[filled..])? {
            0 => return Ok(filled),
            read => filled += read,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let mut tensors = 2u64.to_le_bytes().to_vec();
        tensors.extend(b"{}");
        for (content, kind) in [
            (&b" {\"episodes\": []}"[..], FileKind::Recording),
            (b"{\"kind\": \"update\"}", FileKind::Updates),
            (b"{\"kind\": \"other\"}", FileKind::Json(Some("other".to_owned()))),
            (b"{\"a\": 1, \"b\": 2}", FileKind::Json(None)),
            (b"{\"meta\":{}, \"episodes\": []}", FileKind::Recording),
            (b"PK\x03\x04 and so on", FileKind::StateDict),
            (&tensors, FileKind::Tensors),
            (b"VSTRACE\n and so on", FileKind::Recording),
            (b"\x89MCAP0\r\n and so on", FileKind::Recording),
            (b"hello", FileKind::Unknown),
            (b"", FileKind::Unknown),
        ] {
            std::fs::write(&path, content).unwrap();
            assert_eq!(FileKind::of(&path).unwrap(), kind);
        }
        std::fs::write(&path, "{\"episodes\": [").unwrap();
        assert!(FileKind::of(&path).is_err());
    }
}
