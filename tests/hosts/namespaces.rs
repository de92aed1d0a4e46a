//! Hosts in network namespaces of their own, each joined to ours by a cable or by a relay.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::PROGRAM;
use crate::relay::{Manners, Relay};
use crate::{Host, alone, assert_same_bits, key};

/// A network of its own, and a cable to ours. Dropping it takes both away.
pub struct Namespace {
    name: String,
    address: String,
    /// In place of the cable, if there is one.
    relay: Option<Relay>,
}

impl Namespace {
    /// The one with this number, below 3, at a cable; `None` where this user may not make one.
    pub fn new(number: u8) -> Option<Namespace> {
        Namespace::joined(number, |ours, theirs| {
            ip(&format!("link add {ours} type veth peer name {theirs}")).then_some(None)
        })
    }

    /// The same behind a relay.
    pub fn behind(number: u8, manners: Manners) -> Option<Namespace> {
        Namespace::joined(number, |ours, theirs| Relay::new([ours, theirs], manners).map(Some))
    }

    /// Has `join` make two devices that are joined.
    fn joined(number: u8, join: impl FnOnce(&str, &str) -> Option<Option<Relay>>) -> Option<Namespace> {
        // Another run of the tests has another process id, and so other names and addresses.
        let process = std::process::id();
        let [ours, theirs] = ["a", "b"].map(|end| format!("vs{}{end}{number}", process % 100_000));
        let network = format!("10.{}.{}", process / 80 % 250 + 1, process % 80 * 3 + u32::from(number));
        let (gateway, address) = (format!("{network}.1"), format!("{network}.2"));
        let name = format!("vs-{process}-{number}");
        if !ip(&format!("netns add {name}")) {
            return None;
        }
        let mut namespace = Namespace { name: name.clone(), address: address.clone(), relay: None };
        namespace.relay = join(&ours, &theirs)?;
        let words = [
            format!("link set {theirs} netns {name} name eth0"),
            format!("addr add {gateway}/30 dev {ours}"),
            format!("link set {ours} up"),
            format!("-n {name} addr add {address}/30 dev eth0"),
            format!("-n {name} link set eth0 up"),
            format!("-n {name} link set lo up"),
        ];
        words.iter().all(|words| ip(words)).then_some(namespace)
    }

    pub fn relay(&self) -> &Relay {
        self.relay.as_ref().expect("it is behind one")
    }

    /// Starts a host in it, with a key from this folder and this patience.
    pub fn start(&self, name: &str, folder: &Path, patience: &str) -> Host {
        self.start_over("tcp", name, folder, patience)
    }

    /// The same, over `tcp` or `udp`.
    pub fn start_over(&self, kind: &str, name: &str, folder: &Path, patience: &str) -> Host {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.name, PROGRAM]);
        let (at, key) = (format!("{kind}/{}:7447", self.address), key(folder, "key", 'k'));
        let more = ["--key", key.to_str().unwrap(), "--patience", patience];
        let mut host = Host::start_at(command, name, &at, &more).unwrap();
        host.top = format!("key = \"{}\"\npatience = \"{patience}\"\n", key.display());
        host
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        // The devices go with it.
        ip(&format!("netns del {}", self.name));
    }
}

/// Runs a command of `ip`; whether it could.
fn ip(words: &str) -> bool {
    let status = Command::new("ip").args(words.split(' ')).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

/// Says that a test cannot run here.
pub fn skipped() {
    eprintln!("skipped: this user may not make network namespaces");
}

#[test]
fn hosts_in_namespaces_play_as_one_machine_does() {
    let _alone = alone();
    let (Some(first), Some(second)) = (Namespace::new(0), Namespace::new(1)) else { return skipped() };
    let folder = tempfile::tempdir().unwrap();
    let start = |namespace: &Namespace, name| namespace.start(name, folder.path(), "2s");
    let (first, second) = (start(&first, "first"), start(&second, "second"));
    assert_same_bits(&[&first, &second], "--agents 4 --p 0.4", "");
}
