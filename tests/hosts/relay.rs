//! A cable that is not a good one: it delays packets, drops some, and can be cut.
//!
//! It is a program between two TUN devices, since many kernels have no `netem`. Which packets it drops, and how much longer
//! than the others each takes, is drawn at the address (seed, direction, number of the packet).

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use vamaro_swarm::base::rng::{Draws, Purpose};

/// What it does to packets.
#[derive(Clone, Copy, Debug, Default)]
pub struct Manners {
    /// How long each packet takes.
    pub delay: Duration,
    /// How much longer it takes at most. None overtakes another.
    pub jitter: Duration,
    /// The share of packets that it drops.
    pub loss: f64,
    pub seed: u64,
}

/// A relay between two devices, for as long as it is held: they go with it.
pub struct Relay {
    state: Arc<State>,
    directions: Vec<JoinHandle<()>>,
}

/// What both directions know, and whoever holds the relay.
#[derive(Debug, Default)]
struct State {
    manners: Manners,
    is_cut: AtomicBool,
    has_ended: AtomicBool,
    carried: AtomicU64,
    dropped: AtomicU64,
}

/// A direction.
struct Direction {
    number: u64,
    from: File,
    to: File,
    state: Arc<State>,
    /// Packets that have come in.
    packets: u64,
    /// Those under way, and when each is there.
    under_way: VecDeque<(Instant, Vec<u8>)>,
}

/// The longest packet that a device takes without being told otherwise.
const LONGEST_PACKET: usize = 1500;

/// How long a direction sleeps before it looks whether it is to end.
const SLICE: Duration = Duration::from_millis(50);

impl Relay {
    /// Makes devices of these names, to be given addresses; `None` where this user may not make any.
    pub fn new(devices: [&str; 2], manners: Manners) -> Option<Relay> {
        let [near, far] = devices.map(device);
        let (near, far) = (near?, far?);
        let state = Arc::new(State { manners, ..State::default() });
        let ends = [(near.try_clone().ok()?, far.try_clone().ok()?), (far, near)];
        let directions = ends.into_iter().zip(0..).map(|((from, to), number)| {
            let (state, under_way) = (state.clone(), VecDeque::new());
            let direction = Direction { number, from, to, state, packets: 0, under_way };
            std::thread::spawn(|| direction.carry())
        });
        let directions = directions.collect();
        Some(Relay { state, directions })
    }

    /// Cuts it, or mends it.
    pub fn cut(&self, is_cut: bool) {
        self.state.is_cut.store(is_cut, Ordering::Relaxed);
    }

    /// How many packets it has carried so far, and how many it has dropped, those that a cut has cost among them.
    pub fn counts(&self) -> [u64; 2] {
        [&self.state.carried, &self.state.dropped].map(|count| count.load(Ordering::Relaxed))
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.state.has_ended.store(true, Ordering::Relaxed);
        self.directions.drain(..).for_each(|direction| direction.join().unwrap());
    }
}

impl Manners {
    /// What happens to a packet of a direction: how long it takes, or that it is dropped.
    fn fate(&self, direction: u64, packet: u64) -> Option<Duration> {
        let mut draws = Draws::new(self.seed, Purpose::Link, direction, packet);
        (draws.uniform() >= self.loss).then(|| self.delay + self.jitter.mul_f64(draws.uniform()))
    }
}

impl Direction {
    fn carry(mut self) {
        while !self.state.has_ended.load(Ordering::Relaxed) {
            self.take();
            self.give();
            let due = self.under_way.front().map(|(due, _)| due.saturating_duration_since(Instant::now()));
            let nanos = due.unwrap_or(SLICE).min(SLICE).as_nanos() as i64;
            let timeout = Timespec { tv_sec: 0, tv_nsec: nanos };
            poll(&mut [PollFd::new(&self.from, PollFlags::IN)], Some(&timeout)).unwrap();
        }
    }

    /// Takes in what has come.
    fn take(&mut self) {
        let mut bytes = [0; LONGEST_PACKET];
        loop {
            let length = match self.from.read(&mut bytes) {
                Ok(length) => length,
                // The device is not up, if it is not this.
                Err(e) if e.kind() == ErrorKind::WouldBlock => return,
                Err(_) => return std::thread::sleep(Duration::from_millis(1)),
            };
            // What the kernel says by itself is not IPv4, and may come at any time.
            if bytes[0] >> 4 != 4 {
                continue;
            }
            let fate = self.state.manners.fate(self.number, self.packets);
            self.packets += 1;
            match fate.filter(|_| !self.state.is_cut.load(Ordering::Relaxed)) {
                None => _ = self.state.dropped.fetch_add(1, Ordering::Relaxed),
                Some(takes) => {
                    let last = self.under_way.back().map(|(due, _)| *due);
                    let due = last.into_iter().fold(Instant::now() + takes, Instant::max);
                    self.under_way.push_back((due, bytes[..length].to_vec()));
                }
            }
        }
    }

    /// Gives out what is there by now.
    fn give(&mut self) {
        while self.under_way.front().is_some_and(|(due, _)| *due <= Instant::now()) {
            let (_, packet) = self.under_way.pop_front().expect("there is one");
            // A device that is down takes nothing.
            if self.to.write(&packet).is_ok() {
                self.state.carried.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

/// Makes a device of this name. It is there until it is closed, also once it is in another namespace.
fn device(name: &str) -> Option<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags(libc::O_NONBLOCK);
    let device = options.open("/dev/net/tun").ok()?;
    // SAFETY: it is plain data, for which zeros are values.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    request.ifr_ifru.ifru_flags = (libc::IFF_TUN | libc::IFF_NO_PI) as libc::c_short;
    assert!(name.len() < request.ifr_name.len(), "{name} is too long");
    request.ifr_name.iter_mut().zip(name.bytes()).for_each(|(to, byte)| *to = byte as libc::c_char);
    // SAFETY: the request is one that this call takes, and is only read and written during it.
    let made = unsafe { libc::ioctl(device.as_raw_fd(), libc::TUNSETIFF, &mut request) };
    (made == 0).then_some(device)
}

#[test]
fn what_a_packet_meets_depends_on_its_address_only() {
    let [delay, jitter] = [5, 3].map(Duration::from_millis);
    let manners = Manners { delay, jitter, loss: 0.3, seed: 7 };
    let fates = |direction| (0..1000).map(|packet| manners.fate(direction, packet)).collect::<Vec<_>>();
    let there = fates(0);
    assert!(there == fates(0) && there != fates(1));
    let dropped = there.iter().filter(|fate| fate.is_none()).count();
    assert!((250..350).contains(&dropped), "{dropped} of 1000");
    assert!(there.iter().flatten().all(|takes| (delay..=delay + jitter).contains(takes)));
    // Who drops more drops the same and others.
    let worse = Manners { loss: 0.4, ..manners };
    assert!(there.iter().zip(0..).all(|(fate, packet)| fate.is_some() || worse.fate(0, packet).is_none()));
}
