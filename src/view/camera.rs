//! The camera: takes a picture of what is played when somebody waits for one.

use std::time::Duration;

use glam::DVec2;

use super::pictures::Film;
use super::scene::{AgedGhost, Fate, Part, Scene, Totals};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::Spec;
use crate::environment::places::Places;
use crate::supervisor::{Decisions, Ledger, Observer, Stage, Statistics, Tick};

/// Looks at the first world, and keeps the ledger of all of them.
///
/// Whoever looks hands in an empty [`Scene`] and gets it back filled, at the next tick. A tick for which nobody has handed
/// in any costs little: what a picture needs of the past is kept, nothing else, and of that only what is cheap as long as
/// nobody looks. So slow drawing drops pictures, not ticks.
pub(crate) struct Camera<'a, 'b> {
    ledger: &'a mut Ledger<'b>,
    places: Places,
    films: Vec<Film>,
    past: Past,
}

/// What a picture needs of the ticks before.
#[derive(Debug, Default)]
struct Past {
    /// Where agents were, `[steps, agents]`.
    trail: Vec<DVec2>,
    /// Ticks since each agent had each other's observation of that very tick, `[receiver, sender]`.
    silent: Vec<u32>,
    /// Squared errors of what each agent imputed, and the number of values, both fading.
    errors: Vec<(f64, f64)>,
    episode_return: f64,
    returns: Vec<f64>,
}

/// Steps of a trail at most.
pub(super) const TRAIL: usize = 100;

/// Returns of past episodes at most.
pub(super) const RETURNS: usize = 256;

/// What is left of an error after a tick: half of it after 70.
const FADING: f64 = 0.99;

impl<'a, 'b> Camera<'a, 'b> {
    /// A camera for this environment, which keeps this ledger and takes pictures on these films.
    pub(crate) fn new(spec: &Spec, ledger: &'a mut Ledger<'b>, films: Vec<Film>) -> Camera<'a, 'b> {
        let n = spec.n_agents();
        let past = Past { silent: vec![0; n * n], errors: vec![(0.0, 0.0); n], ..Past::default() };
        Camera { ledger, places: Places::of(spec), films, past }
    }

    fn take(&self, stage: &Stage, decisions: &Decisions, scene: &mut Scene) {
        let (tick, past) = (stage.tick(), &self.past);
        let state = stage.environment().state(WORLD);
        (scene.episode, scene.step, scene.tick) = (tick.episode, tick.step, tick.tick);
        scene.positions.clear();
        scene.positions.extend(stage.environment().positions(WORLD));
        scene.trail.clone_from(&past.trail);
        (scene.landmarks, scene.goal) = (state.landmarks, state.goal);
        scene.targets.clear();
        scene.targets.extend(state.targets.iter().map(|target| target.position));
        scene.parts.clear();
        scene.parts.extend((0..tick.agents).map(|agent| part(decisions, agent)));
        scene.fates.clear();
        for receiver in 0..tick.agents {
            let fates = fates(&tick, decisions, receiver);
            scene.fates.extend(fates.enumerate().map(|(sender, fate)| match scene.parts[sender] {
                Part::Absent => Fate::None,
                _ => fate,
            }));
        }
        scene.ghosts.resize_with(tick.agents, Vec::new);
        for (agent, ghosts) in scene.ghosts.iter_mut().enumerate() {
            ghosts.clear();
            if scene.parts[agent] == Part::Decided {
                ghosts.extend(self.ghosts(stage.spec(), &tick, decisions, agent));
            }
        }
        scene.errors.clear();
        scene.errors.extend(past.errors.iter().map(|(sum, n)| (*n >= 1.0).then(|| (sum / n).sqrt())));
        scene.episode_return = past.episode_return;
        scene.returns.clone_from(&past.returns);
        scene.level = stage.level(tick.episode);
        scene.totals = totals(self.ledger.statistics());
    }

    /// Where an agent thinks the others are that it does not know the places of.
    fn ghosts<'c>(
        &'c self,
        spec: &Spec,
        tick: &Tick,
        decisions: &'c Decisions,
        agent: usize,
    ) -> impl Iterator<Item = AgedGhost> + use<'a, 'b, 'c> {
        let (joint, silent) = (spec.joint_dim(), &self.past.silent[agent * tick.agents..][..tick.agents]);
        let estimate = &decisions.estimates[agent * tick.worlds * joint..][..joint];
        let guessed = self.places.ghosts(agent, estimate, move |sender| silent[sender] == 0);
        guessed.filter(|ghost| ghost.imputed).map(move |ghost| {
            let [x, y] = ghost.observers.map(|observer| silent[observer]);
            AgedGhost { ghost, age: x.max(y) }
        })
    }
}

