//! Simple-spread as PettingZoo's mpe2 plays it (`simple_spread_v3`): cover all landmarks and do not collide, with
//! everything seen from where one is.
//!
//! It differs from the paper's spread tasks in what is observed, in its rewards, in its actions and in its order of
//! integration. Agents choose among actions, or say how hard they push in each direction.

use glam::{DVec2, dvec2};

use super::family::{AnySize, Family, named};
use super::moment::Moment;
use super::motor::Motors;
use super::point_mass::{Plane, write};
use super::wind::Wind;
use super::{
    About, ActionSpace, Actions, AgentSpec, Axis, Body, End, Environment, PaperSetting, Physics, PhysicsSpec,
    Spec, State, TeamReward, Value, World, Worlds,
};
use crate::base::error::Result;
use crate::base::rng::Purpose;

pub(super) const DISCRETE: Family = Family {
    summary: "PettingZoo's simple_spread_v3: everybody sees everybody; they cover all landmarks without colliding",
    named: &[named(3, "simple-spread-3", &["simple_spread_v3"])],
    any_size: Some(AnySize { prefix: "simple-spread-", group: 1 }),
    spec: |id, n_agents| spec(id, n_agents, ActionSpace::Discrete(5)),
    worlds: worlds::<Choice>,
    chance: 0.0,
};

pub(super) const CONTINUOUS: Family = Family {
    summary: "the same with continuous actions: five values from 0 to 1, how hard to push where",
    named: &[named(3, "simple-spread-continuous-3", &[])],
    any_size: Some(AnySize { prefix: "simple-spread-continuous-", group: 1 }),
    spec: |id, n_agents| spec(id, n_agents, ActionSpace::Box { low: vec![0.0; 5], high: vec![1.0; 5] }),
    worlds: worlds::<Push>,
    chance: 0.0,
};

/// The share of an agent's reward that is its own; the rest is the team's.
const LOCAL_RATIO: f64 = 0.5;

/// What an action pushes with, before it is multiplied by the force of an agent.
trait Thrust: Send + 'static {
    fn of(action: &[u32]) -> DVec2;
}

/// One of nothing, `-x`, `+x`, `-y`, `+y`.
struct Choice;

/// How hard to do each of these.
struct Push;

impl Thrust for Choice {
    fn of(action: &[u32]) -> DVec2 {
        const DIRECTIONS: [DVec2; 5] = [DVec2::ZERO, DVec2::NEG_X, DVec2::X, DVec2::NEG_Y, DVec2::Y];
        DIRECTIONS.get(action[0] as usize).copied().unwrap_or(DVec2::ZERO)
    }
}

impl Thrust for Push {
    fn of(action: &[u32]) -> DVec2 {
        let push = |at: usize| f32::from_bits(action[at]);
        // The difference is one of f32, as in the reference.
        dvec2((push(2) - push(1)).into(), (push(4) - push(3)).into())
    }
}

/// Own velocity and place, then the landmarks, the others and what they say, seen from here. Nobody says anything.
fn spec(id: &str, n_agents: usize, actions: ActionSpace) -> Spec {
    let observation = |agent: usize| {
        let own = About::Agent(agent);
        let [vx, vy] = Axis::BOTH.map(|axis| Value::velocity(own, axis));
        let moving = |sign| Axis::BOTH.map(|axis| Value::moving(own, axis, axis as usize, sign));
        let others = (0..n_agents).filter(move |other| *other != agent);
        let mut values = vec![vx, vy];
        values.extend(moving(1.0));
        (0..n_agents).for_each(|_| values.extend(moving(-1.0)));
        values
            .extend(others.flat_map(|other| Axis::BOTH.map(|axis| Value::place(About::Agent(other), axis))));
        values.extend(vec![Value::word(About::Message); 2 * (n_agents - 1)]);
        values
    };
    let agent = |agent| AgentSpec {
        name: format!("agent_{agent}"),
        observation: observation(agent),
        actions: actions.clone(),
    };
    Spec {
        id: id.to_owned(),
        agents: (0..n_agents).map(agent).collect(),
        unique: 6 * n_agents,
        common: Vec::new(),
        landmarks: n_agents,
        targets: 0,
        episode_steps: 25,
        dt: physics(n_agents).dt,
        team_reward: TeamReward::Sum,
        paper: PaperSetting::Two,
        positions: true,
    }
}

