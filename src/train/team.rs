//! A team in training, and one update of it.

use super::actor::Actor;
use super::batch::{Batch, Trajectories};
use super::critic::Critic;
use super::memory::Buffer;
use super::parameters::{Parameters, clip_scale};
use super::predictor::Predictor;
use super::returns::standardise;
use super::settings::Settings;
use super::threads::side_by_side;
use crate::nn::{Dims, Sharing};

/// Actors, critics and predictors that learn together.
#[derive(Clone, Debug)]
pub struct Team {
    /// One per agent, or one.
    pub actors: Vec<Actor>,
    /// One per agent, or one.
    pub critics: Vec<Critic>,
    /// Those of the settings.
    pub predictors: Vec<Predictor>,
    settings: Settings,
    joint: usize,
    /// How many actions each agent has: the first ones.
    available: Vec<usize>,
    threads: usize,
    updates: u64,
    rewards: Buffer,
    /// Of the epoch before, `[T, E, agents]`.
    advantages: Buffer,
    losses: Losses,
}

/// What an update says of itself, all of its last epoch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Losses {
    /// The critics' mean squared error, over all agents.
    pub critic: f64,
    /// The actors' loss: minus surrogate and weighed entropy, over all agents.
    pub actor: f64,
    /// The mean entropy of the policies, nat.
    pub entropy: f64,
    /// The norm of the critics' gradient, before it is clipped.
    pub critic_gradient: f64,
    /// The norm of the actors' gradient, before it is clipped.
    pub actor_gradient: f64,
    /// The loss of each predictor; `None` where there was nothing to learn from.
    pub predictors: Vec<Option<f64>>,
}

/// A network's turn in a round.
enum Turn<'a> {
    Actor(&'a mut Actor),
    Critic(&'a mut Critic),
    Predictor(&'a mut Predictor, &'a mut Option<f64>),
}

impl Team {
    /// An untrained team for `dims` with padded observations of length `observation`, of which agent i has the
    /// first `available[i]` actions. It learns on `threads` threads.
    pub fn untrained(
        settings: Settings,
        dims: &Dims,
        observation: usize,
        available: &[usize],
        seed: u64,
        threads: usize,
    ) -> Team {
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
        Team {
            actors: actors.map(|agents| Actor::new(&settings, dims, agents, seed)).collect(),
            critics: critics.map(|agents| Critic::new(&settings, dims, observation, agents, seed)).collect(),
            predictors: predictors.map(|(spec, how)| Predictor::new(spec, how, dims, seed)).collect(),
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

    /// One update of everything on the episodes of `batch`, and of predictors that learn from replayed episodes
    /// on `replay`.
    ///
    /// Every epoch is a step of the critics, then one of the actors. The critics' steps need nothing of the
    /// actors, so they go one epoch ahead: in round k critics take epoch k while actors take epoch k - 1 on
    /// its advantages. The predictors learn in the last round, when the last advantages are there.
    pub fn update(&mut self, batch: &Batch, replay: Option<Trajectories>) -> &Losses {
        batch.check(self.available.len(), self.joint);
        self.rewards.resize(batch.rewards.len()).copy_from_slice(&batch.rewards);
        if self.settings.standardise_rewards {
            standardise(&mut self.rewards);
        }
        for round in 0..=self.settings.epochs {
            self.differentiate(round, batch, replay);
            self.collect_advantages(batch);
            self.step(round);
        }
        self.updates += 1;
        if self.updates.is_multiple_of(self.settings.target_interval) {
            self.critics.iter_mut().for_each(Critic::renew_target);
        }
        self.note_losses();
        &self.losses
    }

    /// The advantages of the last update's last epoch, `[T, E, agents]`.
    pub fn advantages(&self) -> &[f32] {
        &self.advantages
    }

    /// The gradients of one round, network by network.
    fn differentiate(&mut self, round: usize, batch: &Batch, replay: Option<Trajectories>) {
        let Team { settings, available, rewards, advantages, .. } = self;
        let (settings, available, rewards, advantages) =
            (&*settings, &available[..], &rewards[..], &advantages[..]);
        let (first, last) = (round == 0, round == settings.epochs);
        // Whoever takes longest begins.
        let predictors = self.predictors.iter_mut().zip(&mut self.losses.predictors).filter(|_| last);
        let actors = self.actors.iter_mut().filter(|_| !first);
        let critics = self.critics.iter_mut().filter(|_| !last);
        let turns = predictors
            .map(|(predictor, loss)| Turn::Predictor(predictor, loss))
            .chain(actors.map(Turn::Actor))
            .chain(critics.map(Turn::Critic));
        side_by_side(self.threads, turns, |turn| match turn {
            Turn::Critic(critic) => {
                if first {
                    critic.begin(settings, available.len(), batch, rewards);
                }
                critic.differentiate(batch.actions.len());
            }
            Turn::Actor(actor) => {
                if round == 1 {
                    actor.begin(batch);
                }
                actor.differentiate(settings, batch, available, advantages, round == 1);
            }
            Turn::Predictor(predictor, loss) => {
                *loss = predictor.learn(batch.trajectories(), advantages, replay);
            }
        });
    }

    /// Brings together the advantages that each critic has for its agents.
    fn collect_advantages(&mut self, batch: &Batch) {
        let n_agents = self.available.len();
        let advantages = self.advantages.resize(batch.actions.len());
        for critic in &self.critics {
            let own = critic.advantages.chunks_exact(critic.agents.len());
            for (own, all) in own.zip(advantages.chunks_exact_mut(n_agents)) {
                all[critic.agents.clone()].copy_from_slice(own);
            }
        }
    }

    /// A step of every network that has a gradient of this round. Gradients are clipped together, those of all
    /// actors and those of all critics.
    fn step(&mut self, round: usize) {
        let Settings { epochs, learning_rate, largest_gradient, .. } = self.settings;
        let losses = &mut self.losses;
        if round > 0 {
            losses.actor_gradient = norm(self.actors.iter().map(|actor| &actor.parameters));
        }
        if round < epochs {
            losses.critic_gradient = norm(self.critics.iter().map(|critic| &critic.parameters));
        }
        let actor_scale = clip_scale(losses.actor_gradient, largest_gradient);
        let critic_scale = clip_scale(losses.critic_gradient, largest_gradient);
        let actors = self.actors.iter_mut().filter(|_| round > 0);
        let critics = self.critics.iter_mut().filter(|_| round < epochs);
        let steps = actors
            .map(|actor| (&mut actor.parameters, actor_scale))
            .chain(critics.map(|critic| (&mut critic.parameters, critic_scale)));
        side_by_side(self.threads, steps, |(parameters, scale)| parameters.step(learning_rate, scale));
    }

    fn note_losses(&mut self) {
        let n_agents = self.available.len() as f64;
        let losses = &mut self.losses;
        let over_agents = |parts: &mut dyn Iterator<Item = (f64, usize)>| {
            parts.map(|(mean, agents)| mean * agents as f64).sum::<f64>() / n_agents
        };
        losses.critic = over_agents(&mut self.critics.iter().map(|c| (c.loss, c.agents.len())));
        losses.actor = over_agents(&mut self.actors.iter().map(|a| (a.loss, a.agents.len())));
        losses.entropy = over_agents(&mut self.actors.iter().map(|a| (a.entropy, a.agents.len())));
    }
}

/// The norm of the gradients of several networks together.
fn norm<'a>(parameters: impl Iterator<Item = &'a Parameters>) -> f64 {
    parameters.map(Parameters::squared_norm).sum::<f64>().sqrt()
}