/// The world that is looked at.
const WORLD: usize = 0;

impl Observer for Camera<'_, '_> {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.past.trail.clear();
        self.past.silent.fill(0);
        self.past.episode_return = 0.0;
        self.ledger.begin_episodes(stage)
    }

    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, exchange: Duration) -> Result<()> {
        self.ledger.ticked(stage, decisions, exchange)?;
        if !stage.plays(WORLD) {
            return Ok(());
        }
        self.past.listen(&stage.tick(), decisions);
        if self.films.iter().any(Film::is_watched) {
            self.past.compare(stage.spec(), &stage.tick(), decisions);
        } else {
            self.past.errors.fill((0.0, 0.0));
        }
        for film in &self.films {
            film.take(|scene| self.take(stage, decisions, scene));
        }
        self.past.follow(stage.environment().positions(WORLD));
        Ok(())
    }

    fn stepped(&mut self, stage: &Stage, decisions: &Decisions) -> Result<()> {
        if stage.stepped().next() == Some(WORLD) {
            self.past.episode_return += stage.team_reward(WORLD);
        }
        self.ledger.stepped(stage, decisions)
    }

    fn end_episodes(&mut self, stage: &Stage) -> Result<()> {
        let returns = &mut self.past.returns;
        returns.drain(..(returns.len() + 1).saturating_sub(RETURNS));
        returns.push(self.past.episode_return);
        self.ledger.end_episodes(stage)
    }
}

impl Past {
    fn listen(&mut self, tick: &Tick, decisions: &Decisions) {
        for (agent, silent) in self.silent.chunks_exact_mut(tick.agents).enumerate() {
            let decided = part(decisions, agent) == Part::Decided;
            for (silent, age) in silent.iter_mut().zip(decisions.used(tick, agent, WORLD)) {
                *silent = if decided && *age == 0 { 0 } else { *silent + 1 };
            }
        }
    }

    /// Costs more than all the rest.
    fn compare(&mut self, spec: &Spec, tick: &Tick, decisions: &Decisions) {
        for (agent, (sum, n)) in self.errors.iter_mut().enumerate() {
            (*sum, *n) = (*sum * FADING, *n * FADING);
            if part(decisions, agent) == Part::Decided {
                for squared_error in decisions.imputation_errors(spec, tick, agent, WORLD) {
                    *sum += squared_error;
                    *n += spec.unique_dim() as f64;
                }
            }
        }
    }

    fn follow(&mut self, positions: &[DVec2]) {
        let most = TRAIL * positions.len();
        self.trail.drain(..(self.trail.len() + positions.len()).saturating_sub(most));
        self.trail.extend(positions);
    }
}

fn part(decisions: &Decisions, agent: usize) -> Part {
    match (decisions.absent >> agent & 1, decisions.missing >> agent & 1) {
        (0, 0) => Part::Decided,
        (0, _) => Part::Missed,
        _ => Part::Absent,
    }
}

/// What became of what was sent to one agent, by sender.
fn fates(tick: &Tick, decisions: &Decisions, receiver: usize) -> impl Iterator<Item = Fate> {
    let decided = part(decisions, receiver) == Part::Decided;
    let ages = tick.arriving(receiver, WORLD).iter().zip(decisions.used(tick, receiver, WORLD));
    ages.enumerate().map(move |(sender, ages)| match ages {
        _ if sender == receiver || !decided => Fate::None,
        (_, 0) => Fate::Delivered,
        (&NOT_ARRIVED, _) => Fate::Lost,
        (_, &NOT_ARRIVED) => Fate::Late,
        (_, age) => Fate::Delayed(*age),
    })
}

