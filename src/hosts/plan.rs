//! Which hosts there are, and which agents run where: the file that `--hosts` names.

use std::net::ToSocketAddrs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::key::Key;
use super::patience::Patience;
use crate::base::error::Result;
use crate::base::regular;
use crate::usage;

/// The bytes that the file may have.
const LARGEST: u64 = 1 << 20;

/// What the file says.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plan {
    /// The file with the key, as seen from the folder of this one.
    key: Option<PathBuf>,
    /// How long a host may be silent.
    #[serde(default)]
    pub(crate) patience: Patience,
    #[serde(rename = "host", default)]
    pub(super) hosts: Vec<PlannedHost>,
    #[serde(skip)]
    path: PathBuf,
}

/// A host, as the file describes it.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlannedHost {
    /// What it is called in errors.
    pub(super) name: String,
    /// Where it listens, such as `tcp/192.168.1.11:7447`; `udp/..` if it takes datagrams, too.
    pub(super) at: String,
    /// The agents that run there, if the file says so.
    pub(super) agents: Option<Vec<usize>>,
}

impl Plan {
    /// Reads the file.
    pub(crate) fn read(path: &Path) -> Result<Plan> {
        let text = regular::read_text(path, LARGEST)?;
        let plan = toml::from_str::<Plan>(&text);
        let mut plan = plan.map_err(|e| usage!("{} is no list of hosts: {}", path.display(), e.message()))?;
        plan.path = path.to_owned();
        let wrong = |how: String| Err(usage!("{}: {how}", path.display()));
        if plan.hosts.is_empty() {
            return wrong(
                "there is no host; add one: [[host]], name = \"left\", at = \"tcp/192.168.1.11:7447\""
                    .to_owned(),
            );
        }
        for (index, PlannedHost { name, at, .. }) in plan.hosts.iter().enumerate() {
            if let Err(how) = check_address(at) {
                return wrong(format!("host {name} is at `{at}`, {how}"));
            }
            if plan.key.is_none() && !is_within_this_machine(at) {
                return wrong(format!(
                    "host {name} ({at}) is not on this machine, and there is no key: anybody could answer there, and \
                     be sent the policy; add `key = \"FILE\"` at the top"
                ));
            }
            let others = &plan.hosts[..index];
            if let Some(other) =
                others.iter().find(|other| other.name == *name || socket_of(&other.at) == socket_of(at))
            {
                return wrong(format!(
                    "host {name} ({at}) is there twice: see {} ({})",
                    other.name, other.at
                ));
            }
        }
        Ok(plan)
    }

    /// The first hosts of it, with agents spread evenly over them.
    pub(crate) fn of_first(&self, hosts: usize) -> Plan {
        let spread = |host: &PlannedHost| PlannedHost { agents: None, ..host.clone() };
        Plan { hosts: self.hosts.iter().take(hosts).map(spread).collect(), ..self.clone() }
    }

    /// How many hosts there are.
    pub(crate) fn len(&self) -> usize {
        self.hosts.len()
    }

    /// The key, if the file names one.
    pub(super) fn key(&self) -> Result<Option<Key>> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        self.key.as_ref().map(|key| Key::read(&folder.join(key))).transpose()
    }

    /// The agents of each host, bit by bit, in a team of so many. Those that no host lists are spread evenly over the
    /// hosts without a list; if all hosts have one, they run on the machine of the supervisor.
    pub(crate) fn place(&self, team: usize) -> Result<Vec<u64>> {
        let mut places = vec![0u64; self.hosts.len()];
        for (index, PlannedHost { name, agents, .. }) in self.hosts.iter().enumerate() {
            for agent in agents.iter().flatten() {
                let owner = places.iter().position(|place| *agent < team && place >> agent & 1 == 1);
                let how = match owner {
                    _ if *agent >= team => format!("and this team has agents 0 to {}", team - 1),
                    Some(owner) => format!("and host {} has it already", self.hosts[owner].name),
                    None => {
                        places[index] |= 1 << agent;
                        continue;
                    }
                };
                return Err(usage!("{}: host {name} lists agent {agent}, {how}", self.path.display()));
            }
        }
        let taken = places.iter().fold(0, |all, place| all | place);
        let free: Vec<usize> = (0..team).filter(|agent| taken >> agent & 1 == 0).collect();
        let open: Vec<usize> = (0..places.len()).filter(|host| self.hosts[*host].agents.is_none()).collect();
        for (at, agent) in free.iter().enumerate().filter(|_| !open.is_empty()) {
            places[open[at * open.len() / free.len()]] |= 1 << agent;
        }
        Ok(places)
    }
}

