//! Fitting dynamics to episodes of random play.

use glam::DVec2;

use super::least::{Equations, median};
use super::{Bodies, Contact, Dynamics};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::environment::{End, Environment, Outcome, Spec, Task};
use crate::{failed, usage};

/// Dynamics, and how well they fit what was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The dynamics.
    pub dynamics: Dynamics,
    /// The median error of a velocity after a step, m/s. Contacts count as errors here.
    pub velocity_error: f64,
    /// The median error of a place after a step, m.
    pub place_error: f64,
    /// How often two agents were seen to touch, and no third.
    pub contacts: usize,
}

/// Fewer contacts than this say nothing about them.
const FEWEST_CONTACTS: usize = 20;

/// Fits the dynamics of a task to so many episodes, the first ones of `seed`, in which agents act at random and
/// everything is seen. By least absolute deviations: steps in which agents touch do not disturb the rest. `go_on` is asked
/// again and again; its error ends the fit.
///
/// # Errors
/// `Usage` if the task does not say which values are velocities, or has no discrete actions; `Failed` if velocities do
/// not follow such a law; whatever the environment or `go_on` fails with.
pub fn fit(task: &Task, seed: u64, episodes: u64, go_on: impl Fn() -> Result<()>) -> Result<Fitted> {
    let spec = task.spec();
    let bodies = Bodies::of(spec)?;
    if (0..spec.n_agents()).any(|agent| spec.available_actions(agent) == 0) {
        return Err(usage!("dynamics are fitted to discrete actions; {} has others", spec.id));
    }
    let steps = play(task, seed, episodes, &go_on)?;
    let pushes = Pushes::of(spec);
    let velocities = pushes.equations(&bodies, &steps);
    let motion = velocities.solve(&go_on)?;
    let velocity_error = velocities.median_error(&motion);
    let mut still = vec![0.0; motion.len()];
    still[0] = 1.0;
    // What motors and wind do by chance is no fault of the law: half of a normal error is below this share of its deviation.
    let largest_push = motion[1..].iter().fold(0.0, |largest: f64, push| largest.max(push.abs()));
    let by_chance = 0.6745 * task.chance() * largest_push;
    if velocity_error - by_chance > 0.5 * velocities.median_error(&still) {
        return Err(failed!(
            "velocities in {} do not follow a law of the form v' = keep v + push: half of the errors are above \
             {velocity_error:.3} m/s",
            spec.id
        ));
    }
    let places = place_equations(&bodies, &steps);
    let shares = places.solve(&go_on)?;
    let mut dynamics = Dynamics {
        keep: rounded(motion[0]),
        pushes: pushes.of_solution(&motion),
        before: rounded(shares[0]),
        after: rounded(shares[1]),
        contact: None,
    };
    let certain = (10.0 * velocity_error).max(1e-3);
    let touches = touches(&dynamics, &bodies, &steps, certain);
    dynamics.contact = contact(&touches, certain, &go_on)?;
    let place_error = places.median_error(&shares);
    Ok(Fitted { dynamics, velocity_error, place_error, contacts: touches.len() })
}

/// Without digits that are far below what `f32` observations can say, and without negative zeros.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9 + 0.0
}

/// One step of an episode: what was the case before it, what everybody did, and what was the case then.
struct Step {
    before: Vec<f32>,
    actions: Vec<u32>,
    after: Vec<f32>,
}

fn play(task: &Task, seed: u64, episodes: u64, go_on: impl Fn() -> Result<()>) -> Result<Vec<Step>> {
    let (spec, mut world) = (task.spec(), task.environment(1));
    let (agents, unique, padded) = (spec.n_agents(), spec.unique_dim(), spec.padded_obs_dim());
    let mut outcome = Outcome::of(1, agents);
    let mut steps = Vec::new();
    let mut seen = vec![0.0; agents * padded];
    for episode in 0..episodes {
        go_on()?;
        world.reset(0, seed, episode)?;
        for step in 0..spec.episode_steps as u64 {
            let mut joint = |world: &mut dyn Environment| -> Result<Vec<f32>> {
                world.observe(1, &mut seen)?;
                Ok(seen.chunks_exact(padded).flat_map(|seen| seen[..unique].to_vec()).collect())
            };
            let before = joint(&mut *world)?;
            let mut draws = Draws::new(seed, Purpose::Action, episode, step);
            let mut actions = vec![0; agents];
            for (agent, action) in actions.iter_mut().enumerate() {
                spec.agents[agent].actions.draw(draws.at(agent, 0), std::slice::from_mut(action));
            }
            world.step(&actions, &[true], &mut outcome)?;
            steps.push(Step { before, actions, after: joint(&mut *world)? });
            if outcome.ends[0] != End::Open {
                break;
            }
        }
    }
    Ok(steps)
}

/// Where the unknowns of velocities are: `keep` first, then a push along each axis for each action of each agent.
struct Pushes {
    /// The first action of each agent among all.
    first: Vec<usize>,
    n_actions: usize,
}

