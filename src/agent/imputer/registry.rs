//! The imputers there are, by name.

use std::fmt;
use std::sync::Arc;

use super::dynamics::OwnDynamics;
use super::hold::Hold;
use super::predictor::Prediction;
use super::teammates::Teammates;
use super::velocity::Velocity;
use super::zero::Zero;
use super::{Imputer, Setup};
use crate::base::error::Result;
use crate::nn::Policy;
use crate::usage;

/// The imputer that is used if the policy has dynamics and nobody says otherwise. It needs no knowledge that an agent
/// cannot have.
const DEFAULT: &str = "dynamics";

/// The predictor that is used if the policy has it but no dynamics, and nobody says otherwise.
pub const PREFERRED: &str = "value-aware";

/// The imputers that a program knows by name, beside the predictors of a policy, which go by their own names.
///
/// The supervisor tells agents a name, and each looks it up in its own program's registry. So a program with an
/// imputer of its own registers it in the process that starts a swarm and in those of the agents alike.
#[derive(Clone)]
pub struct Registry {
    entries: Vec<Entry>,
}

#[derive(Clone)]
struct Entry {
    name: &'static str,
    description: &'static str,
    make: Arc<Make>,
    /// Whether a policy has what it needs.
    applies: fn(&Policy) -> bool,
}

type Make = dyn Fn(&Setup) -> Result<Box<dyn Imputer>> + Send + Sync;

impl Default for Registry {
    /// The imputers of this library that go by names of their own.
    fn default() -> Registry {
        Registry { entries: Vec::new() }
            .with_imputer(
                "dynamics",
                "for itself what its own actions make of it by the dynamics in the policy file, for others what the \
                 policy's best predictor expects",
                |setup| Ok(Box::new(OwnDynamics::new(setup)?)),
            )
            .needing_dynamics()
            .with_imputer("hold", "what was received last", |setup| Ok(Box::new(Hold::new(setup))))
            .with_imputer(
                "teammates",
                "as dynamics, and teammates as their actors in the policy file would act on what this agent believes",
                |setup| Ok(Box::new(Teammates::new(setup)?)),
            )
            .needing_dynamics()
            .with_imputer(
                "velocity",
                "what was received last, with places moved on by their velocity",
                |setup| Ok(Box::new(Velocity::new(setup))),
            )
            .with_imputer("zero", "zero", |setup| Ok(Box::new(Zero::new(setup))))
    }
}

impl Registry {
    /// This registry with one more imputer; it takes the place of one of the same name. `description` says what it
    /// takes lost values for.
    pub fn with_imputer(
        mut self,
        name: &'static str,
        description: &'static str,
        make: impl Fn(&Setup) -> Result<Box<dyn Imputer>> + Send + Sync + 'static,
    ) -> Registry {
        self.entries.retain(|entry| entry.name != name);
        self.entries.push(Entry { name, description, make: Arc::new(make), applies: |_| true });
        self
    }

    /// The last entry is only for policies that have dynamics.
    fn needing_dynamics(mut self) -> Registry {
        if let Some(entry) = self.entries.last_mut() {
            entry.applies = |policy| policy.dynamics().is_some();
        }
        self
    }

    /// Everything that can impute with this policy: its predictors, then what is registered.
    pub fn names<'a>(&'a self, policy: &'a Policy) -> impl Iterator<Item = &'a str> {
        let entries = self.entries.iter().filter(|entry| (entry.applies)(policy));
        policy.predictor_names().chain(entries.map(|entry| entry.name))
    }

    /// The imputers that need no predictor, with what each takes lost values for, for a help text.
    pub fn help(&self) -> String {
        let entries = self.entries.iter().map(|entry| format!("{} ({})", entry.name, entry.description));
        entries.collect::<Vec<_>>().join(", ")
    }

