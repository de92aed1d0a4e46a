//! Event files of TensorBoard: scalars as `Event` messages of protocol buffers, framed as TFRecord.
//!
//! A record is the length of its data (u64), a checksum of the length (u32), the data, and a checksum of the
//! data (u32), all little-endian. Fields of the messages, by number:
//!
//! ```text
//! Event    wall_time 1 (double, seconds), step 2 (int64), file_version 3 (string), summary 5 (Summary)
//! Summary  value 1 (repeated Value)
//! Value    tag 1 (string), simple_value 2 (float)
//! ```

use std::time::SystemTime;

/// The name of an event file in the folder of a run. TensorBoard reads every file with `tfevents` in its name.
pub(super) const FILE: &str = "events.out.tfevents.vamaro-swarm";

/// The most bytes it may have.
pub(super) const LARGEST: u64 = 1 << 31;

/// The record that every event file begins with.
pub(super) fn first_record() -> Vec<u8> {
    version_at(now())
}

/// The record of one row: its scalars, by tag.
pub(super) fn scalars(step: u64, values: &[(&str, f64)]) -> Vec<u8> {
    scalars_at(now(), step, values)
}

/// What TensorBoard calls a column. It shows a group for each first part of a tag, groups and tags in alphabetical order:
/// first the returns of tests, then their errors, the returns of training, and the rest.
pub(super) fn tag(column: &str) -> String {
    let test = column.split_once("/test_").and_then(|(imputer, test)| Some((imputer, test.split_once('_')?)));
    match (test, column) {
        (Some((imputer, (level, what @ ("return_mean" | "return_std")))), _) => {
            format!("test/{what}/{imputer}/{level}")
        }
        (Some((imputer, (level, what))), _) => format!("test_errors/{what}/{imputer}/{level}"),
        (None, "return_mean" | "return_std") => format!("train/{column}"),
        (None, "episodes" | "updates") => format!("train_progress/{column}"),
        (None, _) if column.contains('/') => format!("train_predictors/{column}"),
        (None, _) => format!("train_updates/{column}"),
    }
}

/// The length of the whole and undamaged records a file begins with, up to the first with scalars of a step
/// after `last` (any step, if that is `None`).
pub(super) fn length_until(bytes: &[u8], last: Option<u64>) -> usize {
    let mut length = 0;
    while let Some(event) = first_event(&bytes[length..])
        && step(event) <= last
    {
        length += event.len() + FRAME;
    }
    length
}

/// Bytes of a record around its data.
const FRAME: usize = 16;

fn version_at(wall_time: f64) -> Vec<u8> {
    let mut event = start(wall_time);
    bytes_field(&mut event, 3, b"brain.Event:2");
    record(&event)
}

fn scalars_at(wall_time: f64, step: u64, values: &[(&str, f64)]) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, value) in values {
        let mut message = Vec::new();
        bytes_field(&mut message, 1, tag.as_bytes());
        message.push(key(2, WIRE_32_BITS));
        message.extend((*value as f32).to_le_bytes());
        bytes_field(&mut summary, 1, &message);
    }
    let mut event = start(wall_time);
    event.push(key(2, WIRE_VARINT));
    varint(&mut event, step);
    bytes_field(&mut event, 5, &summary);
    record(&event)
}

const WIRE_VARINT: u8 = 0;
const WIRE_64_BITS: u8 = 1;
const WIRE_BYTES: u8 = 2;
const WIRE_32_BITS: u8 = 5;

const fn key(field: u8, wire: u8) -> u8 {
    field << 3 | wire
}

/// An event with its first field.
fn start(wall_time: f64) -> Vec<u8> {
    let mut event = vec![key(1, WIRE_64_BITS)];
    event.extend(wall_time.to_le_bytes());
    event
}

fn bytes_field(message: &mut Vec<u8>, field: u8, bytes: &[u8]) {
    message.push(key(field, WIRE_BYTES));
    varint(message, bytes.len() as u64);
    message.extend(bytes);
}

fn varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        message.push(value as u8 | 0x80);
        value >>= 7;
    }
    message.push(value as u8);
}