/// What is wrong with the address of a host.
pub(super) fn check_address(at: &str) -> std::result::Result<(), &'static str> {
    if takes_datagrams(at) && !cfg!(feature = "hosts-udp") {
        return Err("and this program has no datagrams: build it with `--features hosts-udp`, or use tcp/");
    }
    let has_kind = at.starts_with("tcp/") || takes_datagrams(at);
    match socket_of(at).rsplit_once(':') {
        Some((host, port))
            if has_kind && !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0) =>
        {
            Ok(())
        }
        _ => Err("which is no address such as tcp/192.168.1.11:7447"),
    }
}

/// Whether a host takes datagrams at an address, and not a stream only.
pub(super) fn takes_datagrams(at: &str) -> bool {
    at.starts_with("udp/")
}

/// The socket of an address: `HOST:PORT`.
pub(super) fn socket_of(at: &str) -> &str {
    at.split_once('/').map_or(at, |(_, socket)| socket)
}

/// Whether nobody on another machine can get at an address.
pub(super) fn is_within_this_machine(at: &str) -> bool {
    let addresses = socket_of(at).to_socket_addrs();
    addresses.is_ok_and(|mut addresses| addresses.all(|address| address.ip().is_loopback()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Plan> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hosts.toml");
        std::fs::write(&path, text).unwrap();
        Plan::read(&path)
    }

    fn host(name: &str, port: u16, agents: &str) -> String {
        format!("[[host]]\nname = \"{name}\"\nat = \"tcp/127.0.0.1:{port}\"\n{agents}\n")
    }

    #[test]
    fn agents_are_where_the_file_says_or_spread_evenly() {
        let places = |first: &str, second: &str, team| {
            read(&(host("left", 1, first) + &host("right", 2, second))).unwrap().place(team).unwrap()
        };
        assert_eq!(places("", "", 4), [0b0011, 0b1100]);
        assert_eq!(places("", "", 5), [0b00111, 0b11000]);
        assert_eq!(places("agents = [3]", "", 4), [0b1000, 0b0111]);
        assert_eq!(places("agents = [1]", "agents = [0]", 4), [0b0010, 0b0001], "2 and 3 run here");
    }

    #[test]
    fn hosts_beyond_this_machine_need_a_key() {
        let far = "[[host]]\nname = \"far\"\nat = \"tcp/192.0.2.1:7447\"\n";
        let error = read(far).unwrap_err().to_string();
        assert!(error.contains("host far (tcp/192.0.2.1:7447) is not on this machine"), "{error}");
        assert!(read(&format!("key = \"swarm.key\"\n{far}")).is_ok());
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let refused = |text: String| read(&text).and_then(|plan| plan.place(4)).unwrap_err().to_string();
        let twice = host("left", 1, "agents = [0, 1]") + &host("right", 2, "agents = [1]");
        assert!(refused(twice).contains("host right lists agent 1, and host left has it already"));
        assert!(refused(host("left", 1, "agents = [4]")).contains("agents 0 to 3"));
        assert!(refused(host("left", 1, "") + &host("left", 2, "")).contains("twice"));
        assert!(refused(host("left", 1, "") + &host("right", 1, "")).contains("twice"));
        assert!(refused(host("left", 0, "")).contains("no address"));
        assert!(refused("".to_owned()).contains("no host"));
        assert!(refused(host("left", 1, "agent = [0]")).contains("agent"));
    }
}
