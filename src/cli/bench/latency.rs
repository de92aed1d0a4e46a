//! `bench latency`: hops between processes, ticks, and what agents do in them.

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::{Map, Value, json};

use super::compare::Output;
use super::some_seconds;
use crate::base::distribution::{Distribution, OVERRUN, QUANTILES};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::base::rng::MAX_AGENTS;
use crate::base::threads::cores;
use crate::bus::{Wait, now_ns};
use crate::cli::{table, tell};
use crate::latency::{Hop, Medium, PAYLOADS, Setup, Tick};
use crate::plot::{Figure, Panel, Point, Series};
use crate::supervisor::signals;

/// Latency: hops between processes over our bus and other media, ticks, decisions
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench latency --svg latency.svg
  vamaro-swarm bench latency --agents 2,4 --payloads 64,4096 --wait spin
  vamaro-swarm bench latency --seconds 2 --json > latency.json

Hop: the time between two processes, from all bytes of a message being in place
until the receiver has access to them. `whole` also counts making room for the
message, writing every byte, and reading every byte. If each process can have a
core of its own, they are pinned.
Tick: from the first sensor message sent to the last action received. `bare` is
the same pattern over plain iceoryx2 by agents without networks; `needed` is a
bare tick plus the decisions, shared among the cores. Decision: from having
received everything to publishing the action, with its parts.
Age: of a peer's observation, when a policy uses it. The agents have the paper's
networks for spread-blindfold. An overrun takes longer than a millisecond.")]
pub struct BenchLatency {
    /// Sizes of teams
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "2,4,8,12",
        value_parser = clap::value_parser!(u32).range(2..=MAX_AGENTS as i64))]
    agents: Vec<u32>,

    /// Bytes of a message; ticks use the closest size that a whole number of worlds has
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "64,256,1024,4096,16384,65536",
        value_parser = payload)]
    payloads: Vec<usize>,

    /// How processes wait for each other [default: both]
    #[arg(long, value_enum)]
    wait: Option<Wait>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 0.25, value_parser = some_seconds)]
    seconds: f64,

    /// Measure hops to the hosts of this file instead, ticks over them, and policies on their way; with --agents and
    /// --seconds
    #[cfg(feature = "hosts")]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["payloads", "wait", "svg"])]
    hosts: Option<PathBuf>,

    /// Draw the figures into this file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,

    #[command(flatten)]
    output: Output,
}

/// What is measured.
struct Measured {
    /// Reading the clock, which every figure contains once, in nanoseconds.
    clock_ns: f64,
    hops: Vec<Hop>,
    ticks: Vec<Tick>,
}

impl BenchLatency {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        #[cfg(feature = "hosts")]
        if let Some(path) = &self.hosts {
            let measured = super::hosts::Measured::new(path, &self.agents, self.seconds)?;
            return self.output.print(measured.json(), || measured.text());
        }
        // A place that cannot be written is found before anything is measured.
        let svg = self.svg.as_deref().map(AtomicFile::create).transpose()?;
        let measured = self.measure()?;
        if let Some(mut file) = svg {
            let path = file.path().to_owned();
            let drawing = measured.figure().to_log_svg();
            file.write_all(drawing.as_bytes()).map_err(|e| Error::io("write", &path, e))?;
            file.commit()?;
        }
        self.output.print(measured.json(), || measured.text())
    }

    fn measure(&self) -> Result<Measured> {
        let waits = self.wait.map_or(vec![Wait::Block, Wait::Spin], |wait| vec![wait]);
        let longest = Duration::from_secs_f64(self.seconds);
        let mut measured = Measured { clock_ns: clock_ns(), hops: Vec::new(), ticks: Vec::new() };
        for (wait, payload) in pairs(&waits, &self.payloads) {
            tell(&format!("hops of {payload} bytes, {}", name(wait)));
            for medium in Medium::ALL {
                measured.hops.push(Hop::measure(medium, wait, payload, longest)?);
            }
        }
        for agents in &self.agents {
            let setup = Setup::new(*agents as usize)?;
            for (wait, payload) in pairs(&waits, &self.payloads) {
                tell(&format!("ticks of {agents} agents, {payload} bytes, {}", name(wait)));
                measured.ticks.push(Tick::measure(&setup, payload, wait, longest)?);
            }
        }
        Ok(measured)
    }
}

