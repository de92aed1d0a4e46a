//! The worlds against episodes recorded from the reference environments the paper trains on.
//!
//! `tests/data/recordings` holds one or two episodes of each task, with agents that collide wherever the
//! task has collisions. `VAMARO_RECORDINGS=<dir>` reads another directory of the same format instead, and
//! `-- --nocapture` prints the largest deviations.

use std::path::PathBuf;

use glam::DVec2;
use serde::Deserialize;
use vamaro_swarm::world::{EPISODE_STEPS, Task, World};

/// From a recorded state, one step agrees to this.
const STEP_TOLERANCE: f64 = 1e-12;
/// A whole episode agrees to this: contacts amplify differences in the last bits.
const EPISODE_TOLERANCE: f64 = 1e-6;

#[derive(Deserialize)]
struct Recording {
    task: String,
    n_agents: usize,
    n_landmarks: usize,
    episode_steps: usize,
    episodes: Vec<Episode>,
}

/// Indexed by time, then agent; there is one more state than there are steps.
#[derive(Deserialize)]
struct Episode {
    goal_landmark: Option<usize>,
    landmark_pos: Vec<DVec2Array>,
    agent_pos: Vec<Vec<DVec2Array>>,
    agent_vel: Vec<Vec<DVec2Array>>,
    actions: Vec<Vec<u8>>,
    obs: Vec<Vec<Vec<f32>>>,
    agent_reward: Vec<Vec<f64>>,
    team_reward: Vec<f64>,
    #[serde(rename = "return")]
    total: f64,
}

type DVec2Array = [f64; 2];

fn vectors(arrays: &[DVec2Array]) -> Vec<DVec2> {
    arrays.iter().copied().map(DVec2::from_array).collect()
}

impl Episode {
    /// The message heard at time `t`: what the speaker, agent 0, did in the step before.
    fn message(&self, task: &Task, t: usize) -> Option<u8> {
        (task.id() == "speaker-listener" && t > 0).then(|| self.actions[t - 1][0])
    }

    fn load(&self, t: usize, world: &mut World) {
        let message = self.message(world.task(), t);
        world.set_state(
            &vectors(&self.agent_pos[t]),
            &vectors(&self.agent_vel[t]),
            &vectors(&self.landmark_pos),
            self.goal_landmark,
            message,
        );
    }
}

fn recordings() -> Vec<(Task, Vec<Episode>)> {
    let directory = std::env::var_os("VAMARO_RECORDINGS").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings"),
        PathBuf::from,
    );
    let read = |task: Task| {
        let path = directory.join(format!("{}.json", task.id()));
        let text =
            std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let recording: Recording = serde_json::from_str(&text).expect("the format of the recordings");
        assert_eq!(recording.task, task.id());
        assert_eq!((recording.n_agents, recording.n_landmarks), (task.n_agents(), task.n_landmarks()));
        assert_eq!(recording.episode_steps, EPISODE_STEPS);
        assert!(recording.episodes.iter().all(|episode| episode.actions.len() == EPISODE_STEPS));
        (task, recording.episodes)
    };
    Task::all().into_iter().map(read).collect()
}

/// What `agent` observes; the padding must be zeros, whatever was in the buffer.
fn observed(world: &World, agent: usize) -> Vec<f32> {
    let mut padded = vec![f32::NAN; world.task().padded_obs_dim()];
    world.observe(agent, &mut padded);
    let padding = padded.split_off(world.task().obs_dim(agent));
    assert!(padding.iter().all(|&value| value == 0.0));
    padded
}

fn deviation(ours: impl IntoIterator<Item = f64>, theirs: impl IntoIterator<Item = f64>) -> f64 {
    let (ours, theirs): (Vec<f64>, Vec<f64>) = (ours.into_iter().collect(), theirs.into_iter().collect());
    assert_eq!(ours.len(), theirs.len());
    ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, largest)
}

