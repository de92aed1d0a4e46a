//! Where a policy comes from, and which of its imputers is used.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Imputer, JointLayout};
use crate::base::error::Result;
use crate::environment::{PaperSetting, Spec};
use crate::nn::{ActorKind, Aligned, Dims, Networks, Policy};
use crate::{failed, usage};

/// The policies inside the program: (spec, policy file).
pub static BUILTIN: [(&str, &Aligned<[u8]>); 5] = [
    ("hear-see", &Aligned(*include_bytes!("../../agents/pretrained/hear-see/seed-0.safetensors"))),
    (
        "speaker-listener",
        &Aligned(*include_bytes!("../../agents/pretrained/speaker-listener/seed-0.safetensors")),
    ),
    ("spread-xy-2", &Aligned(*include_bytes!("../../agents/pretrained/spread-xy-2/seed-0.safetensors"))),
    ("spread-xy-4", &Aligned(*include_bytes!("../../agents/pretrained/spread-xy-4/seed-0.safetensors"))),
    (
        "spread-blindfold",
        &Aligned(*include_bytes!("../../agents/pretrained/spread-blindfold/seed-0.safetensors")),
    ),
];

/// The predictor that is used if the policy has it and nobody says otherwise.
pub const PREFERRED: &str = "value-aware";

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PolicySource {
    /// The policy for the task inside the program.
    Builtin,
    /// A random network of the right shape, from this seed.
    Untrained(u64),
    /// A policy file.
    File(PathBuf),
    /// The copy that a supervisor has made for its agents, in the swarm's directory, of a policy that it had checked.
    Copy(PathBuf),
    /// A policy in training: the supervisor hands it to the team at the start, and new weights whenever it
    /// has learned.
    Training,
}

impl PolicySource {
    /// Loads the policy for a task. Weights that are stored as f32, in a file or in the program, stay where they are.
    pub fn load(&self, spec: &Spec) -> Result<Policy> {
        if spec.n_actions() == 0 {
            return Err(usage!(
                "the agents of {} act by values, and policies choose among discrete actions; take a task with these",
                spec.id
            ));
        }
        match self {
            PolicySource::Builtin => {
                let policy = BUILTIN.iter().find(|(id, _)| *id == spec.id());
                let (_, bytes) = policy.ok_or_else(|| {
                    let ids: Vec<&str> = BUILTIN.iter().map(|(id, _)| *id).collect();
                    usage!(
                        "there is no built-in policy for {} (only for {}); give one with --policy FILE, \
                         or use `--policy untrained`, a seeded random network of the right shape",
                        spec.id(),
                        ids.join(", ")
                    )
                })?;
                Policy::from_static(&bytes.0, &dims(spec))
            }
            PolicySource::Untrained(seed) => {
                Policy::untrained(&dims(spec), *seed, Networks::paper(paper_actor(spec)))
            }
            PolicySource::File(path) => Policy::open(path, &dims(spec)),
            PolicySource::Copy(path) => Policy::open_copy(path, &dims(spec)),
            PolicySource::Training => Err(failed!("a policy in training cannot be loaded, only handed over")),
        }
    }
}

impl fmt::Display for PolicySource {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            PolicySource::Builtin => write!(f, "builtin"),
            PolicySource::Untrained(seed) => write!(f, "untrained (seed {seed})"),
            PolicySource::File(path) | PolicySource::Copy(path) => write!(f, "{}", path.display()),
            PolicySource::Training => write!(f, "in training"),
        }
    }
}

/// The sizes a policy for this task has.
pub fn dims(spec: &Spec) -> Dims {
    Dims {
        task: spec.id().to_owned(),
        n_agents: spec.n_agents(),
        joint: spec.joint_dim(),
        predicted: spec.predicted_dim(),
        n_actions: spec.n_actions(),
    }
}

/// The actor of the paper's setting.
pub fn paper_actor(spec: &Spec) -> ActorKind {
    match spec.paper {
        PaperSetting::One => ActorKind::Mlp,
        PaperSetting::Two => ActorKind::Gru,
    }
}

/// Names an imputer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImputerName {
    /// What is not received counts as zero.
    Zero,
    /// What is not received counts as what was received last.
    Hold,
    /// The same, but places move on with their last known velocity.
    Velocity,
    /// A predictor of the policy.
    Predictor(String),
}

impl ImputerName {
    /// The imputer called `name`, or the best one of the policy.
    pub fn choose(name: Option<&str>, policy: &Policy) -> Result<ImputerName> {
        let names: Vec<&str> = policy.predictor_names().collect();
        match name {
            Some("zero") => Ok(ImputerName::Zero),
            Some("hold") => Ok(ImputerName::Hold),
            Some("velocity") => Ok(ImputerName::Velocity),
            Some(name) if names.contains(&name) => Ok(ImputerName::Predictor(name.to_owned())),
            Some(name) => Err(usage!(
                "this policy has no imputer `{name}`; it has {}, and `hold`, `velocity` and `zero` are always there",
                if names.is_empty() { "no predictor".to_owned() } else { names.join(", ") }
            )),
            None => Ok(match names.iter().find(|name| **name == PREFERRED).or(names.first()) {
                Some(name) => ImputerName::Predictor((*name).to_owned()),
                None => ImputerName::Hold,
            }),
        }
    }

    /// Builds it.
    pub fn build(&self, policy: &Policy, spec: &Spec, worlds: usize, longest_delay: u8) -> Result<Imputer> {
        let layout = JointLayout::of(spec);
        match self {
            ImputerName::Zero => Ok(Imputer::zero(layout, worlds)),
            ImputerName::Hold => Ok(Imputer::hold(layout, worlds)),
            ImputerName::Velocity => Ok(Imputer::velocity(spec, worlds)),
            ImputerName::Predictor(name) => match policy.predictor(name) {
                Some(predictor) => {
                    Ok(Imputer::predict_with(predictor.clone(), layout, worlds, longest_delay))
                }
                None => Err(usage!("this policy has no predictor `{name}`")),
            },
        }
    }
}

impl fmt::Display for ImputerName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            ImputerName::Zero => "zero",
            ImputerName::Hold => "hold",
            ImputerName::Velocity => "velocity",
            ImputerName::Predictor(name) => name,
        })
    }
}
