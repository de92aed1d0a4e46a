//! What an environment in another process says of itself, checked: nothing that follows from it may surprise anybody.

use serde::{Deserialize, Serialize};

use super::{About, ActionSpace, AgentSpec, Spec, Value};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::usage;

/// The most values that an agent may observe, and the most that its action may have.
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
    if id.is_empty() || id.chars().any(char::is_control) {
        return Err(usage!("an environment has a name, not {id:?}"));
    }
    if !(1..=MAX_AGENTS).contains(&team) {
        return Err(usage!("{id} has {team} agents, and a team has 1 to {MAX_AGENTS}"));
    }
    if !(1..=LONGEST_EPISODE).contains(&spec.episode_steps) {
        return Err(usage!("{id} has episodes of {} steps, not of 1 to 2^32", spec.episode_steps));
    }
    if !(spec.dt > 0.0 && spec.dt.is_finite()) {
        return Err(usage!("a step of {id} takes {} s, not a time above 0", spec.dt));
    }
    spec.agents.iter().try_for_each(|agent| {
        check_observation(id, team, agent)?;
        check_actions(id, agent)
    })
}

fn check_observation(id: &str, team: usize, agent: &AgentSpec) -> Result<()> {
    let AgentSpec { name: observer, observation, .. } = agent;
    if !(1..=MOST_VALUES).contains(&observation.len()) {
        return Err(usage!(
            "{observer} of {id} observes {} values, not 1 to {MOST_VALUES}",
            observation.len()
        ));
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
        let changes: [(Change, &str); 8] = [
            (|it| it.id.clear(), "has a name"),
            (|it| it.agents.clear(), "has 0 agents"),
            (|it| it.episode_steps = 0, "episodes of 0 steps"),
            (|it| it.dt = Some(0.0), "takes 0 s"),
            (|it| it.agents[1].observation.clear(), "right of drift observes 0 values"),
            (|it| it.agents[0].observation[1].about = About::Agent(2), "left observes a value about agent 2"),
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
}
