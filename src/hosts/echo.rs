//! Messages to a host and back, for `bench latency --hosts`: over a line as in a swarm, over Zenoh with nothing of ours, and
//! over UDP.

use std::fmt;
use std::io;
use std::net::{IpAddr, ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::engine::{End, Engine, Heard, Line};
use super::host::Host;
use super::orders::{Answer, Order, Question, is_secret, say, secret};
use super::plain::Plain;
use super::plan::Plan;
use crate::base::error::Result;
use crate::bus::{Bell, Layout, SupervisorPort, SwarmAddress, SwarmDirectory};
use crate::failed;
use crate::supervisor::signals;

/// What messages go over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Over {
    /// A line, waited for as in a swarm.
    Line,
    /// Zenoh, with the settings of our sessions and nothing of ours around it.
    Zenoh,
    /// Datagrams.
    Udp,
}

impl Over {
    /// All of them, ours first.
    pub(crate) const ALL: [Over; 3] = [Over::Line, Over::Zenoh, Over::Udp];
}

impl fmt::Display for Over {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Over::Line => "our line",
            Over::Zenoh => "plain Zenoh",
            Over::Udp => "UDP",
        })
    }
}

/// What a host is asked for: to answer messages that come over this, each by one as long as it says.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Echo {
    over: Over,
    /// The secret of its names. Every message begins with it.
    line: String,
}

/// A host that can be measured.
pub(crate) struct Partner {
    host: Host,
}

/// It answers messages, until this is dropped.
pub(crate) struct Answering<'a> {
    partner: &'a Partner,
    way: Way,
    /// Messages sent.
    sent: u32,
}

/// One end of the way.
pub(super) struct Way {
    secret: String,
    /// It tells that the other side is gone, whatever messages go over.
    line: Line,
    carrier: Carrier,
    /// Where whoever waits for the line sleeps.
    port: SupervisorPort,
    // Declared last: all else in it goes first.
    _directory: SwarmDirectory,
}

enum Carrier {
    Line,
    Zenoh(Plain),
    Udp(UdpSocket),
}

/// The front of a message: the secret, the length of the answer, and the number of the message.
const SECRET: usize = 32;
const FRONT: usize = SECRET + 8;

/// The most bytes of a message: so many fit into a datagram.
const LONGEST: usize = 60_000;

/// How long either side waits before it looks whether it shall go on.
const SLICE: Duration = Duration::from_millis(100);

/// A datagram that has not been answered by then is lost.
const LOST: Duration = Duration::from_secs(1);

impl Partner {
    /// Connects to the first hosts of a plan.
    pub(crate) fn connect(plan: &Plan, hosts: usize) -> Result<Vec<Partner>> {
        let key = plan.key()?;
        let connect = |planned: &super::plan::PlannedHost| {
            Ok(Partner { host: Host::connect(planned, key.as_ref(), plan.patience, 0, false)? })
        };
        plan.hosts.iter().take(hosts).map(connect).collect()
    }

    /// What the plan calls it.
    pub(crate) fn name(&self) -> &str {
        &self.host.planned.name
    }

    /// Sends a policy file; how long it takes until the host has said that it is there.
    pub(crate) fn ship(&self, policy: &[u8]) -> Result<Duration> {
        let began = Instant::now();
        self.host.ask(&Question::Who, policy, self.host.engine.patience.join())?;
        Ok(began.elapsed())
    }

    /// Has it answer messages that go over this.
    pub(crate) fn answering(&self, over: Over) -> Result<Answering<'_>> {
        let (engine, secret) = (&self.host.engine, secret()?);
        let mut way = Way::open(engine, &secret, End::Supervisor)?;
        if over == Over::Zenoh {
            way.carrier = Carrier::Zenoh(Plain::open(engine, &secret, End::Supervisor)?);
        }
        let echo = Echo { over, line: secret };
        let port = match self.host.ask(&Question::Echo(echo), &[], engine.patience.reply())? {
            Answer::At(port) => port,
            Answer::No(why) => return Err(failed!("{} does not answer messages: {why}", self.host.name)),
            Answer::I(_) | Answer::Yes => return Err(failed!("{} answers something else", self.host.name)),
        };
        if over == Over::Udp {
            let socket = self.socket(port).map_err(|e| failed!("cannot send datagrams: {e}"))?;
            way.carrier = Carrier::Udp(socket);
        }
        Ok(Answering { partner: self, way, sent: 0 })
    }

    /// A socket for datagrams to a port of this host.
    fn socket(&self, port: u16) -> io::Result<UdpSocket> {
        let address = address_of(&self.host.planned.at)?;
        let socket = UdpSocket::bind((any_like(address), 0))?;
        socket.connect((address, port))?;
        Ok(socket)
    }
}

