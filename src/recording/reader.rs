//! Recordings of any format, read episode by episode.

use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use super::compact::{self, CompactEpisodes};
#[cfg(feature = "mcap")]
use super::mcap::McapEpisodes;
use super::{Episode, LARGEST, Recording, RecordingHeader, Versions};
use crate::base::error::{Error, Result};
use crate::base::regular;

/// An open recording or trace. What format it has its first bytes tell.
pub(crate) struct Reader {
    pub(crate) header: RecordingHeader,
    path: PathBuf,
    episodes: Episodes,
    is_over: bool,
}

enum Episodes {
    /// JSON, which is read whole.
    Whole {
        episodes: std::vec::IntoIter<Episode>,
        is_trace: bool,
    },
    Compact(CompactEpisodes),
    #[cfg(feature = "mcap")]
    Mcap(Box<McapEpisodes>),
}

/// Whether a file with these first bytes is a recording that is no JSON.
pub(crate) fn has_magic(beginning: &[u8]) -> bool {
    beginning.starts_with(compact::MAGIC) || beginning.starts_with(MCAP)
}

/// What an MCAP begins with.
const MCAP: &[u8; 8] = b"\x89MCAP0\r\n";

impl Reader {
    /// Opens the recording or trace at `path`.
    pub(crate) fn open(path: &Path) -> Result<Reader> {
        let mut file = regular::open(path)?;
        regular::check(&file, path)?;
        let unreadable = |e| Error::io("read", path, e);
        let mut beginning = Vec::new();
        (&mut file).take(8).read_to_end(&mut beginning).map_err(unreadable)?;
        file.rewind().map_err(unreadable)?;
        let path = path.to_owned();
        if beginning == compact::MAGIC {
            let (header, episodes) = CompactEpisodes::open(file, &path)?;
            return Ok(Reader { header, path, episodes: Episodes::Compact(episodes), is_over: false });
        }
        if beginning == MCAP {
            #[cfg(feature = "mcap")]
            let (header, episodes) = McapEpisodes::open(file, &path)?;
            #[cfg(feature = "mcap")]
            return Ok(Reader { header, path, episodes: Episodes::Mcap(Box::new(episodes)), is_over: false });
            #[cfg(not(feature = "mcap"))]
            return Err(Error::io("read", &path, "this program was built without the feature `mcap`"));
        }
        let Recording { mut header, episodes } = read_json(&path)?;
        // Older files do not say; those of agents that relay do, and have ages that are no delays.
        let longest_delay = episodes.iter().map(Episode::longest_delay).max().unwrap_or_default();
        if !header.relay {
            header.longest_delay = header.longest_delay.max(longest_delay);
        }
        let is_trace = episodes.iter().any(|episode| !episode.joint_estimate.is_empty());
        let episodes = Episodes::Whole { episodes: episodes.into_iter(), is_trace };
        Ok(Reader { header, path, episodes, is_over: false })
    }

    /// Whether the agents' side is recorded as well.
    pub(crate) fn is_trace(&self) -> bool {
        match &self.episodes {
            Episodes::Whole { is_trace, .. } => *is_trace,
            _ => true,
        }
    }

    /// Whether what agents observed and thought has to be computed again. What they observed, reading does.
    pub(crate) fn is_compact(&self) -> bool {
        !matches!(self.episodes, Episodes::Whole { .. })
    }

    /// What to say of a file whose episodes are all read, and which was never finished.
    pub(crate) fn unfinished(&self) -> Option<&'static str> {
        match &self.episodes {
            #[cfg(feature = "mcap")]
            Episodes::Mcap(episodes) if episodes.is_cut() => Some(
                "it has no end: whoever records it was killed, or still does; the episodes that are whole are read",
            ),
            _ => None,
        }
    }
}

impl Iterator for Reader {
    type Item = Result<Episode>;

    fn next(&mut self) -> Option<Result<Episode>> {
        if self.is_over {
            return None;
        }
        let next = match &mut self.episodes {
            Episodes::Whole { episodes, .. } => Ok(episodes.next()),
            Episodes::Compact(episodes) => episodes.next_episode(),
            #[cfg(feature = "mcap")]
            Episodes::Mcap(episodes) => episodes.next_episode(),
        };
        // Behind an error there is nothing that can be trusted.
        self.is_over = !matches!(next, Ok(Some(_)));
        next.map_err(|what| Error::io("read", &self.path, what)).transpose()
    }
}

/// Reads a recording that is JSON.
fn read_json(path: &Path) -> Result<Recording> {
    let text = regular::read(path, LARGEST)?;
    let recording: serde_json::Result<Recording> = serde_json::from_slice(&text);
    // What is newer may look otherwise, too.
    let versions: Option<Versions> = match &recording {
        Ok(Recording { header: RecordingHeader { format_version, version, .. }, .. }) => {
            Some(Versions { format_version: *format_version, version: version.clone() })
        }
        Err(_) => serde_json::from_slice(&text).ok(),
    };
    versions.map_or(Ok(()), Versions::check).map_err(|what| Error::io("read", path, what))?;
    let recording =
        recording.map_err(|e| Error::io("read", path, format!("it is not a recording or trace: {e}")))?;
    recording.check().map_err(|what| Error::io("read", path, what))?;
    Ok(recording)
}
