//! What an environment in another process says of itself, checked: nothing that follows from it may surprise anybody.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use super::{About, ActionSpace, AgentSpec, Spec, Value};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::usage;

/// The most values, or choices, that an action may have.
const MOST_VALUES: usize = 1 << 16;

/// The longest episode, in steps: their numbers have 32 bits.
const LONGEST_EPISODE: usize = u32::MAX as usize;

/// What an environment in another process says of itself, as JSON. All that its agents observe is their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// What it is called.
    pub id: String,
    /// Its agents, in order.
    pub agents: Vec<AgentSpec>,
    /// Steps of the longest episode.
    pub episode_steps: usize,
    /// Length of a step, s, if it has one.
    #[serde(default)]
    pub dt: Option<f64>,
}

impl Description {
    /// The environment it tells of.
    ///
    /// # Errors
    /// `Usage` if there cannot be such an environment.
    pub fn spec(self) -> Result<Spec> {
        let Description { id, agents, episode_steps, dt } = self;
        let plain = Spec::of(&id, agents);
        let spec = Spec { episode_steps, dt: dt.unwrap_or(plain.dt), ..plain };
        check(&spec)?;
        Ok(spec)
    }
}

fn check(spec: &Spec) -> Result<()> {
    let (id, team) = (&spec.id, spec.n_agents());
    if !is_name(id) {
        return Err(usage!("an environment has a name, not {id:?}"));
    }
    if !(1..=MAX_AGENTS).contains(&team) {
        return Err(usage!("{id} has {team} agents, and a team has 1 to {MAX_AGENTS}"));
    }
    if !(1..=LONGEST_EPISODE).contains(&spec.episode_steps) {
        return Err(usage!(
            "{id} has episodes of {} steps, not of 1 to {LONGEST_EPISODE}",
            spec.episode_steps
        ));
    }
    if !(spec.dt > 0.0 && spec.dt.is_finite()) {
        return Err(usage!("a step of {id} takes {} s, not a time above 0", spec.dt));
    }
    let mut names = HashSet::new();
    spec.agents.iter().try_for_each(|agent| {
        let name = &agent.name;
        if !is_name(name) || !names.insert(name) {
            return Err(usage!("the agents of {id} have names, each its own, and one is called {name:?}"));
        }
        check_observation(id, team, agent)?;
        check_actions(id, agent)
    })
}

/// Whether it can stand in a line for people.
fn is_name(text: &str) -> bool {
    !text.is_empty() && !text.chars().any(char::is_control)
}

fn check_observation(id: &str, team: usize, agent: &AgentSpec) -> Result<()> {
    let AgentSpec { name: observer, observation, .. } = agent;
    if observation.is_empty() {
        return Err(usage!("{observer} of {id} observes 0 values, not 1 or more"));
    }
    for Value { about, rate, .. } in observation {
        if let About::Agent(about) = about
            && *about >= team
        {
            return Err(usage!(
                "{id} says that {observer} observes a value about agent {about}, and the team has {team}; they count \
                 from 0"
            ));
        }
        if let About::Target(about) = about {
            return Err(usage!(
                "{id} says that {observer} observes a value about target {about}, and only built-in tasks have targets; \
                 say that it is about a message"
            ));
        }
        if let Some((rate, _)) = rate
            && *rate >= observation.len()
        {
            return Err(usage!(
                "{id} says that value {rate} of what {observer} observes is a rate of change, and there are {} values; \
                 they count from 0",
                observation.len()
            ));
        }
    }
    Ok(())
}

fn check_actions(id: &str, agent: &AgentSpec) -> Result<()> {
    let sound = match &agent.actions {
        ActionSpace::Discrete(n) => (1..=MOST_VALUES).contains(n),
        ActionSpace::Box { low, high } => {
            let bounds = |(low, high): (&f32, &f32)| low.is_finite() && high.is_finite() && low <= high;
            (1..=MOST_VALUES).contains(&low.len())
                && low.len() == high.len()
                && low.iter().zip(high).all(bounds)
        }
    };
    if sound {
        return Ok(());
    }
    Err(usage!(
        "the actions of {} of {id} are {:?}; they are 1 to {MOST_VALUES} choices, or as many values, each between two finite \
         bounds",
        agent.name,
        agent.actions
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(change: impl FnOnce(&mut Description)) -> Result<Spec> {
        let agent = |name: &str, actions| AgentSpec {
            name: name.to_owned(),
            observation: vec![Value::word(About::Message); 2],
            actions,
        };
        let agents = vec![
            agent("left", ActionSpace::Discrete(3)),
            agent("right", ActionSpace::Box { low: vec![-1.0], high: vec![1.0] }),
        ];
        let mut sound = Description { id: "drift".into(), agents, episode_steps: 6, dt: None };
        change(&mut sound);
        sound.spec()
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let spec = described(|_| {}).unwrap();
        assert_eq!((spec.unique, spec.joint_dim(), spec.action_width()), (2, 4, 1));
        type Change = fn(&mut Description);
        let changes: [(Change, &str); 13] = [
            (|it| it.id.clear(), "has a name"),
            (|it| it.agents.clear(), "has 0 agents"),
            (|it| it.agents[0].name.clear(), "one is called \"\""),
            (|it| it.agents[1].name = "left".into(), "one is called \"left\""),
            (|it| it.agents[1].name = "ri\nght".into(), "one is called \"ri\\nght\""),
            (|it| it.episode_steps = 0, "episodes of 0 steps"),
            (|it| it.episode_steps = 1 << 32, "not of 1 to 4294967295"),
            (|it| it.dt = Some(0.0), "takes 0 s"),
            (|it| it.agents[1].observation.clear(), "right of drift observes 0 values"),
            (|it| it.agents[0].observation[1].about = About::Agent(2), "left observes a value about agent 2"),
            (|it| it.agents[0].observation[1].about = About::Target(0), "a value about target 0"),
            (|it| it.agents[0].observation[1].rate = Some((2, 1.0)), "value 2 of what left observes"),
            (
                |it| it.agents[1].actions = ActionSpace::Box { low: vec![0.0], high: vec![] },
                "actions of right",
            ),
        ];
        for (change, says) in changes {
            let error = described(change).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn an_agent_may_observe_a_picture() {
        let frame = vec![Value::word(About::Message); 210 * 160 * 3];
        let spec = described(|it| it.agents[0].observation = frame).unwrap();
        assert_eq!(spec.padded_obs_dim(), 210 * 160 * 3);
    }
}