impl Answering<'_> {
    /// Sends a message of so many bytes, to be answered by one of so many.
    pub(crate) fn send(&mut self, length: usize, answer: usize) {
        self.sent += 1;
        let mut bytes = vec![0; length.clamp(FRONT, LONGEST)];
        bytes[..SECRET].copy_from_slice(self.way.secret.as_bytes());
        bytes[SECRET..SECRET + 4].copy_from_slice(&(answer as u32).to_ne_bytes());
        bytes[SECRET + 4..FRONT].copy_from_slice(&self.sent.to_ne_bytes());
        self.way.send(bytes);
    }

    /// Waits for the answer to the last message; whether it came. Only a datagram may be lost.
    pub(crate) fn is_answered(&self) -> Result<bool> {
        let is_udp = matches!(self.way.carrier, Carrier::Udp(_));
        let longest = if is_udp { LOST } else { self.partner.host.engine.patience.join() };
        let deadline = Instant::now() + longest;
        while Instant::now() < deadline {
            signals::check_stop()?;
            let came = self.way.receive(SLICE).map_err(|e| failed!("{} {e}", self.partner.host.name))?;
            // One that came late answers another.
            if came.is_some_and(|bytes| bytes.get(SECRET + 4..FRONT) == Some(&self.sent.to_ne_bytes())) {
                return Ok(true);
            }
        }
        if is_udp {
            return Ok(false);
        }
        Err(failed!("{} does not answer within {longest:?}", self.partner.host.name))
    }
}

impl Drop for Answering<'_> {
    fn drop(&mut self) {
        self.way.line.say(say(&Order::Leave));
        let deadline = Instant::now() + self.partner.host.engine.patience.reply();
        // It is there for the next when it says so.
        while let Some(Heard::Frame(_) | Heard::Here) =
            self.way.line.hear_within(deadline.saturating_duration_since(Instant::now()))
        {}
    }
}

impl Way {
    /// Opens the end of a host that listens at `at`; also the port for datagrams, 0 if there will be none.
    pub(super) fn open_for(engine: &Engine, at: &str, echo: &Echo) -> Result<(Way, u16)> {
        if !is_secret(&echo.line) {
            return Err(failed!("there are no such names"));
        }
        let mut way = Way::open(engine, &echo.line, End::Host)?;
        let mut port = 0;
        match echo.over {
            Over::Line => {}
            Over::Zenoh => way.carrier = Carrier::Zenoh(Plain::open(engine, &echo.line, End::Host)?),
            Over::Udp => {
                let bound = address_of(at).and_then(|address| UdpSocket::bind((address, 0)));
                let bound = bound.and_then(|socket| Ok((socket.local_addr()?.port(), socket)));
                let (free, socket) = bound.map_err(|e| failed!("cannot receive datagrams: {e}"))?;
                (way.carrier, port) = (Carrier::Udp(socket), free);
            }
        }
        Ok((way, port))
    }

    /// Answers messages until the other side has had enough, or is gone; the first datagram has to come within `arrival`.
    /// Nothing is left then, but for the line.
    pub(super) fn serve(self, arrival: Duration) -> Result<Line> {
        if let Carrier::Udp(socket) = &self.carrier {
            adopt(socket, &self.secret, Instant::now() + arrival)
                .map_err(|e| failed!("no datagram came: {e}"))?;
        }
        while let Ok(came) = self.receive(SLICE) {
            signals::check_stop()?;
            came.iter().for_each(|bytes| self.answer(bytes));
        }
        Ok(self.line)
    }