impl Measured {
    /// The hop of the same size and wait over another medium.
    fn like(&self, hop: &Hop, medium: Medium) -> &Hop {
        let same =
            |other: &&Hop| (other.medium, other.wait, other.payload) == (medium, hop.wait, hop.payload);
        self.hops.iter().find(same).expect("all media are measured with each size and wait")
    }

    fn json(&self) -> Value {
        let hops = self.hops.iter().map(|hop| {
            let (floor, plain) = (self.like(hop, Medium::Futex), self.like(hop, Medium::Plain));
            let times = |of: fn(&Hop) -> &Distribution| {
                let ratios = [
                    ("ratio_to_floor".to_owned(), json!(of(hop).ratios(of(floor)))),
                    ("ratio_to_plain".to_owned(), json!(of(hop).ratios(of(plain)))),
                ];
                of(hop).json().into_iter().chain(ratios).collect::<Map<_, _>>()
            };
            json!({
                "medium": hop.medium,
                "wait": hop.wait,
                "payload": hop.payload,
                "pinned": hop.pinned,
                "hop": times(|hop| &hop.hop),
                "whole": times(|hop| &hop.whole),
            })
        });
        let ticks = self.ticks.iter().map(|tick| {
            json!({
                "agents": tick.agents,
                "worlds": tick.worlds,
                "payload": tick.payload,
                "wait": tick.wait,
                "tick": tick.tick.json(),
                "bare": tick.bare.json(),
                "ratio_to_bare": tick.tick.ratios(&tick.bare),
                "needed_us": tick.needed_us(cores()),
                "ratio_to_needed": tick.tick.quantile_us(0.5) / tick.needed_us(cores()),
                "decision": tick.decision.json(),
                "imputer": tick.imputer.json(),
                "policy": tick.policy.json(),
                "age": tick.age.json(),
            })
        });
        json!({
            "clock_ns": self.clock_ns,
            "overrun_us": OVERRUN.as_micros() as u64,
            "hops": hops.collect::<Vec<_>>(),
            "ticks": ticks.collect::<Vec<_>>(),
        })
    }

    fn text(&self) -> String {
        const TIMES: [&str; 7] = ["p50", "p90", "p99", "p99.9", "max", "count", "overruns"];
        let header = |labels: &[&'static str], more: &[&'static str]| [labels, &TIMES, more].concat();
        let hops = self.hops.iter().map(|hop| {
            let (floor, plain) = (self.like(hop, Medium::Futex), self.like(hop, Medium::Plain));
            let mut row = vec![hop.medium.to_string(), name(hop.wait), hop.payload.to_string()];
            row.extend(times(&hop.hop));
            row.extend([floor, plain].map(|other| ratio(&hop.hop, &other.hop)));
            row.push(us(hop.whole.quantile_us(0.5)));
            row.extend([floor, plain].map(|other| ratio(&hop.whole, &other.whole)));
            row
        });
        let hops = table(
            &header(&["over", "wait", "bytes"], &["/floor", "/plain", "whole", "/floor", "/plain"]),
            hops,
        );
        let ticks = self.ticks.iter().flat_map(|tick| {
            let rows = [
                ("tick", &tick.tick),
                ("  bare", &tick.bare),
                ("  decision", &tick.decision),
                ("    imputer", &tick.imputer),
                ("    policy", &tick.policy),
                ("  age", &tick.age),
            ];
            rows.map(|(what, of)| {
                let labels = [tick.agents, tick.payload].map(|n| n.to_string());
                let needed = format!("{:.2}", of.quantile_us(0.5) / tick.needed_us(cores()));
                let ratios = if what == "tick" { vec![ratio(of, &tick.bare), needed] } else { Vec::new() };
                [vec![what.to_owned(), name(tick.wait)], labels.to_vec(), times(of), ratios].concat()
            })
        });
        let ticks = table(&header(&["what", "wait", "agents", "bytes"], &["/bare", "/needed"]), ticks);
        format!(
            "microseconds; reading the clock takes {:.0} ns, once in each; {}\n\nhops\n{hops}\nticks\n{ticks}",
            self.clock_ns,
            if self.hops.iter().all(|hop| hop.pinned) {
                "hops with a core for each process"
            } else {
                "hops without a core for each process"
            },
        )
    }

