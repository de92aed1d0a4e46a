//! What an evaluation plays, from its arguments.

use super::{Evaluate, Protocol};
use crate::agent::{PolicySource, Registry, Truth};
use crate::base::error::Result;
use crate::cli::policy_source;
use crate::cli::train::threads;
use crate::environment::Task;
use crate::evaluate::{Axis, Condition, Entrant, Place, Requirement, Settings, Sweep};
use crate::link::Site;
use crate::nn::{Policy, PolicyFile};
use crate::usage;

/// With fewer episodes a bootstrap is too sure of itself; see `docs/metrics.md`.
const FEWEST_EPISODES: u64 = 20;

impl Evaluate {
    /// What there is to play.
    pub(super) fn sweep(&self) -> Result<Sweep> {
        for (at, truth) in self.substitute.iter().enumerate() {
            if self.substitute[..at].contains(truth) {
                return Err(usage!("--substitute: {truth} is given twice"));
            }
        }
        let task = self.task.as_deref().map(Task::parse).transpose()?;
        let entrants = self.policies.iter().map(|name| self.entrant(name, task.as_ref()));
        let entrants: Vec<Entrant> = entrants.collect::<Result<_>>()?;
        for (at, entrant) in entrants.iter().enumerate() {
            let same = |other: &&Entrant| other.contender.fingerprint == entrant.contender.fingerprint;
            if let Some(other) = entrants[..at].iter().find(same) {
                return Err(usage!(
                    "{} and {} are the same policy; name it once",
                    other.contender.name,
                    entrant.contender.name
                ));
            }
        }
        let (conditions, axes) = self.conditions(&entrants)?;
        if let Some(truth) = self.substitute.first()
            && !conditions.iter().any(Condition::is_lossless)
        {
            return Err(usage!("--substitute {truth}: a loss is measured against p = 1; add 1 to --levels"));
        }
        let episodes = match self.protocol {
            Some(Protocol::Paper) => 100,
            None => self.episodes.unwrap_or(1000),
        };
        Ok(Sweep {
            settings: Settings {
                episodes,
                seed: self.seed,
                greedy: self.greedy || entrants.iter().all(|entrant| entrant.policy.is_greedy()),
                comm_at_t0: !self.no_comm_at_t0,
                physics: self.physics,
                relay: self.relay,
            },
            conditions,
            axes,
            entrants,
            worlds: self.worlds as usize,
            place: if self.in_process {
                Place::InProcess(threads(self.threads))
            } else {
                Place::Processes(self.wait)
            },
        })
    }

    /// Levels, modes, links and chaos, in this order; and the axes on which links are.
    fn conditions(&self, entrants: &[Entrant]) -> Result<(Vec<Condition>, Vec<Axis>)> {
        let level = |text: &String| {
            let p = text.trim().trim_start_matches("p=").parse().ok();
            let level = p.and_then(|p| Condition::level(p).ok());
            level.ok_or_else(|| usage!("--levels: {text:?} is not a probability between 0 and 1"))
        };
        let mode = |text: &String| match text.trim() {
            mode @ ("uniform" | "asymmetric" | "dynamic") => Condition::parse(mode, 1),
            _ => Err(usage!("--modes: {text:?} is not one of uniform, asymmetric and dynamic")),
        };
        let (mut axes, mut links) = (Vec::new(), Vec::new());
        for text in &self.links {
            match axis(text, entrants)? {
                Some(axis) => axes.push(axis),
                None => links.push(text),
            }
        }
        // A matrix is for teams of one size.
        let for_all = |text: &str, parse: fn(&str, Site) -> Result<Condition>| {
            let read = entrants.iter().map(|entrant| parse(text, entrant.task.spec().into()));
            read.reduce(|all, one| all.and(one)).expect("there are policies")
        };
        // An empty list is one empty word.
        let levels = if self.levels == [""] { &[] } else { &self.levels[..] };
        let all = levels.iter().map(|text| ("--levels", level(text)));
        let all = all.chain(self.modes.iter().map(|text| ("--modes", mode(text))));
        let all = all.chain(links.into_iter().map(|text| ("--links", for_all(text, Condition::parse))));
        let all = all.chain(self.chaos.iter().map(|text| ("--chaos", for_all(text, Condition::parse_chaos))));
        let mut conditions: Vec<Condition> = Vec::new();
        for (option, condition) in all {
            let condition = condition?;
            if conditions.contains(&condition) {
                return Err(usage!("{option}: {condition} is given twice"));
            }
            conditions.push(condition);
        }
        for point in axes.iter().flat_map(|axis| &axis.points) {
            // A level may be on an axis, too.
            if !conditions.contains(&point.condition) {
                conditions.push(point.condition.clone());
            }
        }
        if conditions.is_empty() {
            return Err(usage!("there is nothing to play: give --levels, --modes, --links or --chaos"));
        }
        Ok((conditions, axes))
    }

