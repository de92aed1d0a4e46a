//! Plays the episodes of one cell.

use std::time::Duration;

use super::condition::Condition;
use super::errors::ErrorLedger;
use super::evaluation::{Outcome, Settings};
use super::sweep::Entrant;
use crate::agent::AgentSettings;
use crate::base::error::{Error, Result};
use crate::base::rng::{Draws, Purpose};
use crate::environment::{End, Outcome as Stepped, Task};
use crate::nn::Policy;
use crate::recording::Episode;
use crate::supervisor::{InProcess, Ledger, Recorder, Session, Team, signals};

/// Episodes of an evaluation are numbered from here on: those of training from 0, its tests' from 2^48, so no
/// policy has seen their initial states.
const FIRST_EPISODE: u64 = 1 << 49;

/// Plays all episodes with a team of `policy` that uses this imputer, `worlds` at a time.
pub(super) fn play(
    settings: &Settings,
    policy: &Policy,
    task: &Task,
    condition: &Condition,
    imputer: &str,
    worlds: usize,
    team: &mut impl Team,
) -> Result<Outcome> {
    let end = FIRST_EPISODE + settings.episodes;
    let mut session = session(settings, task, condition, worlds, 0)?;
    if let Some(chaos) = condition.chaos() {
        session = session.with_chaos(chaos, Duration::from_secs_f64(task.spec().dt))?;
    }
    let (mut ledger, mut errors) = (Ledger::default(), ErrorLedger::new(task.spec(), policy, imputer));
    session.play(team, end, &mut [&mut ledger, &mut errors])?;
    let statistics = ledger.into_statistics();
    let returns = statistics.episodes().iter().map(|episode| episode.episode_return).collect();
    Ok(Outcome { returns, errors: errors.finish() })
}

/// A session that begins with this episode.
fn session(
    settings: &Settings,
    task: &Task,
    condition: &Condition,
    worlds: usize,
    episode: u64,
) -> Result<Session> {
    let links = condition.links().build().sharing_at_start(settings.comm_at_t0);
    let environment = task.clone().with_physics(settings.physics)?.environment(worlds);
    let session = Session::new(environment, links, settings.seed).relaying(settings.relay);
    Ok(session.starting_at(FIRST_EPISODE + episode))
}

/// Plays one of the episodes of a cell alone, by agents in this process, and records it.
pub(super) fn play_again(
    settings: &Settings,
    agents: &AgentSettings,
    entrant: &Entrant,
    condition: &Condition,
    episode: u64,
) -> Result<Episode> {
    let mut session = session(settings, &entrant.task, condition, 1, episode)?;
    let (mut team, mut recorder) = (InProcess::new(agents, &entrant.policy)?, Recorder::in_memory());
    session.play(&mut team, FIRST_EPISODE + episode + 1, &mut [&mut recorder])?;
    recorder.into_episodes().pop().ok_or_else(|| Error::Interrupted("interrupted".to_owned()))
}

/// The returns of agents that choose uniformly among their available actions, in the same episodes.
///
/// # Errors
/// `Interrupted` if the program was asked to stop.
pub(super) fn play_at_random(settings: &Settings, task: &Task) -> Result<Vec<f64>> {
    let (spec, mut world) = (task.spec(), task.clone().with_physics(settings.physics)?.environment(1));
    let (mut actions, mut stepped) =
        (vec![0; spec.n_agents() * spec.action_width()], Stepped::of(1, spec.n_agents()));
    let mut play = |episode| {
        signals::check_stop()?;
        world.reset(0, settings.seed, episode)?;
        let mut episode_return = 0.0;
        for step in 0..spec.episode_steps as u64 {
            let mut draws = Draws::new(settings.seed, Purpose::Action, episode, step);
            for (agent, action) in actions.chunks_exact_mut(spec.action_width()).enumerate() {
                spec.agents[agent].actions.draw(draws.at(agent, 0), action);
            }
            world.step(&actions, &[true], &mut stepped)?;
            episode_return += spec.team_reward(&stepped.rewards);
            if stepped.ends[0] != End::Open {
                break;
            }
        }
        Ok(episode_return)
    };
    (FIRST_EPISODE..FIRST_EPISODE + settings.episodes).map(&mut play).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::PolicySource;
    use crate::base::stats::mean;

    fn settings(episodes: u64) -> Settings {
        Settings { episodes, seed: 4, comm_at_t0: true, ..Settings::default() }
    }

    fn outcome(task: &str, p: f64, imputer: &str, worlds: usize) -> Outcome {
        let task = Task::parse(task).unwrap();
        let policy = PolicySource::Builtin.load(task.spec()).unwrap();
        let agents =
            AgentSettings { imputer: imputer.to_owned(), seed: 4, worlds, ..AgentSettings::of(task.spec()) };
        let mut team = InProcess::new(&agents, &policy).unwrap();
        play(&settings(9), &policy, &task, &Condition::level(p).unwrap(), imputer, worlds, &mut team).unwrap()
    }

    #[test]
    fn nothing_depends_on_the_number_of_worlds() {
        for task in ["hear-see", "spread-xy-4"] {
            let alone = outcome(task, 0.3, "value-aware", 1);
            assert_eq!(alone.returns.len(), 9);
            assert!(!alone.errors.is_empty());
            assert!(
                [2, 9].iter().all(|worlds| outcome(task, 0.3, "value-aware", *worlds) == alone),
                "{task}"
            );
        }
    }

    #[test]
    fn cells_are_paired_and_differ_in_their_imputers_only() {
        let [value_aware, hold] = ["value-aware", "hold"].map(|imputer| outcome("hear-see", 1.0, imputer, 3));
        assert_eq!(value_aware, hold, "nothing is imputed where everything is delivered");
        assert!(value_aware.errors.is_empty());
        assert_ne!(
            outcome("hear-see", 0.3, "value-aware", 3).returns,
            outcome("hear-see", 0.3, "hold", 3).returns
        );
    }

    #[test]
    fn a_random_team_does_worse_than_a_trained_one_and_is_always_the_same() {
        for task in ["hear-see", "speaker-listener"] {
            let random = play_at_random(&settings(9), &Task::parse(task).unwrap()).unwrap();
            assert_eq!(random, play_at_random(&settings(9), &Task::parse(task).unwrap()).unwrap());
            assert!(mean(&random) < mean(&outcome(task, 1.0, "hold", 3).returns), "{task}");
        }
    }
}
