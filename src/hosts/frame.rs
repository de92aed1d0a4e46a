//! Messages of the bus, one behind the other, as they travel between machines: header and words of each. Observations are
//! numbered, so that the other side knows what the network has lost: a frame begins with the number of its first one.

use std::ops::Range;

use crate::base::error::Result;
use crate::bus::{Header, Kind, Layout, PROTOCOL};
use crate::failed;

const HEADER: usize = size_of::<Header>();

/// The bytes of a number.
const NUMBER: usize = size_of::<u64>();

/// Messages that travel together.
#[derive(Debug, Default)]
pub(super) struct Frame {
    bytes: Vec<u8>,
    /// Observations in frames before, and with those in this one.
    numbers: Range<u64>,
}

impl Frame {
    /// Adds a message.
    pub(super) fn push(&mut self, header: &Header, words: &[u32]) {
        if self.bytes.is_empty() {
            self.bytes.extend_from_slice(&self.numbers.start.to_le_bytes());
        }
        self.numbers.end += u64::from(header.kind == Kind::Observation as u32);
        self.bytes.extend_from_slice(bytemuck::bytes_of(header));
        self.bytes.extend_from_slice(bytemuck::cast_slice(words));
    }

    /// The bytes of all messages, if there are any; there are none in it afterwards.
    pub(super) fn take(&mut self) -> Option<Vec<u8>> {
        self.numbers.start = self.numbers.end;
        Some(std::mem::take(&mut self.bytes)).filter(|bytes| !bytes.is_empty())
    }
}

/// What a swarm's messages can be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) layout: Layout,
    /// The most worlds in a message.
    pub(super) worlds: usize,
}

impl Shape {
    /// Hands over the messages in the bytes of a frame: each header, and the bytes of its words. Returns the numbers of its
    /// observations.
    ///
    /// # Errors
    /// `Failed` if they are not messages of such a swarm, of version [`PROTOCOL`] and as long as they say.
    pub(super) fn each(
        &self,
        bytes: &[u8],
        mut take: impl FnMut(Header, &[u8]) -> Result<()>,
    ) -> Result<Range<u64>> {
        // None is sent that has no message.
        let frame = bytes.split_first_chunk::<NUMBER>().filter(|(_, messages)| !messages.is_empty());
        let (first, mut bytes) = frame.ok_or_else(|| failed!("a frame is cut off"))?;
        let first = u64::from_le_bytes(*first);
        let mut numbers = first..first;
        while !bytes.is_empty() {
            let (header, rest) =
                bytes.split_at_checked(HEADER).ok_or_else(|| failed!("a message is cut off"))?;
            let header: Header = bytemuck::pod_read_unaligned(header);
            let length = self.length_of(&header).filter(|words| header.length == *words as u64);
            let length = length.ok_or_else(|| failed!("a message cannot be read: {header:?}"))?;
            let words = rest.split_at_checked(length * size_of::<u32>());
            let (words, rest) = words.ok_or_else(|| failed!("a message is cut off"))?;
            numbers.end = numbers.end.saturating_add(u64::from(header.kind == Kind::Observation as u32));
            take(header, words)?;
            bytes = rest;
        }
        Ok(numbers)
    }

    /// The words of a message with this header, if it can be one.
    fn length_of(&self, header: &Header) -> Option<usize> {
        let worlds = header.worlds as usize;
        let is_one = header.protocol == PROTOCOL
            && (header.sender as usize) < self.layout.agents
            && worlds <= self.worlds;
        let kinds = [Kind::Ready, Kind::Sensor, Kind::Observation, Kind::Decision, Kind::Shutdown];
        let kind = kinds.into_iter().find(|kind| *kind as u32 == header.kind).filter(|_| is_one)?;
        match kind {
            Kind::Ready => Some(1),
            Kind::Sensor => Some(self.layout.sensor_words(worlds)),
            Kind::Observation => Some(self.layout.observation_words(worlds)),
            Kind::Decision => Some(self.layout.decision_words(worlds)),
            _ => Some(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape {
        layout: Layout { agents: 2, observation: 3, action: 1, joint: 4, logits: 0, relay: false },
        worlds: 2,
    };

    fn observation(sender: u32, worlds: u32) -> (Header, Vec<u32>) {
        let words: Vec<u32> = (0..3 * worlds).collect();
        let (protocol, kind, length) = (PROTOCOL, Kind::Observation as u32, words.len() as u64);
        (Header { protocol, kind, sender, worlds, length, ..Header::default() }, words)
    }

    #[test]
    fn messages_come_back_in_order() {
        let (mut frame, sent) = (Frame::default(), [observation(0, 2), observation(1, 1)]);
        sent.iter().for_each(|(header, words)| frame.push(header, words));
        let (bytes, mut came) = (frame.take().unwrap(), Vec::new());
        assert_eq!(frame.take(), None);
        let take = |header, words: &[u8]| {
            came.push((
                header,
                words.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect::<Vec<u32>>(),
            ));
            Ok(())
        };
        assert_eq!(SHAPE.each(&bytes, take).unwrap(), 0..2);
        assert_eq!(came, sent);
        // The next one goes on from there.
        sent.iter().for_each(|(header, words)| frame.push(header, words));
        assert_eq!(SHAPE.each(&frame.take().unwrap(), |_, _| Ok(())).unwrap(), 2..4);
    }

    #[test]
    fn what_is_no_message_of_the_swarm_is_refused() {
        let refused = |(header, words): (Header, Vec<u32>), cut: usize| {
            let mut frame = Frame::default();
            frame.push(&header, &words);
            let bytes = frame.take().unwrap();
            SHAPE.each(&bytes[..bytes.len() - cut], |_, _| Ok(())).is_err()
        };
        let (header, words) = observation(0, 1);
        let with = |change: fn(&mut Header)| {
            let mut header = header;
            change(&mut header);
            (header, words.clone())
        };
        assert!([7, 8, 9].iter().all(|length| SHAPE.each(&vec![0; *length], |_, _| Ok(())).is_err()));
        assert!(!refused((header, words.clone()), 0));
        assert!(refused((header, words.clone()), 1) && refused((header, words.clone()), 13));
        assert!(refused(observation(2, 1), 0), "no such agent");
        assert!(refused(observation(0, 3), 0), "more worlds than there are");
        assert!(refused(with(|header| header.protocol += 1), 0));
        assert!(refused(with(|header| header.kind = Kind::Weights as u32), 0));
        assert!(refused(with(|header| header.length = u64::MAX), 0));
    }
}