    /// Opens one end, with messages over the line.
    fn open(engine: &Engine, secret: &str, end: End) -> Result<Way> {
        let directory = SwarmDirectory::create()?;
        let address = SwarmAddress::of(directory.tag());
        let layout = Layout { agents: 1, observation: 1, action: 1, joint: 1, logits: 0, relay: false };
        let port = SupervisorPort::create(&address, &layout)?;
        let bell = std::sync::Arc::new(Bell::of(&address)?);
        let line = engine.line(secret, end, move || bell.ring())?;
        let carrier = Carrier::Line;
        Ok(Way { secret: secret.to_owned(), line, carrier, port, _directory: directory })
    }

    fn send(&self, bytes: Vec<u8>) {
        match &self.carrier {
            Carrier::Line => self.line.send(bytes),
            Carrier::Zenoh(plain) => plain.send(bytes),
            // One that is lost is missed where it was to come.
            Carrier::Udp(socket) => drop(socket.send(&bytes)),
        }
    }

    /// The next message, if one comes within some time.
    ///
    /// # Errors
    /// `Failed` if the other side is gone, or has said that there will be none.
    fn receive(&self, longest: Duration) -> Result<Option<Vec<u8>>> {
        let deadline = Instant::now() + longest;
        loop {
            while let Some(heard) = self.line.hear() {
                match heard {
                    Heard::Frame(bytes) => return Ok(Some(bytes)),
                    Heard::Here => {}
                    Heard::Words(..) | Heard::Gone => return Err(failed!("has left")),
                }
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let came = match &self.carrier {
                Carrier::Line => {
                    // Not 0, which is forever.
                    self.port.sleep(left.max(Duration::from_millis(1)))?;
                    None
                }
                Carrier::Zenoh(plain) => plain.receive(left),
                Carrier::Udp(socket) => receive_datagram(socket, left),
            };
            if came.is_some() {
                return Ok(came);
            }
        }
    }

    /// Answers a message.
    fn answer(&self, bytes: &[u8]) {
        let Some(front) = bytes.get(..FRONT).filter(|front| front.starts_with(self.secret.as_bytes())) else {
            return;
        };
        let length = u32::from_ne_bytes(front[SECRET..SECRET + 4].try_into().expect("it has 4 bytes"));
        // Nobody can have us send more datagrams than come in, or longer ones.
        let most = if matches!(self.carrier, Carrier::Udp(_)) { bytes.len() } else { LONGEST };
        let mut answer = vec![0; (length as usize).clamp(FRONT, most)];
        answer[..FRONT].copy_from_slice(front);
        self.send(answer);
    }
}

/// Connects a socket to whoever sends the first message with the secret, which stays to be received.
fn adopt(socket: &UdpSocket, secret: &str, deadline: Instant) -> io::Result<()> {
    socket.set_read_timeout(Some(SLICE))?;
    let mut bytes = [0; SECRET];
    while Instant::now() < deadline {
        match socket.peek_from(&mut bytes) {
            Ok((_, from)) if bytes == *secret.as_bytes() => return socket.connect(from),
            Ok(_) => drop(socket.recv(&mut bytes)?),
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(e) => return Err(e),
        }
    }
    Err(io::ErrorKind::TimedOut.into())
}

fn receive_datagram(socket: &UdpSocket, longest: Duration) -> Option<Vec<u8>> {
    let mut bytes = vec![0; LONGEST];
    socket.set_read_timeout(Some(longest)).ok()?;
    let length = socket.recv(&mut bytes).ok()?;
    bytes.truncate(length);
    Some(bytes)
}

fn address_of(at: &str) -> io::Result<IpAddr> {
    let first = at.trim_start_matches("tcp/").to_socket_addrs()?.next();
    first.map(|address| address.ip()).ok_or_else(|| io::Error::other("it has no address"))
}

/// All addresses of the kind that one is.
fn any_like(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => std::net::Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => std::net::Ipv6Addr::UNSPECIFIED.into(),
    }
}
