//! Zenoh with nothing of ours around it, to compare with. Beside the engine this is the only file that names it.

use std::time::Duration;

use zenoh::Wait;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::Sample;

use super::engine::{End, Engine};
use crate::base::error::Result;
use crate::failed;

/// One end of two names in the session of an engine, one for each direction: messages are sent as those of a line are, and
/// received as Zenoh has it if nobody says otherwise.
pub(super) struct Plain {
    speaks: Publisher<'static>,
    hears: Subscriber<FifoChannelHandler<Sample>>,
}

impl Plain {
    /// Opens one end. Whoever asks the other side to open its end has opened this one before.
    pub(super) fn open(engine: &Engine, secret: &str, end: End) -> Result<Plain> {
        let key = |end: End| format!("vamaro-swarm/{secret}/{end:?}/plain");
        let wrong = |e: zenoh::Error| failed!("cannot open names: {e}");
        let hears = engine.session.declare_subscriber(key(end)).wait().map_err(wrong)?;
        let speaks = engine.session.declare_publisher(key(end.other()));
        let speaks = speaks.congestion_control(CongestionControl::Block).priority(Priority::RealTime);
        Ok(Plain { speaks: speaks.express(true).wait().map_err(wrong)?, hears })
    }

    pub(super) fn send(&self, bytes: Vec<u8>) {
        let _ = self.speaks.put(bytes).wait();
    }

    /// What comes within some time.
    pub(super) fn receive(&self, longest: Duration) -> Option<Vec<u8>> {
        let sample = self.hears.recv_timeout(longest).ok().flatten()?;
        Some(sample.payload().to_bytes().into_owned())
    }
}
