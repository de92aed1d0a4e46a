//! Recorded worlds: every single step from its recorded state, and a free run of the episode.

use std::path::Path;

use glam::DVec2;

use super::{Comparison, Deviations};
use crate::base::error::{Error, Result};
use crate::environment::{EPISODE_STEPS, Task, World};
use crate::recording::{Episode, Recording};

/// A single step from the recorded state.
const STEP_TOLERANCE: f64 = 1e-12;

/// A free run: in crowded episodes contacts make a difference in the last bit grow to 1e-8.
const RUN_TOLERANCE: f64 = 1e-6;

/// Sums of 25 rewards, added in another order.
const RETURN_TOLERANCE: f64 = 1e-9;

#[derive(Default)]
struct Found {
    states: Deviations,
    rewards: Deviations,
    returns: Deviations,
    /// In units in the last place of an f32.
    observations: Deviations,
    free_run: Deviations,
}

pub(super) fn compare(file: &Path, recording: &Recording) -> Result<Vec<Comparison>> {
    let task = Task::parse(&recording.header.task)?;
    check_team(&task, recording).map_err(|what| Error::io("verify", file, what))?;
    let (mut world, mut found) = (World::new(&task), Found::default());
    for (number, episode) in recording.episodes.iter().enumerate() {
        compare_steps(number, episode, &mut world, &mut found);
        run_freely(number, episode, &mut world, &mut found);
    }
    Ok(vec![
        found.states.largest(file, "state after a step", STEP_TOLERANCE),
        found.rewards.largest(file, "rewards", STEP_TOLERANCE),
        found.returns.largest(file, "return", RETURN_TOLERANCE),
        found.observations.largest(file, "observations (ulp of f32)", 1.0),
        found.free_run.largest(file, "state in a free run", RUN_TOLERANCE),
    ])
}

fn check_team(task: &Task, recording: &Recording) -> std::result::Result<(), String> {
    let header = &recording.header;
    let (expected, found) = ((task.n_agents(), task.n_landmarks()), (header.n_agents, header.n_landmarks));
    if expected != found {
        return Err(format!(
            "it has {} agents and {} landmarks, {} has {} and {}",
            found.0,
            found.1,
            task.id(),
            expected.0,
            expected.1
        ));
    }
    let is_goal = |goal: Option<usize>| {
        goal.is_some() == task.has_goal() && goal.is_none_or(|g| g < task.n_landmarks())
    };
    if let Some(episode) = recording.episodes.iter().find(|episode| !is_goal(episode.goal_landmark)) {
        return Err(format!("{} has no goal {:?}", task.id(), episode.goal_landmark));
    }
    let mut actions =
        recording.episodes.iter().flat_map(|e| &e.actions).flat_map(|team| team.iter().enumerate());
    match actions.find(|(agent, action)| usize::from(**action) >= task.available_actions(*agent)) {
        Some((agent, action)) => Err(format!("agent {agent} has no action {action}")),
        None => Ok(()),
    }
}

fn compare_steps(number: usize, episode: &Episode, world: &mut World, found: &mut Found) {
    let mut observation = vec![0.0; world.task().padded_obs_dim()];
    for (step, recorded) in episode.obs.iter().enumerate() {
        episode.restore(step, world);
        for (agent, recorded) in recorded.iter().enumerate() {
            world.observe(agent, &mut observation);
            compare_observation(&observation, recorded, found.observations.at(number, step));
        }
    }
    let mut total = 0.0;
    for (step, actions) in episode.actions.iter().enumerate() {
        episode.restore(step, world);
        world.step(actions);
        compare_state(world, episode, step + 1, found.states.at(number, step));
        found.rewards.at(number, step).add(world.team_reward(), episode.team_reward[step]);
        if let Some(recorded) = episode.agent_reward.get(step) {
            found.rewards.add_all(world.agent_rewards(), recorded);
        }
        total += world.team_reward();
    }
    found.returns.at(number, EPISODE_STEPS).add(total, episode.episode_return);
}

fn run_freely(number: usize, episode: &Episode, world: &mut World, found: &mut Found) {
    episode.restore(0, world);
    for (step, actions) in episode.actions.iter().enumerate() {
        world.step(actions);
        compare_state(world, episode, step + 1, found.free_run.at(number, step));
    }
}

fn compare_state(world: &World, episode: &Episode, step: usize, deviations: &mut Deviations) {
    let pairs =
        [(world.positions(), &episode.agent_pos[step]), (world.velocities(), &episode.agent_vel[step])];
    for (found, recorded) in pairs {
        for (found, recorded) in found.iter().zip(recorded) {
            let DVec2 { x, y } = *recorded;
            deviations.add(found.x, x);
            deviations.add(found.y, y);
        }
    }
}

/// A recorded observation may be without its padding, which is zero.
fn compare_observation(found: &[f32], recorded: &[f32], deviations: &mut Deviations) {
    if recorded.len() > found.len() {
        deviations.push(f64::INFINITY);
    }
    let padded = recorded.iter().copied().chain(std::iter::repeat(0.0));
    found.iter().zip(padded).for_each(|(found, recorded)| deviations.push(ulps(*found, recorded)));
}

/// How many f32 lie between two values; infinite if one is not a number.
fn ulps(a: f32, b: f32) -> f64 {
    if a.is_nan() || b.is_nan() {
        return f64::INFINITY;
    }
    // Orders the bit patterns like the numbers, with both zeros at 0.
    let rank = |x: f32| {
        let magnitude = i64::from(x.to_bits() & 0x7fff_ffff);
        if x.is_sign_negative() { -magnitude } else { magnitude }
    };
    (rank(a) - rank(b)).abs() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ulps_count_the_floats_between() {
        assert_eq!(ulps(1.0, 1.0), 0.0);
        assert_eq!(ulps(1.0, 1.0f32.next_up()), 1.0);
        assert_eq!(ulps(0.0, -0.0), 0.0);
        assert_eq!(ulps(0.0f32.next_up(), -(0.0f32.next_up())), 2.0);
        assert!(ulps(f32::NAN, 1.0).is_infinite());
    }
}
