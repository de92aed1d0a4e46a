//! Reads the trace that an MCAP holds, from its beginning to its end or to where it was cut off.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::{HEADER, MEDIA_TYPE, NAME};
use crate::base::error::{Error, Result};
use crate::recording::layout::Decoder;
use crate::recording::{Episode, LARGEST, RecordingHeader};

/// Bytes that are read at once. However long a record says that it is, no more room is taken than there are bytes.
const AT_ONCE: usize = 1 << 16;

/// The episodes of an MCAP, one after the other.
pub(in crate::recording) struct McapEpisodes {
    records: Records,
    decoder: Decoder,
    read: u64,
}

impl McapEpisodes {
    /// Reads what stands before the episodes.
    pub(in crate::recording) fn open(file: File, path: &Path) -> Result<(RecordingHeader, McapEpisodes)> {
        let failed = |what: String| Error::io("read", path, what);
        let mut records = Records::of(file);
        let header = match records.next().map_err(failed)? {
            Some(Found::Header(header)) => header,
            _ if records.is_cut => {
                return Err(failed("the file is cut off within its beginning; record it again".to_owned()));
            }
            _ => {
                return Err(failed(format!(
                    "it is an MCAP of another program: no metadata record called {NAME} stands before its messages"
                )));
            }
        };
        let (about, decoder) = Decoder::of(header.as_bytes(), None, path)?;
        Ok((about, McapEpisodes { records, decoder, read: 0 }))
    }

    /// Whether the file has no end.
    pub(in crate::recording) fn is_cut(&self) -> bool {
        self.records.is_cut
    }

    /// The next episode; an error in words.
    pub(in crate::recording) fn next_episode(&mut self) -> std::result::Result<Option<Episode>, String> {
        let within = format!("episode {} of those in the file", self.read);
        let wrong = |what: String| format!("{within}: {what}");
        while let Some(found) = self.records.next().map_err(wrong)? {
            if let Found::Episode(bytes) = found {
                let episode = self.decoder.decode(&bytes).map_err(wrong)?;
                self.read += 1;
                return Ok(Some(episode));
            }
        }
        Ok(None)
    }
}

/// What matters of the records.
enum Found {
    Header(String),
    Episode(Vec<u8>),
    /// What tools show, which is passed over.
    Messages,
}

/// The records of a file, one after the other.
struct Records {
    file: BufReader<File>,
    reader: LinearReader,
    is_cut: bool,
}

impl Records {
    fn of(file: File) -> Records {
        let options = LinearReaderOptions::default()
            // Nothing of ours is in a chunk, so it does not matter how chunks are compressed.
            .with_emit_chunks(true)
            .with_check_finishes_after_end_magic(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(LARGEST as usize);
        let reader = LinearReader::new_with_options(options);
        Records { file: BufReader::with_capacity(AT_ONCE, file), reader, is_cut: false }
    }

    /// The next that matters; `None` at the end, and where the file is cut off. An error in words.
    fn next(&mut self) -> std::result::Result<Option<Found>, String> {
        while let Some(event) = self.reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(bytes)) => {
                    let room = self.reader.insert(bytes.min(AT_ONCE));
                    let read = self.file.read(room).map_err(|e| e.to_string())?;
                    self.reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { opcode: op::CHUNK, .. }) => return Ok(Some(Found::Messages)),
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    if let Some(found) = found(opcode, data)? {
                        return Ok(Some(found));
                    }
                }
                Err(McapError::UnexpectedEof) => {
                    self.is_cut = true;
                    return Ok(None);
                }
                Err(e) => return Err(format!("it is damaged: {e}")),
            }
        }
        Ok(None)
    }
}

/// What matters of a record.
fn found(opcode: u8, data: &[u8]) -> std::result::Result<Option<Found>, String> {
    let wanted = opcode == op::METADATA || opcode == op::ATTACHMENT && has_attachment(data);
    if !wanted {
        return match opcode {
            op::ATTACHMENT => Err("an attachment is shorter than it says".to_owned()),
            _ => Ok(None),
        };
    }
    Ok(match mcap::parse_record(opcode, data).map_err(|e| format!("it is damaged: {e}"))? {
        Record::Metadata(mut of) if of.name == NAME => of.metadata.remove(HEADER).map(Found::Header),
        Record::Attachment { header, data, .. } if header.media_type == MEDIA_TYPE => {
            Some(Found::Episode(data.into_owned()))
        }
        _ => None,
    })
}

/// Whether a record can hold an attachment: two times, two texts, and before the checksum as many bytes as it says. The
/// parser takes that for granted.
fn has_attachment(record: &[u8]) -> bool {
    let text = |rest: &mut &[u8]| -> Option<()> {
        let (length, behind) = rest.split_first_chunk()?;
        *rest = behind.get(u32::from_le_bytes(*length) as usize..)?;
        Some(())
    };
    let length = || -> Option<()> {
        let mut rest = record.get(16..)?;
        text(&mut rest)?;
        text(&mut rest)?;
        let (length, rest) = rest.split_first_chunk()?;
        let data = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        (rest.len() == data.checked_add(4)?).then_some(())
    };
    length().is_some()
}
