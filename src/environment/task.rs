//! A task: an environment with a name.

use std::fmt;
use std::sync::Arc;

use super::family::{Family, MakeWorlds};
use super::registry::{self, FAMILIES};
use super::{Environment, PhysicsSpec, Spec};
use crate::base::error::Result;
use crate::usage;

/// A task: an environment with a name. It makes as many worlds as are needed.
#[derive(Clone)]
pub struct Task {
    spec: Spec,
    summary: &'static str,
    aliases: &'static [&'static str],
    physics: PhysicsSpec,
    /// See [`Task::chance`]: without what physics says.
    chance: f64,
    worlds: Maker,
}

/// Who makes the worlds.
#[derive(Clone)]
enum Maker {
    /// A family of point-mass tasks, with the physics it is told.
    PointMass(MakeWorlds),
    /// Somebody else.
    Other(Arc<MakeOthers>),
}

/// Makes so many worlds, of whatever kind.
type MakeOthers = dyn Fn(&Spec, usize) -> Box<dyn Environment> + Send + Sync;

impl Task {
    /// The task called `name`, in upper or lower case: an id, a paper name or a reference id, or
    /// `spread-xy-N` (N even) or `spread-blindfold-N` for a team of N.
    ///
    /// # Errors
    /// [`Usage`](crate::base::error::Error::Usage) if there is none, with the names or team sizes there are.
    pub fn parse(name: &str) -> Result<Task> {
        registry::find(name).map(|(family, id, n_agents)| Task::of(family, &id, n_agents))
    }

    /// The tasks with names of their own, smallest team of each family first.
    pub fn all() -> Vec<Task> {
        let named = FAMILIES.iter().flat_map(|family| family.named.iter().map(move |named| (family, named)));
        named.map(|(family, named)| Task::of(family, named.id, named.n_agents)).collect()
    }

    /// A task of one's own: `worlds` makes so many worlds of it.
    pub fn custom(
        spec: Spec,
        worlds: impl Fn(&Spec, usize) -> Box<dyn Environment> + Send + Sync + 'static,
    ) -> Task {
        let (physics, worlds) = (PhysicsSpec::default(), Maker::Other(Arc::new(worlds)));
        Task { spec, summary: "", aliases: &[], physics, chance: 0.0, worlds }
    }

    fn of(family: &Family, id: &str, n_agents: usize) -> Task {
        Task {
            spec: (family.spec)(id, n_agents),
            summary: family.summary,
            aliases: registry::aliases(id),
            physics: PhysicsSpec::default(),
            chance: family.chance,
            worlds: Maker::PointMass(family.worlds),
        }
    }

    /// The same task with this physics.
    ///
    /// # Errors
    /// [`Usage`](crate::base::error::Error::Usage) if it is no task of point masses, and this not the default.
    pub fn with_physics(self, physics: PhysicsSpec) -> Result<Task> {
        if matches!(self.worlds, Maker::Other(_)) && !physics.is_default() {
            return Err(usage!(
                "{} cannot have physics {physics}: it is an environment of its own, and not of point masses",
                self.id()
            ));
        }
        Ok(Task { physics, ..self })
    }

    /// The task for a team of `n` where none is named.
    ///
    /// # Errors
    /// [`Usage`](crate::base::error::Error::Usage) if there is none, with the team sizes that have one.
    pub(crate) fn by_team_size(n: usize) -> Result<Task> {
        Task::parse(registry::default_for(n)?)
    }

    /// What tasks for teams of other sizes are called, such as `spread-xy-N (N even, from 2 to 64)`.
    pub(crate) fn other_sizes() -> String {
        registry::other_sizes()
    }

    /// The one name everything that is written down uses, such as `spread-xy-4`.
    pub fn id(&self) -> &str {
        &self.spec.id
    }

