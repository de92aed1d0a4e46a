//! An agent: fuse, act, predict.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::choice::choose;
use super::imputer::{Imputer, Registry, Setup, Step};
use super::oracle::Oracle;
use super::{Inbox, PolicySource, Truth};
use crate::base::error::Result;
use crate::bus::Layout;
use crate::environment::{ActionSpace, Spec};
use crate::failed;
use crate::link::longest_age;
use crate::nn::{Actor, ActorState, Policy, Scratch};

/// What every agent of a team runs with.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AgentSettings {
    /// What the team plays in.
    pub spec: Spec,
    /// Where the policy comes from.
    pub policy: PolicySource,
    /// Which imputer completes the joint observation, by name; or the name of an oracle, see [`Truth`].
    pub imputer: String,
    /// Where that name is looked up. It does not travel: a process looks it up in its own program's.
    #[serde(skip)]
    pub registry: Registry,
    /// Takes the most probable action instead of sampling.
    pub greedy: bool,
    /// Seed of all draws.
    pub seed: u64,
    /// The most parallel worlds.
    pub worlds: usize,
    /// The most ticks by which links may postpone an observation: it is kept for so long.
    pub longest_delay: u8,
    /// Whether messages also carry the newest that their senders hold of others.
    pub relay: bool,
    /// Whether decisions say which logits they were made by. Only a recorder looks at them.
    pub tell_logits: bool,
}

impl AgentSettings {
    /// Sampled actions of the built-in policy in one world, what is lost being held.
    pub fn of(spec: &Spec) -> AgentSettings {
        AgentSettings {
            spec: spec.clone(),
            policy: PolicySource::Builtin,
            imputer: "hold".to_owned(),
            registry: Registry::default(),
            greedy: false,
            seed: 0,
            worlds: 1,
            longest_delay: 0,
            relay: false,
            tell_logits: false,
        }
    }

    /// The layout of the team's messages.
    pub fn layout(&self) -> Layout {
        let spec = &self.spec;
        Layout {
            agents: spec.n_agents(),
            observation: spec.padded_obs_dim(),
            action: spec.action_width(),
            joint: spec.joint_dim(),
            logits: if self.tell_logits { spec.n_actions() } else { 0 },
            relay: self.relay,
        }
    }

    /// The most ticks ago that what reaches an agent may have been observed.
    pub fn longest_age(&self) -> u8 {
        longest_age(self.longest_delay, self.relay, self.spec.episode_steps)
    }
}

/// One agent in a number of parallel worlds. Unless its actor sees what arrived, it never knows whether a part of the joint
/// observation was received or imputed.
#[derive(Debug)]
pub struct Agent {
    index: usize,
    spec: Spec,
    greedy: bool,
    worlds: usize,
    longest_delay: u8,
    imputer: Box<dyn Imputer>,
    /// What it is told of the truth, if the imputer's name is that of an oracle.
    oracle: Option<Oracle>,
    /// Whether it has been told of the last decision.
    has_predicted: bool,
    actor: Actor,
    /// Where the actor is in the weights of the policy, and how many these are.
    weights: Range<usize>,
    policy_weights: usize,
    state: ActorState,
    scratch: Scratch,
    /// The policy's input, `[worlds, joint]`.
    estimates: Vec<f32>,
    /// What the actor says, `[worlds, n_said]`.
    logits: Vec<f32>,
    n_said: usize,
    /// Episode of world 0 and step of the last decision, if there was one in this episode.
    moment: Option<(u64, u32)>,
    /// `[active worlds, words]`.
    actions: Vec<u32>,
    /// How many words an action has.
    words: usize,
    /// What imputers are told of actions that are values, which have no number: zeros, `[worlds]`.
    nothing: Option<Vec<u32>>,
}

impl Agent {
    /// Loads agent `index` of a team.
    pub fn new(settings: &AgentSettings, index: usize) -> Result<Agent> {
        let policy = settings.policy.load(&settings.spec)?;
        Agent::with_policy(settings, &policy, index)
    }

