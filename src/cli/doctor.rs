//! `doctor`: is this machine ready?

use clap::Args;
use rustix::process::{Resource, getrlimit};
use serde_json::{Value, json};

use super::{print, print_json};
use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::table::wrapped;
use crate::base::tasks::Tasks;
use crate::base::threads;
use crate::bus::{
    Layout, SharedMemory, SwarmAddress, check_writable, leftovers, open_files_needed, place,
    shared_memory_needed,
};
use crate::environment::Task;
use crate::failed;
use crate::supervisor::{check_shared_memory, tasks_needed};
use crate::train::{Config, Layer, Preset};

/// Check whether this machine is ready, and clean up after dead swarms
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm doctor
  vamaro-swarm doctor --clean

`ok` is fine, `note` is worth knowing, and FAIL keeps swarms from starting: exit
code 1.")]
pub struct Doctor {
    /// Remove what dead swarms have left behind
    #[arg(long)]
    clean: bool,

    /// Print what was found as one JSON object
    #[arg(long)]
    json: bool,
}

impl Doctor {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let findings = [
            ("cores", cores()),
            ("shared_memory", shared_memory()),
            ("place", writable()),
            ("open_files", open_files()),
            ("processes", processes()),
            ("dead_swarms", self.dead_swarms()),
        ];
        let bad = findings.iter().filter(|(_, finding)| finding.health == Health::Bad).count();
        if self.json {
            let checks = findings.iter().map(|(check, finding)| finding.json(check));
            print_json(&json!({"ready": bad == 0, "checks": checks.collect::<Vec<_>>()}))?;
        } else {
            print(&findings.iter().map(|(_, finding)| finding.text()).collect::<String>())?;
        }
        match bad {
            0 if self.json => Ok(()),
            0 => print("This machine is ready.\n"),
            bad => Err(failed!("{bad} of {} checks failed, see above", findings.len())),
        }
    }

    fn dead_swarms(&self) -> Finding {
        let dead = match leftovers(self.clean) {
            Ok(dead) => dead,
            Err(e) => return Finding::bad(e.to_string()),
        };
        let mib = dead.iter().map(|swarm| swarm.bytes).sum::<u64>() as f64 / f64::from(1 << 20);
        let swarms = if dead.len() == 1 { "swarm" } else { "swarms" };
        let found = format!("{} dead {swarms}, {mib:.1} MiB of shared memory", dead.len());
        if dead.is_empty() {
            return Finding::good("nothing is left of dead swarms");
        }
        if self.clean {
            return Finding::good(format!("removed what was left of {found}"));
        }
        Finding::fair(format!("left behind by {found}; --clean removes it, and so does the next `spawn`"))
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Health {
    Good,
    Fair,
    Bad,
}

struct Finding {
    health: Health,
    words: String,
}

impl Finding {
    fn good(words: impl Into<String>) -> Finding {
        Finding { health: Health::Good, words: words.into() }
    }

    fn fair(words: impl Into<String>) -> Finding {
        Finding { health: Health::Fair, words: words.into() }
    }

    fn bad(words: impl Into<String>) -> Finding {
        Finding { health: Health::Bad, words: words.into() }
    }

    fn text(&self) -> String {
        let mark = match self.health {
            Health::Good => "ok",
            Health::Fair => "note",
            Health::Bad => "FAIL",
        };
        wrapped(&format!("{mark:<8}{}", self.words), 8) + "\n"
    }

    fn json(&self, check: &str) -> Value {
        let health = match self.health {
            Health::Good => "ok",
            Health::Fair => "note",
            Health::Bad => "fail",
        };
        json!({"check": check, "health": health, "words": self.words})
    }
}

fn cores() -> Finding {
    let cores = threads::cores();
    match cores {
        1 => Finding::fair("1 core: every wake-up is a context switch, and --wait spin will crawl"),
        _ => Finding::good(format!("{cores} cores; --wait spin wants one for each agent and the supervisor")),
    }
}

fn shared_memory() -> Finding {
    match SharedMemory::look().and_then(|memory| Ok((memory, usual_swarms()?))) {
        Ok((memory, swarms)) => judge(&memory, &swarms),
        Err(e) => Finding::bad(e.to_string()),
    }
}

/// Bad is where not even the first of the swarms would start.
fn judge(memory: &SharedMemory, swarms: &[UsualSwarm]) -> Finding {
    // A swarm that starts compares the same.
    let check = |swarm: &UsualSwarm| check_shared_memory(&swarm.address, &swarm.layout, memory);
    if let Err(e) = check(&swarms[0]) {
        return Finding::bad(e.to_string());
    }
    let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20));
    let listed = |swarms: Vec<&UsualSwarm>| {
        let words = swarms.iter().map(|swarm| format!("{} ({})", swarm.what, mib(swarm.needs())));
        words.collect::<Vec<_>>().join(", ")
    };
    let (enough, too_little): (Vec<_>, Vec<_>) = swarms.iter().partition(|swarm| check(swarm).is_ok());
    let (free, total) = (mib(memory.available()), mib(memory.total));
    let enough = format!("/dev/shm has {free} free of {total}, enough for {}", listed(enough));
    if too_little.is_empty() {
        return Finding::good(enough);
    }
    Finding::fair(format!(
        "{enough}; too little for {}: enlarge it (mount -o remount,size=.. /dev/shm)",
        listed(too_little)
    ))
}