fn physics(n_agents: usize) -> Physics {
    Physics::of(vec![Body { collides: true, ..Body::of_size(0.15) }; n_agents])
}

fn worlds<T: Thrust>(spec: &Spec, physics: &PhysicsSpec, worlds: usize) -> Box<dyn Environment> {
    Box::new(Worlds::new(spec.clone(), worlds, |spec| SimpleSpread::<T>::new(spec, physics)))
}

/// One world and the state of its episode.
struct SimpleSpread<T> {
    plane: Plane,
    physics: Physics,
    moment: Moment,
    motors: Motors,
    wind: Wind,
    forces: Vec<DVec2>,
    thrust: std::marker::PhantomData<T>,
}

impl<T: Thrust> SimpleSpread<T> {
    fn new(spec: &Spec, laws: &PhysicsSpec) -> SimpleSpread<T> {
        let n = spec.n_agents();
        let physics = physics(n).under(laws);
        SimpleSpread {
            plane: Plane::of(n, n, 0),
            moment: Moment::default(),
            motors: Motors::of(&physics),
            wind: Wind::of(&physics),
            physics,
            forces: vec![DVec2::ZERO; n],
            thrust: std::marker::PhantomData,
        }
    }
}

impl<T: Thrust> World for SimpleSpread<T> {
    /// All at rest, everything uniform in `[-1, 1]^2`, drawn as in the other tasks.
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()> {
        self.moment = Moment::first(seed, episode);
        self.plane.scatter(&mut self.moment.draws(Purpose::Reset));
        self.wind.begin(self.moment);
        Ok(())
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        let Plane { positions, velocities, landmarks, .. } = &self.plane;
        let here = positions[agent];
        let (own, rest) = out.split_at_mut(4);
        write(&[velocities[agent], here], own);
        let others = positions.iter().enumerate().filter(|(other, _)| *other != agent);
        let seen = landmarks.iter().chain(others.map(|(_, place)| place));
        let (pairs, _) = rest.as_chunks_mut();
        let mut pairs = pairs.iter_mut();
        for (place, pair) in seen.zip(pairs.by_ref()) {
            *pair = (*place - here).as_vec2().to_array();
        }
        pairs.for_each(|silence| *silence = [0.0; 2]);
    }

    /// Bodies move with the velocities they have, and only then are these changed.
    fn step(&mut self, actions: Actions, rewards: &mut [f64]) -> Result<End> {
        let SimpleSpread { plane, physics, moment, motors, wind, forces, .. } = self;
        for (agent, force) in forces.iter_mut().enumerate() {
            *force = T::of(actions.of(agent)) * physics.force;
        }
        motors.shake(*moment, forces);
        wind.blow(*moment, forces);
        moment.pass();
        physics.add_contact_forces(&plane.positions, forces);
        let moving = plane.positions.iter_mut().zip(&mut plane.velocities);
        for ((position, velocity), (force, body)) in moving.zip(forces.iter().zip(&physics.bodies)) {
            *position += *velocity * physics.dt;
            *velocity = *velocity * (1.0 - physics.damping) + *force / body.mass * physics.dt;
        }
        // What the team earns, and 1 less for everybody that one touches.
        rewards.fill(-plane.uncovered() * (1.0 - LOCAL_RATIO));
        physics.touching(&plane.positions, |a, b| {
            rewards[a] -= LOCAL_RATIO;
            rewards[b] -= LOCAL_RATIO;
        });
        Ok(End::Open)
    }

    fn state(&self) -> State {
        self.plane.state(false)
    }

    fn set_state(&mut self, state: &State, _last_actions: Option<Actions>) -> Result<()> {
        self.plane.place(state, false)
    }

    fn positions(&self) -> &[DVec2] {
        &self.plane.positions
    }
}