    /// Hops by size, and at the smallest size the tails of hops, ticks, decisions and ages, for each way to wait.
    fn figure(&self) -> Figure {
        let mut waits: Vec<Wait> = self.hops.iter().map(|hop| hop.wait).collect();
        waits.dedup();
        let panel = |title: String, x_label: &str, y_label: &str, series: Vec<Series>| Panel {
            title,
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            series,
            ..Panel::default()
        };
        let smallest = self.hops.iter().map(|hop| hop.payload).min().unwrap_or_default();
        let by_size = waits.iter().map(|wait| {
            let series = Medium::ALL.map(|medium| {
                let hops = self.hops.iter().filter(|hop| hop.wait == *wait && hop.medium == medium);
                let points = hops.map(|hop| point(hop.payload as f64, hop.hop.quantile_us(0.5)));
                Series { name: medium.to_string(), points: points.collect() }
            });
            panel(format!("hop, p50, {}", name(*wait)), "bytes", "microseconds", series.into())
        });
        let tails = waits.iter().map(|wait| {
            let hops = self.hops.iter().filter(|hop| hop.wait == *wait && hop.payload == smallest);
            let series = hops.map(|hop| Series { name: hop.medium.to_string(), points: tail(&hop.hop) });
            let title = format!("hops of {smallest} bytes, {}", name(*wait));
            panel(title, "hop, microseconds", "share that takes longer", series.collect())
        });
        let smallest = |tick: &&Tick| {
            let same = self.ticks.iter().filter(|other| other.agents == tick.agents);
            same.map(|other| other.payload).min() == Some(tick.payload)
        };
        let parts: [(&str, Part); 3] =
            [("tick", |tick| &tick.tick), ("decision", |tick| &tick.decision), ("age", |tick| &tick.age)];
        let ticks = parts.iter().flat_map(|(what, of)| waits.iter().map(move |wait| (*what, *of, *wait)));
        let ticks = ticks.map(|(what, of, wait)| {
            let ticks = self.ticks.iter().filter(smallest).filter(|tick| tick.wait == wait);
            let series =
                ticks.map(|tick| Series { name: format!("{} agents", tick.agents), points: tail(of(tick)) });
            let x_label = format!("{what}, microseconds");
            panel(format!("{what}, {}", name(wait)), &x_label, "share that takes longer", series.collect())
        });
        Figure {
            title: "Latency between processes".to_owned(),
            panels: by_size.chain(tails).chain(ticks).collect(),
        }
    }
}

/// A distribution of a tick.
type Part = fn(&Tick) -> &Distribution;

fn pairs(waits: &[Wait], payloads: &[usize]) -> Vec<(Wait, usize)> {
    waits.iter().flat_map(|wait| payloads.iter().map(|payload| (*wait, *payload))).collect()
}

fn point(x: f64, y: f64) -> Point {
    Point { x, y, band: None }
}

/// The tail of a distribution, thinned out to what can be told apart.
fn tail(distribution: &Distribution) -> Vec<Point> {
    const APART: f64 = 1.02;
    let mut points: Vec<Point> = Vec::new();
    for (us, share) in distribution.tail() {
        let far = |last: &Point| us > APART * last.x || last.y > APART * share;
        if points.last().is_none_or(far) {
            points.push(point(us, share));
        }
    }
    points
}

pub(super) fn times(of: &Distribution) -> Vec<String> {
    let quantiles = QUANTILES.map(|(_, quantile)| us(of.quantile_us(quantile)));
    let rest = [us(of.quantile_us(1.0)), of.count().to_string(), of.overruns().to_string()];
    quantiles.into_iter().chain(rest).collect()
}

pub(super) fn us(us: f64) -> String {
    format!("{us:.2}")
}

/// The ratio of the medians.
pub(super) fn ratio(of: &Distribution, to: &Distribution) -> String {
    format!("{:.2}", of.quantile_us(0.5) / to.quantile_us(0.5))
}

fn name(wait: Wait) -> String {
    match wait {
        Wait::Block => "block".to_owned(),
        Wait::Spin => "spin".to_owned(),
    }
}

/// What reading the clock takes.
fn clock_ns() -> f64 {
    const READINGS: u64 = 10_000;
    let began = now_ns();
    (1..READINGS).for_each(|_| _ = std::hint::black_box(now_ns()));
    (now_ns() - began) as f64 / READINGS as f64
}

fn payload(text: &str) -> std::result::Result<usize, String> {
    match text.parse() {
        Ok(bytes) if PAYLOADS.contains(&bytes) && bytes % 4 == 0 => Ok(bytes),
        _ => Err(format!("expected a multiple of 4 from {} to {}", PAYLOADS.start(), PAYLOADS.end())),
    }
}
