//! What links do: losses at each step, losses in a row, losses over the distance, and delays.

use super::{Figure, Panel, Point, Series};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::environment::{End, Outcome, Task};
use crate::link::{Address, Context, Fates, LinkSpec};

/// Episodes that are looked at.
const EPISODES: u64 = 1000;

/// The most losses in a row that are counted.
const IN_A_ROW: usize = 12;

/// The width of a class of distances, m, and their number.
const CLASS: f64 = 0.25;
const CLASSES: usize = 12;

/// How many of how many.
#[derive(Clone, Copy, Default)]
struct Share {
    count: u32,
    of: u32,
}

/// What came of what was sent.
struct Realised {
    lost_at: Vec<Share>,
    /// At index k, of all pieces of k + 1 steps of an episode, those in which a link lost everything.
    lost_in_a_row: [Share; IN_A_ROW],
    /// By distance of sender and receiver, where the task has places.
    lost_over: [Share; CLASSES],
    /// At index k, of what is delivered, that which arrives after k ticks.
    delayed: Vec<Share>,
}

/// What these links do to a team whose agents choose uniformly among their actions, with nothing shared at the start.
///
/// # Errors
/// Whatever the links or the environment fail with.
pub fn links(spec: &LinkSpec, task: &Task) -> Result<Figure> {
    let Realised { lost_at, lost_in_a_row, lost_over, delayed } = Realised::of(spec, task)?;
    let all = lost_at
        .iter()
        .fold(Share::default(), |all, share| Share { count: all.count + share.count, of: all.of + share.of });
    let mean = all.value().unwrap_or_default();
    let line = |name: &str, points: Vec<(f64, f64)>| Series {
        name: name.to_owned(),
        points: points.into_iter().map(|(x, y)| Point { x, y, band: None }).collect(),
    };
    let found = |shares: &[Share], x: &dyn Fn(usize) -> f64| {
        let points = shares.iter().enumerate().filter_map(|(at, share)| Some((x(at), share.value()?)));
        line("these links", points.collect())
    };
    let panel = |title: &str, x_label: &str, series: Vec<Series>| Panel {
        title: title.to_owned(),
        x_label: x_label.to_owned(),
        y_label: "share".to_owned(),
        series,
        ..Panel::default()
    };
    let independent = (0..IN_A_ROW).map(|at| (1.0 + at as f64, mean.powi(1 + at as i32))).collect();
    let in_a_row =
        vec![found(&lost_in_a_row, &|at| 1.0 + at as f64), line("independent losses, as many", independent)];
    let mut panels = vec![
        panel("lost at each step", "step", vec![found(&lost_at, &|at| at as f64)]),
        panel("so many steps in a row lost", "steps", in_a_row),
    ];
    if lost_over.iter().any(|share| share.of > 0) {
        let middle = |at: usize| CLASS * (at as f64 + 0.5);
        panels.push(panel("lost over the distance", "m", vec![found(&lost_over, &middle)]));
    }
    if delayed.len() > 1 {
        panels.push(panel("delay of what is delivered", "ticks", vec![found(&delayed, &|at| at as f64)]));
    }
    let title = format!("{spec}: {:.1} % lost, {} episodes of {}", 100.0 * mean, EPISODES, task.id());
    Ok(Figure { title, panels })
}

impl Realised {
    fn of(spec: &LinkSpec, task: &Task) -> Result<Realised> {
        const SEED: u64 = 0;
        let (about, mut world) = (task.spec(), task.environment(1));
        let (agents, width) = (about.n_agents(), about.action_width());
        let bytes = about.padded_obs_dim() * size_of::<f32>();
        let mut links = spec.build().sharing_at_start(false);
        let mut realised = Realised {
            lost_at: vec![Share::default(); about.episode_steps],
            lost_in_a_row: Default::default(),
            lost_over: Default::default(),
            delayed: vec![Share::default(); usize::from(links.longest_delay()) + 1],
        };
        let (mut fates, mut outcome) = (Fates::new(agents), Outcome::of(1, agents));
        let mut actions = vec![0; agents * width];
        for episode in 0..EPISODES {
            world.reset(0, SEED, episode)?;
            links.begin(0, episode);
            // For how many steps each link has lost.
            let mut lost = vec![0; agents * agents];
            for step in 0..about.episode_steps {
                let address = Address { seed: SEED, position: 0, episode, step: step as u64 };
                let positions = Some(world.positions(0)).filter(|places| !places.is_empty());
                links.deliveries(&Context { address, world: 0, bytes, positions }, &mut fates)?;
                let others = |link: &usize| link / agents != link % agents;
                for link in (0..agents * agents).filter(others) {
                    let (receiver, sender) = (link / agents, link % agents);
                    let distance = positions.map(|places| places[receiver].distance(places[sender]));
                    lost[link] = realised.count(step, lost[link], fates.delay(receiver, sender), distance);
                }
                let mut draws = Draws::new(SEED, Purpose::Action, episode, step as u64);
                for (agent, action) in actions.chunks_exact_mut(width).enumerate() {
                    about.agents[agent].actions.draw(draws.at(agent, 0), action);
                }
                world.step(&actions, &[true], &mut outcome)?;
                if outcome.ends[0] != End::Open {
                    break;
                }
            }
        }
        Ok(realised)
    }

    /// Counts an observation that is sent over a link that has lost at so many steps before. Returns at how many it has
    /// now.
    fn count(&mut self, step: usize, before: usize, fate: Option<u8>, distance: Option<f64>) -> usize {
        let lost = if fate.is_none() { before + 1 } else { 0 };
        self.lost_at[step].add(fate.is_none());
        for (at, share) in self.lost_in_a_row.iter_mut().enumerate().take(step + 1) {
            share.add(lost > at);
        }
        let class = distance.map(|distance| (distance / CLASS) as usize);
        if let Some(share) = class.and_then(|class| self.lost_over.get_mut(class)) {
            share.add(fate.is_none());
        }
        if let Some(ticks) = fate {
            self.delayed.iter_mut().enumerate().for_each(|(at, share)| share.add(at == usize::from(ticks)));
        }
        lost
    }
}

impl Share {
    fn add(&mut self, counts: bool) {
        self.count += u32::from(counts);
        self.of += 1;
    }

    fn value(self) -> Option<f64> {
        (self.of > 0).then(|| f64::from(self.count) / f64::from(self.of))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_show_what_links_do() {
        let task = Task::parse("hear-see").unwrap();
        let figure = links(&LinkSpec::parse("jam(3, 5) + delay(2)", 2).unwrap(), &task).unwrap();
        assert_eq!(figure.title, "jam(3, 5) + delay(2, 0): 8.0 % lost, 1000 episodes of hear-see");
        let at =
            |panel: usize, series: usize, point: usize| figure.panels[panel].series[series].points[point].y;
        assert_eq!([at(0, 0, 2), at(0, 0, 3), at(0, 0, 5)], [0.0, 1.0, 0.0]);
        // One of 24 pairs of steps is lost, and none of three.
        assert_eq!([at(1, 0, 1), at(1, 0, 2)], [1.0 / 24.0, 0.0]);
        assert!((at(1, 1, 1) - 0.08 * 0.08).abs() < 1e-12);
        assert_eq!([at(3, 0, 0), at(3, 0, 2)], [0.0, 1.0]);
    }
}
