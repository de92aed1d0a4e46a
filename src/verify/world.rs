//! Recorded worlds: every single step from its recorded state, and a free run of the episode.

use std::path::Path;

use glam::DVec2;

use super::{Comparison, Deviations};
use crate::base::error::{Error, Result};
use crate::environment::{Environment, Outcome, State, Target, Task};
use crate::recording::{Episode, Reader, RecordingHeader};

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

/// One world, put where a recording has it.
struct World {
    environment: Box<dyn Environment>,
    outcome: Outcome,
    /// That of all draws, if it was recorded.
    seed: Option<u64>,
}

/// The worlds of a recording, and how far they are from what was recorded.
pub(super) struct Worlds {
    task: Task,
    world: World,
    found: Found,
    /// Whether what agents observed was recorded, and not computed from the states.
    has_observations: bool,
}

impl Worlds {
    /// The worlds of the recording in `file`.
    pub(super) fn of(file: &Path, recording: &Reader) -> Result<Worlds> {
        let header = &recording.header;
        let task = Task::parse(&header.task)?.with_physics(header.physics)?;
        check_team(&task, header).map_err(|what| Error::io("verify", file, what))?;
        let outcome = Outcome::of(1, task.spec().n_agents());
        let world = World { environment: task.environment(1), outcome, seed: header.seed };
        Ok(Worlds { task, world, found: Found::default(), has_observations: !recording.is_compact() })
    }

    /// Compares an episode, the so-manieth of the file.
    pub(super) fn compare(&mut self, file: &Path, number: usize, episode: &Episode) -> Result<()> {
        let wrong = |what| Error::io("verify", file, what);
        check_actions(&self.task, episode).map_err(wrong)?;
        check_draws(&self.task, self.world.seed, episode).map_err(wrong)?;
        compare_steps(number, episode, &mut self.world, &mut self.found)?;
        run_freely(number, episode, &mut self.world, &mut self.found)
    }

    /// What was compared.
    pub(super) fn compared(&self, file: &Path) -> Vec<Comparison> {
        let Found { states, rewards, returns, observations, free_run } = &self.found;
        let observed =
            self.has_observations.then(|| observations.largest(file, "observations (ulp of f32)", 1.0));
        [
            states.largest(file, "state after a step", STEP_TOLERANCE),
            rewards.largest(file, "rewards", STEP_TOLERANCE),
            returns.largest(file, "return", RETURN_TOLERANCE),
        ]
        .into_iter()
        .chain(observed)
        .chain([free_run.largest(file, "state in a free run", RUN_TOLERANCE)])
        .collect()
    }
}

fn check_team(task: &Task, header: &RecordingHeader) -> std::result::Result<(), String> {
    let spec = task.spec();
    let (expected, found) = ((spec.n_agents(), spec.landmarks), (header.n_agents, header.n_landmarks));
    if expected != found {
        return Err(format!(
            "it has {} agents and {} landmarks, {} has {} and {}",
            found.0, found.1, spec.id, expected.0, expected.1
        ));
    }
    if header.episode_steps != spec.episode_steps {
        let (found, expected) = (header.episode_steps, spec.episode_steps);
        return Err(format!("its episodes have up to {found} steps, those of {} {expected}", spec.id));
    }
    Ok(())
}

fn check_actions(task: &Task, episode: &Episode) -> std::result::Result<(), String> {
    let mut actions = episode.actions.iter().flat_map(|team| team.iter().zip(&task.spec().agents));
    match actions.find(|(action, agent)| !agent.actions.contains(&action.words(0))) {
        Some((action, agent)) => Err(format!("{} has no action {action}", agent.name)),
        None => Ok(()),
    }
}

/// Whether what is random in steps can be drawn again.
fn check_draws(task: &Task, seed: Option<u64>, episode: &Episode) -> std::result::Result<(), String> {
    let addressed = seed.is_some() && episode.episode.is_some();
    if (task.chance() > 0.0 || task.spec().targets > 0) && !addressed {
        return Err(
            "motor noise, wind and the turns of targets cannot be drawn again without `seed` and the number of each \
             `episode`"
                .to_owned(),
        );
    }
    Ok(())
}

fn compare_steps(number: usize, episode: &Episode, world: &mut World, found: &mut Found) -> Result<()> {
    let spec = world.environment.spec().clone();
    let mut observations = vec![0.0; spec.n_agents() * spec.padded_obs_dim()];
    for (step, recorded) in episode.obs.iter().enumerate() {
        world.restore(episode, step)?;
        world.environment.observe(1, &mut observations)?;
        for (observed, recorded) in observations.chunks_exact(spec.padded_obs_dim()).zip(recorded) {
            compare_observation(observed, recorded, found.observations.at(number, step));
        }
    }
    world.begin(episode)?;
    let mut total = 0.0;
    for (step, recorded) in episode.team_reward.iter().enumerate() {
        world.restore(episode, step)?;
        world.step(episode, step)?;
        compare_state(&world.state(), episode, step + 1, found.states.at(number, step));
        let rewards = &world.outcome.rewards;
        let team_reward = spec.team_reward(rewards);
        found.rewards.at(number, step).add(team_reward, *recorded);
        if let Some(recorded) = episode.agent_reward.get(step) {
            found.rewards.add_all(rewards, recorded);
        }
        total += team_reward;
    }
    found.returns.at(number, episode.actions.len()).add(total, episode.episode_return);
    Ok(())
}

fn run_freely(number: usize, episode: &Episode, world: &mut World, found: &mut Found) -> Result<()> {
    world.begin(episode)?;
    world.restore(episode, 0)?;
    for step in 0..episode.actions.len() {
        world.step(episode, step)?;
        compare_state(&world.state(), episode, step + 1, found.free_run.at(number, step));
    }
    Ok(())
}

impl World {
    /// Begins an episode: what is random in its steps is drawn again, in their order.
    fn begin(&mut self, episode: &Episode) -> Result<()> {
        match self.seed.zip(episode.episode) {
            Some((seed, number)) => self.environment.reset(0, seed, number),
            None => Ok(()),
        }
    }

    /// Puts it into the state before a step.
    fn restore(&mut self, episode: &Episode, step: usize) -> Result<()> {
        let (state, last_actions) = episode.at(step, self.environment.spec().action_width());
        self.environment.set_state(0, &state, last_actions.as_deref())
    }

    /// Does what was done in a step.
    fn step(&mut self, episode: &Episode, step: usize) -> Result<()> {
        let actions = episode.words(step, self.environment.spec().action_width());
        self.environment.step(&actions, &[true], &mut self.outcome)
    }

    fn state(&self) -> State {
        self.environment.state(0)
    }
}

fn compare_state(state: &State, episode: &Episode, step: usize, deviations: &mut Deviations) {
    let found = |of: fn(&Target) -> DVec2| state.targets.iter().map(of).collect::<Vec<_>>();
    let [places, velocities] = [found(|target| target.position), found(|target| target.velocity)];
    let pairs = [
        (&state.positions, episode.agent_pos.get(step)),
        (&state.velocities, episode.agent_vel.get(step)),
        (&places, episode.target_pos.get(step)),
        (&velocities, episode.target_vel.get(step)),
    ];
    for (found, recorded) in pairs {
        for (found, recorded) in found.iter().zip(recorded.into_iter().flatten()) {
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
