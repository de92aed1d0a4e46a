//! What the options of `spawn` choose: task or environment, policy, links, settings of the agents, recorder.

use std::path::Path;
use std::time::Duration;

use super::super::policy_source;
use super::Spawn;
use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::scheduling::Scheduling;
use crate::bus::Wait;
use crate::environment::{ActionSpace, Environment, Spec, Task};
use crate::link::{CommunicationMatrix, LinkSpec, RadioLog, Site, complement};
use crate::nn::{Policy, PolicyFile};
use crate::recording::{FORMAT_VERSION, Format, RecordingHeader};
use crate::supervisor::{AgentCommand, Deadlines, Hosted, Recorder};
use crate::usage;

/// How long the process of an environment may take to start: some import for long.
const LONGEST_START: Duration = Duration::from_secs(60);

/// What names the network between hosts as the link.
const NETWORK: &str = "network";

/// What is played, in all its worlds.
pub(super) struct Scene {
    pub(super) spec: Spec,
    pub(super) environment: Box<dyn Environment>,
    /// How long a step is, s, if the environment says so.
    tick: Option<f64>,
    /// What is played, unless another process hosts it.
    task: Option<Task>,
}

impl Spawn {
    /// Refuses what is wrong whatever is played.
    pub(super) fn check(&self) -> Result<()> {
        if self.chaos.is_some() && self.active_worlds() > 1 {
            return Err(usage!(
                "--chaos needs --worlds 1: an agent is one process for all worlds, and a kill would hit them all"
            ));
        }
        #[cfg(feature = "hosts")]
        if self.hosts.is_some() && self.wait == Wait::Spin {
            return Err(usage!(
                "--hosts needs --wait block: what comes from other machines wakes nobody who polls"
            ));
        }
        #[cfg(feature = "hosts")]
        self.check_network()?;
        if self.deadline.is_some() && self.in_process && self.environment.is_none() {
            return Err(usage!(
                "--deadline is for processes, and with --in-process there are none, unless --env starts one; leave out \
                 one of the two"
            ));
        }
        Ok(())
    }

    /// Whether the network between hosts is the link.
    pub(super) fn network_is_link(&self) -> bool {
        cfg!(feature = "hosts") && self.links.as_deref().is_some_and(|links| links.trim() == NETWORK)
    }

    /// Refuses the network as the link where there is none, or where it is not the only one.
    #[cfg(feature = "hosts")]
    fn check_network(&self) -> Result<()> {
        let links = self.links.as_deref().unwrap_or_default();
        if !links.split('+').any(|link| link.trim() == NETWORK) {
            return Ok(());
        }
        if !self.network_is_link() || self.p.is_some() || self.drop.is_some() || self.no_comm_at_t0 {
            return Err(usage!(
                "--links network emulates nothing: it does not go with other links, --p, --drop or --no-comm-at-t0"
            ));
        }
        if self.hosts.is_none() {
            return Err(usage!(
                "--links network is the network between hosts: say with --hosts FILE where they are"
            ));
        }
        if self.rate.is_none() {
            return Err(usage!(
                "--links network needs --rate HZ: in lockstep everybody waits for everything, so nothing would be lost"
            ));
        }
        Ok(())
    }

    /// A task, or what another process hosts.
    pub(super) fn find_scene(&self) -> Result<Scene> {
        let worlds = self.active_worlds();
        if let Some(command) = &self.environment {
            return self.find_hosted(command, worlds);
        }
        let task = self.find_task(&policy_source(&self.policy, self.seed)?)?.with_physics(self.physics)?;
        let spec = task.spec().clone();
        Ok(Scene { tick: Some(spec.dt), spec, environment: task.environment(worlds), task: Some(task) })
    }

    /// The policy, told the physics of the scene if the imputer asks for that.
    pub(super) fn load(&self, source: &PolicySource, scene: &Scene) -> Result<Policy> {
        let policy = source.load(&scene.spec)?;
        match &scene.task {
            Some(task) => Registry::default().told(policy, task, self.imputer.as_deref().into_iter()),
            None => Ok(policy),
        }
    }

