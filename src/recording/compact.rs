//! The compact format: a header, and the episodes behind it. `docs/formats.md` describes it byte by byte.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::Path;

use super::layout::{Decoder, Layout};
use super::{Episode, FORMAT_VERSION, RecordingHeader};
use crate::base::error::{Error, Result};

/// What such a file begins with.
pub(crate) const MAGIC: &[u8; 8] = b"VSTRACE\n";

/// The most bytes the header may have.
const LARGEST_HEADER: u32 = 1 << 20;

/// The beginning of a file.
pub(super) fn begin(layout: &Layout, header: &RecordingHeader) -> Vec<u8> {
    let header = layout.header(header);
    [&MAGIC[..], &FORMAT_VERSION.to_le_bytes(), &(header.len() as u32).to_le_bytes(), &header].concat()
}

/// What stands behind the last of so many episodes.
pub(super) fn end(episodes: u64) -> Vec<u8> {
    [&0u32.to_le_bytes()[..], &episodes.to_le_bytes()].concat()
}

/// The episodes of a compact file, one after the other.
pub(super) struct CompactEpisodes {
    file: BufReader<File>,
    decoder: Decoder,
    read: u64,
}

impl CompactEpisodes {
    /// Reads what stands before the episodes, behind [`MAGIC`].
    pub(super) fn open(file: File, path: &Path) -> Result<(RecordingHeader, CompactEpisodes)> {
        let failed = |what: String| Error::io("read", path, what);
        let mut file = BufReader::with_capacity(1 << 16, file);
        let mut start = [0; 16];
        read(&mut file, &mut start, "its beginning").map_err(failed)?;
        let [version, length] =
            [8, 12].map(|at| u32::from_le_bytes(start[at..at + 4].try_into().expect("four bytes")));
        if length > LARGEST_HEADER {
            return Err(failed(format!(
                "its header has {length} bytes, and {LARGEST_HEADER} is the most there can be"
            )));
        }
        let mut header = vec![0; length as usize];
        read(&mut file, &mut header, "its header").map_err(failed)?;
        let (about, decoder) = Decoder::of(&header, Some(version), path)?;
        Ok((about, CompactEpisodes { file, decoder, read: 0 }))
    }

    /// The next episode; an error in words.
    pub(super) fn next_episode(&mut self) -> std::result::Result<Option<Episode>, String> {
        let within = format!("episode {} of those in the file", self.read);
        let mut steps = [0; 4];
        read(&mut self.file, &mut steps, &within)?;
        if steps == [0; 4] {
            return self.check_end().map(|()| None);
        }
        let wrong = |what: String| format!("{within}: {what}");
        let length = self.decoder.length(u32::from_le_bytes(steps) as usize).map_err(wrong)?;
        let mut bytes = vec![0; length];
        bytes[..4].copy_from_slice(&steps);
        read(&mut self.file, &mut bytes[4..], &within)?;
        let episode = self.decoder.decode(&bytes).map_err(wrong)?;
        self.read += 1;
        Ok(Some(episode))
    }

    fn check_end(&mut self) -> std::result::Result<(), String> {
        let mut episodes = [0; 8];
        read(&mut self.file, &mut episodes, "its end")?;
        let (expected, found) = (u64::from_le_bytes(episodes), self.read);
        let rest = self.file.read(&mut [0]).map_err(|e| e.to_string())?;
        match rest {
            _ if expected != found => {
                Err(format!("it ends after {found} episodes, and says that it has {expected}"))
            }
            0 => Ok(()),
            _ => Err("there is something behind its end".to_owned()),
        }
    }
}

/// Fills the buffer, or says where the file ends instead.
fn read(file: &mut impl Read, buffer: &mut [u8], within: &str) -> std::result::Result<(), String> {
    file.read_exact(buffer).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => format!("the file is cut off within {within}; copy it again"),
        _ => e.to_string(),
    })
}
