//! Point-mass agents on a plane: how an episode begins and steps, for every family of tasks.

use std::fmt::Debug;

use glam::{DVec2, dvec2};

use super::moment::Moment;
use super::motor::Motors;
use super::wind::Wind;
use super::{Actions, End, Physics, PhysicsSpec, Spec, State, Target, World, Worlds};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::failed;

/// What makes a family of tasks what it is.
pub(super) trait Rules: Clone + Debug + Send + 'static {
    /// Whether one landmark is the goal of all.
    const HAS_GOAL: bool = false;

    /// How bodies move in a team of so many.
    fn physics(n_agents: usize) -> Physics;

    /// The landmark that becomes the goal.
    fn draw_goal(_draws: &mut Draws, _landmarks: usize) -> usize {
        0
    }

    /// Adds what landmarks do to agents to the forces on these, N.
    fn push(_plane: &Plane, _physics: &Physics, _forces: &mut [DVec2]) {}

    /// Moves those who are not of the team on by a step, where there are any.
    fn move_targets(_plane: &mut Plane, _physics: &Physics, _draws: &mut Draws) {}

    /// What is said with these actions, where somebody speaks.
    fn message(_actions: Actions) -> Option<u32> {
        None
    }

    /// Writes what `agent` observes into `out`.
    fn observe(plane: &Plane, agent: usize, out: &mut [f32]);

    /// Writes what each agent earns where it is now.
    fn reward(plane: &Plane, physics: &Physics, rewards: &mut [f64]);
}

/// What is where.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    pub(super) positions: Vec<DVec2>,
    pub(super) velocities: Vec<DVec2>,
    pub(super) landmarks: Vec<DVec2>,
    /// Who moves and is not of the team.
    pub(super) targets: Vec<Target>,
    /// The landmark all go to; 0 where the task has no goal.
    pub(super) goal: usize,
    /// What the speaker said in the last step.
    pub(super) message: Option<u32>,
}

/// One world and the state of its episode.
#[derive(Clone, Debug)]
pub(super) struct PointMass<R> {
    pub(super) plane: Plane,
    physics: Physics,
    moment: Moment,
    motors: Motors,
    wind: Wind,
    forces: Vec<DVec2>,
    rules: std::marker::PhantomData<R>,
}

/// A batch of worlds with these rules.
pub(super) fn worlds<R: Rules>(
    spec: &Spec,
    physics: &PhysicsSpec,
    worlds: usize,
) -> Box<dyn super::Environment> {
    Box::new(Worlds::new(spec.clone(), worlds, |spec| PointMass::<R>::new(spec, physics)))
}

impl<R: Rules> PointMass<R> {
    /// A world before its first episode: everything lies at the origin.
    pub(super) fn new(spec: &Spec, physics: &PhysicsSpec) -> PointMass<R> {
        let n = spec.n_agents();
        let physics = R::physics(n).under(physics);
        PointMass {
            plane: Plane::of(n, spec.landmarks, spec.targets),
            moment: Moment::default(),
            motors: Motors::of(&physics),
            wind: Wind::of(&physics),
            physics,
            forces: vec![DVec2::ZERO; n],
            rules: std::marker::PhantomData,
        }
    }

    fn act(&mut self, actions: Actions) {
        for (agent, force) in self.forces.iter_mut().enumerate() {
            *force = self.physics.action_force(actions.choice(agent));
        }
        self.motors.shake(self.moment, &mut self.forces);
        self.wind.blow(self.moment, &mut self.forces);
        self.plane.message = R::message(actions);
    }

    fn collide(&mut self) {
        self.physics.add_contact_forces(&self.plane.positions, &mut self.forces);
        R::push(&self.plane, &self.physics, &mut self.forces);
    }

    fn integrate(&mut self) {
        self.physics.integrate(&self.forces, &mut self.plane.velocities, &mut self.plane.positions);
        if !self.plane.targets.is_empty() {
            self.move_targets();
        }
        self.moment.pass();
    }

    /// Apart, so that a step without targets stays small.
    #[inline(never)]
    fn move_targets(&mut self) {
        R::move_targets(&mut self.plane, &self.physics, &mut self.moment.draws(Purpose::Turn));
    }
}