    /// The other names [`Task::parse`] knows it by: paper name and reference id, where it has them.
    pub fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }

    /// What the team does, in one line.
    pub fn summary(&self) -> &'static str {
        self.summary
    }

    /// What it is.
    pub fn spec(&self) -> &Spec {
        &self.spec
    }

    /// Its physics; the default for an environment of its own.
    pub fn physics(&self) -> &PhysicsSpec {
        &self.physics
    }

    /// Standard deviation of the force that pushes an agent along an axis by chance, whatever it does, in units of a full
    /// push.
    pub(crate) fn chance(&self) -> f64 {
        self.chance.hypot(self.physics.motor_noise).hypot(self.physics.wind)
    }

    /// So many worlds of it.
    pub fn environment(&self, worlds: usize) -> Box<dyn Environment> {
        match &self.worlds {
            Maker::PointMass(make) => make(&self.spec, &self.physics, worlds),
            Maker::Other(make) => make(&self.spec, worlds),
        }
    }
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Task").field("spec", &self.spec).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;

    #[test]
    fn shapes_are_those_of_the_reference_environments() {
        // id, agents, landmarks, obs dims, padded, unique, common, joint, predicted
        type Shape<'a> = (&'a str, usize, usize, Vec<usize>, [usize; 5]);
        let expected: [Shape; 8] = [
            ("hear-see", 2, 1, vec![2, 8], [8, 8, 0, 16, 16]),
            ("speaker-listener", 2, 3, vec![3, 11], [11, 11, 0, 22, 22]),
            ("spread-xy-2", 2, 2, vec![8; 2], [8, 4, 4, 12, 8]),
            ("spread-xy-4", 4, 4, vec![12; 4], [12, 4, 8, 24, 16]),
            ("spread-xy-8", 8, 8, vec![20; 8], [20, 4, 16, 48, 32]),
            ("spread-blindfold", 3, 3, vec![10; 3], [10, 4, 6, 18, 12]),
            ("spread-blindfold-6", 6, 6, vec![16; 6], [16, 4, 12, 36, 24]),
            ("spread-blindfold-12", 12, 12, vec![28; 12], [28, 4, 24, 72, 48]),
        ];
        for (task, (id, n_agents, n_landmarks, obs_dims, dims)) in Task::all().iter().zip(expected) {
            let spec = task.spec();
            assert_eq!((task.id(), spec.n_agents(), spec.landmarks), (id, n_agents, n_landmarks));
            assert_eq!((0..n_agents).map(|agent| spec.obs_dim(agent)).collect::<Vec<_>>(), obs_dims, "{id}");
            let found = [
                spec.padded_obs_dim(),
                spec.unique_dim(),
                spec.common_dim(),
                spec.joint_dim(),
                spec.predicted_dim(),
            ];
            assert_eq!(found, dims, "{id}");
            for agent in 0..n_agents {
                let speaker = id == "speaker-listener" && agent == 0;
                assert_eq!(spec.available_actions(agent), if speaker { 3 } else { 5 }, "{id}");
            }
            assert_eq!((spec.n_actions(), spec.action_width(), spec.episode_steps), (5, 1, 25), "{id}");
            assert!(!task.summary().contains('\n'));
        }
    }

    #[test]
    fn physics_is_for_point_masses() {
        let noisy: PhysicsSpec = "motor_noise=0.3".parse().unwrap();
        let own = || {
            let task = Task::parse("hear-see").unwrap();
            Task::custom(task.spec().clone(), move |_, worlds| task.environment(worlds))
        };
        let error = own().with_physics(noisy).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{error:?}");
        assert!(error.to_string().contains("not of point masses"), "{error}");
        assert!(own().with_physics(PhysicsSpec::default()).is_ok());
        let task = Task::parse("hear-see").unwrap().with_physics(noisy).unwrap();
        assert_eq!((task.id(), task.physics()), ("hear-see", &noisy));
    }

    #[test]
    fn a_team_size_has_one_task_or_an_error_that_helps() {
        let expected = [
            (2, "hear-see"),
            (3, "spread-blindfold"),
            (4, "spread-xy-4"),
            (6, "spread-blindfold-6"),
            (8, "spread-xy-8"),
            (12, "spread-blindfold-12"),
        ];
        for (n, id) in expected {
            let task = Task::by_team_size(n).unwrap();
            assert_eq!((task.id(), task.spec().n_agents()), (id, n));
        }
        for (n, says) in
            [(0, "1 to 64"), (1, "spread-blindfold-1`"), (5, "2, 3, 4, 6, 8 and 12"), (65, "1 to 64")]
        {
            let error = Task::by_team_size(n).unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{error:?}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
