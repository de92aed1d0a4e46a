//! Writing a recording, in either format.

use std::io::Write;
use std::path::Path;

use super::compact::Layout;
use super::{Episode, RecordingHeader};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::environment::Task;

/// Whether a recording of this name is JSON. All others are compact.
pub(crate) fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Writes a recording, episode by episode. The file appears when it is finished.
#[derive(Debug)]
pub(crate) struct RecordingFile {
    file: AtomicFile,
    episodes: u64,
    /// That of a compact file, and an episode in it; `None` for JSON.
    compact: Option<(Layout, Vec<u8>)>,
}

impl RecordingFile {
    /// Starts a recording at `path`, in the format that its name tells.
    ///
    /// # Errors
    /// `Usage` if it would be compact, and is of a task that the program does not know: nobody could read it.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<RecordingFile> {
        let task = (!is_json(path)).then(|| Task::parse(&header.task)).transpose()?;
        let compact = task.map(|task| (Layout::of(&task), Vec::new()));
        let mut recorder = RecordingFile { file: AtomicFile::create(path)?, episodes: 0, compact };
        let beginning = match &recorder.compact {
            Some((layout, _)) => layout.begin(header),
            None => {
                let header = serde_json::to_string(header).expect("a header is plain data");
                let open = header.strip_suffix('}').expect("a struct is a JSON object");
                format!("{open},\"episodes\":[").into_bytes()
            }
        };
        recorder.write(&beginning)?;
        Ok(recorder)
    }

    /// Whether it holds what agents observed and thought.
    pub fn is_json(&self) -> bool {
        self.compact.is_none()
    }

    /// Appends an episode.
    pub fn push(&mut self, episode: &Episode) -> Result<()> {
        let RecordingFile { file, episodes, compact } = self;
        let written = match compact {
            Some((layout, bytes)) => {
                layout.encode(episode, bytes);
                file.write_all(bytes)
            }
            None => writeln!(file, "{}", if *episodes == 0 { "" } else { "," })
                .and_then(|()| serde_json::to_writer(&mut *file, episode).map_err(std::io::Error::from)),
        };
        *episodes += 1;
        written.map_err(|e| Error::io("write", self.file.path(), e))
    }

    /// Puts the recording in its place.
    pub fn finish(mut self) -> Result<()> {
        let end = if self.is_json() { b"\n]}\n".to_vec() } else { Layout::end(self.episodes) };
        self.write(&end)?;
        self.file.commit()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|e| Error::io("write", self.file.path(), e))
    }
}
