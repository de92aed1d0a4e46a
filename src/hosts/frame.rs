//! Messages of the bus, one behind the other, as they travel between machines: header and words of each.

use crate::base::error::Result;
use crate::bus::{Header, Kind, Layout, PROTOCOL};
use crate::failed;

const HEADER: usize = size_of::<Header>();

/// Messages that travel together.
#[derive(Debug, Default)]
pub(super) struct Frame {
    bytes: Vec<u8>,
}

impl Frame {
    /// Adds a message.
    pub(super) fn push(&mut self, header: &Header, words: &[u32]) {
        self.bytes.extend_from_slice(bytemuck::bytes_of(header));
        self.bytes.extend_from_slice(bytemuck::cast_slice(words));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The bytes of all messages; there are none in it afterwards.
    pub(super) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
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
    /// Hands over the messages in some bytes: each header, and the bytes of its words.
    ///
    /// # Errors
    /// `Failed` if they are not messages of such a swarm, of version [`PROTOCOL`] and as long as they say.
    pub(super) fn each(
        &self,
        mut bytes: &[u8],
        mut take: impl FnMut(Header, &[u8]) -> Result<()>,
    ) -> Result<()> {
        while !bytes.is_empty() {
            let (header, rest) =
                bytes.split_at_checked(HEADER).ok_or_else(|| failed!("a message is cut off"))?;
            let header: Header = bytemuck::pod_read_unaligned(header);
            let length = self.length_of(&header).filter(|words| header.length == *words as u64);
            let length = length.ok_or_else(|| failed!("a message cannot be read: {header:?}"))?;
            let words = rest.split_at_checked(length * size_of::<u32>());
            let (words, rest) = words.ok_or_else(|| failed!("a message is cut off"))?;
            take(header, words)?;
            bytes = rest;
        }
        Ok(())
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
        let (bytes, mut came) = (frame.take(), Vec::new());
        assert!(frame.is_empty());
        let take = |header, words: &[u8]| {
            came.push((
                header,
                words.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect::<Vec<u32>>(),
            ));
            Ok(())
        };
        SHAPE.each(&bytes, take).unwrap();
        assert_eq!(came, sent);
    }

    #[test]
    fn what_is_no_message_of_the_swarm_is_refused() {
        let refused = |(header, words): (Header, Vec<u32>), cut: usize| {
            let mut frame = Frame::default();
            frame.push(&header, &words);
            let bytes = frame.take();
            SHAPE.each(&bytes[..bytes.len() - cut], |_, _| Ok(())).is_err()
        };
        let (header, words) = observation(0, 1);
        let with = |change: fn(&mut Header)| {
            let mut header = header;
            change(&mut header);
            (header, words.clone())
        };
        assert!(!refused((header, words.clone()), 0));
        assert!(refused((header, words.clone()), 1) && refused((header, words.clone()), 13));
        assert!(refused(observation(2, 1), 0), "no such agent");
        assert!(refused(observation(0, 3), 0), "more worlds than there are");
        assert!(refused(with(|header| header.protocol += 1), 0));
        assert!(refused(with(|header| header.kind = Kind::Weights as u32), 0));
        assert!(refused(with(|header| header.length = u64::MAX), 0));
    }
}