impl<R: Rules> World for PointMass<R> {
    /// All at rest, everything uniform in `[-1, 1]^2`. The draws are those of ([`Purpose::Reset`], episode, step 0): the
    /// places, then the goal where one is drawn.
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()> {
        self.moment = Moment::first(seed, episode);
        let mut draws = self.moment.draws(Purpose::Reset);
        self.plane.scatter(&mut draws);
        self.plane.goal = R::draw_goal(&mut draws, self.plane.landmarks.len());
        self.plane.message = None;
        self.wind.begin(self.moment);
        Ok(())
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        R::observe(&self.plane, agent, out);
    }

    /// One step of 0.1 s: agents act, collide and move, and are paid for where they end up.
    ///
    /// An action that does not exist does nothing: a body gets no force and the speaker stays silent.
    #[inline]
    fn step(&mut self, actions: Actions, rewards: &mut [f64]) -> Result<End> {
        self.act(actions);
        self.collide();
        self.integrate();
        R::reward(&self.plane, &self.physics, rewards);
        Ok(End::Open)
    }

    fn state(&self) -> State {
        self.plane.state(R::HAS_GOAL)
    }

    fn set_state(&mut self, state: &State, last_actions: Option<Actions>) -> Result<()> {
        self.plane.place(state, R::HAS_GOAL)?;
        self.plane.message = last_actions.and_then(R::message);
        Ok(())
    }

    fn positions(&self) -> &[DVec2] {
        &self.plane.positions
    }
}

impl Plane {
    /// Everything lies at the origin.
    pub(super) fn of(agents: usize, landmarks: usize, targets: usize) -> Plane {
        Plane {
            positions: vec![DVec2::ZERO; agents],
            velocities: vec![DVec2::ZERO; agents],
            landmarks: vec![DVec2::ZERO; landmarks],
            targets: vec![Target::default(); targets],
            ..Plane::default()
        }
    }

    /// Puts everything at rest in a place of its own, uniform in `[-1, 1]^2`: x and y of each agent, then of
    /// each landmark, then of each target.
    pub(super) fn scatter(&mut self, draws: &mut Draws) {
        self.targets.fill(Target::default());
        let targets = self.targets.iter_mut().map(|target| &mut target.position);
        for place in self.positions.iter_mut().chain(&mut self.landmarks).chain(targets) {
            *place = dvec2(draws.between(-1.0, 1.0), draws.between(-1.0, 1.0));
        }
        self.velocities.fill(DVec2::ZERO);
    }

    /// What is where.
    pub(super) fn state(&self, has_goal: bool) -> State {
        State {
            positions: self.positions.clone(),
            velocities: self.velocities.clone(),
            landmarks: self.landmarks.clone(),
            targets: self.targets.clone(),
            goal: has_goal.then_some(self.goal),
        }
    }

    /// The distances from each landmark to the agent nearest to it, added up, m.
    pub(super) fn uncovered(&self) -> f64 {
        let to_nearest = |landmark: &DVec2| {
            let squared = self.positions.iter().map(|position| position.distance_squared(*landmark));
            squared.fold(f64::INFINITY, f64::min).sqrt()
        };
        self.landmarks.iter().map(to_nearest).sum()
    }

    /// Puts everything where `state` has it.
    pub(super) fn place(&mut self, state: &State, has_goal: bool) -> Result<()> {
        let State { positions, velocities, landmarks, targets, goal } = state;
        let (agents, places) = (self.positions.len(), self.landmarks.len());
        if (positions.len(), velocities.len(), landmarks.len()) != (agents, agents, places) {
            return Err(failed!(
                "this state has {} places, {} velocities and {} landmarks, the world {agents} agents and {places} landmarks",
                positions.len(),
                velocities.len(),
                landmarks.len()
            ));
        }
        if goal.is_some() != has_goal || goal.is_some_and(|goal| goal >= places) {
            return Err(failed!("this world has no goal {goal:?}"));
        }
        if targets.len() != self.targets.len() {
            return Err(failed!(
                "this state has {} targets, and the world {}",
                targets.len(),
                self.targets.len()
            ));
        }
        self.positions.copy_from_slice(positions);
        self.velocities.copy_from_slice(velocities);
        self.landmarks.copy_from_slice(landmarks);
        self.targets.copy_from_slice(targets);
        self.goal = goal.unwrap_or(0);
        Ok(())
    }
}

/// Writes `vectors` as consecutive x, y to the front of `out`.
pub(super) fn write(vectors: &[DVec2], out: &mut [f32]) {
    let (pairs, _) = out.as_chunks_mut();
    for (pair, vector) in pairs.iter_mut().zip(vectors) {
        *pair = vector.as_vec2().to_array();
    }
}
