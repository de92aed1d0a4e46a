//! Oracles: agents that are told a part of the truth. They measure what it costs not to know that part.
//!
//! Only an imputer whose name says so is an oracle's, such as `value-aware+oracle:own`, and no registry knows that name:
//! whoever wants an oracle has to make its name with [`Truth::oracle`]. The imputer itself never sees the truth. It is put
//! into the estimate that the imputer has made, on which the agent acts and from which the imputer carries on.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use super::Inbox;
use crate::base::error::Result;
use crate::environment::{About, Spec};
use crate::nn::Policy;
use crate::{failed, usage};

/// What stands in the name of every oracle, between that of its imputer and what it knows.
const MARK: &str = "+oracle:";

/// A part of the joint observation, by whose state its values tell of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// That of the agent itself, whoever observes it.
    Own,
    /// That of everybody else who moves: all other agents, and those who are not of the team.
    Others,
    /// That of no agent: landmarks, colours, and what somebody said.
    Constants,
    /// That of the agent with this number.
    Agent(usize),
    /// That of those who move and are not of the team.
    Targets,
}

impl Truth {
    /// The name of the oracle that knows this, and takes this imputer for the rest.
    pub fn oracle(self, imputer: &str) -> String {
        format!("{imputer}{MARK}{self}")
    }

    /// The imputer behind a name, and what is known beside it if the name is that of an oracle.
    pub fn split(name: &str) -> (&str, Option<Truth>) {
        let oracle = name.rsplit_once(MARK);
        let oracle = oracle.and_then(|(imputer, truth)| Some((imputer, Some(truth.parse().ok()?))));
        oracle.unwrap_or((name, None))
    }

    /// Whether an environment says of any value that it tells of this.
    ///
    /// # Errors
    /// `Usage` if it does not.
    pub fn check(self, spec: &Spec) -> Result<()> {
        let common = spec.common.iter().map(|value| value.about);
        let values = spec.agents.iter().flat_map(|of| &of.observation).map(|value| value.about).chain(common);
        if values.into_iter().any(|about| (0..spec.n_agents()).any(|agent| self.covers(about, agent))) {
            return Ok(());
        }
        let state = match self {
            Truth::Own => "an agent itself".to_owned(),
            Truth::Others => "other agents or targets".to_owned(),
            Truth::Targets => "targets".to_owned(),
            Truth::Constants => "landmarks or messages".to_owned(),
            Truth::Agent(agent) => format!("agent {agent}, counted from 0"),
        };
        Err(usage!(
            "the `Spec` of {} says of no observed value that it is about {state}, so no oracle can know it",
            spec.id
        ))
    }

    /// Whether agents of a policy can be told any truth.
    ///
    /// # Errors
    /// `Usage` if not: what their actors see of what arrived would call it lost or old.
    pub fn check_actors(policy: &Policy) -> Result<()> {
        if !policy.networks().actors_hear() {
            return Ok(());
        }
        Err(usage!(
            "an oracle puts the truth into estimates, and the actors of this policy also see what arrived and how old it \
             is, which would still call the truth lost; take a policy whose actors see the estimate alone"
        ))
    }

    /// The dims of the joint observation that tell of this, for this agent.
    pub fn dims(self, spec: &Spec, agent: usize) -> impl Iterator<Item = usize> {
        let values = spec.agents.iter().enumerate().flat_map(move |(sender, of)| {
            let first = sender * spec.unique_dim();
            of.observation.iter().enumerate().map(move |(dim, value)| (first + dim, value.about))
        });
        values.filter(move |(_, about)| self.covers(*about, agent)).map(|(dim, _)| dim)
    }

    fn covers(self, about: About, agent: usize) -> bool {
        match (self, about) {
            (Truth::Own, About::Agent(of)) => of == agent,
            (Truth::Others, About::Agent(of)) => of != agent,
            (Truth::Others | Truth::Targets, About::Target(_)) => true,
            (Truth::Agent(one), About::Agent(of)) => of == one,
            (Truth::Constants, About::Landmark | About::Message) => true,
            _ => false,
        }
    }
}

/// `own`, `others`, `targets`, `constants` or `agent:K`.
impl fmt::Display for Truth {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Truth::Own => f.write_str("own"),
            Truth::Others => f.write_str("others"),
            Truth::Constants => f.write_str("constants"),
            Truth::Targets => f.write_str("targets"),
            Truth::Agent(agent) => write!(f, "agent:{agent}"),
        }
    }
}

