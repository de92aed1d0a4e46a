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

/// 50 ticks in 2 s.
const SHORT: &str = "--rate 25 --episodes 2";

/// Plays over hosts for some ticks, by the clock: the summary, and what it has of the first host. What was recorded must
/// come out again.
fn play(hosts: &[&Host], words: &str, rest: &str) -> (Value, Value) {
    let folder = tempfile::tempdir().unwrap();
    let (plan, trace) = (plan(folder.path(), hosts, rest), folder.path().join("trace.json"));
    let words = format!(
        "spawn --agents 4 {words} --deadline 60s --json --hosts {} --record {}",
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
    let (summary, about) = play(&[&host], &format!("--links network {SHORT}"), "");
    assert_eq!((&summary["links"], &summary["p"]), (&"network".into(), &Value::Null), "{summary}");
    assert_eq!(summary["real_time"]["dropped_rate"], 0.0, "{summary}");
    // A stream loses nothing, but what is not taken at once is dropped.
    let [observations, lost] = counts(&about);
    assert!(observations > lost, "{about}");
    let (_, about) = play(&[&host], &format!("--p 0.5 {SHORT}"), "");
    assert_next_to_nothing_is_lost(&about);
}

/// Observations that went over the network, and those that it lost.
fn counts(about: &Value) -> [u64; 2] {
    ["observations", "lost"].map(|what| about[what].as_u64().unwrap())
}

/// A stream loses nothing, but on a busy machine what finds no room for a millisecond is dropped.
fn assert_next_to_nothing_is_lost(about: &Value) {
    let [observations, lost] = counts(about);
    assert!(observations > 0 && lost < observations / 10, "{about}");
}

#[cfg(feature = "hosts-udp")]
mod datagrams {
    use std::collections::HashMap;
    use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
    use std::process::Command;
    use std::thread;

    use super::*;
    use crate::common::PROGRAM;

    /// So many datagrams get through each way, which is enough to connect.
    const SAFE: usize = 30;

    /// Which datagrams get through, by their number.
    type Passes = fn(usize) -> bool;

    /// A host on this machine behind a way on which datagrams are lost, there and back.
    fn host_behind(passes: [Passes; 2], more: &[&str]) -> Host {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let at = format!("udp/127.0.0.1:{port}");
        let mut host = Host::start_at(Command::new(PROGRAM), "left", &at, more).unwrap();
        host.at = format!("udp/127.0.0.1:{}", lossy_way(([127, 0, 0, 1], port).into(), passes));
        host
    }

    /// A way to a host, on which these datagrams get through. Streams lose nothing. Returns its port.
    fn lossy_way(to: SocketAddr, [there, back]: [Passes; 2]) -> u16 {
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
                    let (far_end, near) = (far.try_clone().unwrap(), datagrams.try_clone().unwrap());
                    thread::spawn(move || {
                        let mut bytes = [0; 1 << 16];
                        for number in 0.. {
                            let Ok(length) = far_end.recv(&mut bytes) else { return };
                            if back(number) {
                                let _ = near.send_to(&bytes[..length], from);
                            }
                        }
                    });
                    far
                });
                if there(number) {
                    let _ = far.send(&bytes[..length]);
                }
            }
        });
        here.port()
    }

    #[test]
    fn datagrams_that_are_lost_are_observations_that_are_lost() {
        let _alone = alone();
        let host = host_behind([|number| number < SAFE || number % 3 != 0, |_| true], &[]);
        let (summary, about) = play(&[&host], &format!("--links network {SHORT}"), "agents = [2, 3]\n");
        assert!(about["lost"].as_u64().unwrap() > 0, "{summary}");
        // Sensors and decisions are not lost.
        assert!(about["missed_ticks"].as_u64().unwrap() < 100, "{summary}");
        // Without that, observations go where nothing is lost.
        let (_, about) = play(&[&host], &format!("--p 0.5 {SHORT}"), "agents = [2, 3]\n");
        assert_next_to_nothing_is_lost(&about);
    }

    #[test]
    fn where_no_datagram_gets_through_any_longer_observations_go_by_the_stream() {
        let _alone = alone();
        let dies: Passes = |number| number < SAFE;
        let mut host = host_behind([dies; 2], &["--patience", "1s"]);
        host.top = "patience = \"1s\"\n".to_owned();
        let words = "--links network --rate 50 --episodes 6";
        let (summary, about) = play(&[&host], words, "agents = [2, 3]\n");
        let [observations, lost] = counts(&about);
        assert!(lost > 0, "{summary}");
        // Two agents on either side: a datagram has no more than two observations.
        assert!(observations - lost > 2 * 2 * SAFE as u64, "{summary}");
    }
}
