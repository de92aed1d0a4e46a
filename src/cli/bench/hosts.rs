//! `bench latency --hosts`: hops to other machines, ticks over them, and policies on their way.

use std::path::Path;
use std::time::Duration;

use serde_json::{Map, Value, json};

use super::latency::{ratio, times, us};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::base::threads::cores;
use crate::cli::{table, tell};
use crate::hosts::{Over, Plan};
use crate::latency::{HostHop, HostTick, Setup, frame_of_observations};

/// What is measured.
pub(super) struct Measured {
    hops: Vec<HostHop>,
    ticks: Vec<HostTick>,
}

impl Measured {
    /// Measures with the hosts of a plan and teams of these sizes.
    pub(super) fn new(plan: &Path, teams: &[u32], seconds: f64) -> Result<Measured> {
        let plan = Plan::read(plan)?;
        let longest = Duration::from_secs_f64(seconds);
        let smallest = teams.iter().min().map_or(0, |agents| *agents as usize);
        let payload = frame_of_observations(&plan, &Setup::new(smallest)?)?;
        tell(&format!("hops of {payload} bytes"));
        let hops = HostHop::measure(&plan, payload, longest)?;
        let mut ticks = Vec::new();
        for agents in teams {
            let setup = Setup::new(*agents as usize)?;
            // A host without agents has nothing to do.
            for hosts in plan.len().min(2)..=plan.len().min(*agents as usize) {
                tell(&format!("ticks of {agents} agents over {hosts} hosts"));
                ticks.push(HostTick::measure(&plan, hosts, &setup, longest)?);
            }
        }
        Ok(Measured { hops, ticks })
    }

    /// The hop to the same host over plain Zenoh.
    fn plain(&self, hop: &HostHop) -> &Distribution {
        let same = self.hops.iter().find(|other| other.host == hop.host && other.over == Over::Zenoh);
        &same.expect("all ways are measured to each host").hop
    }

    pub(super) fn json(&self) -> Value {
        let hops = self.hops.iter().map(|hop| {
            let ratios = [("ratio_to_plain".to_owned(), json!(hop.hop.ratios(self.plain(hop))))];
            let times = hop.hop.json().into_iter().chain(ratios).collect::<Map<_, _>>();
            json!({ "host": hop.host, "medium": hop.over, "payload": hop.payload, "hop": times })
        });
        let ticks = self.ticks.iter().map(|tick| {
            json!({
                "hosts": tick.hosts,
                "agents": tick.agents,
                "tick": tick.tick.json(),
                "exchange": tick.exchange.json(),
                "decision": tick.decision.json(),
                "needed_us": tick.needed_us(cores()),
                "ratio_to_needed": tick.tick.quantile_us(0.5) / tick.needed_us(cores()),
                "frames": tick.frames,
                "policy_bytes": tick.policy,
                "policy_ms": tick.shipping.quantile_us(0.5) / 1e3,
            })
        });
        json!({ "hops": hops.collect::<Vec<_>>(), "ticks": ticks.collect::<Vec<_>>() })
    }

    pub(super) fn text(&self) -> String {
        const TIMES: [&str; 7] = ["p50", "p90", "p99", "p99.9", "max", "count", "overruns"];
        let header = |labels: &[&'static str], more: &[&'static str]| [labels, &TIMES, more].concat();
        let hops = self.hops.iter().map(|hop| {
            let labels = vec![hop.host.clone(), hop.over.to_string(), hop.payload.to_string()];
            [labels, times(&hop.hop), vec![ratio(&hop.hop, self.plain(hop))]].concat()
        });
        let hops = table(&header(&["host", "over", "bytes"], &["/plain"]), hops);
        let ticks = self.ticks.iter().flat_map(|tick| {
            let rows = [("tick", &tick.tick), ("  exchange", &tick.exchange), ("  decision", &tick.decision)];
            rows.map(|(what, of)| {
                let labels = [tick.hosts, tick.agents].map(|n| n.to_string());
                let of_tick = [
                    format!("{:.2}", of.quantile_us(0.5) / tick.needed_us(cores())),
                    format!("{:.1}", tick.frames),
                    format!("{:.1}", tick.policy as f64 / 1e6),
                    us(tick.shipping.quantile_us(0.5) / 1e3),
                ];
                let of_tick = if what == "tick" { of_tick.to_vec() } else { Vec::new() };
                [vec![what.to_owned()], labels.to_vec(), times(of), of_tick].concat()
            })
        });
        let header = header(&["what", "hosts", "agents"], &["/needed", "frames", "policy, MB", "ms"]);
        let ticks = table(&header, ticks);
        format!("microseconds\n\nhops\n{hops}\nticks\n{ticks}")
    }
}
