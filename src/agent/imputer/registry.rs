//! The imputers there are, by name.

use std::fmt;
use std::sync::Arc;

use super::dynamics::OwnDynamics;
use super::hold::Hold;
use super::imagined::Guess;
use super::motion::{Known, no_dynamics, not_given};
use super::predictor::Prediction;
use super::teammates::Teammates;
use super::velocity::Velocity;
use super::zero::Zero;
use super::{Imputer, Setup};
use crate::base::error::Result;
use crate::dynamics::fit;
use crate::environment::{PhysicsSpec, Task};
use crate::nn::{Policy, PredictorSpec};
use crate::usage;

/// The imputer that is used if the policy has dynamics and nobody says otherwise. It needs no knowledge that an agent
/// cannot have.
const DEFAULT: &str = "dynamics";

/// The predictor that is used if nobody says otherwise, unless another one sees its agent's own action.
pub const PREFERRED: &str = "value-aware";

/// Beliefs about each world of the imputer `particles`.
const PARTICLES: usize = 16;

/// Episodes to which the dynamics that imputers are told are fitted. That takes a tenth of a second.
const GIVEN_EPISODES: u64 = 300;

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
    make: Make,
    /// Whether no evaluation plays it unless it is asked for.
    only_on_request: bool,
    /// Whether it runs the actors of teammates on what an agent believes.
    imagines_actors: bool,
}

#[derive(Clone)]
enum Make {
    /// It imputes everything.
    Alone(Arc<MakeAlone>),
    /// It moves what dynamics move, which it knows in this way.
    WithDynamics(Known, MakeWithDynamics),
}

type MakeAlone = dyn Fn(&Setup) -> Result<Box<dyn Imputer>> + Send + Sync;

/// Makes it with the imputer that everything else is left to.
type MakeWithDynamics = fn(&Setup, Box<dyn Imputer>) -> Result<Box<dyn Imputer>>;

impl Default for Registry {
    /// The imputers of this library that go by names of their own.
    fn default() -> Registry {
        Registry { entries: Vec::new() }
            .with_dynamics(
                "dynamics",
                "the own state from the own actions and the dynamics in the policy file, the rest by the policy's best \
                 predictor",
                |setup, rest| Ok(Box::new(OwnDynamics::new(setup, rest, Known::Fitted)?)),
            )
            .with_given(
                "given-dynamics",
                "like dynamics, but told the physics that is played: a ceiling",
                |setup, rest| Ok(Box::new(OwnDynamics::new(setup, rest, Known::Given)?)),
            )
            .with_given(
                "given-teammates",
                "like teammates, but told the physics that is played: a ceiling",
                |setup, rest| Ok(Box::new(Teammates::new(setup, rest, Guess::Mean, Known::Given)?)),
            )
            .imagining_actors()
            .with_imputer("hold", "the last value received", |setup| Ok(Box::new(Hold::new(setup))))
            .with_dynamics(
                "kalman",
                "a Kalman filter: constant velocity, with the own action as its control input",
                |setup, rest| Ok(Box::new(OwnDynamics::constant_velocity(setup, rest)?)),
            )
            .with_dynamics(
                "particles",
                "like teammates, but the weighted mean of 16 beliefs with sampled actions of teammates",
                |setup, rest| Ok(Box::new(Teammates::new(setup, rest, Guess::Drawn(PARTICLES), Known::Fitted)?)),
            )
            .imagining_actors()
            .only_on_request()
            .with_dynamics(
                "shared-dice",
                "like teammates, but with the teammates' own random draws, from a seed that all share: a bound, not a method",
                |setup, rest| Ok(Box::new(Teammates::new(setup, rest, Guess::SharedDice, Known::Fitted)?)),
            )
            .imagining_actors()
            .only_on_request()
            .with_dynamics(
                "teammates",
                "like dynamics, and teammates act as their actors in the policy file would on this agent's estimate",
                |setup, rest| Ok(Box::new(Teammates::new(setup, rest, Guess::Mean, Known::Fitted)?)),
            )
            .imagining_actors()
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
        self.entries.push(Entry::of(name, description, Make::Alone(Arc::new(make))));
        self
    }

