//! What a predictor may see of who is near whom.

use super::Dims;
use crate::environment::places::Places;

/// How near agents are to each other, of those whose places stand in the joint observation. Landmarks and targets do not
/// count.
///
/// Bodies push each other when they touch, along the line between them. That follows from their places, but not linearly,
/// and an LSTM takes long to find it. From what is shown here it follows almost linearly, if the distance at which they
/// touch is between the smallest reach and the largest.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Proximity {
    /// The dims that say where an agent is along x and y.
    places: Vec<[usize; 2]>,
}

/// How far away others are that count as near, m.
const REACHES: [f32; 4] = [0.1, 0.2, 0.3, 0.4];

impl Proximity {
    /// In a team; `None` if the places of two agents or more are not told.
    pub fn of(dims: &Dims) -> Option<Proximity> {
        let places: Vec<_> = Places::among(&dims.agents, dims.predicted / dims.n_agents).dims().collect();
        (places.len() > 1).then_some(Proximity { places })
    }

    /// How many values it has.
    pub fn width(&self) -> usize {
        2 * REACHES.len() * self.places.len()
    }

    /// Appends, agent by agent and reach by reach along x and y, the sum over the others within reach of `1 - distance /
    /// reach` times the direction away from them.
    pub fn show(&self, joint: &[f32], seen: &mut Vec<f32>) {
        for (agent, own) in self.places.iter().enumerate() {
            let mut sums = [[0.0; 2]; REACHES.len()];
            for (_, other) in self.places.iter().enumerate().filter(|(other, _)| *other != agent) {
                let [x, y] = [0, 1].map(|axis| joint[own[axis]] - joint[other[axis]]);
                let distance = (x * x + y * y).sqrt();
                // Of agents in one place nobody can say on which side they are.
                if distance == 0.0 {
                    continue;
                }
                for (sum, reach) in sums.iter_mut().zip(REACHES) {
                    let near = (1.0 - distance / reach).max(0.0) / distance;
                    *sum = [sum[0] + near * x, sum[1] + near * y];
                }
            }
            seen.extend(sums.as_flattened());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::dims;
    use crate::environment::Task;

    fn of(task: &str) -> Option<Proximity> {
        Proximity::of(&dims(Task::parse(task).unwrap().spec()))
    }

    fn seen(proximity: &Proximity, joint: &[f32]) -> Vec<f32> {
        let mut seen = Vec::new();
        proximity.show(joint, &mut seen);
        assert_eq!(seen.len(), proximity.width());
        seen
    }

    /// The joint observation of spread-xy-2 with its agents in these places.
    fn joint(proximity: &Proximity, places: [[f32; 2]; 2]) -> Vec<f32> {
        let mut joint = vec![0.5; 12];
        for (dims, place) in proximity.places.iter().zip(places) {
            dims.iter().zip(place).for_each(|(dim, value)| joint[*dim] = value);
        }
        joint
    }

    #[test]
    fn who_is_near_pushes_away_from_itself_and_who_is_not_does_not() {
        let proximity = of("spread-xy-2").unwrap();
        let near = seen(&proximity, &joint(&proximity, [[0.12, 0.5], [0.0, 0.34]]));
        let [of_first, of_second] = near.as_chunks::<8>().0 else { panic!("there are two agents") };
        // They are 0.2 m apart: beyond or at the first two reaches, and halfway to the last one.
        let expected = [0.0, 0.0, 0.0, 0.0, 0.2, 0.8 / 3.0, 0.3, 0.4];
        for (at, expected) in expected.into_iter().enumerate() {
            assert!((of_first[at] - expected).abs() < 1e-5, "{of_first:?}");
            assert!((of_second[at] + expected).abs() < 1e-5, "{of_second:?}");
        }
        let far = seen(&proximity, &joint(&proximity, [[0.9, 0.5], [0.0, 0.34]]));
        assert!(far.iter().all(|value| *value == 0.0), "{far:?}");
        let same = seen(&proximity, &joint(&proximity, [[0.3, 0.3]; 2]));
        assert!(same.iter().all(|value| *value == 0.0), "{same:?}");
    }

    #[test]
    fn of_several_the_sum_counts() {
        let proximity = of("spread-blindfold").unwrap();
        let mut joint = vec![0.0; 18];
        for (dims, x) in proximity.places.iter().zip([0.0, 0.15, -0.25]) {
            joint[dims[0]] = x;
        }
        let seen = seen(&proximity, &joint);
        // By reach along x: the one in the middle is pushed left by who is 0.15 m away, and right by who is 0.25 m away.
        let middle = [0.0, -0.25, -0.5 + 0.5 / 3.0, -0.625 + 0.375];
        let (right, left) = ([0.0, 0.25, 0.5, 0.625], [0.0, 0.0, -0.5 / 3.0, -0.375]);
        for (expected, seen) in [middle, right, left].as_flattened().iter().zip(seen.chunks_exact(2)) {
            assert!((seen[0] - expected).abs() < 1e-6 && seen[1] == 0.0, "{seen:?}, not {expected}");
        }
    }

    #[test]
    fn there_is_something_to_see_where_two_places_are_told() {
        for task in ["hear-see", "spread-xy-4", "predator-prey-3", "scout-3", "rendezvous-3"] {
            assert!(of(task).is_some(), "{task}");
        }
        assert_eq!(of("speaker-listener"), None);
    }
}
