//! Episodes whose actions come from outside.

use std::path::Path;

use super::ears::Ears;
use super::elsewhere::{Described, Elsewhere, Told};
use crate::agent::imputer::Setup;
use crate::agent::{PolicySource, Registry};
use crate::base::error::Result;
use crate::dynamics::Dynamics;
use crate::environment::{ActionSpace, Spec, Task};
use crate::link::{LinkSpec, Links, Site};
use crate::nn::Policy;
use crate::supervisor::{Decisions, Stage};
use crate::{failed, usage};

/// The most values in the joint estimates of a team: 256 MiB.
const MOST_VALUES: usize = 1 << 26;

/// A stage, and what its agents have.
pub(super) struct Play {
    stage: Stage,
    ears: Ears,
    decisions: Decisions,
    spec: Spec,
    worlds: usize,
    longest_delay: u8,
    relay: bool,
    policy: Policy,
    imputer: String,
    /// The seed that the imputers were made with.
    seed: u64,
    told: Option<Told>,
    /// Where the values that are shown stand in a padded joint estimate, and a row for those of all agents. Empty if all
    /// are shown.
    columns: Vec<usize>,
    shown: Vec<f32>,
}

/// How agents hear each other.
pub(super) struct Hearing<'a> {
    /// The links, as text.
    pub links: &'a str,
    /// The name of the imputer, unless it is to be the policy's best.
    pub imputer: Option<&'a str>,
    /// Whether everything is delivered at t = 0.
    pub share_at_start: bool,
    /// Whether messages also carry the newest that their senders hold of others.
    pub relay: bool,
}

impl Hearing<'_> {
    fn links(&self, site: impl Into<Site>) -> Result<Links> {
        let links = LinkSpec::parse(self.links, site)?;
        Ok(links.build().sharing_at_start(self.share_at_start))
    }
}

impl Play {
    /// Of so many worlds of one of our tasks. The imputers are those that this policy has, or the plain ones without.
    ///
    /// # Errors
    /// `Usage` if links, imputer or the number of worlds make no sense.
    pub(super) fn of_task(
        task: &Task,
        policy: Option<&PolicySource>,
        hearing: &Hearing,
        worlds: usize,
    ) -> Result<Play> {
        let spec = task.spec();
        check_worlds(spec, worlds)?;
        let policy = policy.unwrap_or(&PolicySource::Nobody).load(spec)?;
        let stage = Stage::new(task.environment(worlds), hearing.links(spec)?, 0);
        Play::assemble(stage, policy, hearing, worlds)
    }

    /// Of an environment that lives elsewhere, with the predictors of a `policy` file, if there is one.
    ///
    /// # Errors
    /// `Usage` if links or imputer make no sense.
    pub(super) fn elsewhere(described: Described, policy: Option<&Path>, hearing: &Hearing) -> Result<Play> {
        let Described { spec, moves, tick } = described;
        let nobody = PolicySource::Nobody.load(&spec)?;
        let policy = policy.map_or(Ok(nobody.clone()), |path| Policy::open(path, nobody.dims()))?;
        let policy = if moves { policy.with_dynamics(constant_velocity(&spec)) } else { policy };
        let links = hearing.links(Site { agents: spec.n_agents(), tick })?;
        let unique = spec.unique_dim();
        let values = |agent: usize| agent * unique..agent * unique + spec.obs_dim(agent);
        let columns: Vec<usize> = (0..spec.n_agents()).flat_map(values).collect();
        let (environment, told) = Elsewhere::new(spec);
        let play = Play::assemble(Stage::new(Box::new(environment), links, 0), policy, hearing, 1)?;
        let shown = vec![0.0; play.spec.n_agents() * columns.len()];
        Ok(Play { told: Some(told), columns, shown, ..play })
    }

    fn assemble(stage: Stage, policy: Policy, hearing: &Hearing, worlds: usize) -> Result<Play> {
        let (stage, relay) = (stage.relaying(hearing.relay), hearing.relay);
        let (spec, longest_delay) = (stage.spec().clone(), stage.longest_delay());
        let imputer = Registry::default().choose(hearing.imputer, &policy)?;
        let ears = ears(&spec, &policy, &imputer, worlds, (longest_delay, relay), 0)?;
        Ok(Play {
            decisions: Decisions {
                actions: vec![0; spec.n_agents() * worlds * spec.action_width()],
                ..Decisions::default()
            },
            stage,
            ears,
            spec,
            worlds,
            longest_delay,
            relay,
            policy,
            imputer,
            seed: 0,
            told: None,
            columns: Vec::new(),
            shown: Vec::new(),
        })
    }