/// Unlike [`f64::max`], a NaN wins: a deviation that is not a number must not pass.
fn largest(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// How far positions, velocities and rewards are from the recorded time `t`.
fn deviations(world: &World, episode: &Episode, t: usize) -> [f64; 4] {
    let flat = |of: &[DVec2]| of.iter().flat_map(|vector| vector.to_array()).collect::<Vec<f64>>();
    [
        deviation(flat(world.positions()), episode.agent_pos[t].concat()),
        deviation(flat(world.velocities()), episode.agent_vel[t].concat()),
        deviation(world.agent_rewards().to_vec(), episode.agent_reward[t - 1].clone()),
        deviation([world.team_reward()], [episode.team_reward[t - 1]]),
    ]
}

/// How many `f32` values lie between two observed values.
fn ulps(a: f32, b: f32) -> u32 {
    let ordered = |x: f32| if x < 0.0 { -((-x).to_bits() as i64) } else { x.abs().to_bits() as i64 };
    ordered(a).abs_diff(ordered(b)) as u32
}

#[test]
fn every_step_from_a_recorded_state_leads_to_the_next() {
    for (task, episodes) in recordings() {
        let mut world = World::new(&task);
        let mut worst = [0.0; 4];
        for (k, episode) in episodes.iter().enumerate() {
            for t in 0..EPISODE_STEPS {
                episode.load(t, &mut world);
                world.step(&episode.actions[t]);
                let found = deviations(&world, episode, t + 1);
                worst = std::array::from_fn(|i| largest(worst[i], found[i]));
                for agent in 0..task.n_agents() {
                    for (ours, &theirs) in observed(&world, agent).iter().zip(&episode.obs[t + 1][agent]) {
                        // Around zero an ulp is far below the state's own tolerance.
                        let close =
                            ulps(*ours, theirs) <= 1 || f64::from((ours - theirs).abs()) <= STEP_TOLERANCE;
                        assert!(close, "{} episode {k} after step {t}: {ours} {theirs}", task.id());
                    }
                }
            }
        }
        println!("{:20} step: position, velocity, reward, team reward {worst:?}", task.id());
        assert!(worst.iter().all(|&by| by <= STEP_TOLERANCE), "{} {worst:?}", task.id());
    }
}

#[test]
fn a_recorded_state_is_observed_as_recorded_to_the_bit() {
    for (task, episodes) in recordings() {
        let mut world = World::new(&task);
        for episode in &episodes {
            for (t, seen) in episode.obs.iter().enumerate() {
                episode.load(t, &mut world);
                for (agent, theirs) in seen.iter().enumerate() {
                    assert_eq!(&observed(&world, agent), theirs, "{} agent {agent} at {t}", task.id());
                }
            }
        }
    }
}

#[test]
fn a_whole_episode_stays_with_the_recording() {
    for (task, episodes) in recordings() {
        let mut world = World::new(&task);
        let mut worst = [0.0; 4];
        for episode in &episodes {
            episode.load(0, &mut world);
            let mut total = 0.0;
            for (t, actions) in episode.actions.iter().enumerate() {
                world.step(actions);
                total += world.team_reward();
                let found = deviations(&world, episode, t + 1);
                worst = std::array::from_fn(|i| largest(worst[i], found[i]));
            }
            // The return adds up one deviation per step.
            assert!((total - episode.total).abs() <= EPISODE_STEPS as f64 * EPISODE_TOLERANCE);
        }
        println!("{:20} episode: position, velocity, reward, team reward {worst:?}", task.id());
        assert!(worst.iter().all(|&by| by <= EPISODE_TOLERANCE), "{} {worst:?}", task.id());
    }
}

#[test]
fn the_recordings_hold_contacts_where_there_are_any() {
    for (task, episodes) in recordings() {
        let bodies = &task.physics().bodies;
        let touch = |positions: &Vec<DVec2Array>| {
            let places = vectors(positions);
            (0..places.len())
                .any(|a| (0..a).any(|b| places[a].distance(places[b]) < bodies[a].size + bodies[b].size))
        };
        let contacts = episodes.iter().flat_map(|episode| &episode.agent_pos).filter(|&at| touch(at)).count();
        assert!(!bodies[0].collides || contacts > 5, "{}: {contacts} crowded moments", task.id());
    }
}
