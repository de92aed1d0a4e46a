//! Shared memory and a futex, with nothing around them: the least that a message between processes can take.

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::Errno;
use rustix::thread::futex::{self, Flags, Timespec};

use super::transport::Transport;
use crate::base::error::Result;
use crate::bus::Wait;
use crate::failed;

/// Bytes in front of each lane's payload: a cache line for the count of its messages.
const COUNT: usize = 64;

/// One end of memory with two lanes, one for each direction: a count of messages, and the newest of them.
///
/// The memory has no name, so it goes with the processes that have it.
pub(super) struct FutexEnd {
    memory: MmapRaw,
    payload: usize,
    /// The lanes that are written and read here.
    out: usize,
    back: usize,
    /// Messages sent and received.
    sent: u32,
    received: u32,
    wait: Wait,
}

impl FutexEnd {
    /// An end, and the memory for the other one.
    pub(super) fn create(payload: usize, wait: Wait) -> Result<(FutexEnd, OwnedFd)> {
        let memory = memfd_create("vamaro-swarm-floor", MemfdFlags::CLOEXEC).map_err(io::Error::from);
        let memory = memory.and_then(|memory| {
            let memory = File::from(memory);
            memory.set_len(2 * lane(payload) as u64)?;
            Ok(memory)
        });
        let memory = memory.map_err(cannot_share)?;
        let end = FutexEnd::of(&memory, [0, 1], payload, wait)?;
        Ok((end, memory.into()))
    }

    /// The other end, whose memory is the standard input of a process.
    pub(super) fn standard(payload: usize, wait: Wait) -> Result<FutexEnd> {
        let memory = io::stdin().as_fd().try_clone_to_owned().map_err(cannot_share)?;
        FutexEnd::of(&memory.into(), [1, 0], payload, wait)
    }

    fn of(memory: &File, [out, back]: [usize; 2], payload: usize, wait: Wait) -> Result<FutexEnd> {
        let bytes = 2 * lane(payload);
        if memory.metadata().map_err(cannot_share)?.len() != bytes as u64 {
            return Err(failed!("the shared memory lacks the {bytes} bytes of two lanes"));
        }
        let memory = MmapOptions::new().len(bytes).map_raw(memory).map_err(cannot_share)?;
        Ok(FutexEnd { memory, payload, out, back, sent: 0, received: 0, wait })
    }

    fn count(&self, at: usize) -> &AtomicU32 {
        // SAFETY: both lanes lie inside of the memory, which is mapped as long as `self` lives, begin on a cache
        // line, and their first word is touched as an atomic only, here and in the other process.
        unsafe { AtomicU32::from_ptr(self.memory.as_mut_ptr().add(at * lane(self.payload)).cast()) }
    }

    /// The payload of a lane.
    fn bytes(&self, at: usize) -> *mut u8 {
        self.memory.as_mut_ptr().wrapping_add(at * lane(self.payload) + COUNT)
    }
}

impl Transport for FutexEnd {
    fn send(&mut self, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        // SAFETY: the bytes lie inside of the memory. The other process looks at them between the count below and
        // its answer, without which nothing is sent here again, so nobody else has them now.
        fill(unsafe { std::slice::from_raw_parts_mut(self.bytes(self.out), self.payload) });
        self.sent = self.sent.wrapping_add(1);
        self.count(self.out).store(self.sent, Ordering::Release);
        match self.wait {
            Wait::Block => {
                futex::wake(self.count(self.out), Flags::empty(), 1).map(drop).map_err(cannot_share)
            }
            Wait::Spin => Ok(()),
        }
    }

    fn receive(&mut self, read: impl FnOnce(&[u8])) -> Result<bool> {
        let count = self.count(self.back).load(Ordering::Acquire);
        if count == self.received {
            return Ok(false);
        }
        self.received = count;
        // SAFETY: the bytes lie inside of the memory. They were written before the count, and are written again
        // only when this message has been answered, which happens after `read` is done with them.
        read(unsafe { std::slice::from_raw_parts(self.bytes(self.back), self.payload) });
        Ok(true)
    }

    fn sleep(&self, longest: Duration) -> Result<()> {
        let timeout = Timespec { tv_sec: longest.as_secs() as i64, tv_nsec: longest.subsec_nanos().into() };
        match futex::wait(self.count(self.back), Flags::empty(), self.received, Some(&timeout)) {
            Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => Ok(()),
            Err(e) => Err(cannot_share(e)),
        }
    }
}

/// Bytes of a lane.
fn lane(payload: usize) -> usize {
    COUNT + payload.next_multiple_of(COUNT)
}

fn cannot_share(e: impl std::fmt::Display) -> crate::base::error::Error {
    failed!("cannot share memory with another process: {e}")
}
