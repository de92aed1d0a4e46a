//! One hop: from one process to another, over all that messages can be sent over.
//!
//! Two processes send each other messages in turn. The clock is the same in both, so each message is timed by
//! itself, and both directions count.

use std::process::Stdio;
use std::time::Duration;

use super::bus::BusEnd;
use super::futex::FutexEnd;
use super::kernel::KernelEnd;
use super::message::{self, Received, Took};
use super::peer::{Echo, LEAVE_DEADLINE, PeerSettings, Role, await_state};
use super::pin::Pinned;
use super::plain::PlainEnd;
use super::repeat;
use super::transport::{Medium, Transport};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::bus::now_ns;
use crate::bus::{SwarmDirectory, Wait};
use crate::failed;
use crate::supervisor::{AgentCommand, Children, signals};

/// The sizes that messages may have, in bytes; multiples of four.
pub const PAYLOADS: std::ops::RangeInclusive<usize> = 64..=64 << 10;

/// The number of the message that tells the peer to leave.
const LEAVE: u64 = u64::MAX;

/// How long messages took over one medium.
#[derive(Clone, Debug)]
pub struct Hop {
    /// What they were sent over.
    pub medium: Medium,
    /// How their receivers waited.
    pub wait: Wait,
    /// Their size in bytes.
    pub payload: usize,
    /// From the moment all bytes of a message were in their place until its receiver had them before him.
    pub hop: Distribution,
    /// The same with making room for the message and writing it before, and reading it after.
    pub whole: Distribution,
    /// Whether each process had a core of its own.
    pub pinned: bool,
}

impl Hop {
    /// Times messages for so long, after a tenth of it to warm up.
    pub fn measure(medium: Medium, wait: Wait, payload: usize, longest: Duration) -> Result<Hop> {
        // Those who do not use iceoryx2 leave it empty.
        let directory = SwarmDirectory::create()?;
        let tag = directory.tag();
        let peer = |stdio: [Stdio; 2]| {
            let role = Role::Echo(Echo { medium, payload, tag: tag.to_owned() });
            let name = format!("the peer over {medium}");
            let mut peer = Children::new(AgentCommand::this_program()?, || ())?;
            peer.start(&name, "peer", &PeerSettings::new(wait, role), stdio)?;
            Ok(peer)
        };
        let nothing = || [Stdio::null(), Stdio::null()];
        let mut measured = Hop {
            medium,
            wait,
            payload,
            hop: Distribution::default(),
            whole: Distribution::default(),
            pinned: false,
        };
        match medium {
            Medium::Futex => {
                let (end, memory) = FutexEnd::create(payload, wait)?;
                measured.exchange(end, peer([memory.into(), Stdio::null()])?, longest)?;
            }
            Medium::Plain => {
                let end = PlainEnd::create(tag, payload, wait)?;
                measured.exchange(end, peer(nothing())?, longest)?;
            }
            Medium::Bus => {
                let end = BusEnd::create(tag, payload, wait)?;
                measured.exchange(end, peer(nothing())?, longest)?;
            }
            Medium::UnixDatagram | Medium::UnixStream | Medium::Pipe | Medium::Udp => {
                let (end, other) = KernelEnd::pair(medium, payload)?;
                measured.exchange(end, peer(other.map(Stdio::from))?, longest)?;
            }
        }
        Ok(measured)
    }

    fn exchange(&mut self, mut end: impl Transport, mut peer: Children, longest: Duration) -> Result<()> {
        let pinned = Pinned::new(&peer.ids().collect::<Vec<u32>>());
        self.pinned = pinned.is_some();
        // The peer speaks first: then it is there.
        let mut last = self.receive(&mut end, &mut peer, 0)?;
        let mut number = 0;
        repeat(longest, |counts| {
            number += 1;
            send(&mut end, number, last.took)?;
            last = self.receive(&mut end, &mut peer, number)?;
            if counts {
                for Took { hop, whole } in [last.took, last.answers] {
                    self.hop.record(hop);
                    self.whole.record(whole);
                }
            }
            Ok(())
        })?;
        send(&mut end, LEAVE, Took::default())?;
        peer.reap(LEAVE_DEADLINE);
        Ok(())
    }

    fn receive(&self, end: &mut impl Transport, peer: &mut Children, number: u64) -> Result<Received> {
        let received = receive(end, self.wait, || {
            peer.check_alive()?;
            signals::check_stop()
        })?;
        if received.number == number {
            Ok(received)
        } else {
            Err(failed!("{}: got message {} for {number}", self.medium, received.number))
        }
    }
}

/// Answers messages until one says not to.
pub(super) fn answer(echo: &Echo, wait: Wait) -> Result<()> {
    let Echo { medium, payload, ref tag } = *echo;
    match medium {
        Medium::Futex => answer_over(FutexEnd::standard(payload, wait)?, wait),
        Medium::Plain => answer_over(PlainEnd::open(tag, payload, wait)?, wait),
        Medium::Bus => answer_over(BusEnd::open(tag, payload, wait)?, wait),
        Medium::UnixDatagram | Medium::UnixStream | Medium::Pipe | Medium::Udp => {
            answer_over(KernelEnd::standard(medium, payload)?, wait)
        }
    }
}

fn answer_over(mut end: impl Transport, wait: Wait) -> Result<()> {
    send(&mut end, 0, Took::default())?;
    loop {
        let received = receive(&mut end, wait, || Ok(()))?;
        if received.number == LEAVE {
            return Ok(());
        }
        send(&mut end, received.number, received.took)?;
    }
}

fn send(end: &mut impl Transport, number: u64, answers: Took) -> Result<()> {
    let begun = now_ns();
    end.send(|bytes| message::fill(bytes, number, begun, answers))
}

fn receive<T: Transport>(end: &mut T, wait: Wait, mut check: impl FnMut() -> Result<()>) -> Result<Received> {
    let mut received = None;
    let ready = |end: &mut T| end.receive(|bytes| received = Some(message::read(bytes)));
    await_state(end, wait, T::sleep, ready, |_| check())?;
    received.expect("a message is in")
}
