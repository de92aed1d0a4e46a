//! A team in training, and one update of it.

use std::time::{Duration, Instant};

use super::actor::{ActorLosses, LearningActor};
use super::batch::{Batch, Trajectories};
use super::critic::{CriticLosses, LearningCritic};
use super::memory::Buffer;
use super::parameters::clip_scale;
use super::predictor::{LearningPredictor, PredictorLosses};
use super::returns::standardise;
use super::settings::{Objective, Settings};
use crate::base::threads::side_by_side;
use crate::nn::{Dims, Sharing};

/// Actors, critics and predictors that learn together.
#[derive(Clone, Debug)]
pub struct Learner {
    /// One per agent, or one.
    pub(crate) actors: Vec<LearningActor>,
    /// One per agent, or one.
    pub(crate) critics: Vec<LearningCritic>,
    /// Those of the settings.
    pub(crate) predictors: Vec<LearningPredictor>,
    settings: Settings,
    joint: usize,
    /// How many actions each agent has: the first ones.
    available: Vec<usize>,
    threads: usize,
    pub(super) updates: u64,
    rewards: Buffer,
    /// Of the critics' last epoch, `[T, E, agents]`.
    advantages: Buffer,
    losses: Losses,
}

/// What an update says of itself; of actors and critics its last epoch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Losses {
    /// What the critics say, over all agents.
    pub critics: CriticLosses,
    /// The norm of the critics' gradient, before it is clipped.
    pub critic_gradient: f64,
    /// What the actors say, over all agents.
    pub actors: ActorLosses,
    /// The norm of the actors' gradient, before it is clipped.
    pub actor_gradient: f64,
    /// What each predictor says; `None` where there was nothing to learn from.
    pub predictors: Vec<Option<PredictorLosses>>,
}

/// Time that networks took, summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Busy {
    /// The actors.
    pub actors: Duration,
    /// The critics.
    pub critics: Duration,
    /// The predictors.
    pub predictors: Duration,
}

