//! `foxglove.FrameTransforms` as protocol buffers: of the well-known messages Rerun knows only those.
//!
//! Four kinds of fields are all there is to it: a compiler of schemas would be larger than what it would write.

use super::messages::{FrameTransform, Time, Vector};

/// Types of fields, as descriptors number them.
const DOUBLE: u64 = 1;
const INT64: u64 = 3;
const INT32: u64 = 5;
const STRING: u64 = 9;
const MESSAGE: u64 = 11;

/// Whether there is one or any number.
const ONE: u64 = 1;
const MANY: u64 = 3;

/// A message that is being written.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(mut self, mut value: u64) -> Message {
        while value > 0x7f {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
        self
    }

    fn integer(self, number: u64, value: u64) -> Message {
        self.varint(number << 3).varint(value)
    }

    fn double(self, number: u64, value: f64) -> Message {
        let mut message = self.varint(number << 3 | 1);
        message.0.extend(value.to_le_bytes());
        message
    }

    fn bytes(self, number: u64, bytes: &[u8]) -> Message {
        let mut message = self.varint(number << 3 | 2).varint(bytes.len() as u64);
        message.0.extend(bytes);
        message
    }

    fn text(self, number: u64, text: &str) -> Message {
        self.bytes(number, text.as_bytes())
    }

    fn message(self, number: u64, inner: Message) -> Message {
        self.bytes(number, &inner.0)
    }
}

/// The schema: a set of file descriptors.
pub(super) fn schema() -> Vec<u8> {
    let vector = [("x", ONE, DOUBLE, ""), ("y", ONE, DOUBLE, ""), ("z", ONE, DOUBLE, "")];
    let quaternion = [&vector[..], &[("w", ONE, DOUBLE, "")]].concat();
    let transform = [
        ("timestamp", ONE, MESSAGE, ".google.protobuf.Timestamp"),
        ("parent_frame_id", ONE, STRING, ""),
        ("child_frame_id", ONE, STRING, ""),
        ("translation", ONE, MESSAGE, ".foxglove.Vector3"),
        ("rotation", ONE, MESSAGE, ".foxglove.Quaternion"),
    ];
    let timestamp = Message::default()
        .text(1, "google/protobuf/timestamp.proto")
        .text(2, "google.protobuf")
        .message(4, described("Timestamp", &[("seconds", ONE, INT64, ""), ("nanos", ONE, INT32, "")]))
        .text(12, "proto3");
    let foxglove = Message::default()
        .text(1, "foxglove/FrameTransforms.proto")
        .text(2, "foxglove")
        .text(3, "google/protobuf/timestamp.proto")
        .message(4, described("Vector3", &vector))
        .message(4, described("Quaternion", &quaternion))
        .message(4, described("FrameTransform", &transform))
        .message(
            4,
            described("FrameTransforms", &[("transforms", MANY, MESSAGE, ".foxglove.FrameTransform")]),
        )
        .text(12, "proto3");
    Message::default().message(1, timestamp).message(1, foxglove).0
}

/// The descriptor of a message: of each field its name, how many there are, its type, and of which message that is. They
/// are numbered from 1.
fn described(name: &str, fields: &[(&str, u64, u64, &str)]) -> Message {
    (1..).zip(fields).fold(Message::default().text(1, name), |all, (number, (name, label, kind, of))| {
        let field = Message::default().text(1, name).integer(3, number).integer(4, *label).integer(5, *kind);
        all.message(2, if of.is_empty() { field } else { field.text(6, of) })
    })
}

/// The bytes of a message.
pub(super) fn frame_transforms(transforms: &[FrameTransform]) -> Vec<u8> {
    transforms.iter().fold(Message::default(), |all, of| all.message(1, transform(of))).0
}

fn transform(of: &FrameTransform) -> Message {
    let Time { sec, nsec } = of.timestamp;
    let Vector { x, y, z } = of.translation;
    Message::default()
        .message(1, Message::default().integer(1, sec).integer(2, nsec))
        .text(2, of.parent_frame_id)
        .text(3, of.child_frame_id)
        .message(4, Message::default().double(1, x.into()).double(2, y.into()).double(3, z.into()))
        // Nobody turns.
        .message(5, Message::default().double(4, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_protocol_buffers_have_them() {
        // 150 is the example of the documentation of the encoding.
        assert_eq!(Message::default().integer(1, 150).0, [0x08, 0x96, 0x01]);
        assert_eq!(Message::default().text(2, "testing").0, b"\x12\x07testing");
        let inner = Message::default().integer(1, 150);
        assert_eq!(Message::default().message(3, inner).0, [0x1a, 0x03, 0x08, 0x96, 0x01]);
        assert_eq!(Message::default().double(1, 1.0).0, [0x09, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]);
    }
}