    /// The imputer called `name` with this policy. Without a name: `dynamics` if the policy has them, else its best
    /// predictor, or `hold` if it has none.
    ///
    /// # Errors
    /// `Usage` if there is none, with the names there are.
    pub fn choose(&self, name: Option<&str>, policy: &Policy) -> Result<String> {
        let Some(name) = name else {
            if policy.dynamics().is_some() && self.entries.iter().any(|entry| entry.name == DEFAULT) {
                return Ok(DEFAULT.to_owned());
            }
            return Ok(best_predictor(policy).unwrap_or("hold").to_owned());
        };
        let all = policy.predictor_names().chain(self.entries.iter().map(|entry| entry.name));
        match all.filter(|other| *other == name).count() {
            1 => Ok(name.to_owned()),
            0 => Err(self.unknown(name, policy)),
            _ => Err(usage!(
                "`{name}` is a predictor of this policy and an imputer of this program; register yours under \
                 another name"
            )),
        }
    }

    /// Makes the imputer called `name`.
    ///
    /// # Errors
    /// As [`Registry::choose`]; whatever the imputer itself cannot be made for.
    pub fn make(&self, name: &str, setup: &Setup) -> Result<Box<dyn Imputer>> {
        self.choose(Some(name), setup.policy)?;
        match self.entries.iter().find(|entry| entry.name == name) {
            Some(entry) => (entry.make)(setup),
            None => {
                let prediction = Prediction::new(name, setup).expect("the policy has what is chosen");
                Ok(Box::new(prediction))
            }
        }
    }

    fn unknown(&self, name: &str, policy: &Policy) -> crate::base::error::Error {
        let likeness = |other: &&str| strsim::jaro_winkler(name, other);
        let nearest = self.names(policy).max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        let predictors: Vec<&str> = policy.predictor_names().collect();
        let always: Vec<&str> = self.entries.iter().map(|entry| entry.name).collect();
        usage!(
            "this policy has no imputer `{name}`; the nearest is `{}`. Its predictors: {}. Always there: {}",
            nearest.unwrap_or_default(),
            if predictors.is_empty() { "none".to_owned() } else { predictors.join(", ") },
            always.join(", ")
        )
    }
}

/// The predictor of a policy that is used where nobody says which.
pub(super) fn best_predictor(policy: &Policy) -> Option<&str> {
    let preferred = policy.predictor(PREFERRED).map(|_| PREFERRED);
    preferred.or_else(|| policy.predictor_names().next())
}

impl fmt::Debug for Registry {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list().entries(self.entries.iter().map(|entry| entry.name)).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::PolicySource;
    use crate::environment::Task;
    use crate::nn::{ActorKind, NAMED_OTHERWISE, Networks};

    fn policy() -> Policy {
        PolicySource::Builtin.load(Task::parse("hear-see").unwrap().spec()).unwrap()
    }

    #[test]
    fn no_predictor_can_be_called_like_an_imputer_of_the_library() {
        let registry = Registry::default();
        let names: Vec<&str> = registry.entries.iter().map(|entry| entry.name).collect();
        assert_eq!(names, NAMED_OTHERWISE);
    }

    #[test]
    fn a_name_that_is_not_there_is_answered_with_those_that_are() {
        let registry = Registry::default().with_imputer("kalman", "a filter's mean", |_| unreachable!());
        let error = registry.choose(Some("calman"), &policy()).unwrap_err().to_string();
        assert!(error.contains("nearest is `kalman`") && error.contains("value-aware, maro"), "{error}");
        assert_eq!(registry.choose(None, &policy()).unwrap(), "dynamics");
        let networks = Networks::paper(ActorKind::Mlp);
        let untrained = Policy::untrained(policy().dims(), 0, networks).unwrap();
        assert_eq!(registry.choose(None, &untrained).unwrap(), "value-aware");
        assert!(!registry.names(&untrained).any(|name| name == "teammates"));
        assert_eq!(registry.choose(Some("kalman"), &policy()).unwrap(), "kalman");
        assert!(registry.help().contains("kalman (a filter's mean)"));
    }

    #[test]
    fn a_name_means_one_thing() {
        let registry = Registry::default().with_imputer("maro", "mine", |_| unreachable!());
        let error = registry.choose(Some("maro"), &policy()).unwrap_err().to_string();
        assert!(error.contains("register yours under another name"), "{error}");
        let twice = Registry::default().with_imputer("hold", "mine", |_| unreachable!());
        assert_eq!(twice.entries.len(), Registry::default().entries.len());
    }
}
