//! What goes through the kernel: sockets and pipes, which copy a message twice.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, ioctl_fionbio, read, write};

use super::transport::{Medium, Transport};
use crate::base::error::Result;
use crate::failed;

/// The most bytes in a UDP datagram, which cannot be as long as the longest message. No other way needs parts.
const DATAGRAM: usize = 32 << 10;

/// How long the other end may take to make room for a message.
const ROOM_DEADLINE: Duration = Duration::from_secs(10);

/// One end of a pair of sockets or of two pipes.
///
/// Reading and writing never block: all waiting is done by `poll`, which has a bound.
pub(super) struct KernelEnd {
    input: OwnedFd,
    output: OwnedFd,
    outgoing: Vec<u8>,
    incoming: Vec<u8>,
    /// Bytes of the next message that have come in.
    arrived: usize,
    /// The most that is written at a time.
    part: usize,
}

impl KernelEnd {
    /// An end, and input and output of the other one.
    pub(super) fn pair(medium: Medium, payload: usize) -> Result<(KernelEnd, [OwnedFd; 2])> {
        let pair = match medium {
            Medium::UnixDatagram => {
                UnixDatagram::pair().and_then(|(near, far)| both(near.into(), far.into()))
            }
            Medium::UnixStream => UnixStream::pair().and_then(|(near, far)| both(near.into(), far.into())),
            Medium::Udp => udp_pair().and_then(|(near, far)| both(near.into(), far.into())),
            Medium::Pipe | Medium::Futex | Medium::Plain | Medium::Bus => pipes(),
        };
        let [near, far] = pair.map_err(|e| failed!("cannot open two ends of {medium}: {e}"))?;
        Ok((KernelEnd::of(near, medium, payload)?, far))
    }

    /// The other end: standard input and output of a process.
    pub(super) fn standard(medium: Medium, payload: usize) -> Result<KernelEnd> {
        let [input, output] =
            [io::stdin().as_fd().try_clone_to_owned(), io::stdout().as_fd().try_clone_to_owned()]
                .map(|end| end.map_err(|e| failed!("cannot use standard input and output: {e}")));
        KernelEnd::of([input?, output?], medium, payload)
    }

    fn of([input, output]: [OwnedFd; 2], medium: Medium, payload: usize) -> Result<KernelEnd> {
        for end in [&input, &output] {
            ioctl_fionbio(end, true).map_err(gone)?;
        }
        let (outgoing, incoming) = (vec![0; payload], vec![0; payload]);
        let part = if medium == Medium::Udp { DATAGRAM } else { payload };
        Ok(KernelEnd { input, output, outgoing, incoming, arrived: 0, part })
    }
}

impl Transport for KernelEnd {
    fn send(&mut self, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        fill(&mut self.outgoing);
        let mut left = &self.outgoing[..];
        let mut deadline = None;
        while !left.is_empty() {
            match write(&self.output, &left[..left.len().min(self.part)]) {
                Ok(written) => left = &left[written..],
                Err(Errno::AGAIN | Errno::INTR) => {
                    if *deadline.get_or_insert_with(|| Instant::now() + ROOM_DEADLINE) < Instant::now() {
                        return Err(failed!("the other end did not make room within {ROOM_DEADLINE:?}"));
                    }
                    wait_for(&self.output, PollFlags::OUT, Duration::from_millis(100))?;
                }
                Err(e) => return Err(gone(e)),
            }
        }
        Ok(())
    }

    fn receive(&mut self, show: impl FnOnce(&[u8])) -> Result<bool> {
        while self.arrived < self.incoming.len() {
            match read(&self.input, &mut self.incoming[self.arrived..]) {
                Ok(0) => return Err(failed!("the other end is closed")),
                Ok(more) => self.arrived += more,
                Err(Errno::AGAIN | Errno::INTR) => return Ok(false),
                Err(e) => return Err(gone(e)),
            }
        }
        self.arrived = 0;
        show(&self.incoming);
        Ok(true)
    }

    fn sleep(&self, longest: Duration) -> Result<()> {
        wait_for(&self.input, PollFlags::IN, longest)
    }
}

/// The near and the far end of a pair of sockets, each input and output.
fn both(near: OwnedFd, far: OwnedFd) -> io::Result<[[OwnedFd; 2]; 2]> {
    Ok([[near.try_clone()?, near], [far.try_clone()?, far]])
}

fn pipes() -> io::Result<[[OwnedFd; 2]; 2]> {
    let ((near_input, far_output), (far_input, near_output)) = (io::pipe()?, io::pipe()?);
    Ok([[near_input.into(), near_output.into()], [far_input.into(), far_output.into()]])
}

fn udp_pair() -> io::Result<(UdpSocket, UdpSocket)> {
    let free = (Ipv4Addr::LOCALHOST, 0);
    let (near, far) = (UdpSocket::bind(free)?, UdpSocket::bind(free)?);
    near.connect(far.local_addr()?)?;
    far.connect(near.local_addr()?)?;
    Ok((near, far))
}

/// Sleeps until it can be read or written, at most for `longest`.
fn wait_for(end: &OwnedFd, what: PollFlags, longest: Duration) -> Result<()> {
    let timeout = Timespec { tv_sec: longest.as_secs() as i64, tv_nsec: longest.subsec_nanos().into() };
    match poll(&mut [PollFd::new(end, what)], Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(e) => Err(gone(e)),
    }
}

fn gone(e: Errno) -> crate::base::error::Error {
    failed!("cannot communicate with the other end: {e}")
}
