//! MCAP: the trace, and beside it what [Foxglove](https://foxglove.dev) and other tools show of it. `docs/formats.md`
//! lists what is in a file.
//!
//! The trace is what a compact file holds: its header is a metadata record, each of its episodes an attachment. So it is
//! read without looking at the channels, by whatever tool these were compressed, as long as the header stands first.
//!
//! Simulated time passes: step s of the first episode is at s ticks. The next episode begins a tick after the last state
//! of the one before.

mod channels;
mod messages;
mod protobuf;
mod reader;
mod scene;
mod schemas;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::Metadata;
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, McapResult, WriteOptions, Writer};

pub(super) use reader::McapEpisodes;

use self::channels::Channels;
use super::layout::Layout;
use super::{Episode, RecordingHeader};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::environment::Task;

/// The name of the record that holds the header, and of the profile.
const NAME: &str = "vamaro-swarm";

/// Under which key.
const HEADER: &str = "header";

/// What an attachment is that holds an episode.
const MEDIA_TYPE: &str = "application/x-vamaro-swarm-episode";

/// An episode that has more bytes than this is cut into several chunks.
const CHUNK: u64 = 4 << 20;

/// Nothing is written before it is whole: a chunk that is cut off is all that a killed process leaves behind.
type Out = Writer<NoSeek<BufWriter<File>>>;

/// Writes an MCAP, which grows with each episode.
pub(crate) struct McapFile {
    out: Out,
    path: PathBuf,
    layout: Layout,
    channels: Channels,
    /// When the next episode begins, in ticks.
    ticks: u64,
    /// Bytes of an episode.
    bytes: Vec<u8>,
}

impl McapFile {
    /// Starts a file at `path`. It is there at once, and holds all that it takes to read what follows.
    ///
    /// # Errors
    /// `Usage` if the program does not know the task: nobody could read it.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<McapFile> {
        let task = Task::parse(&header.task)?;
        let file = AtomicFile::create(path)?.appear()?;
        let (path, layout) = (path.to_owned(), Layout::of(&task));
        let begin = || -> McapResult<(Out, Channels)> {
            let mut out = WriteOptions::new()
                .library(format!("{NAME} {}", env!("CARGO_PKG_VERSION")))
                .chunk_size(Some(CHUNK))
                .disable_seeking(true)
                .create(NoSeek::new(BufWriter::new(file)))?;
            let text = String::from_utf8(layout.header(header)).expect("JSON is text");
            let metadata = BTreeMap::from([(HEADER.to_owned(), text)]);
            out.write_metadata(&Metadata { name: NAME.to_owned(), metadata })?;
            let channels = Channels::create(&mut out, &task, header.rate)?;
            out.flush()?;
            Ok((out, channels))
        };
        let (out, channels) = begin().map_err(|e| failed(&path, e))?;
        Ok(McapFile { out, path, layout, channels, ticks: 0, bytes: Vec::new() })
    }

    /// Appends an episode. It is in the file when this returns.
    pub fn push(&mut self, episode: &Episode) -> Result<()> {
        self.append(episode).map_err(|e| failed(&self.path, e))
    }

    fn append(&mut self, episode: &Episode) -> McapResult<()> {
        let begins = self.channels.time(self.ticks);
        self.channels.write(&mut self.out, episode, self.ticks)?;
        self.layout.encode(episode, &mut self.bytes);
        self.out.attach(&Attachment {
            log_time: begins,
            create_time: begins,
            name: format!("episode {}", episode.episode.unwrap_or_default()),
            media_type: MEDIA_TYPE.to_owned(),
            data: (&self.bytes).into(),
        })?;
        self.ticks += episode.agent_pos.len() as u64;
        self.out.flush()
    }

    /// Ends the file, with an index of what is in it.
    pub fn finish(mut self) -> Result<()> {
        self.out.finish().map_err(|e| failed(&self.path, e))?;
        let file = self.out.into_inner().into_inner();
        let synced = file.into_inner().map_err(|e| e.into_error()).and_then(|file| file.sync_all());
        synced.map_err(|e| Error::io("write", &self.path, e))
    }
}

impl std::fmt::Debug for McapFile {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("McapFile").field("path", &self.path).finish_non_exhaustive()
    }
}

fn failed(path: &Path, error: McapError) -> Error {
    match error {
        McapError::Io(e) => Error::io("write", path, e),
        other => Error::io("write", path, other),
    }
}
