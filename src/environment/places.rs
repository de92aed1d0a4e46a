//! Where an agent thinks the others are, as its estimate of the joint observation tells it.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::{About, AgentSpec, Axis, Spec, Unit, Value};

/// The dims of a joint observation that say where each agent is.
///
/// An agent's place may stand in its own observation, in a teammate's, or one axis in either. A dim counts if it is a
/// place of an agent whose rate of change is that agent's velocity in the same observation. Nothing else is sure to be
/// a place on the plane: what is seen from an agent falls as the agent moves towards it, and what has no rate may be
/// seen from anywhere.
///
/// Of the built-in tasks only speaker-listener does not tell: nobody observes where the listener is on the plane, nor
/// anything of the speaker.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Places {
    /// Agent by agent, along x and y.
    agents: Vec<[Vec<Told>; 2]>,
}

/// A dim that is a coordinate of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Told {
    /// Whose observation it is in.
    observer: usize,
    /// Where in the joint observation.
    dim: usize,
}

/// Where one agent thinks another is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Ghost {
    /// The other.
    pub(crate) agent: usize,
    /// Where, m.
    pub(crate) place: DVec2,
    /// Whose observations its coordinates are in, x and y.
    pub(crate) observers: [usize; 2],
    /// Whether a coordinate was imputed. Otherwise the agent knows it: it observes it itself, or was told just now.
    pub(crate) imputed: bool,
}

impl Places {
    /// What an environment says of itself.
    pub(crate) fn of(spec: &Spec) -> Places {
        Places::among(&spec.agents, spec.unique_dim())
    }

    /// What is said of the observations of a team. The first `unique` values of each are its part of the joint observation;
    /// places in what follows are not found.
    pub(crate) fn among(observers: &[AgentSpec], unique: usize) -> Places {
        let mut agents = vec![<[Vec<Told>; 2]>::default(); observers.len()];
        for (observer, agent) in observers.iter().enumerate() {
            for (dim, value) in agent.observation.iter().take(unique).enumerate() {
                let Some((about, axis)) = place_of(value, &agent.observation) else { continue };
                if let Some(told) = agents.get_mut(about) {
                    told[axis as usize].push(Told { observer, dim: observer * unique + dim });
                }
            }
        }
        Places { agents }
    }

    /// Whether both coordinates of an agent are told.
    #[cfg(any(feature = "view", test))]
    pub(crate) fn tell(&self, agent: usize) -> bool {
        self.agents[agent].iter().all(|told| !told.is_empty())
    }

    /// The dims that say where each agent is along x and y, of those of whom both are told. If several do, the first one counts.
    pub(crate) fn dims(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.agents.iter().filter_map(|[x, y]| Some([x.first()?.dim, y.first()?.dim]))
    }

    /// Where `viewer`, whose estimate of the joint observation this is, thinks the others are. Those whose places are
    /// not told are left out. `has` says whose observations of this very step it has; its own it always has.
    pub(crate) fn ghosts<'a>(
        &'a self,
        viewer: usize,
        estimate: &'a [f32],
        has: impl Fn(usize) -> bool + 'a,
    ) -> impl Iterator<Item = Ghost> + 'a {
        let has = move |told: &Told| told.observer == viewer || has(told.observer);
        let others = (0..self.agents.len()).filter(move |agent| *agent != viewer);
        others.filter_map(move |agent| {
            // What is known goes before what is imputed.
            let best = |told: &[Told]| told.iter().copied().find(&has).or(told.first().copied());
            let [x, y] = self.agents[agent].each_ref().map(|told| best(told));
            let (x, y) = (x?, y?);
            let place = DVec2::new(estimate[x.dim].into(), estimate[y.dim].into());
            let observers = [x.observer, y.observer];
            Some(Ghost { agent, place, observers, imputed: !(has(&x) && has(&y)) })
        })
    }
}