impl Pushes {
    fn of(spec: &Spec) -> Pushes {
        let mut n_actions = 0;
        let first = (0..spec.n_agents()).map(|agent| {
            n_actions += spec.available_actions(agent);
            n_actions - spec.available_actions(agent)
        });
        Pushes { first: first.collect(), n_actions }
    }

    fn at(&self, agent: usize, action: u32, axis: usize) -> usize {
        1 + 2 * (self.first[agent] + action as usize) + axis
    }

    fn equations(&self, bodies: &Bodies, steps: &[Step]) -> Equations {
        let mut equations = Equations::of(1 + 2 * self.n_actions);
        for Step { before, actions, after } in steps {
            for (agent, &action) in actions.iter().enumerate() {
                for (dim, axis) in bodies.velocities(agent) {
                    let push = self.at(agent, action, axis as usize);
                    equations.push(vec![(0, before[dim].into()), (push, 1.0)], after[dim].into());
                }
            }
        }
        equations
    }

    fn of_solution(&self, solution: &[f64]) -> Vec<Vec<[f64; 2]>> {
        let mut pushes = solution[1..].chunks_exact(2).map(|push| [rounded(push[0]), rounded(push[1])]);
        let ends = self.first[1..].iter().chain([&self.n_actions]);
        let agents = self.first.iter().zip(ends);
        agents.map(|(first, end)| pushes.by_ref().take(end - first).collect()).collect()
    }
}

fn place_equations(bodies: &Bodies, steps: &[Step]) -> Equations {
    let mut equations = Equations::of(2);
    for Step { before, after, .. } in steps {
        for place in (0..bodies.n_agents()).flat_map(|agent| bodies.places(agent)) {
            let [old, new] =
                [before, after].map(|joint| f64::from(place.sign) * f64::from(joint[place.rate]));
            let moved = f64::from(after[place.dim]) - f64::from(before[place.dim]);
            equations.push(vec![(0, old), (1, new)], moved);
        }
    }
    equations
}

/// How far two agents were apart that pushed each other while nobody else was pushed, and how hard. What adds less than
/// `certain` to a velocity may be chance.
fn touches(dynamics: &Dynamics, bodies: &Bodies, steps: &[Step], certain: f64) -> Vec<(f64, f64)> {
    let mut touches = Vec::new();
    for Step { before, actions, after } in steps {
        let mut pushed = (0..bodies.n_agents()).filter_map(|agent| {
            let mut free = before.clone();
            dynamics.advance(bodies, agent, dynamics.push(agent, actions[agent] as usize), before, &mut free);
            let mut extra = DVec2::ZERO;
            for (dim, axis) in bodies.velocities(agent) {
                extra[axis as usize] = f64::from(after[dim]) - f64::from(free[dim]);
            }
            (extra.length() > certain).then_some((agent, extra))
        });
        let (Some((a, push)), Some((b, back)), None) = (pushed.next(), pushed.next(), pushed.next()) else {
            continue;
        };
        let (Some(first), Some(second)) = (bodies.spot(a, before), bodies.spot(b, before)) else { continue };
        let apart = first - second;
        if (push + back).length() < certain && apart.length() > 0.0 {
            touches.push((apart.length(), push.dot(apart.normalize())));
        }
    }
    touches
}

