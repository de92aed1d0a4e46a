//! How far off guesses of places are, by their age: the uncertainty that is drawn around ghosts.

use super::scene::Scene;

/// The errors of the ghosts seen so far, by agent that guesses and by age.
///
/// No imputer says how sure it is, so this is measured: how far guesses that were just as old turned out to be off, as a
/// root mean square. It needs the truth, which a view has and agents have not.
#[derive(Clone, Debug, Default)]
pub(super) struct Doubt {
    /// Squared errors, m^2, and their number, `[agents][age]`.
    errors: Vec<Vec<(f64, u32)>>,
    /// The last tick that was taken in.
    last: Option<u64>,
}

/// Older guesses count as so old.
const OLDEST: usize = 255;

impl Doubt {
    /// Takes in what one tick shows, once.
    pub(super) fn note(&mut self, scene: &Scene) {
        if scene.positions.is_empty() || self.last.replace(scene.tick) == Some(scene.tick) {
            return;
        }
        self.errors.resize(scene.ghosts.len(), Vec::new());
        for (ghosts, errors) in scene.ghosts.iter().zip(&mut self.errors) {
            for ghost in ghosts {
                let age = (ghost.age as usize).min(OLDEST);
                errors.resize(errors.len().max(age + 1), (0.0, 0));
                let (sum, n) = &mut errors[age];
                *sum += ghost.ghost.place.distance_squared(scene.positions[ghost.ghost.agent]);
                *n += 1;
            }
        }
    }

    /// How far an agent's guesses of this age were off, m; `None` if it has made none.
    pub(super) fn of(&self, agent: usize, age: u32) -> Option<f64> {
        let (sum, n) = self.errors.get(agent)?.get((age as usize).min(OLDEST))?;
        (*n > 0).then(|| (sum / f64::from(*n)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, dvec2};

    use super::*;
    use crate::environment::places::Ghost;
    use crate::view::scene::AgedGhost;

    #[test]
    fn doubt_is_the_root_mean_square_of_guesses_as_old() {
        let ghost = |x: f64, age| {
            let ghost = Ghost { agent: 1, place: dvec2(x, 0.0), observers: [1, 1], imputed: true };
            AgedGhost { ghost, age }
        };
        let scene = |tick, ghosts: Vec<AgedGhost>| Scene {
            tick,
            positions: vec![DVec2::ZERO; 2],
            ghosts: vec![ghosts, vec![]],
            ..Scene::default()
        };
        let mut doubt = Doubt::default();
        assert_eq!(doubt.of(0, 1), None);
        doubt.note(&scene(1, vec![ghost(3.0, 1)]));
        doubt.note(&scene(1, vec![ghost(3.0, 1)]));
        doubt.note(&scene(2, vec![ghost(0.5, 2)]));
        doubt.note(&scene(3, vec![ghost(1.0, 1), ghost(7.0, 1000)]));
        assert_eq!(doubt.of(0, 1), Some(5f64.sqrt()), "a tick that is seen twice counts once");
        assert_eq!((doubt.of(0, 2), doubt.of(0, 9999)), (Some(0.5), Some(7.0)));
        assert_eq!((doubt.of(0, 3), doubt.of(1, 1), doubt.of(2, 1)), (None, None, None));
    }
}