/// Whose place on the plane a value is, and along which axis.
fn place_of(value: &Value, observation: &[Value]) -> Option<(usize, Axis)> {
    let (About::Agent(about), Some(axis), Unit::Metre) = (value.about, value.axis, value.unit) else {
        return None;
    };
    let (rate, sign) = value.rate?;
    let moves_with_it = sign == 1.0 && observation.get(rate) == Some(&Value::velocity(value.about, axis));
    moves_with_it.then_some((about, axis))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;

    fn places(task: &str) -> (Places, Spec) {
        let task = Task::parse(task).unwrap();
        (Places::of(task.spec()), task.spec().clone())
    }

    /// The joint observation of a world just begun, and where everybody is in it.
    fn joint(task: &str) -> (Vec<f32>, Vec<DVec2>) {
        let task = Task::parse(task).unwrap();
        let (spec, mut world) = (task.spec(), task.environment(1));
        world.reset(0, 5, 3).unwrap();
        let mut observations = vec![0.0; spec.n_agents() * spec.padded_obs_dim()];
        world.observe(1, &mut observations).unwrap();
        let mut joint: Vec<f32> = observations
            .chunks_exact(spec.padded_obs_dim())
            .flat_map(|observation| &observation[..spec.unique_dim()])
            .copied()
            .collect();
        joint.extend(&observations[spec.unique_dim()..spec.padded_obs_dim()]);
        (joint, world.positions(0).to_vec())
    }

    #[test]
    fn an_estimate_that_is_right_has_everybody_where_they_are() {
        let tasks = ["hear-see", "spread-xy-2", "spread-xy-4", "spread-blindfold", "simple-spread-3"];
        for task in tasks.into_iter().chain(["simple-spread-continuous-3", "spread-xy-64"]) {
            let ((places, spec), (estimate, truth)) = (places(task), joint(task));
            for viewer in 0..spec.n_agents() {
                let ghosts: Vec<Ghost> = places.ghosts(viewer, &estimate, |_| true).collect();
                assert_eq!(ghosts.len(), spec.n_agents() - 1, "{task}");
                for Ghost { agent, place, imputed, .. } in ghosts {
                    assert!(agent != viewer && places.tell(agent) && !imputed, "{task}");
                    assert!(place.distance(truth[agent]) < 1e-6, "{task}: {place}, not {}", truth[agent]);
                }
            }
        }
    }

    #[test]
    fn hear_see_has_both_places_in_the_observation_of_one() {
        let ((places, _), (estimate, _)) = (places("hear-see"), joint("hear-see"));
        let ghost = |viewer, has: bool| places.ghosts(viewer, &estimate, move |_| has).next().unwrap();
        assert!(ghost(0, false).imputed, "who hears sees nobody");
        assert!(!ghost(0, true).imputed);
        assert!(!ghost(1, false).imputed, "who sees needs no link");
    }

    #[test]
    fn spread_xy_has_one_axis_in_the_observation_of_either() {
        let ((places, _), (estimate, _)) = (places("spread-xy-4"), joint("spread-xy-4"));
        let imputed = |viewer, of: &'static [usize]| {
            let ghosts = places.ghosts(viewer, &estimate, move |sender| of.contains(&sender));
            ghosts.filter(|ghost| ghost.imputed).map(|ghost| ghost.agent).collect::<Vec<_>>()
        };
        assert_eq!(imputed(0, &[]), [1, 2, 3], "it sees x of agent 1, but not y");
        assert_eq!(imputed(0, &[1]), [2, 3]);
        assert_eq!(imputed(0, &[1, 2]), [2, 3]);
        assert_eq!(imputed(0, &[1, 2, 3]), [0; 0]);
    }

    #[test]
    fn what_is_seen_from_elsewhere_is_no_place() {
        // In simple-spread an agent sees the others from where it is. Only what they say of themselves are places.
        let ((places, spec), (mut estimate, _)) = (places("simple-spread-3"), joint("simple-spread-3"));
        estimate[spec.unique_dim() + 2] = 7.0;
        let ghost = places.ghosts(0, &estimate, |_| false).next().unwrap();
        assert_eq!((ghost.agent, ghost.place.x, ghost.imputed), (1, 7.0, true));
    }

    #[test]
    fn speaker_listener_does_not_tell() {
        let ((places, _), (estimate, _)) = (places("speaker-listener"), joint("speaker-listener"));
        assert!(!places.tell(0) && !places.tell(1));
        assert_eq!(places.ghosts(0, &estimate, |_| true).count(), 0);
    }

    #[test]
    fn nonsense_in_a_description_is_no_place() {
        let (_, mut spec) = places("spread-blindfold");
        spec.agents[0].observation[2].rate = Some((99, 1.0));
        spec.agents[1].observation[2].about = About::Agent(99);
        let places = Places::of(&spec);
        assert_eq!([0, 1, 2].map(|agent| places.tell(agent)), [false, false, true]);
    }
}
