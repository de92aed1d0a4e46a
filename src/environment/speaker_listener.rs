//! Speaker-listener: one agent knows the goal and cannot move, the other moves and listens.

use super::physics::Body;
use super::{Observed, World, write};

pub(super) const SUMMARY: &str = "the speaker knows the goal and cannot move, the listener moves and is told";
pub(super) const N_AGENTS: usize = 2;
pub(super) const N_LANDMARKS: usize = 3;
/// What the speaker can say: as many words as there are landmarks.
pub(super) const N_MESSAGES: usize = N_LANDMARKS;
pub(super) const PADDED_OBS_DIM: usize = 11;
pub(super) const OBS_DIMS: [usize; N_AGENTS] = [3, PADDED_OBS_DIM];
pub(super) const SPEAKER: usize = 0;
const LISTENER: usize = 1;

/// See [`observe`].
pub(super) const OBSERVED: [&[Observed]; N_AGENTS] = [
    &[Observed::WORD; N_LANDMARKS],
    &[
        Observed::VELOCITY,
        Observed::VELOCITY,
        Observed::moving(0, -1.0),
        Observed::moving(1, -1.0),
        Observed::moving(0, -1.0),
        Observed::moving(1, -1.0),
        Observed::moving(0, -1.0),
        Observed::moving(1, -1.0),
        Observed::WORD,
        Observed::WORD,
        Observed::WORD,
    ],
];

pub(super) fn bodies() -> Vec<Body> {
    let listener = Body::of_size(0.075);
    vec![Body { movable: false, ..listener }, listener]
}

/// What the speaker says with its action; nothing with an action it does not have.
pub(super) fn message(actions: &[u8]) -> Option<u8> {
    Some(actions[SPEAKER]).filter(|&word| usize::from(word) < N_MESSAGES)
}

/// The speaker observes the colour of the goal; the listener its own velocity, where each landmark lies
/// from it, and the speaker's last message, one-hot.
pub(super) fn observe(world: &World, agent: usize, out: &mut [f32]) {
    out.fill(0.0);
    if agent == SPEAKER {
        out[..N_LANDMARKS].fill(0.15);
        out[world.goal] = 0.65;
    } else {
        let here = world.positions[LISTENER];
        let [first, second, third] = [0, 1, 2].map(|landmark| world.landmarks[landmark] - here);
        write(&[world.velocities[LISTENER], first, second, third], out);
        if let Some(word) = world.message {
            out[PADDED_OBS_DIM - N_MESSAGES + usize::from(word)] = 1.0;
        }
    }
}

/// Both agents pay the listener's squared distance to the goal.
pub(super) fn reward(world: &mut World) {
    let goal = world.landmarks[world.goal];
    world.rewards.fill(-world.positions[LISTENER].distance_squared(goal));
}