    fn entrant(&self, name: &str, task: Option<&Task>) -> Result<Entrant> {
        let source = policy_source(name, self.seed)?;
        let task = match (&source, task) {
            (PolicySource::File(path), expected) => {
                let of_file = Task::parse(&PolicyFile::read(path)?.meta.task)?;
                match expected {
                    Some(task) if task.id() != of_file.id() => {
                        return Err(usage!("{name} is a policy for {}, not for {}", of_file.id(), task.id()));
                    }
                    _ => of_file,
                }
            }
            (_, Some(task)) => task.clone(),
            (_, None) => return Err(usage!("{name}: for which task? Name it with --task")),
        };
        let played = task.clone().with_physics(self.physics)?;
        let names = self.imputers.iter().map(|name| name.trim());
        let policy = Registry::default().told(source.load(task.spec())?, &played, names)?;
        let imputers = self.imputers_of(&policy, &task).map_err(|error| usage!("{name}: {error}"))?;
        Ok(Entrant::new(name, source, policy, task, imputers))
    }

    /// Each imputer, and behind it the oracles that take it for what they do not know.
    fn imputers_of(&self, policy: &Policy, task: &Task) -> Result<Vec<String>> {
        let plain = self.plain_imputers_of(policy)?;
        self.substitute.iter().try_for_each(|truth| truth.check(task.spec()))?;
        if !self.substitute.is_empty() {
            Truth::check_actors(policy).map_err(|error| usage!("--substitute: {error}"))?;
        }
        let with_oracles = plain.into_iter().flat_map(|imputer| {
            let oracles: Vec<String> = self.substitute.iter().map(|truth| truth.oracle(&imputer)).collect();
            std::iter::once(imputer).chain(oracles)
        });
        Ok(with_oracles.collect())
    }

    fn plain_imputers_of(&self, policy: &Policy) -> Result<Vec<String>> {
        let registry = Registry::default();
        if self.imputers.is_empty() {
            return Ok(registry.names(policy).map(str::to_owned).collect());
        }
        let mut imputers = Vec::new();
        for name in &self.imputers {
            let imputer = registry.choose(Some(name.trim()), policy)?;
            if imputers.contains(&imputer) {
                return Err(usage!("--imputers: {name} is given twice"));
            }
            imputers.push(imputer);
        }
        Ok(imputers)
    }

    /// The imputers that others are compared with: each group with the first that it is played with.
    pub(super) fn baselines(&self, sweep: &Sweep) -> Result<Vec<&str>> {
        let Some(name) = self.baseline.as_deref() else { return Ok(vec!["maro", "hold"]) };
        let played = |entrant: &Entrant| entrant.plays(name);
        if sweep.entrants.iter().any(played) {
            Ok(vec![name])
        } else {
            Err(usage!("--baseline {name}: no policy is played with this imputer; add it to --imputers"))
        }
    }

    /// The requirements, each with its imputer. An error for one that nothing of what is played can meet.
    pub(super) fn requirements(&self, sweep: &Sweep) -> Result<Vec<Requirement>> {
        let site = Site::from(sweep.entrants[0].task.spec());
        let with_imputer = |text: &String| {
            let requirement = Requirement::parse(text, site).map_err(|error| usage!("--require {error}"))?;
            let wrong = |why: String| usage!("--require '{requirement}': {why}");
            if !sweep.conditions.contains(&requirement.condition) {
                return Err(wrong(format!("{} is not played", requirement.condition)));
            }
            if requirement.needs_lossless() && !sweep.conditions.iter().any(Condition::is_lossless) {
                return Err(wrong("a score needs p = 1; add 1 to --levels".to_owned()));
            }
            if sweep.settings.episodes < FEWEST_EPISODES {
                let why = "intervals over so few episodes are too narrow to rely on; play at least";
                return Err(wrong(format!("{why} {FEWEST_EPISODES}")));
            }
            let by_itself = |entrant: &Entrant| Registry::default().choose(None, &entrant.policy);
            let mut names = Vec::new();
            for entrant in &sweep.entrants {
                let name = match &requirement.imputer {
                    Some(name) => name.clone(),
                    None => by_itself(entrant)?,
                };
                if !entrant.plays(&name) {
                    let policy = &entrant.contender.name;
                    let default = match requirement.imputer {
                        Some(_) => ";",
                        None => ", its default imputer; name another, as in 'p=0.2 imputer=hold ..', or",
                    };
                    return Err(wrong(format!(
                        "{policy} is not played with {name}{default} add it to --imputers"
                    )));
                }
                names.push(name);
            }
            if names.iter().any(|name| *name != names[0]) {
                let why =
                    "the default imputers of these policies differ; name one, as in 'p=0.2 imputer=hold ..'";
                return Err(wrong(why.to_owned()));
            }
            Ok(Requirement { imputer: names.into_iter().next(), ..requirement })
        };
        self.require.iter().map(with_imputer).collect()
    }
}

/// The axis that a text says for all teams; `None` for links without a list of values.
fn axis(text: &str, entrants: &[Entrant]) -> Result<Option<Axis>> {
    let mut axis = None;
    for entrant in entrants {
        let Some(own) = Axis::parse(text, entrant.task.spec())? else { return Ok(None) };
        axis = Some(match axis {
            Some(axis) => own.and(axis)?,
            None => own,
        });
    }
    Ok(axis)
}