/// The line through what was seen: how hard agents push each other by how far they are apart. None if that is too little,
/// or no line, or if pushes below `certain` are missing that the line would need.
fn contact(touches: &[(f64, f64)], certain: f64, go_on: impl Fn() -> Result<()>) -> Result<Option<Contact>> {
    let mut line = Equations::of(2);
    touches.iter().for_each(|&(apart, push)| line.push(vec![(0, 1.0), (1, -apart)], push));
    let solution = line.solve(go_on)?;
    let [touching, stiffness] = solution[..] else { return Ok(None) };
    let typical = median(touches.iter().map(|(_, push)| push.abs()).collect());
    let is_line = stiffness > 0.0 && line.median_error(&solution) < 0.05 * typical;
    let is_whole = certain < 0.25 * typical;
    let contact = Contact { stiffness: rounded(stiffness), distance: rounded(touching / stiffness) };
    let is_certain = line.len() >= FEWEST_CONTACTS && is_line && is_whole && contact.distance > 0.0;
    Ok(is_certain.then_some(contact))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::PhysicsSpec;

    #[test]
    fn a_fit_ends_when_it_may_not_go_on() {
        let task = Task::parse("hear-see").unwrap();
        // Before it plays, while it plays, and while it solves equations.
        for asked in [0u32, 10, 30] {
            let left = std::cell::Cell::new(asked);
            let go_on = || match left.replace(left.get().saturating_sub(1)) {
                0 => Err(failed!("enough")),
                _ => Ok(()),
            };
            assert_eq!(fit(&task, 0, 20, go_on).unwrap_err().to_string(), "enough", "{asked}");
        }
    }

    #[test]
    fn the_physics_of_the_paper_is_recovered_from_play() {
        for (name, distance) in [
            ("hear-see", None),
            ("spread-xy-2", Some(0.3)),
            ("spread-xy-4", Some(0.2)),
            ("spread-blindfold", Some(0.3)),
        ] {
            let task = Task::parse(name).unwrap();
            let Fitted { dynamics, velocity_error, place_error, contacts } =
                fit(&task, 0, 100, || Ok(())).unwrap();
            assert!(velocity_error < 1e-6 && place_error < 1e-6, "{name}: {velocity_error} {place_error}");
            assert!((dynamics.keep - 0.75).abs() < 1e-5, "{name}: {dynamics:?}");
            assert!(
                dynamics.before.abs() < 1e-5 && (dynamics.after - 0.1).abs() < 1e-5,
                "{name}: {dynamics:?}"
            );
            let pushes = [[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]];
            for (fitted, true_one) in dynamics.pushes.concat().iter().zip(pushes.iter().cycle()) {
                let off = fitted.iter().zip(true_one).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < 1e-5, "{name}: {dynamics:?}");
            }
            match (dynamics.contact, distance) {
                (Some(contact), Some(distance)) => {
                    assert!((contact.distance - distance).abs() < 1e-3, "{name}: {contact:?}");
                    assert!((contact.stiffness - 10.0).abs() < 0.1, "{name}: {contact:?}");
                }
                (contact, expected) => assert!(contact.is_none() && expected.is_none(), "{name}: {contacts}"),
            }
        }
    }

    #[test]
    fn other_physics_is_recovered_from_noisy_play() {
        // Strong noise hides contacts: none are better than wrong ones.
        for (name, distance, motor_noise) in [("spread-xy-2", None, 0.5), ("spread-xy-4", Some(0.2), 0.02)] {
            let physics = PhysicsSpec { motor_noise, damping: 0.3, mass: 1.25, wind: 0.0 };
            let task = Task::parse(name).unwrap().with_physics(physics).unwrap();
            let Fitted { dynamics, velocity_error, place_error, .. } =
                fit(&task, 0, 1000, || Ok(())).unwrap();
            // Half of the errors of a normal distribution are below 0.6745 of its standard deviation.
            let expected = 0.6745 * 0.4 * motor_noise;
            assert!((velocity_error / expected - 1.0).abs() < 0.05, "{name}: {velocity_error}");
            assert!(place_error < 1e-6 && (dynamics.keep - 0.7).abs() < 0.01, "{name}: {dynamics:?}");
            let pushes = [[0.0, 0.0], [0.4, 0.0], [-0.4, 0.0], [0.0, 0.4], [0.0, -0.4]];
            for (fitted, true_one) in dynamics.pushes.concat().iter().zip(pushes.iter().cycle()) {
                let off = fitted.iter().zip(true_one).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                // The standard error of the median of 5000 normal errors is 0.018 of their deviation.
                assert!(off < 5.0 * 0.018 * 0.4 * motor_noise, "{name}: {dynamics:?}");
            }
            match (dynamics.contact, distance) {
                (Some(contact), Some(distance)) => {
                    assert!((contact.distance / distance - 1.0).abs() < 0.01, "{name}: {contact:?}");
                    assert!((contact.stiffness / 8.0 - 1.0).abs() < 0.03, "{name}: {contact:?}");
                }
                (contact, expected) => {
                    assert!(contact.is_none() && expected.is_none(), "{name}: {contact:?}")
                }
            }
        }
    }

    /// There places move by the old velocity, and agents see each other only from where they are themselves.
    #[test]
    fn the_other_order_of_integration_is_recognised() {
        let Fitted { dynamics, .. } =
            fit(&Task::parse("simple-spread-3").unwrap(), 0, 100, || Ok(())).unwrap();
        assert!((dynamics.keep - 0.75).abs() < 1e-5, "{dynamics:?}");
        assert!((dynamics.before - 0.1).abs() < 1e-5 && dynamics.after.abs() < 1e-5, "{dynamics:?}");
    }

    #[test]
    fn a_body_that_moves_alone_goes_where_the_dynamics_say() {
        let task = Task::parse("hear-see").unwrap();
        let (dynamics, bodies) =
            (fit(&task, 0, 20, || Ok(())).unwrap().dynamics, Bodies::of(task.spec()).unwrap());
        // Other episodes than those of the fit.
        for episode in play(&task, 7, 3, || Ok(())).unwrap().chunks_exact(25) {
            let mut joint = episode[0].before.clone();
            for step in episode {
                let before = joint.clone();
                for agent in 0..2 {
                    let push = dynamics.push(agent, step.actions[agent] as usize);
                    dynamics.advance(&bodies, agent, push, &before, &mut joint);
                }
            }
            let off = joint.iter().zip(&episode[24].after).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-4, "{off}");
        }
    }

    #[test]
    fn an_environment_that_does_not_label_its_values_is_told_so() {
        let mut spec = Task::parse("hear-see").unwrap().spec().clone();
        spec.agents.iter_mut().flat_map(|agent| &mut agent.observation).for_each(|value| value.axis = None);
        let error = Bodies::of(&spec).unwrap_err().to_string();
        assert!(error.contains("label them in its `Spec`"), "{error}");
    }
}