    /// Makes agent `index` of a team from a policy that is loaded already.
    pub fn with_policy(settings: &AgentSettings, policy: &Policy, index: usize) -> Result<Agent> {
        let spec = settings.spec.clone();
        let AgentSettings { worlds, seed, .. } = *settings;
        let (longest_age, greedy) = (settings.longest_age(), settings.greedy || policy.is_greedy());
        let setup =
            Setup { spec: &spec, policy, agent: index, worlds, seed, longest_delay: longest_age, greedy };
        let actor = policy.actor(index).clone();
        let (imputer, truth) = Truth::split(&settings.imputer);
        if truth.is_some() {
            Truth::check_actors(policy)?;
        }
        Ok(Agent {
            index,
            greedy,
            worlds,
            longest_delay: settings.longest_delay,
            imputer: settings.registry.make(imputer, &setup)?,
            oracle: truth.map(|truth| Oracle::new(truth, &spec, index)).transpose()?,
            has_predicted: false,
            state: actor.state(worlds),
            scratch: Scratch::default(),
            weights: policy.actor_range(index),
            policy_weights: policy.n_values(),
            actor,
            estimates: vec![0.0; worlds * spec.joint_dim()],
            logits: vec![0.0; worlds * policy.dims().said()],
            n_said: policy.dims().said(),
            moment: None,
            actions: Vec::with_capacity(worlds * spec.action_width()),
            words: spec.action_width(),
            nothing: matches!(spec.agents[index].actions, ActionSpace::Box { .. }).then(|| vec![0; worlds]),
            spec,
        })
    }

    /// Which agent of the team this is.
    pub fn index(&self) -> usize {
        self.index
    }

    /// What decides.
    pub(super) fn actor(&self) -> &Actor {
        &self.actor
    }

    /// Size of the team.
    pub fn team(&self) -> usize {
        self.spec.n_agents()
    }

    /// The most parallel worlds.
    pub fn worlds(&self) -> usize {
        self.worlds
    }

    /// The most ticks by which links may postpone what it receives.
    pub fn longest_delay(&self) -> u8 {
        self.longest_delay
    }

    /// The number of weights of the policy it was made from.
    pub(crate) fn policy_weights(&self) -> usize {
        self.policy_weights
    }

    /// Takes new weights: of all those of the policy, `[policy_weights]` in the order of its tensors, a copy of
    /// what its own networks need.
    pub fn renew(&mut self, weights: &[f32]) {
        self.actor.renew(&weights[self.weights.clone()]);
        self.imputer.renew(weights);
    }

    /// Computes a step of nothing, so that what the networks need is in memory before the first episode begins, which
    /// forgets this.
    pub(crate) fn warm_up(&mut self) -> Result<()> {
        self.begin_episode(self.worlds);
        self.act(0, 0, &vec![0.0; self.worlds])?;
        self.predict();
        Ok(())
    }

    /// Forgets the last episode: one starts in this many worlds.
    pub fn begin_episode(&mut self, worlds: usize) {
        self.state.start(worlds);
        self.moment = None;
        self.imputer.begin_episodes(worlds);
    }

