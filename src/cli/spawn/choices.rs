//! What the options of `spawn` amount to: task, links, settings of the agents, recorder.

use std::path::Path;

use super::Spawn;
use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::scheduling::Scheduling;
use crate::bus::Wait;
use crate::environment::Task;
use crate::link::{CommunicationMatrix, LinkSpec, RadioLog, Site, complement};
use crate::nn::{Policy, PolicyFile};
use crate::recording::{FORMAT_VERSION, RecordingHeader, is_json};
use crate::supervisor::Recorder;
use crate::usage;

impl Spawn {
    pub(super) fn find_task(&self, policy: &PolicySource) -> Result<Task> {
        let (name, agents) = match (&self.task, self.agents) {
            (None, None) => {
                return match policy {
                    PolicySource::File(path) => Task::parse(&PolicyFile::read(path)?.meta.task),
                    _ => Task::parse("hear-see"),
                };
            }
            (None, Some(agents)) => return Task::by_team_size(agents),
            (Some(name), None) => return Task::parse(name),
            (Some(name), Some(agents)) => (name, agents),
        };
        // `--task spread-xy --agents 6` names a task as well as `spread-xy-6` does.
        let of_that_size =
            |name: &str| Task::parse(name).ok().filter(|task| task.spec().n_agents() == agents);
        if let Some(task) = of_that_size(name).or_else(|| of_that_size(&format!("{name}-{agents}"))) {
            return Ok(task);
        }
        let task = Task::parse(name)?;
        let others =
            ["spread-blindfold", "spread-xy"].map(|family| of_that_size(&format!("{family}-{agents}")));
        let others: Vec<String> = others.iter().flatten().map(|task| task.id().to_owned()).collect();
        Err(if others.is_empty() {
            usage!("a team has 1 to {MAX_AGENTS} agents, not {agents}")
        } else {
            usage!(
                "{} is for {} agents, not {agents}; leave out --task or --agents, or choose a task of that \
             size: {}",
                task.id(),
                task.spec().n_agents(),
                others.join(", ")
            )
        })
    }

    /// Seconds from one tick to the next; in lockstep, as the environment has them.
    pub(super) fn tick(&self, task: &Task) -> f64 {
        self.rate.map_or(task.spec().dt, |rate| 1.0 / rate)
    }

    pub(super) fn find_links(&self, task: &Task) -> Result<LinkSpec> {
        let level = self.p.or(self.drop.map(complement));
        let site = Site { tick: Some(self.tick(task)), ..Site::from(task.spec()) };
        let links = self.links.as_deref().map(|text| LinkSpec::parse(text, site)).transpose()?;
        match (level.map(LinkSpec::level).transpose()?, links) {
            (Some(level), Some(links)) => level.then(links),
            (level, links) => level.or(links).map_or_else(|| LinkSpec::level(1.0), Ok),
        }
    }

    pub(super) fn scheduling(&self) -> Result<Scheduling> {
        if self.fifo.is_some() && self.wait == Wait::Spin {
            return Err(usage!(
                "--fifo with --wait spin: processes that never sleep and run ahead of all others would block the whole \
                 machine; use --wait block"
            ));
        }
        Ok(Scheduling { pin: self.pin, lock_memory: self.lock_memory, fifo: self.fifo })
    }

    pub(super) fn settings(
        &self,
        task: &Task,
        links: &LinkSpec,
        policy: PolicySource,
        loaded: &Policy,
    ) -> Result<AgentSettings> {
        let registry = Registry::default();
        Ok(AgentSettings {
            spec: task.spec().clone(),
            policy,
            imputer: registry.choose(self.imputer.as_deref(), loaded)?,
            registry,
            greedy: self.greedy,
            seed: self.seed,
            // More worlds than episodes would have nothing to do.
            worlds: u64::from(self.worlds).min(self.episodes) as usize,
            longest_delay: links.longest_delay(),
            relay: self.relay,
            tell_logits: self.record.as_deref().is_some_and(is_json),
        })
    }

    pub(super) fn start_recording(
        &self,
        path: &Path,
        links: &LinkSpec,
        settings: &AgentSettings,
        policy: &Policy,
    ) -> Result<Recorder> {
        let spec = &settings.spec;
        let header = RecordingHeader {
            task: spec.id.clone(),
            n_agents: spec.n_agents(),
            n_landmarks: spec.landmarks,
            episode_steps: spec.episode_steps,
            actor: Some(policy.networks().actor.to_string()),
            imputer: Some(settings.imputer.clone()),
            policy: Some(settings.policy.to_string()),
            seed: Some(self.seed),
            greedy: Some(self.greedy),
            links: Some(links.recorded_name()),
            matrix: links.matrix().map(CommunicationMatrix::to_rows),
            physics: self.physics,
            comm_at_t0: Some(!self.no_comm_at_t0),
            rate: self.rate,
            longest_delay: settings.longest_delay,
            relay: self.relay,
            logs: links.logs().map(RadioLog::fingerprint).collect(),
            format_version: Some(FORMAT_VERSION),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        };
        Recorder::create(path, &header)
    }
}
