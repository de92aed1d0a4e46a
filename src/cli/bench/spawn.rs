//! `bench spawn`: what a swarm costs, and how that grows.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Map, Value, json};

use super::compare::Output;
use super::{median, some_seconds};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::bus::Wait;
use crate::cli::{table, tell};
use crate::latency::{BareTeam, Memory, Played, Setup, exponent};
use crate::supervisor::signals;

/// Swarms: start-up, memory per agent, and how tick time grows
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench spawn
  vamaro-swarm bench spawn --agents 4,16 --worlds 1,10,100 --wait spin --json

Agents are processes with the paper's networks for spread-blindfold. Start is
the time from reading the policy file to the end of the first tick, the median
of three. Memory is the mean over the agents after playing: all pages (RSS),
pages divided among the processes that share them (PSS), and pages of one agent
alone (private). A tick goes from the first sensor message to the last decision;
its median counts. More worlds mean larger messages and longer decisions; the
effect of messages alone is measured with four agents without networks, over
plain iceoryx2. Exponents are those of the best-fitting power laws.")]
pub struct BenchSpawn {
    /// Sizes of teams, each in one world
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "2,4,8,16,32,64",
        value_parser = clap::value_parser!(u32).range(1..=MAX_AGENTS as i64))]
    agents: Vec<u32>,

    /// Numbers of parallel worlds, each for a team of four
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1,4,16,64,256",
        value_parser = clap::value_parser!(u32).range(1..=4096))]
    worlds: Vec<u32>,

    /// How processes wait for each other
    #[arg(long, value_enum, default_value_t)]
    wait: Wait,

    /// Seconds of ticks for each measurement
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = some_seconds)]
    seconds: f64,

    #[command(flatten)]
    output: Output,
}

/// Size of the team that plays in several worlds.
const TEAM: usize = 4;

/// Bytes of the messages of agents without networks.
const PAYLOADS: [usize; 6] = [64, 256, 1024, 4096, 16384, 65536];

/// Starts of a swarm.
const STARTS: usize = 3;

/// What is measured of a swarm.
struct Swarm {
    agents: usize,
    worlds: usize,
    /// Bytes of an observation message.
    payload: usize,
    start_ms: f64,
    /// Mean over the agents, MiB.
    rss: f64,
    pss: f64,
    private: f64,
    tick: Distribution,
}

/// Ticks with nothing in them.
struct Bare {
    /// Bytes of an observation message.
    payload: usize,
    tick: Distribution,
}

