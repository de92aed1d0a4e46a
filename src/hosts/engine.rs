//! The engine between machines, Zenoh: the only file that names it, but for `plain.rs` and `threads.rs`.
//!
//! A host listens; a supervisor has a session with each of its hosts. A session first carries questions and their answers.
//! Then a [`Line`] is opened in it, over which either side sends what it likes: all of it arrives, in order. Each side is
//! told when the other is gone.
//!
//! A host lets in everybody who has its key, and passes on between them what they ask for by name: several may be there at
//! a time. So the names of a line have a secret in them, which keeps swarms apart and makes them hard to speak into. It
//! keeps nobody from reading who has been let in: names may be asked for by a pattern.

use std::borrow::Cow;
use std::net::{TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, TryRecvError, bounded};
use serde_json::{Value, json};
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::SampleKind;
use zenoh::{Config, Session, Wait};

use super::key::Key;
use super::orders::LARGEST_POLICY;
use super::patience::Patience;
use super::plan::{socket_of, takes_datagrams};
use crate::base::error::Result;
use crate::bus::now_ns;
use crate::failed;
use crate::supervisor::signals;

/// Where a host is asked.
const QUESTIONS: &str = "vamaro-swarm/questions";

/// The answers that a connection by datagrams may take, which are tried so often each: a datagram may be lost.
const LONGEST_BY_DATAGRAMS: u32 = 5;
const ATTEMPTS: u32 = 3;

/// Streams and datagrams between two ends, those included of attempts of which one side does not know yet that they failed.
const MOST_LINKS: usize = 16;

/// Who sends so many messages that nobody has taken is cut off: in lockstep a few are under way.
const MOST_HEARD: usize = 4096;

/// The bytes of the longest message: a policy, and what is asked with it.
const LONGEST_MESSAGE: u64 = LARGEST_POLICY + (1 << 20);

/// How long this waits before it looks whether it was asked to stop.
const SLICE: Duration = Duration::from_millis(50);

/// One end of the engine.
pub(super) struct Engine {
    pub(super) session: Session,
    pub(super) patience: Patience,
}

/// A question, which is to be answered.
pub(super) struct Question(Query);

/// Answers questions for as long as it is held.
pub(super) struct Answering {
    _queryable: Queryable<()>,
}

/// Which end of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Supervisor,
    Host,
}

impl End {
    pub(super) fn other(self) -> End {
        match self {
            End::Supervisor => End::Host,
            End::Host => End::Supervisor,
        }
    }
}

/// What comes over a line.
#[derive(Debug)]
pub(super) enum Heard {
    /// Messages.
    Frame(Vec<u8>),
    /// Orders or events, and when they came: nanoseconds of the monotonic clock.
    Words(Vec<u8>, u64),
    /// The other side is there.
    Here,
    /// It is gone.
    Gone,
}

/// One end of the line between a supervisor and a host.
pub(super) struct Line {
    speaks: Publisher<'static>,
    /// The same, but what finds no room is dropped at once.
    hurries: Publisher<'static>,
    /// The same over what may lose it.
    throws: Publisher<'static>,
    heard: Receiver<Heard>,
    _hears: Subscriber<()>,
    _watches: Subscriber<()>,
    /// The other side watches this.
    _lives: LivelinessToken,
}

impl Engine {
    /// Listens at an address, for all that have the key.
    pub(super) fn listen(at: &str, key: Option<&Key>, patience: Patience) -> Result<Engine> {
        let key = key.map(|key| ("transport/auth/usrpwd/dictionary_file", key.path.to_string_lossy().into()));
        let own = [("mode", "peer".into()), ("listen/endpoints", endpoints(at).into()), links(at)];
        // The engine is short of words, too, for why it cannot.
        let bound = TcpListener::bind(socket_of(at));
        let bound =
            bound.and_then(|_| takes_datagrams(at).then(|| UdpSocket::bind(socket_of(at))).transpose());
        drop(bound.map_err(|e| failed!("cannot listen at {at}: {e}; is another host running here?"))?);
        let session = open(patience, own.into_iter().chain(key));
        let session = session.map_err(|e| failed!("cannot listen at {at}: {}", words(&e)))?;
        Ok(Engine { session, patience })
    }

