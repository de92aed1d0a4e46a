//! What the network between hosts loses and delays.

use serde_json::Value;

use crate::common::{fail, succeed};
use crate::{Host, alone, plan};

#[test]
fn the_network_is_the_link_only_where_there_is_one_and_alone() {
    let _alone = alone();
    let hosts = "--hosts nowhere.toml --rate 20";
    for (words, saying) in [
        ("--links network --rate 20", "--hosts"),
        ("--links network --hosts nowhere.toml", "--rate"),
        (&format!("--links network --p 0.5 {hosts}"), "--p"),
        (&format!("--links network --drop 0.5 {hosts}"), "--drop"),
        (&format!("--links network --no-comm-at-t0 {hosts}"), "--no-comm-at-t0"),
        (&format!("--links network+delay(1) {hosts}"), "other links"),
    ] {
        fail(&format!("spawn {words}"), 2, &["--links network", saying]);
    }
    #[cfg(not(feature = "hosts-udp"))]
    fail("host --listen udp/127.0.0.1:7447", 2, &["udp/127.0.0.1:7447", "hosts-udp"]);
}

/// Plays over hosts for some ticks, by the clock: the summary, and what it has of the first host. What was recorded must
/// come out again.
fn play(hosts: &[&Host], words: &str, rest: &str) -> (Value, Value) {
    let folder = tempfile::tempdir().unwrap();
    let (plan, trace) = (plan(folder.path(), hosts, rest), folder.path().join("trace.json"));
    let words = format!(
        "spawn --agents 4 --episodes 2 --rate 25 --deadline 60s --json {words} --hosts {} --record {}",
        plan.display(),
        trace.display()
    );
    let summary: Value = serde_json::from_str(&succeed(&words)).unwrap();
    let verified = succeed(&format!("verify {}", trace.display()));
    assert!(verified.contains("links: what arrived"), "{verified}");
    hosts.iter().for_each(|host| host.assert_empty());
    let first = summary["hosts"][0].clone();
    (summary, first)
}

#[test]
fn what_is_lost_on_the_way_is_not_emulated() {
    let _alone = alone();
    let host = Host::start("left", &[]);
    let (summary, about) = play(&[&host], "--links network", "");
    assert_eq!((&summary["links"], &summary["p"]), (&"network".into(), &Value::Null), "{summary}");
    assert_eq!(summary["real_time"]["dropped_rate"], 0.0, "{summary}");
    let of = |about: &Value, what: &str| about[what].as_u64().unwrap();
    // A stream loses nothing, but what is not taken at once is dropped.
    assert!(of(&about, "observations") > of(&about, "lost"), "{about}");
    let (_, about) = play(&[&host], "--p 0.5", "");
    assert!(of(&about, "observations") > 0 && of(&about, "lost") == 0, "{about}");
}

#[cfg(feature = "hosts-udp")]
mod datagrams {
    use std::collections::HashMap;
    use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
    use std::process::Command;
    use std::thread;

    use super::*;
    use crate::common::PROGRAM;

    /// So many datagrams get through, and then two of three.
    const SAFE: usize = 30;

    /// A way to a host on this machine, on which datagrams are lost. Streams lose nothing. Returns its port.
    fn lossy_way(to: SocketAddr) -> u16 {
        let streams = TcpListener::bind("127.0.0.1:0").unwrap();
        let here = streams.local_addr().unwrap();
        let datagrams = UdpSocket::bind(here).unwrap();
        thread::spawn(move || {
            for near in streams.incoming() {
                let (near, far) = (near.unwrap(), TcpStream::connect(to).unwrap());
                for (mut from, mut to) in [(&near, &far), (&far, &near)].map(|(a, b)| {
                    b.set_nodelay(true).unwrap();
                    (a.try_clone().unwrap(), b.try_clone().unwrap())
                }) {
                    thread::spawn(move || std::io::copy(&mut from, &mut to));
                }
            }
        });
        thread::spawn(move || {
            let (mut ways, mut bytes) = (HashMap::new(), [0; 1 << 16]);
            for number in 0.. {
                let (length, from) = datagrams.recv_from(&mut bytes).unwrap();
                let far = ways.entry(from).or_insert_with(|| {
                    let far = UdpSocket::bind("127.0.0.1:0").unwrap();
                    far.connect(to).unwrap();
                    let (back, near) = (far.try_clone().unwrap(), datagrams.try_clone().unwrap());
                    thread::spawn(move || {
                        let mut bytes = [0; 1 << 16];
                        while let Ok(length) = back.recv(&mut bytes) {
                            let _ = near.send_to(&bytes[..length], from);
                        }
                    });
                    far
                });
                if number < SAFE || number % 3 != 0 {
                    let _ = far.send(&bytes[..length]);
                }
            }
        });
        here.port()
    }

    #[test]
    fn datagrams_that_are_lost_are_observations_that_are_lost() {
        let _alone = alone();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let at = format!("udp/127.0.0.1:{port}");
        let mut host = Host::start_at(Command::new(PROGRAM), "left", &at, &[]).unwrap();
        host.at = format!("udp/127.0.0.1:{}", lossy_way(([127, 0, 0, 1], port).into()));
        let (summary, about) = play(&[&host], "--links network", "agents = [2, 3]\n");
        assert!(about["lost"].as_u64().unwrap() > 0, "{summary}");
        // Sensors and decisions are not lost.
        assert!(about["missed_ticks"].as_u64().unwrap() < 100, "{summary}");
        // Without that, observations go where nothing is lost.
        let (_, about) = play(&[&host], "--p 0.5", "agents = [2, 3]\n");
        assert_eq!(about["lost"], 0, "{about}");
    }
}