    /// What this command hosts. It may take long to start, so what can be wrong without it is looked at first.
    fn find_hosted(&self, command: &AgentCommand, worlds: usize) -> Result<Scene> {
        policy_source(&self.policy, self.seed)?;
        self.check_links()?;
        let usual = Deadlines { ready: LONGEST_START, ..Deadlines::default() };
        let deadlines = Deadlines { answer: self.deadline.unwrap_or(usual.answer), ..usual };
        let hosted = Hosted::start(command, worlds, deadlines)?;
        let (spec, tick) = (hosted.spec().clone(), hosted.tick());
        if self.chaos.is_some() && self.rate.or(tick).is_none() {
            return Err(usage!(
                "--chaos is for some time, and {} does not say how long a step is; give --rate, or have its description \
                 give `dt`",
                spec.id
            ));
        }
        Ok(Scene { spec, tick, environment: Box::new(hosted), task: None })
    }

    /// The policy; none if every agent is another program, and no policy is asked for or built in.
    pub(super) fn find_policy(&self, spec: &Spec) -> Result<PolicySource> {
        let is_other = |agent: usize| self.other_agents.iter().any(|(other, _)| *other == agent);
        let source = policy_source(&self.policy, self.seed)?;
        if source == PolicySource::Builtin && (0..spec.n_agents()).all(is_other) && source.load(spec).is_err()
        {
            return Ok(PolicySource::Nobody);
        }
        let by_values = |agent: usize| matches!(spec.agents[agent].actions, ActionSpace::Box { .. });
        match (0..spec.n_agents()).find(|agent| by_values(*agent) && !is_other(*agent)) {
            None => Ok(source),
            // ONNX actors can.
            Some(_) if source.load(spec).is_ok() => Ok(source),
            Some(agent) => Err(usage!(
                "{} of {} acts by values, and our networks choose among discrete actions; give a program of your own for it \
                 with --agent {agent}=COMMAND",
                spec.agents[agent].name,
                spec.id
            )),
        }
    }

    /// More worlds than episodes would have nothing to do.
    fn active_worlds(&self) -> usize {
        u64::from(self.worlds).min(self.episodes) as usize
    }

    fn find_task(&self, policy: &PolicySource) -> Result<Task> {
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
    pub(super) fn tick(&self, spec: &Spec) -> f64 {
        self.rate.map_or(spec.dt, |rate| 1.0 / rate)
    }

    pub(super) fn find_links(&self, scene: &Scene) -> Result<LinkSpec> {
        let tick = self.rate.map(|rate| 1.0 / rate).or(scene.tick);
        self.links_at(Site { tick, ..Site::from(&scene.spec) })
    }

    /// Refuses links before it is known where they are: what is wrong in the same words at two places that have nothing in
    /// common is wrong anywhere.
    fn check_links(&self) -> Result<()> {
        let places = [(1, 1e-3), (MAX_AGENTS, 1e3)];
        let wrong = places.map(|(agents, tick)| self.links_at(Site { agents, tick: Some(tick) }).err());
        match wrong {
            [Some(here), Some(there)] if here.to_string() == there.to_string() => Err(here),
            _ => Ok(()),
        }
    }

    fn links_at(&self, site: Site) -> Result<LinkSpec> {
        if self.network_is_link() {
            return Ok(LinkSpec::network());
        }
        let level = self.p.or(self.drop.map(complement));
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
        scene: &Scene,
        links: &LinkSpec,
        policy: PolicySource,
        loaded: &Policy,
    ) -> Result<AgentSettings> {
        let registry = Registry::default();
        Ok(AgentSettings {
            spec: scene.spec.clone(),
            policy,
            imputer: registry.choose(self.imputer.as_deref(), loaded)?,
            registry,
            greedy: self.greedy || loaded.is_greedy(),
            seed: self.seed,
            worlds: self.active_worlds(),
            longest_delay: links.longest_delay(),
            relay: self.relay,
            tell_logits: self.record.as_deref().map(Format::of) == Some(Format::Json),
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
            greedy: Some(settings.greedy),
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