    fn with_dynamics(
        mut self,
        name: &'static str,
        description: &'static str,
        make: MakeWithDynamics,
    ) -> Registry {
        self.entries.push(Entry::of(name, description, Make::WithDynamics(Known::Fitted, make)));
        self
    }

    /// As [`with_dynamics`](Registry::with_dynamics), of the physics that is played. No evaluation plays it unless it is
    /// asked for.
    fn with_given(
        mut self,
        name: &'static str,
        description: &'static str,
        make: MakeWithDynamics,
    ) -> Registry {
        self.entries.push(Entry::of(name, description, Make::WithDynamics(Known::Given, make)));
        self.only_on_request()
    }

    /// No evaluation plays the last entry unless it is asked for.
    fn only_on_request(mut self) -> Registry {
        self.last().only_on_request = true;
        self
    }

    /// The last entry runs the actors of teammates on what an agent believes.
    fn imagining_actors(mut self) -> Registry {
        self.last().imagines_actors = true;
        self
    }

    fn last(&mut self) -> &mut Entry {
        self.entries.last_mut().expect("there is an entry")
    }

    /// What an evaluation compares unless it is told what: the predictors of a policy, then what is registered and
    /// needs nothing that the policy lacks. Dice that all share are no knowledge that agents have by themselves, and
    /// many beliefs take their time: these have to be asked for.
    pub fn names<'a>(&'a self, policy: &'a Policy) -> impl Iterator<Item = &'a str> {
        let has_dynamics = |entry: &&Entry| match entry.make {
            Make::Alone(_) => true,
            Make::WithDynamics(..) => policy.dynamics().is_some(),
        };
        let entries = self.entries.iter().filter(|entry| !entry.only_on_request).filter(has_dynamics);
        let entries = entries.filter(|entry| entry.can_imagine(policy));
        policy.predictor_names().chain(entries.map(|entry| entry.name))
    }

    /// The imputers that need no predictor, with what each takes lost values for, for a help text.
    pub fn help(&self) -> String {
        let entries = self.entries.iter().map(|entry| format!("{} ({})", entry.name, entry.description));
        entries.collect::<Vec<_>>().join(", ")
    }

    /// The imputer called `name` with this policy; `dynamics(maro)` is one that leaves to `maro` what it does not move
    /// itself. Without a name: the imputer that the policy names itself; `dynamics` if it has them, else its best predictor, or
    /// `hold` if it has none.
    ///
    /// # Errors
    /// `Usage` if there is none, with the names there are; if it needs dynamics and the policy has none; if it runs the actors
    /// of teammates and these see more than estimates.
    pub fn choose(&self, asked: Option<&str>, policy: &Policy) -> Result<String> {
        let Some(name) = asked.or(policy.meta().imputer.as_deref()) else {
            if policy.dynamics().is_some() && self.entry(DEFAULT).is_some() {
                return Ok(DEFAULT.to_owned());
            }
            return Ok(best_predictor(policy).unwrap_or("hold").to_owned());
        };
        let (outer, rest) = parts(name)?;
        let entries = self.entries.iter().map(|entry| entry.name);
        match policy.predictor_names().chain(entries).filter(|other| *other == outer).count() {
            1 => {}
            0 if asked.is_none() => {
                return Err(usage!(
                    "the policy was trained with imputer `{outer}`, which is not in this program; name another one, such as \
                     `hold`"
                ));
            }
            0 => return Err(self.unknown(outer, policy)),
            _ => {
                return Err(usage!(
                    "`{outer}` is a predictor of this policy and an imputer of this program; register yours under \
                     another name"
                ));
            }
        }
        if self.entry(outer).is_some_and(|entry| !entry.can_imagine(policy)) {
            return Err(usage!(
                "`{outer}` runs the actors of teammates on what an agent believes, and those of this policy also see what \
                 arrived and how old it is, which only the teammates know; take another imputer, such as `hold`"
            ));
        }
        match (rest, self.entry(outer).map(|entry| &entry.make)) {
            (_, Some(Make::WithDynamics(Known::Fitted, _))) if policy.dynamics().is_none() => {
                return Err(no_dynamics(&policy.dims().task));
            }
            (_, Some(Make::WithDynamics(Known::Given, _))) if policy.given().is_none() => {
                return Err(not_given(&policy.dims().task));
            }
            (Some(rest), Some(Make::WithDynamics(..))) => self.choose(Some(rest), policy).map(drop)?,
            (Some(_), _) => {
                return Err(usage!("`{name}`: the imputer `{outer}` takes no other imputer in parentheses"));
            }
            (None, _) => {}
        }
        Ok(name.to_owned())
    }