/// A swarm that people start.
struct UsualSwarm {
    what: &'static str,
    address: SwarmAddress,
    layout: Layout,
}

impl UsualSwarm {
    /// The shared memory that it may come to use, in bytes.
    fn needs(&self) -> u64 {
        shared_memory_needed(&self.address, &self.layout)
    }
}

/// `spawn` as it is without options, more agents and worlds, and a team in training.
fn usual_swarms() -> Result<[UsualSwarm; 5]> {
    let swarm = |what, task: &str, address: SwarmAddress| -> Result<UsualSwarm> {
        let task = Task::parse(task)?;
        let layout = AgentSettings::of(task.spec()).layout();
        Ok(UsualSwarm { what, address: SwarmAddress { agents: task.spec().n_agents(), ..address }, layout })
    };
    let plain = SwarmAddress::of("");
    let real_time = SwarmAddress { worlds: 10, real_time: true, ..plain.clone() };
    let mut layer = Layer::new("doctor");
    layer.set("task", TRAINED);
    let worlds = Config::resolve(Preset::default(), &[layer])?.update_every;
    // It has what a policy in training has.
    let weights = PolicySource::Builtin.load(Task::parse(TRAINED)?.spec())?.n_values();
    let trained = SwarmAddress { worlds, weights, ..plain.clone() };
    Ok([
        swarm("`spawn`", "hear-see", plain.clone())?,
        swarm("4 agents", "spread-xy-4", plain.clone())?,
        swarm("4 with --rate and --worlds 10", "spread-xy-4", real_time)?,
        swarm("`train` with 4", TRAINED, trained)?,
        swarm("64 agents", "spread-xy-64", plain)?,
    ])
}

/// The task of the team in training.
const TRAINED: &str = "spread-xy-4";

fn writable() -> Finding {
    let found = format!("swarms can write where their files belong, in {}", place().path().display());
    match (check_writable(), &place().instead) {
        (Ok(()), None) => Finding::good(found),
        (Ok(()), Some(why)) => Finding::fair(format!("{found}: {why}")),
        (Err(e), _) => Finding::bad(e.to_string()),
    }
}

fn open_files() -> Finding {
    let needed = open_files_needed(MAX_AGENTS);
    // A swarm raises the soft limit itself.
    match getrlimit(Resource::Nofile).maximum {
        Some(limit) if limit < needed => Finding::fair(format!(
            "{limit} open files a process: too few for the largest teams, which need {needed}"
        )),
        limit => Finding::good(format!("{} open files a process", words(limit))),
    }
}

fn processes() -> Finding {
    let Some(tasks) = Tasks::of_this_user() else {
        return Finding::good("unlimited processes".to_owned());
    };
    let found = format!("{} of {} processes and threads are free", tasks.free(), tasks.limit);
    // `spawn` has a thread more, which shows the swarm to those who watch.
    let [smallest, largest] = [2, MAX_AGENTS].map(|agents| tasks_needed(agents) + 1);
    let too_few = |team: &str, needed| {
        format!("{found}, but {team} needs {needed}: allow them with `ulimit -u {}`", tasks.running + needed)
    };
    if tasks.free() < smallest {
        Finding::bad(too_few("a team of two", smallest))
    } else if tasks.free() < largest {
        Finding::fair(too_few("the largest team", largest))
    } else {
        Finding::good(found)
    }
}

fn words(limit: Option<u64>) -> String {
    limit.map_or("unlimited".to_owned(), |limit| limit.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_memory_is_judged_by_what_starts_in_it() {
        let swarms = usual_swarms().unwrap();
        let with = |bytes| judge(&SharedMemory { free: bytes, promised: 0, total: bytes }, &swarms);
        let least = swarms[0].needs();
        assert!(with(least - 1).health == Health::Bad);
        let all_but = with(least);
        assert!(all_but.health == Health::Fair, "{}", all_but.words);
        let (enough, too_little) = all_but.words.split_once("too little for").unwrap();
        assert!(enough.contains("`spawn`") && too_little.contains("`train` with 4"), "{}", all_but.words);
        let most = swarms.iter().map(UsualSwarm::needs).max().unwrap();
        assert!(with(most).health == Health::Good && with(most - 1).health == Health::Fair);
    }
}