/// The step of an event with scalars, as [`scalars`] lays it out: the step comes right after the wall time.
fn step(event: &[u8]) -> Option<u64> {
    let (field, rest) = event.get(9..)?.split_first()?;
    if *field != key(2, WIRE_VARINT) {
        return None;
    }
    let length = rest.iter().position(|byte| byte & 0x80 == 0)?;
    Some(rest[..=length].iter().rev().fold(0, |value, byte| value << 7 | u64::from(byte & 0x7f)))
}

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut record = length.to_vec();
    record.extend(masked_crc(&length).to_le_bytes());
    record.extend(data);
    record.extend(masked_crc(data).to_le_bytes());
    record
}

/// The data of the record at the front, if it is whole and its checksums hold.
fn first_event(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let (length_crc, rest) = rest.split_first_chunk::<4>()?;
    let (data, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let data_crc = rest.first_chunk::<4>()?;
    let holds = |bytes: &[u8], crc: &[u8; 4]| masked_crc(bytes) == u32::from_le_bytes(*crc);
    (holds(length, length_crc) && holds(data, data_crc)).then_some(data)
}

/// TFRecord stores checksums rotated and shifted, so that data which hold checksums keep theirs distinct.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), bit by bit: a row has few bytes.
fn crc32c(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0x82f6_3b78;
    let shift = |crc: u32, _| crc >> 1 ^ POLYNOMIAL & (crc & 1).wrapping_neg();
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), shift))
}

/// Seconds since 1970.
fn now() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Written by the Python package tensorboard 2.21.0: `RecordWriter` of `event_pb2.Event`.
    const VERSION: &str = "1800000000000000a37f4b220900000040fc54d9411a0d627261696e2e4576656e743a32eced8f9d";
    const SCALARS: &str = "4a00000000000000af77dbb00900001040fc54d94110a0c21e2a3b0a290a2276616c75652d6177617265\
                           2f746573745f703d302e325f72657475726e5f6d65616e156666d2c10a0e0a07656e74726f7079150000\
                           003f5c9a22a6";

    fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    #[test]
    fn records_are_those_of_tensorboard() {
        assert_eq!(hex(&version_at(1.7e9)), VERSION);
        let values = [("value-aware/test_p=0.2_return_mean", -26.3), ("entropy", 0.5)];
        assert_eq!(hex(&scalars_at(1_700_000_000.25, 500_000, &values)), SCALARS);
    }

    #[test]
    fn tags_are_in_groups_with_the_returns_of_tests_first() {
        let columns =
            ["episodes", "return_mean", "critic_loss", "maro/nll", "maro/test_p=0.2_imputation_rmse"];
        let mut tags = columns.map(tag).to_vec();
        tags.push(tag("maro/test_p=0.2_return_mean"));
        tags.push(tag("maro/test_p=1_return_std"));
        tags.sort();
        assert_eq!(
            tags,
            [
                "test/return_mean/maro/p=0.2",
                "test/return_std/maro/p=1",
                "test_errors/imputation_rmse/maro/p=0.2",
                "train/return_mean",
                "train_predictors/maro/nll",
                "train_progress/episodes",
                "train_updates/critic_loss",
            ]
        );
    }

    #[test]
    fn checksums_published_in_rfc_3720() {
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c(&(0..32).collect::<Vec<u8>>()), 0x46dd_794e);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn a_file_is_cut_after_a_step() {
        let mut file = first_record();
        let mut ends = vec![file.len()];
        let steps = [0, 127, 128, u64::MAX >> 1];
        for step in steps {
            file.extend(scalars(step, &[("loss", 1.0)]));
            ends.push(file.len());
        }
        assert_eq!(length_until(&file, None), ends[0]);
        for (step, end) in steps.into_iter().zip(&ends[1..]) {
            assert_eq!(length_until(&file, Some(step)), *end);
        }
        assert_eq!(length_until(&file, Some(500)), ends[3]);
        assert_eq!(length_until(&[], Some(500)), 0);
    }

    #[test]
    fn a_torn_or_damaged_record_ends_a_file() {
        let whole = [first_record(), scalars(250, &[("loss", 1.0)]), scalars(500, &[("loss", 1.0)])].concat();
        let first = length_until(&whole, None);
        let second = length_until(&whole, Some(250));
        for length in second..whole.len() {
            assert_eq!(length_until(&whole[..length], Some(500)), second);
        }
        for byte in first..second {
            let mut damaged = whole.clone();
            damaged[byte] ^= 0x10;
            assert_eq!(length_until(&damaged, Some(500)), first, "byte {byte}");
        }
    }
}