    /// Begins the episodes from this one on, one in each world.
    pub(super) fn begin(&mut self, seed: u64, episode: u64) -> Result<()> {
        if seed != self.seed {
            let Play { spec, policy, imputer, worlds, longest_delay, relay, .. } = self;
            self.ears = ears(spec, policy, imputer, *worlds, (*longest_delay, *relay), seed)?;
            self.seed = seed;
        }
        let end = episode.checked_add(self.worlds as u64);
        let end = end.ok_or_else(|| usage!("there is no episode {episode}: episode numbers have 64 bits"))?;
        self.stage.start_over(seed, episode);
        self.stage.begin_episodes(end)?;
        self.ears.begin_episodes();
        self.hear()
    }

    /// One step, with the actions as they are. Whether the episodes go on.
    pub(super) fn step(&mut self) -> Result<bool> {
        if !self.stage.is_playing() {
            return Err(failed!("no episode is under way; call reset() first"));
        }
        self.ears.predict(&self.stage.tick(), &self.decisions.actions);
        self.stage.step_worlds(&self.decisions)?;
        self.hear()?;
        Ok(self.stage.is_playing())
    }

    fn hear(&mut self) -> Result<()> {
        self.stage.sense()?;
        self.stage.draw_links(0)?;
        self.ears.hear(&self.stage.tick());
        let (joint, row) = (self.spec.joint_dim(), self.columns.len());
        if row > 0 {
            let rows = self.shown.chunks_exact_mut(row).zip(self.ears.estimates().chunks_exact(joint));
            for (shown, estimate) in rows {
                shown.iter_mut().zip(&self.columns).for_each(|(value, column)| *value = estimate[*column]);
            }
        }
        Ok(())
    }

    /// Takes the shown estimates, which somebody has corrected, for those that the next step starts from.
    pub(super) fn believe(&mut self, write: impl FnOnce(&mut [f32])) {
        if self.columns.is_empty() {
            return write(self.ears.estimates_mut());
        }
        write(&mut self.shown);
        let joint = self.spec.joint_dim();
        let rows = self.shown.chunks_exact(self.columns.len());
        for (shown, estimate) in rows.zip(self.ears.estimates_mut().chunks_exact_mut(joint)) {
            shown.iter().zip(&self.columns).for_each(|(value, column)| estimate[*column] = *value);
        }
    }

    /// The joint estimates, `[agents, worlds, joint]`; of an environment elsewhere without padding.
    pub(super) fn estimates(&self) -> &[f32] {
        if self.columns.is_empty() { self.ears.estimates() } else { &self.shown }
    }

    /// How long a joint estimate is.
    pub(super) fn joint(&self) -> usize {
        if self.columns.is_empty() { self.spec.joint_dim() } else { self.columns.len() }
    }

    /// See [`Ears`].
    pub(super) fn ears(&self) -> &Ears {
        &self.ears
    }

    /// What is played, and by whom.
    pub(super) fn stage(&self) -> &Stage {
        &self.stage
    }

    /// What to tell an environment elsewhere.
    pub(super) fn told(&self) -> Option<&Told> {
        self.told.as_ref()
    }

    /// The worlds that are played.
    pub(super) fn worlds(&self) -> usize {
        self.worlds
    }

    /// What is done next, `[agents, worlds, width]`.
    pub(super) fn actions(&mut self) -> &mut [u32] {
        &mut self.decisions.actions
    }
}

/// An error unless there is room for what a team has in so many worlds.
pub(super) fn check_worlds(spec: &Spec, worlds: usize) -> Result<()> {
    let most = MOST_VALUES / (spec.n_agents() * spec.joint_dim().max(spec.n_actions())).max(1);
    if (1..=most).contains(&worlds) {
        return Ok(());
    }
    Err(usage!("num_envs is {worlds}, and {} can be played in 1 to {most} worlds at once", spec.id))
}

fn ears(
    spec: &Spec,
    policy: &Policy,
    imputer: &str,
    worlds: usize,
    (longest_delay, relay): (u8, bool),
    seed: u64,
) -> Result<Ears> {
    let setup = Setup { spec, policy, agent: 0, worlds, longest_delay, seed, greedy: false };
    Ears::new(&setup, &Registry::default(), imputer, relay)
}

/// Bodies move on as they are observed to, whatever agents do: so a step moves what has a rate.
fn constant_velocity(spec: &Spec) -> Dynamics {
    let actions = |agent: usize| match &spec.agents[agent].actions {
        ActionSpace::Discrete(n) => *n,
        ActionSpace::Box { .. } => 0,
    };
    Dynamics {
        keep: 1.0,
        pushes: (0..spec.n_agents()).map(|agent| vec![[0.0; 2]; actions(agent)]).collect(),
        before: 0.0,
        after: spec.dt,
        contact: None,
    }
}
