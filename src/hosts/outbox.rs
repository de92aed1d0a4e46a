//! What one side sends the other next.

use super::engine::Line;
use super::frame::Frame;
use crate::bus::{Header, Kind};

/// Messages that travel together, in one frame. Where the network is the link, observations have a frame of their own,
/// which may be lost.
#[derive(Debug)]
pub(super) struct Outbox {
    all: Frame,
    observations: Frame,
    /// Whether it is sent against the clock: who takes nothing for a while must not hold up anybody.
    pub(super) real_time: bool,
    /// Whether the network is the link.
    pub(super) network_is_link: bool,
}

impl Outbox {
    pub(super) fn new(real_time: bool, network_is_link: bool) -> Outbox {
        Outbox { all: Frame::default(), observations: Frame::default(), real_time, network_is_link }
    }

    /// Adds a message.
    pub(super) fn push(&mut self, header: &Header, words: &[u32]) {
        let is_own = self.network_is_link && header.kind == Kind::Observation as u32;
        let frame = if is_own { &mut self.observations } else { &mut self.all };
        frame.push(header, words);
    }

    /// Sends what there is: so many frames. What cannot be sent is gone.
    pub(super) fn send(&mut self, line: Option<&Line>) -> u64 {
        let (all, observations) = (self.all.take(), self.observations.take());
        let Some(line) = line else { return 0 };
        let frames = all.iter().chain(&observations).count() as u64;
        if let Some(frame) = all {
            if self.real_time {
                line.send_unless_full(frame);
            } else {
                line.send(frame);
            }
        }
        observations.into_iter().for_each(|frame| line.send_or_lose(frame));
        frames
    }
}
