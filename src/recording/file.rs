//! Writing a recording, in any format.

use std::io::Write;
use std::path::Path;

use super::compact;
use super::layout::Layout;
#[cfg(feature = "mcap")]
use super::mcap::McapFile;
use super::{Episode, RecordingHeader};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::environment::Task;

/// How a recording is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// For other programs: everything, as text.
    Json,
    /// For other tools: the trace, and beside it what they show.
    Mcap,
    /// For long runs.
    Compact,
}

impl Format {
    /// That of a recording of this name.
    pub(crate) fn of(path: &Path) -> Format {
        let ends_in = |ending| path.extension().is_some_and(|it| it.eq_ignore_ascii_case(ending));
        match () {
            () if ends_in("json") => Format::Json,
            () if ends_in("mcap") => Format::Mcap,
            () => Format::Compact,
        }
    }
}

/// Writes a recording, episode by episode. The file appears when it is finished, but for MCAP, which grows with each
/// episode.
#[derive(Debug)]
pub(crate) enum RecordingFile {
    Json {
        file: AtomicFile,
        episodes: u64,
    },
    #[cfg(feature = "mcap")]
    Mcap(Box<McapFile>),
    Compact {
        file: AtomicFile,
        layout: Layout,
        episodes: u64,
        /// Those of an episode.
        bytes: Vec<u8>,
    },
}

impl RecordingFile {
    /// Starts a recording at `path`, in the format that its name tells.
    ///
    /// # Errors
    /// `Usage` if it would not be JSON, and is of a task that the program does not know: nobody could read it.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<RecordingFile> {
        Ok(match Format::of(path) {
            Format::Json => {
                let header = serde_json::to_string(header).expect("a header is plain data");
                let open = header.strip_suffix('}').expect("a struct is a JSON object");
                let mut file = AtomicFile::create(path)?;
                write(&mut file, format!("{open},\"episodes\":[").as_bytes())?;
                RecordingFile::Json { file, episodes: 0 }
            }
            #[cfg(feature = "mcap")]
            Format::Mcap => RecordingFile::Mcap(Box::new(McapFile::create(path, header)?)),
            #[cfg(not(feature = "mcap"))]
            Format::Mcap => {
                return Err(crate::usage!(
                    "{}: this program was built without the feature `mcap`; choose a name that ends in .json or .trace",
                    path.display()
                ));
            }
            Format::Compact => {
                let layout = Layout::of(&Task::parse(&header.task)?);
                let mut file = AtomicFile::create(path)?;
                write(&mut file, &compact::begin(&layout, header))?;
                RecordingFile::Compact { file, layout, episodes: 0, bytes: Vec::new() }
            }
        })
    }

    /// The format it is written in.
    pub fn format(&self) -> Format {
        match self {
            RecordingFile::Json { .. } => Format::Json,
            #[cfg(feature = "mcap")]
            RecordingFile::Mcap(_) => Format::Mcap,
            RecordingFile::Compact { .. } => Format::Compact,
        }
    }

    /// Appends an episode.
    pub fn push(&mut self, episode: &Episode) -> Result<()> {
        match self {
            RecordingFile::Json { file, episodes } => {
                let written = writeln!(file, "{}", if *episodes == 0 { "" } else { "," })
                    .and_then(|()| serde_json::to_writer(&mut *file, episode).map_err(std::io::Error::from));
                *episodes += 1;
                written.map_err(|e| Error::io("write", file.path(), e))
            }
            #[cfg(feature = "mcap")]
            RecordingFile::Mcap(file) => file.push(episode),
            RecordingFile::Compact { file, layout, episodes, bytes } => {
                layout.encode(episode, bytes);
                *episodes += 1;
                write(file, bytes)
            }
        }
    }

    /// Ends the recording, and puts it in its place.
    pub fn finish(self) -> Result<()> {
        match self {
            RecordingFile::Json { mut file, .. } => {
                write(&mut file, b"\n]}\n")?;
                file.commit()
            }
            #[cfg(feature = "mcap")]
            RecordingFile::Mcap(file) => file.finish(),
            RecordingFile::Compact { mut file, episodes, .. } => {
                write(&mut file, &compact::end(episodes))?;
                file.commit()
            }
        }
    }
}

fn write(file: &mut AtomicFile, bytes: &[u8]) -> Result<()> {
    file.write_all(bytes).map_err(|e| Error::io("write", file.path(), e))
}