    /// Connects to a host that listens at an address. The engine cannot be interrupted in that, so a thread does it, which
    /// is left to itself if the program is asked to stop.
    pub(super) fn connect(at: &str, key: Option<&Key>, patience: Patience) -> Result<Engine> {
        let (at, key, (done, is_done)) = (at.to_owned(), key.cloned(), bounded(1));
        let connect = move || drop(done.send(Engine::connect_now(&at, key.as_ref(), patience)));
        let thread = std::thread::Builder::new().spawn(connect);
        thread.map_err(|e| failed!("cannot be reached: no thread can be started: {e}"))?;
        loop {
            signals::check_stop()?;
            match is_done.recv_timeout(SLICE) {
                Ok(engine) => return engine,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(failed!("cannot be reached")),
            }
        }
    }

    fn connect_now(at: &str, key: Option<&Key>, patience: Patience) -> Result<Engine> {
        let key = key.map(|key| {
            let user = json!({"user": key.name, "password": key.secret});
            ("transport/auth/usrpwd", user)
        });
        let by_stream = [("mode", "client".into()), ("connect/timeout_ms", milliseconds(patience.reply()))];
        // A client has one link only.
        let by_datagrams = [
            ("mode", "peer".into()),
            ("listen/endpoints", json!([])),
            ("connect/timeout_ms", milliseconds(LONGEST_BY_DATAGRAMS * patience.reply())),
            ("connect/retry", json!({"period_init_ms": 100, "period_max_ms": 100})),
            ("transport/unicast/open_timeout", milliseconds(patience.reply() / ATTEMPTS)),
        ];
        let (how, also) = if takes_datagrams(at) {
            (by_datagrams.to_vec(), ", and do datagrams get through")
        } else {
            (by_stream.to_vec(), "")
        };
        let own = [
            ("connect/endpoints", endpoints(at).into()),
            ("connect/exit_on_failure", true.into()),
            links(at),
        ];
        knock(at, patience.reply())
            .map_err(|e| failed!("cannot be reached: {e}; is `vamaro-swarm host` running there?"))?;
        let session = open(patience, own.into_iter().chain(how).chain(key));
        let session =
            session.map_err(|e| failed!("does not let us in: is its key the same{also}? ({})", words(&e)))?;
        Ok(Engine { session, patience })
    }

    /// Asks the host something, and sends a policy file with it.
    pub(super) fn ask(&self, question: Vec<u8>, policy: &[u8], longest: Duration) -> Result<Vec<u8>> {
        let asked = self.session.get(QUESTIONS).payload(question).attachment(policy).timeout(longest);
        let answers = asked.wait().map_err(|e| failed!("cannot be asked: {e}"))?;
        let deadline = Instant::now() + longest;
        let silent = || {
            if Instant::now() < deadline {
                failed!("cannot be reached any longer")
            } else {
                failed!("does not answer within {longest:?}")
            }
        };
        while Instant::now() < deadline + SLICE {
            signals::check_stop()?;
            if let Some(reply) = answers.recv_timeout(SLICE).map_err(|_| silent())? {
                let answer = reply.result().map_err(|_| silent())?;
                return Ok(answer.payload().to_bytes().into_owned());
            }
        }
        Err(silent())
    }

    /// Has questions answered, by a thread of the engine.
    pub(super) fn answer(&self, answer: impl Fn(Question) + Send + Sync + 'static) -> Result<Answering> {
        let queryable =
            self.session.declare_queryable(QUESTIONS).callback(move |query| answer(Question(query)));
        let queryable = queryable.wait().map_err(|e| failed!("cannot answer questions: {e}"))?;
        Ok(Answering { _queryable: queryable })
    }