/// A network's turn in a round; actors and critics know which epoch they are in.
enum Turn<'a> {
    Actor(&'a mut LearningActor, usize),
    Critic(&'a mut LearningCritic, usize),
    Predictor(&'a mut LearningPredictor, &'a mut Option<PredictorLosses>),
}

impl Learner {
    /// An untrained team for `dims` with padded observations of length `observation`; agent i has the first `available[i]`
    /// actions. It learns on `threads` threads.
    pub fn untrained(
        settings: Settings,
        dims: &Dims,
        observation: usize,
        available: &[usize],
        seed: u64,
        threads: usize,
    ) -> Learner {
        assert_eq!(available.len(), dims.n_agents, "every agent has actions");
        assert_eq!(
            settings.predictors.len(),
            settings.networks.predictors.len(),
            "every predictor has settings"
        );
        // The agents of each network.
        let groups = |sharing: Sharing| {
            let size = match sharing {
                Sharing::Separate => 1,
                Sharing::Shared => dims.n_agents,
            };
            (0..dims.n_agents).step_by(size).map(move |first| first..first + size)
        };
        let (actors, critics) = (groups(settings.networks.sharing), groups(settings.critic_sharing));
        let predictors = settings.networks.predictors.iter().zip(&settings.predictors);
        Learner {
            actors: actors.map(|agents| LearningActor::new(&settings, dims, agents, seed)).collect(),
            critics: critics
                .map(|agents| LearningCritic::new(&settings, dims, observation, agents, seed))
                .collect(),
            predictors: predictors
                .map(|(spec, how)| LearningPredictor::new(spec, how, dims, settings.backend, seed))
                .collect(),
            joint: dims.joint,
            available: available.to_vec(),
            threads,
            updates: 0,
            rewards: Buffer::default(),
            advantages: Buffer::default(),
            losses: Losses { predictors: vec![None; settings.predictors.len()], ..Losses::default() },
            settings,
        }
    }

    /// One update of everything on the episodes of `batch`. Predictors that learn from replayed episodes take
    /// their step number k on `replays[k]`; where nothing is stored yet, `replays` is empty.
    ///
    /// An epoch is a step of the critics, then one of the actors on the advantages that the critics had before.
    /// Gradients are clipped together, so a network has to wait for its like between gradient and step; but
    /// critics need nothing of the actors. So a round is one turn of every network: the step that its last
    /// gradient asks for, then the next gradient, with the actors one epoch behind. The predictors have their
    /// turn when the last advantages are there.
    pub fn update(&mut self, batch: &Batch, replays: &[Trajectories]) -> &Losses {
        batch.check(self.available.len(), self.joint);
        let steps = self.settings.predictor_updates;
        assert!(replays.is_empty() || replays.len() == steps, "every step of a predictor has its replay");
        self.rewards.resize(batch.rewards.len()).copy_from_slice(&batch.rewards);
        if self.settings.standardise_rewards {
            standardise(&mut self.rewards, &batch.ends);
        }
        // The critics' last step is in round `epochs`, the actors' in the one after it.
        for round in 0..=self.settings.epochs + 1 {
            self.take_turns(round, batch, replays);
            self.meet(batch);
        }
        self.updates += 1;
        if self.updates.is_multiple_of(self.settings.target_interval) {
            self.critics.iter_mut().for_each(LearningCritic::renew_target);
        }
        &self.losses
    }

    /// The advantages of the last update's last epoch, `[T, E, agents]`; zero behind an episode's end.
    pub fn advantages(&self) -> &[f32] {
        &self.advantages
    }

    /// The time that the networks have taken since the team was made.
    pub(crate) fn busy(&self) -> Busy {
        Busy {
            actors: self.actors.iter().map(|actor| actor.busy).sum(),
            critics: self.critics.iter().map(|critic| critic.busy).sum(),
            predictors: self.predictors.iter().map(|predictor| predictor.busy).sum(),
        }
    }

    /// Floating-point operations of all matrix products that the method needs for one update on `episodes` of
    /// `steps`, with predictors that replay `replayed` episodes a step; a multiply-add is two.
    ///
    /// Every epoch takes every actor and critic forward and backward once over all steps, and so does a
    /// predictor in each of its steps, over all steps but the last; target critics go forward once, and over
    /// the observation after the last action too. Backward is a product for the gradient of a weight and, but
    /// in the first layer, one for the derivative by its input; every time step counts alike. Everything
    /// between the products is left out.
    pub(crate) fn flop_per_update(&self, episodes: usize, steps: usize, replayed: usize) -> f64 {
        let rows = |episodes: usize, steps: usize| (episodes * steps) as f64;
        let epochs = self.settings.epochs as f64;
        let actors = self.actors.iter().map(|actor| {
            actor.parameters.flop_both_ways() * epochs * rows(episodes, steps) * actor.agents.len() as f64
        });
        let critics = self.critics.iter().map(|critic| {
            let epochs = critic.parameters.flop_both_ways() * epochs * rows(episodes, steps);
            let target = critic.parameters.flop_forward() * rows(episodes, steps + 1);
            (epochs + target) * critic.valued.len() as f64
        });
        let predictors = self.predictors.iter().map(|predictor| {
            let episodes = match predictor.settings.objective {
                Objective::Maro => replayed,
                Objective::ValueAware { .. } => episodes,
            };
            let steps = rows(episodes, steps - 1) * self.settings.predictor_updates as f64;
            predictor.parameters.flop_both_ways() * steps * predictor.views() as f64
        });
        actors.sum::<f64>() + critics.sum::<f64>() + predictors.sum::<f64>()
    }

    /// One round: the turns of all networks, side by side.
    fn take_turns(&mut self, round: usize, batch: &Batch, replays: &[Trajectories]) {
        let Settings { epochs, learning_rate, largest_gradient, .. } = self.settings;
        let actor_scale = clip_scale(self.losses.actor_gradient, largest_gradient);
        let critic_scale = clip_scale(self.losses.critic_gradient, largest_gradient);
        let (settings, available) = (&self.settings, &self.available[..]);
        let (rewards, advantages) = (&self.rewards[..], &self.advantages[..]);

        // What takes longest begins.
        let predictors = self.predictors.iter_mut().zip(&mut self.losses.predictors);
        let predictors = predictors.filter(|_| round == epochs);
        let actors = self.actors.iter_mut().filter(|_| round >= 1);
        let critics = self.critics.iter_mut().filter(|_| round <= epochs);
        let turns = predictors
            .map(|(predictor, loss)| Turn::Predictor(predictor, loss))
            .chain(actors.map(|actor| Turn::Actor(actor, round - 1)))
            .chain(critics.map(|critic| Turn::Critic(critic, round)));
        side_by_side(self.threads, turns, |turn| {
            let began = Instant::now();
            let busy = match turn {
                Turn::Critic(critic, epoch) => {
                    match epoch {
                        0 => critic.begin(settings, available.len(), batch, rewards),
                        _ => critic.parameters.step(learning_rate, critic_scale),
                    }
                    if epoch < epochs {
                        critic.differentiate(available.len(), batch);
                    }
                    &mut critic.busy
                }
                Turn::Actor(actor, epoch) => {
                    match epoch {
                        0 => actor.begin(available.len(), batch),
                        _ => actor.parameters.step(learning_rate, actor_scale),
                    }
                    if epoch < epochs {
                        actor.differentiate(settings, batch, available, advantages, epoch == 0);
                    }
                    &mut actor.busy
                }
                Turn::Predictor(predictor, loss) => {
                    *loss = predictor.learn(settings, batch.trajectories(), advantages, replays);
                    &mut predictor.busy
                }
            };
            *busy += began.elapsed();
        });
    }

    /// Between rounds: the advantages that each critic has for its agents come together, and so do losses and
    /// norms.
    fn meet(&mut self, batch: &Batch) {
        let n_agents = self.available.len();
        let advantages = self.advantages.resize(batch.actions.len());
        for critic in &self.critics {
            let rows = advantages.chunks_exact_mut(n_agents);
            let own = critic.advantages.chunks_exact(critic.advantages.len() / rows.len());
            for (own, all) in own.zip(rows) {
                let agents = &mut all[critic.agents.clone()];
                match own {
                    [teams] => agents.fill(*teams),
                    _ => agents.copy_from_slice(own),
                }
            }
        }
        let norm = |squares: &mut dyn Iterator<Item = f64>| squares.sum::<f64>().sqrt();
        let losses = &mut self.losses;
        losses.actor_gradient = norm(&mut self.actors.iter().map(|actor| actor.squared_norm));
        losses.critic_gradient = norm(&mut self.critics.iter().map(|critic| critic.squared_norm));
        (losses.actors, losses.critics) = Default::default();
        self.actors.iter().for_each(|actor| losses.actors += actor.losses);
        self.critics.iter().for_each(|critic| losses.critics += critic.losses);
    }
}
