//! Speaker-listener: one agent knows the goal and cannot move, the other moves and listens.

use super::family::{Family, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{
    About, ActionSpace, Actions, AgentSpec, Axis, Body, PaperSetting, Physics, Spec, TeamReward, Value,
};
use crate::base::rng::Draws;

pub(super) const FAMILY: Family = Family {
    summary: "the speaker knows the goal and cannot move, the listener moves and is told",
    named: &[named(N_AGENTS, "speaker-listener", &["SL", "SimpleSpeakerListener-v0"])],
    any_size: None,
    spec,
    worlds: worlds::<SpeakerListener>,
    chance: 0.0,
};

const N_AGENTS: usize = 2;
const N_LANDMARKS: usize = 3;
/// What the speaker can say: as many words as there are landmarks.
const N_MESSAGES: usize = N_LANDMARKS;
const PADDED_OBS_DIM: usize = 11;
const SPEAKER: usize = 0;
const LISTENER: usize = 1;

#[derive(Clone, Debug)]
struct SpeakerListener;

/// See [`SpeakerListener::observe`]. Where landmarks lie from the listener changes as it moves.
fn spec(id: &str, _n_agents: usize) -> Spec {
    let own = About::Agent(LISTENER);
    let mut heard = Axis::BOTH.map(|axis| Value::velocity(own, axis)).to_vec();
    for _ in 0..N_LANDMARKS {
        heard.extend(Axis::BOTH.map(|axis| Value::moving(own, axis, axis as usize, -1.0)));
    }
    heard.extend([Value::word(About::Message); N_MESSAGES]);
    let agent = |name: &str, observation, n| AgentSpec {
        name: name.to_owned(),
        observation,
        actions: ActionSpace::Discrete(n),
    };
    let colour = vec![Value::word(About::Landmark); N_LANDMARKS];
    Spec {
        id: id.to_owned(),
        agents: vec![agent("speaker", colour, N_MESSAGES), agent("listener", heard, 5)],
        unique: PADDED_OBS_DIM,
        common: Vec::new(),
        landmarks: N_LANDMARKS,
        targets: 0,
        episode_steps: 25,
        dt: SpeakerListener::physics(N_AGENTS).dt,
        team_reward: TeamReward::SumForEach,
        paper: PaperSetting::One,
        positions: true,
    }
}

impl Rules for SpeakerListener {
    const HAS_GOAL: bool = true;

    fn physics(_n_agents: usize) -> Physics {
        let listener = Body::of_size(0.075);
        Physics::of(vec![Body { movable: false, ..listener }, listener])
    }

    fn draw_goal(draws: &mut Draws, landmarks: usize) -> usize {
        draws.below(landmarks)
    }

    /// What the speaker says with its action; nothing with an action it does not have.
    fn message(actions: Actions) -> Option<u32> {
        Some(actions.choice(SPEAKER)).filter(|&word| (word as usize) < N_MESSAGES)
    }

    /// The speaker observes the colour of the goal; the listener its own velocity, where each landmark lies
    /// from it, and the speaker's last message, one-hot.
    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        out.fill(0.0);
        if agent == SPEAKER {
            out[..N_LANDMARKS].fill(0.15);
            out[plane.goal] = 0.65;
        } else {
            let here = plane.positions[LISTENER];
            let [first, second, third] = [0, 1, 2].map(|landmark| plane.landmarks[landmark] - here);
            write(&[plane.velocities[LISTENER], first, second, third], out);
            if let Some(word) = plane.message {
                out[PADDED_OBS_DIM - N_MESSAGES + word as usize] = 1.0;
            }
        }
    }

    /// Both agents pay the listener's squared distance to the goal.
    fn reward(plane: &Plane, _physics: &Physics, rewards: &mut [f64]) {
        let goal = plane.landmarks[plane.goal];
        rewards.fill(-plane.positions[LISTENER].distance_squared(goal));
    }
}