    /// Opens one end of the line with this secret. A thread of the engine calls `tell` after something has come. Whoever
    /// asks the other side to open its end has opened this one before: then nothing is lost.
    pub(super) fn line(
        &self,
        secret: &str,
        end: End,
        tell: impl Fn() + Clone + Send + Sync + 'static,
    ) -> Result<Line> {
        let key = |end: End, what: &str| format!("vamaro-swarm/{secret}/{end:?}/{what}");
        let other = end.other();
        let wrong = |e: zenoh::Error| failed!("cannot open the line: {e}");
        let publisher = |congestion| {
            let publisher = self.session.declare_publisher(key(other, "hears"));
            publisher.congestion_control(congestion).priority(Priority::RealTime).express(true)
        };
        let throws = publisher(CongestionControl::Drop);
        #[cfg(feature = "hosts-udp")]
        let throws = throws.reliability(zenoh::qos::Reliability::BestEffort);
        let (sender, heard) = bounded(MOST_HEARD);
        let inlet = Inlet(Arc::new(Mutex::new(Some(sender))));
        let pass = |inlet: Inlet| {
            let tell = tell.clone();
            move |heard| {
                inlet.put(heard);
                tell();
            }
        };
        let (pass_on, pass_life) = (pass(inlet.clone()), pass(inlet));
        let hears = self.session.declare_subscriber(key(end, "hears"));
        let hears = hears.callback(move |sample| {
            let bytes = sample.payload().to_bytes().into_owned();
            let is_words = *sample.encoding() == Encoding::APPLICATION_JSON;
            pass_on(if is_words { Heard::Words(bytes, now_ns()) } else { Heard::Frame(bytes) });
        });
        let watches = self.session.liveliness().declare_subscriber(key(other, "lives")).history(true);
        let watches = watches.callback(move |sample| match sample.kind() {
            SampleKind::Put => pass_life(Heard::Here),
            SampleKind::Delete => pass_life(Heard::Gone),
        });
        Ok(Line {
            _hears: hears.wait().map_err(wrong)?,
            _watches: watches.wait().map_err(wrong)?,
            _lives: self.session.liveliness().declare_token(key(end, "lives")).wait().map_err(wrong)?,
            speaks: publisher(CongestionControl::Block).wait().map_err(wrong)?,
            hurries: publisher(CongestionControl::Drop).wait().map_err(wrong)?,
            throws: throws.wait().map_err(wrong)?,
            heard,
        })
    }
}

impl Question {
    /// What is asked.
    pub(super) fn bytes(&self) -> Cow<'_, [u8]> {
        self.0.payload().map(|payload| payload.to_bytes()).unwrap_or_default()
    }

    /// The policy file that has come with it, which is copied if it came in parts.
    pub(super) fn policy(&self) -> Cow<'_, [u8]> {
        self.0.attachment().map(|policy| policy.to_bytes()).unwrap_or_default()
    }

    /// Answers it, which ends it: only then does the answer count. Who asked may be gone, and misses nothing then.
    pub(super) fn answer(self, bytes: Vec<u8>) {
        let _ = self.0.reply(QUESTIONS, bytes).wait();
    }
}

impl Line {
    /// Sends messages to the other side. That it is gone, if it is, is heard.
    pub(super) fn send(&self, frame: Vec<u8>) {
        let _ = self.speaks.put(frame).wait();
    }

    /// Sends messages, unless the other side takes nothing.
    pub(super) fn send_unless_full(&self, frame: Vec<u8>) {
        let _ = self.hurries.put(frame).wait();
    }

    /// Sends messages that may be lost, if that is how the network is: by datagrams, where there are any.
    pub(super) fn send_or_lose(&self, frame: Vec<u8>) {
        let _ = self.throws.put(frame).wait();
    }

    /// Sends orders or events.
    pub(super) fn say(&self, words: Vec<u8>) {
        let _ = self.speaks.put(words).encoding(Encoding::APPLICATION_JSON).wait();
    }

