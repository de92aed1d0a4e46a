//! Ways for a message from one process to another.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::base::error::Result;

/// One end of a way to another process and back. Messages are of one size, and each is answered before the next is
/// sent.
pub(super) trait Transport {
    /// Sends a message that `fill` writes: in place if the way leads through shared memory, else in memory of its own,
    /// which the kernel copies. Wakes the other end if it sleeps.
    fn send(&mut self, fill: impl FnOnce(&mut [u8])) -> Result<()>;

    /// Shows `read` the message that has come in, if one has; whether there was one.
    fn receive(&mut self, read: impl FnOnce(&[u8])) -> Result<bool>;

    /// Sleeps until a message may have come in, at most for `longest`.
    fn sleep(&self, longest: Duration) -> Result<()>;
}

/// What a message is sent over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Medium {
    /// POSIX shared memory and a futex, with nothing around them: the floor.
    Futex,
    /// iceoryx2's publish-subscribe and events, with nothing of ours around them.
    Plain,
    /// An observation on our bus.
    Bus,
    /// A pair of Unix domain datagram sockets.
    UnixDatagram,
    /// A pair of Unix domain stream sockets.
    UnixStream,
    /// Two pipes.
    Pipe,
    /// UDP on the loopback interface.
    Udp,
}

impl Medium {
    /// All of them, the floor first.
    pub const ALL: [Medium; 7] = [
        Medium::Futex,
        Medium::Plain,
        Medium::Bus,
        Medium::UnixDatagram,
        Medium::UnixStream,
        Medium::Pipe,
        Medium::Udp,
    ];
}

impl fmt::Display for Medium {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Medium::Futex => "memory and futex",
            Medium::Plain => "plain iceoryx2",
            Medium::Bus => "our bus",
            Medium::UnixDatagram => "Unix datagram",
            Medium::UnixStream => "Unix stream",
            Medium::Pipe => "pipe",
            Medium::Udp => "UDP",
        })
    }
}