impl Serialize for Truth {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl FromStr for Truth {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Truth, String> {
        let agent = text.strip_prefix("agent:").and_then(|agent| agent.parse().ok()).map(Truth::Agent);
        let named = [Truth::Own, Truth::Others, Truth::Targets, Truth::Constants].into_iter().chain(agent);
        let mut named = named.filter(|truth| truth.to_string() == text);
        named
            .next()
            .ok_or_else(|| "expected own, others, targets, constants or agent:K, such as agent:0".to_owned())
    }
}

/// What an agent knows beside what its imputer makes of what it received.
#[derive(Debug)]
pub(super) struct Oracle {
    agent: usize,
    unique: usize,
    /// Of the joint observation. What the agent observes itself is true without an oracle.
    dims: Vec<usize>,
}

impl Oracle {
    /// That of this agent.
    ///
    /// # Errors
    /// As [`Truth::check`].
    pub(super) fn new(truth: Truth, spec: &Spec, agent: usize) -> Result<Oracle> {
        truth.check(spec)?;
        let unique = spec.unique_dim();
        let dims = truth.dims(spec, agent).filter(|dim| dim / unique != agent).collect();
        Ok(Oracle { agent, unique, dims })
    }

    /// Puts the truth in its place in the joint estimate of one world. `everything` is what all peers observe now.
    ///
    /// # Errors
    /// `Failed` if it is not all there.
    pub(super) fn substitute(&self, everything: &Inbox, estimate: &mut [f32]) -> Result<()> {
        for &dim in &self.dims {
            let sender = dim / self.unique;
            let sent = everything.from(sender).ok_or_else(|| {
                failed!("agent-{} is an oracle, but does not have what agent-{sender} observes", self.agent)
            })?;
            estimate[dim] = sent.observation[dim % self.unique];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;

    #[test]
    fn an_oracle_is_known_by_its_name_and_nobody_else_is_taken_for_one() {
        for truth in [Truth::Own, Truth::Others, Truth::Targets, Truth::Constants, Truth::Agent(12)] {
            assert_eq!(Truth::split(&truth.oracle("maro")), ("maro", Some(truth)));
        }
        for name in ["maro", "maro+own", "own", "maro+oracle:", "maro+oracle:all", "maro+oracle:agent:+1"] {
            assert_eq!(Truth::split(name), (name, None));
        }
    }

    #[test]
    fn every_value_is_own_or_of_others_or_a_constant() {
        for task in Task::all() {
            let spec = task.spec();
            let values = |agent: usize| spec.agents[agent].observation.len();
            for agent in 0..spec.n_agents() {
                let parts = [Truth::Own, Truth::Others, Truth::Constants];
                let mut dims: Vec<usize> = parts.iter().flat_map(|truth| truth.dims(spec, agent)).collect();
                dims.sort_unstable();
                let all = (0..spec.n_agents())
                    .flat_map(|sender| (0..values(sender)).map(move |dim| sender * spec.unique_dim() + dim));
                assert_eq!(dims, all.collect::<Vec<_>>(), "{}", spec.id);
                let own: Vec<usize> = Truth::Own.dims(spec, agent).collect();
                assert_eq!(own, Truth::Agent(agent).dims(spec, agent).collect::<Vec<_>>());
            }
        }
        // In scout-3 the target is known to agent 0 alone, and agent 0 knows it without an oracle.
        let spec = Task::parse("scout-3").unwrap().spec().clone();
        let dims = |truth, agent| Oracle::new(truth, &spec, agent).unwrap().dims;
        assert_eq!(dims(Truth::Targets, 2), [4, 5, 6, 7]);
        assert_eq!(dims(Truth::Others, 2), [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        assert!(dims(Truth::Targets, 0).is_empty());
        // Of spread-xy-2, agent 0 is seen along y by agent 1: place and velocity, first of each pair.
        let spec = Task::parse("spread-xy-2").unwrap().spec().clone();
        assert_eq!(Oracle::new(Truth::Own, &spec, 0).unwrap().dims, [4, 6]);
        assert_eq!(Oracle::new(Truth::Others, &spec, 0).unwrap().dims, [5, 7]);
    }

    #[test]
    fn what_an_environment_does_not_tell_of_cannot_be_known() {
        let of = |task: &str, truth: Truth| truth.check(Task::parse(task).unwrap().spec());
        assert!(of("hear-see", Truth::Agent(1)).is_ok());
        // Everybody knows the landmarks of spread-xy, so there is nothing to substitute, which is no mistake.
        assert!(of("hear-see", Truth::Constants).is_ok() && of("spread-xy-2", Truth::Constants).is_ok());
        for (task, truth, says) in [
            ("hear-see", Truth::Agent(2), "about agent 2, counted from 0"),
            ("spread-blindfold-1", Truth::Others, "about other agents or targets"),
            ("rendezvous-3", Truth::Targets, "about targets"),
        ] {
            let error = of(task, truth).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains(task), "{error}");
        }
    }
}
