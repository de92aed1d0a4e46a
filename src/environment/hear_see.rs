//! Hear-see: one agent is told where the goal is, the other sees where both agents are.

use super::family::{Family, Named, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{About, ActionSpace, AgentSpec, Axis, Body, PaperSetting, Physics, Spec, TeamReward, Value};

pub(super) const FAMILY: Family = Family {
    summary: "one agent knows the goal, the other sees both agents; both go to the goal",
    named: &[Named {
        default_for_its_size: true,
        ..named(N_AGENTS, "hear-see", &["HS", "SimpleBlindDeaf-v0"])
    }],
    any_size: None,
    spec,
    worlds: worlds::<HearSee>,
    chance: 0.0,
};

const N_AGENTS: usize = 2;
const PADDED_OBS_DIM: usize = 8;
const HEARS: usize = 0;

#[derive(Clone, Debug)]
struct HearSee;

/// See [`HearSee::observe`].
fn spec(id: &str, _n_agents: usize) -> Spec {
    let hears = Axis::BOTH.map(|axis| Value::place(About::Landmark, axis)).to_vec();
    let agents = || (0..N_AGENTS).flat_map(|agent| Axis::BOTH.map(|axis| (About::Agent(agent), axis)));
    let places =
        agents().enumerate().map(|(at, (about, axis))| Value::moving(about, axis, 2 * N_AGENTS + at, 1.0));
    let velocities = agents().map(|(about, axis)| Value::velocity(about, axis));
    let agent = |name: &str, observation| AgentSpec {
        name: name.to_owned(),
        observation,
        actions: ActionSpace::Discrete(5),
    };
    Spec {
        id: id.to_owned(),
        agents: vec![agent("hears", hears), agent("sees", places.chain(velocities).collect())],
        unique: PADDED_OBS_DIM,
        common: Vec::new(),
        landmarks: 1,
        targets: 0,
        episode_steps: 25,
        dt: HearSee::physics(N_AGENTS).dt,
        team_reward: TeamReward::SumForEach,
        paper: PaperSetting::One,
        positions: true,
    }
}

impl Rules for HearSee {
    const HAS_GOAL: bool = true;

    fn physics(n_agents: usize) -> Physics {
        Physics::of(vec![Body::of_size(0.075); n_agents])
    }

    /// Agent 0 observes the goal; agent 1 both positions, then both velocities.
    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        if agent == HEARS {
            out.fill(0.0);
            write(&[plane.landmarks[plane.goal]], out);
        } else {
            let (front, back) = out.split_at_mut(2 * N_AGENTS);
            write(&plane.positions, front);
            write(&plane.velocities, back);
        }
    }

    /// Both agents pay the mean squared distance to the goal.
    fn reward(plane: &Plane, _physics: &Physics, rewards: &mut [f64]) {
        let goal = plane.landmarks[plane.goal];
        let squared: f64 = plane.positions.iter().map(|position| position.distance_squared(goal)).sum();
        rewards.fill(-squared / N_AGENTS as f64);
    }
}
