//! Hosts in network namespaces of their own, joined by a cable.

use std::process::{Command, Stdio};

use crate::common::{PROGRAM, succeed};
use crate::{Host, plan};

/// A network of its own, and a cable to ours. Dropping it takes both away.
struct Namespace {
    name: String,
    address: String,
}

impl Namespace {
    /// The one with this number, up to 250; `None` where this user may not make one.
    fn new(number: u8) -> Option<Namespace> {
        let name = format!("vs-{}-{number}", std::process::id());
        let (ours, theirs) = (format!("vs{}a{number}", std::process::id() % 100_000), "eth0");
        let (gateway, address) = (format!("10.213.{number}.1"), format!("10.213.{number}.2"));
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
    let (Some(first), Some(second)) = (Namespace::new(1), Namespace::new(2)) else {
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
        Host::start_at(command, name, &at, &["--key", key.to_str().unwrap()])
    };
    let hosts = [start(&first, "first"), start(&second, "second")];
    let plan = plan(folder.path(), &[&hosts[0], &hosts[1]], "");
    std::fs::write(&plan, "key = \"key\"\n".to_owned() + &std::fs::read_to_string(&plan).unwrap()).unwrap();
    let words = "spawn --agents 4 --p 0.4 --episodes 3 --json";
    let here: serde_json::Value = serde_json::from_str(&succeed(words)).unwrap();
    let there: serde_json::Value =
        serde_json::from_str(&succeed(&format!("{words} --hosts {}", plan.display()))).unwrap();
    assert_eq!(here["return"], there["return"]);
    hosts.iter().for_each(Host::assert_empty);
}
