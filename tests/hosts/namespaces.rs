//! Hosts in network namespaces of their own, joined by a cable.

use std::process::{Command, Stdio};

use crate::common::PROGRAM;
use crate::{Host, alone, assert_same_bits};

/// A network of its own, and a cable to ours. Dropping it takes both away.
struct Namespace {
    name: String,
    address: String,
}

impl Namespace {
    /// The one with this number, 0 or 1; `None` where this user may not make one.
    fn new(number: u8) -> Option<Namespace> {
        // Another run of the tests has another process id, and so other names and addresses.
        let process = std::process::id();
        let name = format!("vs-{process}-{number}");
        let (ours, theirs) = (format!("vs{}a{number}", process % 100_000), "eth0");
        let network = format!("10.{}.{}", process / 100 % 250 + 1, process % 100 * 2 + u32::from(number));
        let (gateway, address) = (format!("{network}.1"), format!("{network}.2"));
        let namespace = Namespace { name: name.clone(), address: address.clone() };
        let words = [
            format!("netns add {name}"),
            format!("link add {ours} type veth peer name {theirs} netns {name}"),
            format!("addr add {gateway}/30 dev {ours}"),
            format!("link set {ours} up"),
            format!("-n {name} addr add {address}/30 dev {theirs}"),
            format!("-n {name} link set {theirs} up"),
            format!("-n {name} link set lo up"),
        ];
        words.iter().all(|words| ip(words)).then_some(namespace)
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        // The cable goes with it.
        ip(&format!("netns del {}", self.name));
    }
}

fn ip(words: &str) -> bool {
    let status = Command::new("ip").args(words.split(' ')).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

#[test]
fn hosts_in_namespaces_play_as_one_machine_does() {
    let _alone = alone();
    let (Some(first), Some(second)) = (Namespace::new(0), Namespace::new(1)) else {
        return eprintln!("skipped: this user may not make network namespaces");
    };
    let folder = tempfile::tempdir().unwrap();
    let key = folder.path().join("key");
    std::fs::write(&key, format!("swarm:{}\n", "k".repeat(32))).unwrap();
    std::fs::set_permissions(&key, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let start = |namespace: &Namespace, name: &str| {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &namespace.name, PROGRAM]);
        let at = format!("tcp/{}:7447", namespace.address);
        let mut host = Host::start_at(command, name, &at, &["--key", key.to_str().unwrap()]).unwrap();
        host.key = Some(key.clone());
        host
    };
    let (first, second) = (start(&first, "first"), start(&second, "second"));
    assert_same_bits(&[&first, &second], "--agents 4 --p 0.4", "");
}
