//! `doctor`: is this machine ready?

use clap::Args;
use rustix::process::{Resource, getrlimit};

use super::print;
use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::threads;
use crate::bus::{Layout, SharedMemory, SwarmAddress, check_writable, leftovers, open_files_needed, place};
use crate::environment::Task;
use crate::failed;
use crate::supervisor::check_shared_memory;
use crate::train::{Config, Layer, Preset};

/// Check whether this machine is ready, and clean up after dead swarms
#[derive(Debug, Args)]
pub struct Doctor {
    /// Remove what dead swarms have left behind
    #[arg(long)]
    clean: bool,
}

impl Doctor {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let findings = [cores(), shared_memory(), writable(), open_files(), processes(), self.dead_swarms()];
        let text: String = findings.iter().map(|f| format!("{:<8}{}\n", f.mark(), f.words)).collect();
        print(&text)?;
        match findings.iter().filter(|finding| finding.health == Health::Bad).count() {
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

    fn mark(&self) -> &'static str {
        match self.health {
            Health::Good => "ok",
            Health::Fair => "note",
            Health::Bad => "FAIL",
        }
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
    // A swarm that starts compares the same.
    let checked = SharedMemory::look().and_then(|memory| {
        let needs = usual_swarms()?.map(|(address, layout)| check_shared_memory(&address, &layout, &memory));
        let needs = needs.into_iter().collect::<Result<Vec<u64>>>()?;
        Ok((memory, needs))
    });
    let (memory, needs) = match checked {
        Ok(checked) => checked,
        Err(e) => return Finding::bad(e.to_string()),
    };
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    Finding::good(format!(
        "/dev/shm has {:.1} MiB free of {:.1} MiB; 4 agents take, with 10 worlds in real time, up to {:.1} MiB, and \
         in training {:.1} MiB",
        mib(memory.available()),
        mib(memory.total),
        mib(needs[0]),
        mib(needs[1])
    ))
}

/// A team of four against the clock with ten worlds, and one in training.
fn usual_swarms() -> Result<[(SwarmAddress, Layout); 2]> {
    let task = Task::parse("spread-xy-4")?;
    let layout = AgentSettings::of(task.spec()).layout();
    let spawn = SwarmAddress { agents: 4, worlds: 10, real_time: true, ..SwarmAddress::of("") };
    let mut layer = Layer::new("doctor");
    layer.set("task", task.spec().id());
    let worlds = Config::resolve(Preset::default(), &[layer])?.update_every;
    // It has what a policy in training has.
    let weights = PolicySource::Builtin.load(task.spec())?.n_values();
    let train = SwarmAddress { real_time: false, worlds, weights, ..spawn.clone() };
    Ok([(spawn, layout), (train, layout)])
}

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
    match getrlimit(Resource::Nproc).current {
        Some(limit) if limit < 128 => {
            Finding::bad(format!("only {limit} processes: raise it with `ulimit -u 1024`"))
        }
        limit => Finding::good(format!("{} processes", words(limit))),
    }
}

fn words(limit: Option<u64>) -> String {
    limit.map_or("unlimited".to_owned(), |limit| limit.to_string())
}