    /// Sends an order or event that is worth nothing later, unless the other side takes nothing.
    pub(super) fn say_unless_full(&self, words: Vec<u8>) {
        let _ = self.hurries.put(words).encoding(Encoding::APPLICATION_JSON).wait();
    }

    /// What has come, if there is something.
    pub(super) fn hear(&self) -> Option<Heard> {
        match self.heard.try_recv() {
            Err(TryRecvError::Empty) => None,
            heard => Some(heard.unwrap_or(Heard::Gone)),
        }
    }

    /// What comes within some time.
    pub(super) fn hear_within(&self, longest: Duration) -> Option<Heard> {
        match self.heard.recv_timeout(longest) {
            Err(RecvTimeoutError::Timeout) => None,
            heard => Some(heard.unwrap_or(Heard::Gone)),
        }
    }
}

/// Where what comes is put. Once it is full it is closed: the other side is gone to whoever has taken what is in it.
#[derive(Clone)]
struct Inlet(Arc<Mutex<Option<Sender<Heard>>>>);

impl Inlet {
    fn put(&self, heard: Heard) {
        let mut sender = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if sender.as_ref().is_some_and(|sender| sender.try_send(heard).is_err()) {
            *sender = None;
        }
    }
}

/// Sees whether somebody listens there, since the engine does not say why it cannot connect.
fn knock(at: &str, longest: Duration) -> std::io::Result<()> {
    let mut last = std::io::Error::other("it has no address");
    for address in socket_of(at).to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, longest) {
            Ok(_) => return Ok(()),
            Err(e) => last = e,
        }
    }
    Err(last)
}

/// Where the engine listens, or connects to, for an address: datagrams come beside a stream, at the same port. Then all
/// goes over the stream but for what may be lost.
fn endpoints(at: &str) -> Vec<String> {
    let datagrams = takes_datagrams(at).then(|| at.to_owned());
    [format!("tcp/{}", socket_of(at))].into_iter().chain(datagrams).collect()
}

/// How many links there may be between two ends.
fn links(at: &str) -> (&'static str, Value) {
    ("transport/unicast/max_links", if takes_datagrams(at) { MOST_LINKS } else { 1 }.into())
}

/// A time, as the engine takes it.
fn milliseconds(time: Duration) -> Value {
    (time.as_millis() as u64).into()
}

/// What the engine says of an error, without the places in its source.
fn words(e: &zenoh::Error) -> String {
    e.to_string().split(" at /").next().unwrap_or_default().to_owned()
}

/// Opens a session: nothing is found by itself, nor read from files or the environment.
fn open(patience: Patience, own: impl Iterator<Item = (&'static str, Value)>) -> zenoh::Result<Session> {
    let [silence, reply] = [patience.silence(), patience.reply()];
    let common = [
        ("scouting/multicast/enabled", false.into()),
        ("scouting/gossip/enabled", false.into()),
        ("transport/link/tx/lease", milliseconds(silence)),
        ("transport/unicast/open_timeout", milliseconds(reply)),
        ("transport/unicast/accept_timeout", milliseconds(reply)),
        ("transport/link/rx/max_message_size", LONGEST_MESSAGE.into()),
        // Who takes nothing for so long is gone as well, us.
        (
            "transport/link/tx/queue/congestion_control/block/wait_before_close",
            (silence.as_micros() as u64).into(),
        ),
    ];
    let mut config = Config::default();
    for (name, value) in common.into_iter().chain(own) {
        config.insert_json5(name, &value.to_string())?;
    }
    zenoh::open(config).wait()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_sends_more_than_is_taken_is_gone() {
        let (sender, heard) = bounded(2);
        let inlet = Inlet(Arc::new(Mutex::new(Some(sender))));
        (0..4).for_each(|_| inlet.put(Heard::Here));
        assert_eq!(heard.iter().count(), 2, "it ends behind what was in it");
    }
}