    /// This policy, told the dynamics of the physics of `task` if one of these imputers asks for them: fitted to play
    /// without the noise of motors and wind, they are exact.
    ///
    /// # Errors
    /// As [`fit`].
    pub(crate) fn told<'a>(
        &self,
        policy: Policy,
        task: &Task,
        mut names: impl Iterator<Item = &'a str>,
    ) -> Result<Policy> {
        if !names.any(|name| self.needs_given(name)) {
            return Ok(policy);
        }
        let calm = PhysicsSpec { motor_noise: 0.0, wind: 0.0, ..*task.physics() };
        Ok(policy.with_given(fit(&task.clone().with_physics(calm)?, 0, GIVEN_EPISODES, || Ok(()))?.dynamics))
    }

    fn needs_given(&self, name: &str) -> bool {
        let (outer, rest) = parts(name).unwrap_or((name, None));
        let known = self.entry(outer).map(|entry| &entry.make);
        matches!(known, Some(Make::WithDynamics(Known::Given, _)))
            || rest.is_some_and(|rest| self.needs_given(rest))
    }

    /// Makes the imputer called `name`.
    ///
    /// # Errors
    /// As [`Registry::choose`]; whatever the imputer itself cannot be made for.
    pub fn make(&self, name: &str, setup: &Setup) -> Result<Box<dyn Imputer>> {
        self.choose(Some(name), setup.policy)?;
        let (outer, rest) = parts(name)?;
        match self.entry(outer).map(|entry| &entry.make) {
            Some(Make::Alone(make)) => make(setup),
            Some(Make::WithDynamics(_, make)) => {
                let rest = rest.or_else(|| best_predictor(setup.policy)).unwrap_or("hold");
                make(setup, self.make(rest, setup)?)
            }
            None => {
                let prediction = Prediction::new(outer, setup).expect("the policy has what is chosen");
                Ok(Box::new(prediction))
            }
        }
    }

    fn entry(&self, name: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.name == name)
    }

    fn unknown(&self, name: &str, policy: &Policy) -> crate::base::error::Error {
        let likeness = |other: &&str| strsim::jaro_winkler(name, other);
        let all = policy.predictor_names().chain(self.entries.iter().map(|entry| entry.name));
        let nearest = all.max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        let predictors: Vec<&str> = policy.predictor_names().collect();
        let named = |of: fn(&Make) -> bool| {
            let names = self.entries.iter().filter(|entry| of(&entry.make)).map(|entry| entry.name);
            names.collect::<Vec<_>>().join(", ")
        };
        usage!(
            "this policy has no imputer `{name}`; the nearest is `{}`. Its predictors: {}. Always there: {}. If it holds dynamics: {}",
            nearest.unwrap_or_default(),
            if predictors.is_empty() { "none".to_owned() } else { predictors.join(", ") },
            named(|make| matches!(make, Make::Alone(_))),
            named(|make| matches!(make, Make::WithDynamics(..)))
        )
    }
}

impl Entry {
    fn of(name: &'static str, description: &'static str, make: Make) -> Entry {
        Entry { name, description, make, only_on_request: false, imagines_actors: false }
    }

    /// Whether it can run the actors of teammates, if it does that: what they see has to follow from estimates.
    fn can_imagine(&self, policy: &Policy) -> bool {
        !(self.imagines_actors && policy.networks().actors_hear())
    }
}

/// The name of an imputer, and of the one that it leaves the rest to, in parentheses behind it.
fn parts(name: &str) -> Result<(&str, Option<&str>)> {
    let Some((outer, rest)) = name.split_once('(') else { return Ok((name, None)) };
    let rest = rest.strip_suffix(')');
    let rest = rest.ok_or_else(|| usage!("imputer `{name}`: a `)` is missing at the end"))?;
    Ok((outer.trim(), Some(rest.trim())))
}

