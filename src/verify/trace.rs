//! Recorded agents: joint estimates and logits from the recorded observations and deliveries.

use std::path::Path;

use super::{Comparison, Deviations};
use crate::agent::{Agent, AgentSettings, Inbox, PREFERRED, PolicySource, Received, Registry, dims};
use crate::base::error::{Error, Result};
use crate::environment::{Spec, Task};
use crate::nn::{Meta, Policy, import};
use crate::recording::{Episode, Recording};
use crate::usage;

/// Largest deviation of a joint estimate or logit: networks in f32 that add in another order.
const LARGEST: f64 = 1e-4;

/// Their median deviation.
const MEDIAN: f64 = 1e-5;

pub(super) fn compare(
    file: &Path,
    recording: &Recording,
    source: Option<&PolicySource>,
) -> Result<Vec<Comparison>> {
    let task = Task::parse(&recording.header.task)?;
    let spec = task.spec();
    let policy = find_policy(file, recording, source, spec)?;
    let settings = AgentSettings {
        imputer: Registry::default().choose(recording.header.imputer.as_deref(), &policy)?,
        longest_delay: recording.episodes.iter().map(Episode::longest_delay).max().unwrap_or_default(),
        ..AgentSettings::of(spec)
    };
    let (mut estimates, mut logits) = (Deviations::default(), Deviations::default());
    for index in 0..spec.n_agents() {
        let mut agent = Agent::with_policy(&settings, &policy, index)?;
        for (number, episode) in recording.episodes.iter().enumerate() {
            check_lengths(episode, spec, index)
                .map_err(|what| Error::io("verify", file, format!("episode {number}: {what}")))?;
            replay(&mut agent, number, episode, spec, &mut estimates, &mut logits);
        }
    }
    Ok(vec![
        estimates.largest(file, "joint estimates", LARGEST),
        estimates.median(file, "joint estimates, median", MEDIAN),
        logits.largest(file, "logits", LARGEST),
        logits.median(file, "logits, median", MEDIAN),
    ])
}

/// Runs one agent on what it saw and received, and compares what it thought.
fn replay(
    agent: &mut Agent,
    number: usize,
    episode: &Episode,
    spec: &Spec,
    estimates: &mut Deviations,
    logits: &mut Deviations,
) {
    let (index, available) = (agent.index(), spec.available_actions(agent.index()));
    agent.begin_episode(1);
    for step in 0..episode.delivered.len() {
        let observations = &episode.obs[step];
        let inbox = Inbox::of(spec.n_agents(), |sender| {
            let age = episode.age(step, index, sender)?;
            Some(Received { age, observation: &episode.obs[step - usize::from(age)][sender] })
        });
        agent.fuse(0, &observations[index], &inbox);
        // What was done is recorded, so no draw decides it.
        agent.act(0, step as u32, &[0.0]);
        estimates.at(number, step).add_all(agent.estimates(), &episode.joint_estimate[step][index]);
        logits.at(number, step).add_all(&agent.logits()[..available], &episode.logits[step][index]);
        let done = episode.actions[step][index].words(1);
        agent.correct(0, step as u32, &done).expect("actions were checked with the worlds");
        agent.predict();
    }
}

fn check_lengths(episode: &Episode, spec: &Spec, agent: usize) -> std::result::Result<(), String> {
    let padded = |step: &Vec<Vec<f32>>| step.iter().all(|obs| obs.len() == spec.padded_obs_dim());
    if !episode.obs.iter().all(padded) {
        return Err(format!("observations of a trace are padded to {}", spec.padded_obs_dim()));
    }
    let joint = |step: &Vec<Vec<f32>>| step[agent].len() == spec.joint_dim();
    if !episode.joint_estimate.iter().all(joint) {
        return Err(format!("joint estimates of {} have {} values", spec.id(), spec.joint_dim()));
    }
    Ok(())
}

/// The policy asked for, the one beside the trace, or the one the trace names.
fn find_policy(
    file: &Path,
    recording: &Recording,
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
    let header = &recording.header;
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
