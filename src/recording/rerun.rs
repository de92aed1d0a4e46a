//! The agents of a trace, who think again what they thought.

use std::path::Path;

use super::{Episode, Presence, RecordingHeader};
use crate::agent::{Agent, AgentSettings, Inbox, PREFERRED, PolicySource, Received, Registry, dims};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::environment::{Spec, Task};
use crate::nn::{Meta, Policy, import};
use crate::usage;

/// A team that is given what the agents of a trace saw and received.
#[derive(Debug)]
pub(crate) struct Rerun {
    agents: Vec<Agent>,
    spec: Spec,
    /// That of the draws by which actions are sampled.
    seed: u64,
}

impl Rerun {
    /// The team of the trace in `file`. It has the policy of `source`, the one beside the file, or the one that the trace
    /// names.
    pub(crate) fn new(file: &Path, header: &RecordingHeader, source: Option<&PolicySource>) -> Result<Rerun> {
        let task = Task::parse(&header.task)?;
        let spec = task.spec();
        let (registry, policy) = (Registry::default(), find_policy(file, header, source, spec)?);
        let played = task.clone().with_physics(header.physics)?;
        let policy = registry.told(policy, &played, header.imputer.as_deref().into_iter())?;
        let seed = header.seed.unwrap_or_default();
        let settings = AgentSettings {
            imputer: registry.choose(header.imputer.as_deref(), &policy)?,
            longest_delay: header.longest_delay,
            relay: header.relay,
            seed,
            greedy: header.greedy.unwrap_or_default(),
            ..AgentSettings::of(spec)
        };
        let agents = (0..spec.n_agents()).map(|index| Agent::with_policy(&settings, &policy, index));
        Ok(Rerun { agents: agents.collect::<Result<_>>()?, spec: spec.clone(), seed })
    }

    /// What the team plays in.
    pub(crate) fn spec(&self) -> &Spec {
        &self.spec
    }

    /// Plays an episode again and tells of each decision, by its step. Returns how many decisions cannot be made again: an
    /// agent that misses a tick against the clock may have seen it or not, and remembers accordingly.
    ///
    /// # Errors
    /// In words, if the values are not as long as those of the task, or an action is none.
    pub(crate) fn play(
        &mut self,
        episode: &Episode,
        mut told: impl FnMut(usize, &Agent),
    ) -> std::result::Result<usize, String> {
        let padded = |step: &Vec<Vec<f32>>| step.iter().all(|obs| obs.len() == self.spec.padded_obs_dim());
        if !episode.obs.iter().all(padded) {
            return Err(format!("observations of a trace are padded to {}", self.spec.padded_obs_dim()));
        }
        let (number, mut left_out) = (episode.episode.unwrap_or_default(), 0);
        for agent in &mut self.agents {
            agent.begin_episode(1);
            let (index, mut is_known) = (agent.index(), true);
            for step in 0..episode.delivered.len() {
                match episode.presence(step, index) {
                    Presence::Absent => continue,
                    Presence::Missed => {
                        is_known = false;
                        continue;
                    }
                    Presence::Anew => {
                        agent.begin_episode(1);
                        is_known = true;
                    }
                    Presence::Decided => {}
                }
                if !is_known {
                    left_out += 1;
                    continue;
                }
                let inbox = Inbox::of(self.spec.n_agents(), |sender| {
                    let age = episode.age(step, index, sender)?;
                    Some(Received { age, observation: &episode.obs[step - usize::from(age)][sender] })
                });
                agent.fuse(0, &episode.obs[step][index], &inbox);
                let mut draws = Draws::new(self.seed, Purpose::Action, number, step as u64);
                agent
                    .act(number, step as u32, &[draws.at(index, 0).uniform()])
                    .map_err(|error| error.to_string())?;
                told(step, agent);
                let done = episode.actions[step][index].words(1);
                agent.correct(number, step as u32, &done).map_err(|e| e.to_string())?;
                agent.predict();
            }
        }
        Ok(left_out)
    }

    /// Runs the agents of an episode again, and notes their estimates; leaves them out if that cannot be done.
    pub(crate) fn think(&mut self, episode: &mut Episode) -> std::result::Result<(), String> {
        let mut estimates = vec![vec![Vec::new(); self.agents.len()]; episode.actions.len()];
        self.play(episode, |step, agent| estimates[step][agent.index()] = agent.estimates().to_vec())?;
        episode.joint_estimate = estimates;
        Ok(())
    }
}

/// The policy asked for, the one beside the trace, or the one the trace names.
fn find_policy(
    file: &Path,
    header: &RecordingHeader,
    source: Option<&PolicySource>,
    spec: &Spec,
) -> Result<Policy> {
    if let Some(source) = source {
        return source.load(spec);
    }
    let beside = |name: &str| file.parent().unwrap_or(Path::new("")).join(name);
    let (own, actors, predictor) = (beside("policy.safetensors"), beside("agent.th"), beside("network.th"));
    if own.exists() {
        return PolicySource::File(own).load(spec);
    }
    if actors.exists() && predictor.exists() {
        let predictors = [(PREFERRED.to_owned(), predictor)];
        return import(&actors, &predictors, &dims(spec), Meta::new(spec.id(), 0));
    }
    let name = header.policy.as_deref().unwrap_or_default();
    let own = [PolicySource::Builtin, PolicySource::Untrained(header.seed.unwrap_or_default())];
    let named = own.into_iter().find(|source| source.to_string() == name);
    match named.or_else(|| Path::new(name).is_file().then(|| PolicySource::File(name.into()))) {
        Some(source) => source.load(spec),
        None => Err(usage!(
            "no policy for the trace {}{}: put policy.safetensors (or agent.th and network.th) beside it, or \
             name one with --policy",
            file.display(),
            if name.is_empty() { String::new() } else { format!(", which was recorded with {name}") }
        )),
    }
}