/// The predictor of a policy that is used where nobody says which: one that sees what its agent does, if there is one.
fn best_predictor(policy: &Policy) -> Option<&str> {
    let specs = policy.networks().predictors.iter();
    let rank = |spec: &&PredictorSpec| (!spec.sees_own_action(), spec.name != PREFERRED);
    specs.min_by_key(rank).map(|spec| &spec.name[..])
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
        let registry = Registry::default().with_imputer("median", "a filter's mean", |_| unreachable!());
        let error = registry.choose(Some("medean"), &policy()).unwrap_err().to_string();
        assert!(error.contains("nearest is `median`") && error.contains("value-aware, maro"), "{error}");
        assert_eq!(registry.choose(None, &policy()).unwrap(), "dynamics");
        let networks = Networks::paper(ActorKind::Mlp);
        let untrained = Policy::untrained(policy().dims(), 0, networks).unwrap();
        assert_eq!(registry.choose(None, &untrained).unwrap(), "value-aware");
        let acting = |name| PredictorSpec::acting(name, policy().dims());
        let [other, paper] = ["other", PREFERRED].map(PredictorSpec::paper);
        for (predictors, best) in [
            (vec![other.clone()], "other"),
            (vec![other.clone(), paper.clone()], PREFERRED),
            (vec![other, paper, acting("acting"), acting("late")], "acting"),
            (vec![acting("acting"), acting(PREFERRED)], PREFERRED),
        ] {
            let networks = Networks { predictors, ..Networks::paper(ActorKind::Mlp) };
            let untrained = Policy::untrained(policy().dims(), 0, networks).unwrap();
            assert_eq!(registry.choose(None, &untrained).unwrap(), best);
        }
        assert!(!registry.names(&untrained).any(|name| name == "teammates"));
        for name in ["dynamics", "kalman(hold)"] {
            let error = registry.choose(Some(name), &untrained).unwrap_err().to_string();
            assert!(error.contains("no dynamics of hear-see") && error.contains("fit"), "{error}");
        }
        assert_eq!(registry.choose(Some("median"), &policy()).unwrap(), "median");
        assert!(registry.help().contains("median (a filter's mean)"));
    }

    #[test]
    fn a_predictor_runs_only_where_it_is_left_something() {
        let task = Task::parse("spread-xy-4").unwrap();
        let policy = PolicySource::Builtin.load(task.spec()).unwrap();
        let work = |name, longest_delay| {
            let setup = Setup { longest_delay, ..Setup::of(task.spec(), &policy, 1) };
            Registry::default().make(name, &setup).unwrap().multiply_adds()
        };
        let predictor = work("acting", 0);
        assert_eq!(work("teammates", 0), work("teammates(hold)", 0));
        assert_eq!(work("teammates", 2), work("teammates(hold)", 2) + predictor);
        assert_eq!([work("kalman", 0), work("dynamics", 0)], [0, predictor]);
    }

    #[test]
    fn a_name_means_one_thing() {
        let registry = Registry::default().with_imputer("maro", "mine", |_| unreachable!());
        let error = registry.choose(Some("maro"), &policy()).unwrap_err().to_string();
        assert!(error.contains("register yours under another name"), "{error}");
        let error = |name| Registry::default().choose(Some(name), &policy()).unwrap_err().to_string();
        assert_eq!(Registry::default().choose(Some("kalman(maro)"), &policy()).unwrap(), "kalman(maro)");
        assert!(error("dynamics(marro)").contains("nearest is `maro`"), "{}", error("dynamics(marro)"));
        assert!(error("hold(maro)").contains("takes no other imputer"), "{}", error("hold(maro)"));
        assert!(error("maro(hold)").contains("takes no other imputer"), "{}", error("maro(hold)"));
        assert!(error("dynamics(maro").contains("`)` is missing"), "{}", error("dynamics(maro"));
        let twice = Registry::default().with_imputer("hold", "mine", |_| unreachable!());
        assert_eq!(twice.entries.len(), Registry::default().entries.len());
    }
}