impl BenchSpawn {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let by_agents = self.agents.iter().map(|agents| self.measure(*agents as usize, 1));
        let by_agents = by_agents.collect::<Result<Vec<Swarm>>>()?;
        let by_worlds = self.worlds.iter().map(|worlds| self.measure(TEAM, *worlds as usize));
        let by_worlds = by_worlds.collect::<Result<Vec<Swarm>>>()?;
        let by_payload = PAYLOADS.iter().map(|payload| self.measure_bare(*payload));
        let by_payload = by_payload.collect::<Result<Vec<Bare>>>()?;
        let points = |swarms: &[Swarm], x: fn(&Swarm) -> usize| -> Vec<(f64, f64)> {
            swarms.iter().map(|swarm| (x(swarm) as f64, swarm.tick.quantile_us(0.5))).collect()
        };
        let bare = by_payload.iter().map(|bare| (bare.payload as f64, bare.tick.quantile_us(0.5)));
        let exponents = [
            ("agents", exponent(&points(&by_agents, |swarm| swarm.agents))),
            ("worlds", exponent(&points(&by_worlds, |swarm| swarm.worlds))),
            ("payload", exponent(&bare.collect::<Vec<_>>())),
        ];
        let list = |swarms: &[Swarm]| swarms.iter().map(Swarm::json).collect::<Vec<_>>();
        let result = json!({
            "wait": self.wait,
            "by_agents": list(&by_agents),
            "by_worlds": list(&by_worlds),
            "by_payload": by_payload.iter().map(Bare::json).collect::<Vec<_>>(),
            // One that no two points fit is NaN, which JSON has as null.
            "tick_exponents": exponents.iter().map(|(x, b)| ((*x).to_owned(), json!(b))).collect::<Map<_, _>>(),
        });
        self.output.print(result, || {
            const HEADER: [&str; 9] =
                ["agents", "worlds", "bytes", "start ms", "RSS MiB", "PSS", "private", "tick p50 us", "p99"];
            let swarms = table(&HEADER, by_agents.iter().chain(&by_worlds).map(Swarm::row));
            let bare =
                table(&["agents", "bytes", "bare tick p50 us", "p99"], by_payload.iter().map(Bare::row));
            let fitted = exponents.iter().filter(|(_, exponent)| exponent.is_finite());
            let words: Vec<String> = fitted.map(|(x, exponent)| format!("{x}^{exponent:.2}")).collect();
            format!("{swarms}\n{bare}\nthe tick grows as {}\n", words.join(", "))
        })
    }

    fn measure(&self, agents: usize, worlds: usize) -> Result<Swarm> {
        tell(&format!("{agents} agents, {worlds} worlds"));
        let setup = Setup::new(agents)?;
        let mut starts = Vec::new();
        let mut played = None;
        for _ in 0..STARTS {
            // One swarm at a time.
            drop(played.take());
            let began = Instant::now();
            let mut swarm = Played::start(&setup, worlds, self.wait)?;
            swarm.tick()?;
            starts.push(began.elapsed().as_secs_f64() * 1e3);
            played = Some(swarm);
        }
        let mut played = played.expect("it was started");
        let mut tick = Distribution::default();
        let longest = Duration::from_secs_f64(self.seconds);
        played.play(longest, |_, elapsed| tick.record(elapsed.as_nanos() as u64))?;
        let memory = played.team().process_ids().map(Memory::of).collect::<Result<Vec<Memory>>>()?;
        let mib = |bytes: fn(&Memory) -> u64| {
            memory.iter().map(bytes).sum::<u64>() as f64 / memory.len() as f64 / f64::from(1 << 20)
        };
        Ok(Swarm {
            agents,
            worlds,
            payload: setup.payload(worlds),
            start_ms: median(starts),
            rss: mib(|memory| memory.rss),
            pss: mib(|memory| memory.pss),
            private: mib(|memory| memory.private),
            tick,
        })
    }

    fn measure_bare(&self, payload: usize) -> Result<Bare> {
        tell(&format!("{TEAM} agents without networks, {payload} bytes"));
        let mut tick = Distribution::default();
        let mut team = BareTeam::start(TEAM, payload, self.wait)?;
        team.play(Duration::from_secs_f64(self.seconds), |elapsed| tick.record(elapsed.as_nanos() as u64))?;
        Ok(Bare { payload, tick })
    }
}

impl Bare {
    fn json(&self) -> Value {
        json!({ "agents": TEAM, "payload": self.payload, "tick": self.tick.json() })
    }

    fn row(&self) -> Vec<String> {
        let row = [TEAM, self.payload].map(|n| n.to_string()).into_iter();
        row.chain([0.5, 0.99].map(|quantile| format!("{:.1}", self.tick.quantile_us(quantile)))).collect()
    }
}

impl Swarm {
    fn json(&self) -> Value {
        json!({
            "agents": self.agents,
            "worlds": self.worlds,
            "payload": self.payload,
            "start_ms": self.start_ms,
            "rss_mib": self.rss,
            "pss_mib": self.pss,
            "private_mib": self.private,
            "tick": self.tick.json(),
        })
    }

    fn row(&self) -> Vec<String> {
        let mut row = [self.agents, self.worlds, self.payload].map(|n| n.to_string()).to_vec();
        row.push(format!("{:.0}", self.start_ms));
        row.extend([self.rss, self.pss, self.private].map(|mib| format!("{mib:.1}")));
        row.extend([0.5, 0.99].map(|quantile| format!("{:.1}", self.tick.quantile_us(quantile))));
        row
    }
}
