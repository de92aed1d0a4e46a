//! Others in the engine: who has no key, and who has one and speaks nonsense.

use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::process::Child;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use zenoh::bytes::Encoding;
use zenoh::{Config, Session, Wait};

use crate::common::{await_sleeps, children, stderr, succeed};
use crate::{Host, alone, await_end, end, key, plan, play};

/// A session with a host, as a program of somebody else would have it.
fn session(host: &Host, secret: Option<String>) -> zenoh::Result<Session> {
    let mut config = Config::default();
    let mut set =
        |name: &str, value: serde_json::Value| config.insert_json5(name, &value.to_string()).unwrap();
    set("mode", "client".into());
    set("connect/endpoints", [host.at.as_str()].as_slice().into());
    set("connect/timeout_ms", 2000.into());
    set("connect/exit_on_failure", true.into());
    set("scouting/multicast/enabled", false.into());
    if let Some(secret) = secret {
        set("transport/auth/usrpwd", serde_json::json!({"user": "swarm", "password": secret}));
    }
    zenoh::open(config).wait()
}

/// A host with a key, whose secret is 32 times `k`.
fn host(folder: &Path) -> Host {
    let key = key(folder, "key", 'k');
    let mut host = Host::start("left", &["--key", key.to_str().unwrap()]);
    host.top = format!("key = \"{}\"\n", key.display());
    host
}

#[test]
fn who_has_no_key_cannot_disturb_a_swarm() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let host = host(folder.path());
    let supervisor = play(&plan(folder.path(), &[&host], ""), &[&host], "--task hear-see");
    assert!(session(&host, None).is_err());
    assert!(session(&host, Some("w".repeat(32))).is_err());
    let noise = (0..20u8).map(|number| {
        let mut stream = TcpStream::connect(host.at.trim_start_matches("tcp/")).unwrap();
        // Some say how long they are, and are not; some say nothing at all.
        let bytes =
            [&[number, number % 3][..], &vec![number.wrapping_mul(37); usize::from(number) * 50]].concat();
        stream.write_all(&bytes[..bytes.len() * usize::from(number % 4 != 0)]).unwrap();
        stream
    });
    let noise: Vec<TcpStream> = noise.collect();
    await_sleeps(children(host.process.id())[0], 50);
    drop(noise);
    let (code, said) = end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    host.assert_empty();
}

/// Somebody who has been let in.
struct Stranger {
    session: Session,
    /// What travels, and under which names.
    overheard: Receiver<(String, Vec<u8>)>,
}

impl Stranger {
    fn new(host: &Host) -> Stranger {
        let session = session(host, Some("k".repeat(32))).unwrap();
        let (hear, overheard) = channel();
        let all = session.declare_subscriber("vamaro-swarm/**").callback(move |sample| {
            let _ = hear.send((sample.key_expr().to_string(), sample.payload().to_bytes().into_owned()));
        });
        all.background().wait().unwrap();
        Stranger { session, overheard }
    }

    /// The next frame that travels to this end, and the name it travels under.
    fn overhear(&self, end: &str) -> (String, Vec<u8>) {
        // What is there may be of a swarm that has ended.
        self.overheard.try_iter().for_each(drop);
        loop {
            let heard = self.overheard.recv_timeout(Duration::from_secs(20)).expect("something travels");
            // Frames begin with a number, which is seldom a brace, and words with one.
            if heard.0.contains(end) && heard.0.ends_with("hears") && !heard.1.starts_with(b"{") {
                return heard;
            }
        }
    }

    fn say(&self, name: &str, bytes: Vec<u8>, encoding: Encoding) {
        self.session.put(name, bytes).encoding(encoding).wait().unwrap();
    }

    /// What the host answers to a question.
    fn ask(&self, question: &[u8], policy: &[u8]) -> String {
        let asked = self.session.get("vamaro-swarm/questions").payload(question).attachment(policy);
        let answer = asked.timeout(Duration::from_secs(10)).wait().unwrap().recv().unwrap();
        let answer = answer.result().expect("it answers").payload().to_bytes();
        String::from_utf8(answer.into_owned()).unwrap()
    }
}

#[test]
fn who_has_the_key_and_speaks_nonsense_ends_a_swarm_and_no_host() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let host = host(folder.path());
    let plan = plan(folder.path(), &[&host], "");
    let start = || play(&plan, &[&host], "--task hear-see --on-failure abort");
    let supervisor = start();
    let stranger = Stranger::new(&host);
    // Questions do nothing to a swarm.
    let deep = "[".repeat(100_000);
    for question in ["", "{}", "null", "\"Join\"", "{\"Join\":{}}", "\u{0}\u{ff}", &deep] {
        let answer = stranger.ask(question.as_bytes(), &[0; 1000]);
        assert!(answer.starts_with("{\"No\""), "{question:.20}: {answer}");
    }
    await_sleeps(children(host.process.id())[0], 50);
    let (name, _) = stranger.overhear("Host");
    stranger.say(&name, b"nonsense".to_vec(), Encoding::default());
    assert_ended(supervisor, &host);
    let supervisor = start();
    let (name, _) = stranger.overhear("Supervisor");
    stranger.say(&name, b"nonsense".to_vec(), Encoding::APPLICATION_JSON);
    assert_ended(supervisor, &host);
    succeed(&format!("spawn --task hear-see --episodes 1 --deadline 60s --hosts {}", plan.display()));
}

/// Waits until the only host of a swarm is lost to it.
fn assert_ended(supervisor: Child, host: &Host) {
    let output = await_end(supervisor);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("host left") && !said.contains("panicked"), "{said}");
    host.assert_empty();
}