    /// Completes what was delivered in one world to a joint estimate.
    pub fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox) {
        let joint = self.spec.joint_dim();
        let estimate = &mut self.estimates[world * joint..(world + 1) * joint];
        self.imputer.fuse(world, own, inbox, estimate);
        for sender in 0..self.spec.n_agents() {
            let age = inbox.from(sender).map(|received| received.age);
            self.state.hear(world, sender, if sender == self.index { Some(0) } else { age });
        }
    }

    /// Whether it is to be told, after [`Agent::fuse`], what its peers observe, whatever their links make of it.
    pub fn is_oracle(&self) -> bool {
        self.oracle.is_some()
    }

    /// Puts the truth in the place of what was imputed in one world, as far as the agent is an oracle.
    ///
    /// # Errors
    /// `Failed` if it needs more than what is there.
    pub fn substitute(&mut self, world: usize, everything: &Inbox) -> Result<()> {
        let joint = self.spec.joint_dim();
        let estimate = &mut self.estimates[world * joint..(world + 1) * joint];
        self.oracle.as_ref().map_or(Ok(()), |oracle| oracle.substitute(everything, estimate))
    }

    /// Chooses an action in each world of the episode from the joint estimates, and by its draw from [0, 1) where actions are
    /// sampled.
    ///
    /// # Errors
    /// `Failed` if an actor of an ONNX file cannot say what to do; ours always can.
    pub fn act(&mut self, episode: u64, step: u32, draws: &[f64]) -> Result<()> {
        let worlds = draws.len();
        (self.moment, self.has_predicted) = (Some((episode, step)), false);
        self.actions.clear();
        self.actions.resize(worlds * self.words, 0);
        let estimates = &self.estimates[..worlds * self.spec.joint_dim()];
        let logits = &mut self.logits[..worlds * self.n_said];
        self.actor.step(worlds, estimates, &[], &mut self.state, &mut self.scratch, logits)?;
        let space = &self.spec.agents[self.index].actions;
        let actions = self.actions.chunks_exact_mut(self.words);
        for ((said, draw), words) in logits.chunks_exact(self.n_said).zip(draws).zip(actions) {
            choose(space, said, *draw, self.greedy, words);
        }
        Ok(())
    }

    /// Carries the joint estimates of the last [`Agent::act`] over to the next step, and computes of that what it can.
    pub fn predict(&mut self) {
        self.actor.prepare(self.active(), &mut self.state);
        let moment = self.moment.expect("predict follows act");
        let joint = self.spec.joint_dim();
        let done = self
            .nothing
            .as_ref()
            .map_or(&self.actions[..], |nothing| &nothing[..self.actions.len() / self.words]);
        self.imputer.predict(&Step::of(moment, &self.estimates, joint, done));
        self.has_predicted = true;
    }

    /// Takes in what was `carried_out` in each world at a step of the episode of world 0, should that not be what it
    /// chose. If its last decision was not of that step, it does not matter to anything any more.
    ///
    /// # Errors
    /// `Failed` if it has no such action.
    pub(crate) fn correct(&mut self, episode: u64, step: u32, carried_out: &[u32]) -> Result<()> {
        let Some(moment) = self.moment.filter(|moment| *moment == (episode, step)) else { return Ok(()) };
        if self.actions == carried_out {
            return Ok(());
        }
        let space = &self.spec.agents[self.index].actions;
        if carried_out.len() != self.actions.len()
            || !carried_out.chunks_exact(self.words).all(|action| space.contains(action))
        {
            return Err(failed!(
                "agent-{} is told that it did {carried_out:?}, which is not one of its actions",
                self.index
            ));
        }
        self.actions.copy_from_slice(carried_out);
        if self.has_predicted && self.nothing.is_none() {
            let step = Step::of(moment, &self.estimates, self.spec.joint_dim(), &self.actions);
            self.imputer.revise(&step);
        }
        Ok(())
    }

    /// The actions chosen last, `[worlds, words]`.
    pub fn actions(&self) -> &[u32] {
        &self.actions
    }

    /// The joint estimates they were chosen from, `[worlds, joint]`.
    pub fn estimates(&self) -> &[f32] {
        &self.estimates[..self.active() * self.spec.joint_dim()]
    }

    /// What they were chosen by, `[worlds, values]`: logits, or of values the means and log-stds.
    pub fn logits(&self) -> &[f32] {
        &self.logits[..self.active() * self.n_said]
    }

    /// The worlds of the last decision.
    fn active(&self) -> usize {
        self.actions.len() / self.words
    }
}
