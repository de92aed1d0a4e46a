//! Joint observations as an agent sees them in a team whose agents are alike: from itself on.

use super::Dims;
use crate::environment::{About, AgentSpec, Value};

/// Turns joint observations so that an agent's own part comes first, and divides what is not its own by the number of agents.
///
/// One actor for all agents then learns what to do with the own part once, not once for each place where it may stand, and
/// before anything else. So a team shares out its landmarks: without the division, teams of eight did not.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Egocentric {
    agents: usize,
    /// How many values are the parts of the agents.
    predicted: usize,
    /// Agents this far apart are alike.
    period: usize,
}

impl Egocentric {
    /// For a team.
    ///
    /// # Panics
    /// If it is not known what each agent observes and does.
    pub fn of(dims: &Dims) -> Egocentric {
        let agents = dims.n_agents;
        assert_eq!(dims.agents.len(), agents, "egocentric actors depend on which agents are alike");
        let mut periods = (1..=agents).filter(|period| agents.is_multiple_of(*period));
        let period = periods.find(|&period| repeats(&dims.agents, period)).unwrap_or(agents);
        Egocentric { agents, predicted: dims.predicted, period }
    }

    /// Appends a joint observation as `agent` sees it: the parts of the agents from the first of its period on, then of those
    /// before; all but those of its period are divided. So is the common part, if its length is a multiple of
    /// the number of agents.
    pub fn show(&self, agent: usize, joint: &[f32], seen: &mut Vec<f32>) {
        let first = agent - agent % self.period;
        let (parts, common) = joint.split_at(self.predicted);
        for values in [parts, common] {
            if !values.len().is_multiple_of(self.agents) {
                seen.extend_from_slice(values);
                continue;
            }
            let (before, rest) = values.split_at(first * (values.len() / self.agents));
            let (own, after) = rest.split_at(self.period * (values.len() / self.agents));
            seen.extend_from_slice(own);
            seen.extend(after.iter().chain(before).map(|value| value / self.agents as f32));
        }
    }
}

/// Whether every agent observes and does what the one `period` before it does, of agents that are `period` further on.
fn repeats(agents: &[AgentSpec], period: usize) -> bool {
    let further = |value: &Value| match value.about {
        About::Agent(agent) => Value { about: About::Agent((agent + period) % agents.len()), ..*value },
        _ => *value,
    };
    let later = agents.iter().cycle().skip(period);
    agents.iter().zip(later).all(|(agent, later)| {
        agent.actions == later.actions
            && agent.observation.iter().map(further).eq(later.observation.iter().copied())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::dims;
    use crate::environment::Task;

    #[test]
    fn agents_are_alike_as_far_as_their_observations_say() {
        for (task, period) in [
            ("spread-blindfold-6", 1),
            // One of two sees x, the other one y.
            ("spread-xy-8", 2),
            ("predator-prey-3", 1),
            // The scout is not like the others.
            ("scout-3", 3),
            ("hear-see", 2),
        ] {
            let task = Task::parse(task).unwrap();
            assert_eq!(Egocentric::of(&dims(task.spec())).period, period, "{}", task.id());
        }
    }

    #[test]
    fn an_agent_comes_first_and_so_does_its_part_of_what_is_common() {
        let seen = |period, agent, joint: &[f32]| {
            let mut seen = Vec::new();
            Egocentric { agents: 3, predicted: 6, period }.show(agent, joint, &mut seen);
            seen
        };
        let joint = [0.0, 3.0, 30.0, 33.0, 60.0, 63.0, 15.0, 18.0, 21.0];
        assert_eq!(seen(1, 0, &joint), [0.0, 3.0, 10.0, 11.0, 20.0, 21.0, 15.0, 6.0, 7.0]);
        assert_eq!(seen(1, 1, &joint), [30.0, 33.0, 20.0, 21.0, 0.0, 1.0, 18.0, 7.0, 5.0]);
        assert_eq!(seen(1, 2, &joint), [60.0, 63.0, 0.0, 1.0, 10.0, 11.0, 21.0, 5.0, 6.0]);
        assert_eq!(seen(3, 2, &joint), joint, "nobody is alike");
        // What does not divide stays as it is.
        assert_eq!(seen(1, 1, &joint[..8]), [30.0, 33.0, 20.0, 21.0, 0.0, 1.0, 15.0, 18.0]);
        assert_eq!(seen(1, 1, &joint[..6]), [30.0, 33.0, 20.0, 21.0, 0.0, 1.0]);
    }
}