fn totals(statistics: &Statistics) -> Totals {
    let (missed, due) = statistics.missed_of_due();
    let ticks = statistics.tick_times();
    Totals {
        finished: statistics.finished(),
        return_mean: statistics.return_mean(),
        return_ci95: statistics.return_ci95(),
        delivery_rate: statistics.delivery_rate(),
        late_rate: statistics.late_rate(),
        imputation_rmse: statistics.imputation_rmse(),
        missed,
        absent: statistics.absent(),
        due,
        tick_p50_us: ticks.quantile_us(0.5),
        tick_p99_us: ticks.quantile_us(0.99),
        elapsed_s: statistics.elapsed().as_secs_f64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{AgentSettings, PolicySource};
    use crate::environment::Task;
    use crate::link::{LinkSpec, Links};
    use crate::supervisor::{InProcess, Session};
    use crate::view::pictures::Pictures;

    /// Looks at every so many ticks, and draws nothing.
    struct Eye {
        pictures: Pictures,
        every: u64,
        scenes: Vec<Scene>,
        truth: Vec<Vec<DVec2>>,
    }

    impl Observer for Eye {
        fn ticked(&mut self, stage: &Stage, _: &Decisions, _: Duration) -> Result<()> {
            self.truth.push(stage.environment().positions(WORLD).to_vec());
            Ok(())
        }

        fn stepped(&mut self, stage: &Stage, _: &Decisions) -> Result<()> {
            if let Ok(scene) = self.pictures.taken.try_recv() {
                self.scenes.push(*scene);
            }
            if stage.tick().tick.is_multiple_of(self.every) {
                self.pictures.wanted.try_send(Box::default()).unwrap();
            }
            Ok(())
        }
    }

    /// What is seen of two episodes, at every so many ticks, and the statistics.
    fn see(task: &str, links: Links, every: u64) -> (Eye, Statistics) {
        let task = Task::parse(task).unwrap();
        let policy = PolicySource::Builtin.load(task.spec()).unwrap();
        let longest_delay = links.longest_delay();
        let settings = AgentSettings { longest_delay, ..AgentSettings::of(task.spec()) };
        let mut team = InProcess::new(&settings, &policy).unwrap();
        let mut session = Session::new(task.environment(1), links, 0);
        let (pictures, film) = Pictures::new();
        pictures.wanted.try_send(Box::default()).unwrap();
        let mut eye = Eye { pictures, every, scenes: Vec::new(), truth: Vec::new() };
        let mut ledger = Ledger::default();
        let mut camera = Camera::new(task.spec(), &mut ledger, vec![film]);
        session.play(&mut team, 2, &mut [&mut camera, &mut eye]).unwrap();
        (eye, ledger.into_statistics())
    }

    #[test]
    fn a_picture_is_that_of_the_tick_at_which_it_was_taken() {
        let (eye, statistics) = see("spread-xy-4", Links::level(0.0), 1);
        assert_eq!(eye.scenes.len(), 50);
        for (scene, truth) in eye.scenes.iter().zip(&eye.truth) {
            let step = scene.step as usize;
            assert_eq!((&scene.positions, scene.landmarks.len(), scene.goal), (truth, 4, None));
            assert_eq!(scene.trail.len(), 4 * step, "step {step} of episode {}", scene.episode);
            assert_eq!(scene.trail.last().is_some(), step > 0);
            let lost = scene.fates.iter().filter(|fate| **fate == Fate::Lost).count();
            assert_eq!(lost, if step == 0 { 0 } else { 12 });
            for ghosts in &scene.ghosts {
                // Nothing arrives, but at the start.
                assert_eq!(ghosts.len(), if step == 0 { 0 } else { 3 });
                assert!(ghosts.iter().all(|ghost| ghost.age == scene.step), "{ghosts:?}");
            }
        }
        let [first, second] = [&eye.scenes[24], &eye.scenes[25]];
        assert_eq!((first.episode, first.step, second.episode, second.step), (0, 24, 1, 0));
        assert_eq!(second.returns, [statistics.episodes()[0].episode_return]);
        assert_eq!((second.episode_return, second.totals.finished), (0.0, 1));
        assert!(first.episode_return < 0.0 && first.errors.iter().all(|error| error.unwrap() > 0.0));
    }

    #[test]
    fn nobody_who_looks_seldom_is_waited_for_and_nothing_is_missed_in_the_ledger() {
        let (all, statistics) = see("hear-see", Links::level(0.5), 1);
        let (some, same) = see("hear-see", Links::level(0.5), 7);
        assert_eq!((statistics.ticks(), same.ticks()), (50, 50));
        assert_eq!(statistics.episodes(), same.episodes());
        assert_eq!(some.scenes.len(), 1 + 7);
        for scene in &some.scenes {
            // Times differ.
            let plain = |scene: &Scene| Scene { totals: Totals::default(), ..scene.clone() };
            let same = all.scenes.iter().find(|other| other.tick == scene.tick).unwrap();
            assert_eq!(plain(scene), plain(same));
        }
    }

    #[test]
    fn what_links_postpone_is_told_from_what_they_lose() {
        let (eye, _) = see("hear-see", LinkSpec::parse("delay(2)", 2).unwrap().build(), 1);
        let fates: Vec<Fate> = eye.scenes[..5].iter().map(|scene| scene.fates[1]).collect();
        assert_eq!(fates[0], Fate::Delivered, "at the start");
        assert_eq!(fates[1..], [Fate::Lost, Fate::Lost, Fate::Delayed(2), Fate::Delayed(2)]);
        // Agent 1 sees both agents itself.
        assert!(eye.scenes.iter().all(|scene| scene.ghosts[1].is_empty()));
        assert_eq!(eye.scenes[3].ghosts[0][0].age, 3);
    }
}
