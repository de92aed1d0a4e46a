//! Where a policy comes from.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::base::error::Result;
use crate::environment::{ActionSpace, AgentSpec, PaperSetting, Spec};
use crate::nn::{ActorKind, Aligned, Dims, Networks, Policy};
use crate::{failed, usage};

/// The policies inside the program: (spec, policy file).
pub static BUILTIN: [(&str, &Aligned<[u8]>); 8] = [
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
    (
        "spread-blindfold-6",
        &Aligned(*include_bytes!("../../agents/pretrained/spread-blindfold-6/seed-0.safetensors")),
    ),
    ("spread-xy-8", &Aligned(*include_bytes!("../../agents/pretrained/spread-xy-8/seed-0.safetensors"))),
    (
        "spread-blindfold-12",
        &Aligned(*include_bytes!("../../agents/pretrained/spread-blindfold-12/seed-0.safetensors")),
    ),
];

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
    /// None: all agents are other programs, which act as they like.
    Nobody,
}

impl PolicySource {
    /// Loads the policy for a task. Weights stay where they are, in a file or in the program, whether they are stored as f32
    /// or f16; those of a file that has both are copied.
    pub fn load(&self, spec: &Spec) -> Result<Policy> {
        let policy = self.open(spec)?;
        if *self == PolicySource::Nobody {
            return Ok(policy);
        }
        let by_values = |agent: &AgentSpec| matches!(agent.actions, ActionSpace::Box { .. });
        if policy.networks().actor != ActorKind::Onnx && spec.agents.iter().any(by_values) {
            return Err(usage!(
                "agents of {} act by values, and our networks choose among discrete actions; take a task with these, or a \
                 policy of ONNX files (docs/onnx.md)",
                spec.id
            ));
        }
        if spec.n_actions() > 0 && spec.agents.iter().any(by_values) {
            return Err(usage!(
                "some agents of {} choose, others act by values; policies are for one or the other",
                spec.id
            ));
        }
        Ok(policy)
    }

    fn open(&self, spec: &Spec) -> Result<Policy> {
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
            PolicySource::Training => {
                Err(failed!("a policy in training cannot be loaded from a file, only passed on"))
            }
            PolicySource::Nobody => nobody(spec),
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
            PolicySource::Nobody => write!(f, "none"),
        }
    }
}

/// A policy whose actors nobody runs, and without predictors: imputers look into one.
fn nobody(spec: &Spec) -> Result<Policy> {
    let dims = Dims { n_actions: spec.n_actions().max(1), ..dims(spec) };
    let networks = Networks { hidden: 1, predictors: Vec::new(), ..Networks::paper(ActorKind::Mlp) };
    Policy::untrained(&dims, 0, networks)
}

/// The sizes a policy for this task has.
pub fn dims(spec: &Spec) -> Dims {
    Dims {
        task: spec.id().to_owned(),
        n_agents: spec.n_agents(),
        joint: spec.joint_dim(),
        predicted: spec.predicted_dim(),
        n_actions: spec.n_actions(),
        agents: spec.agents.clone(),
    }
}

/// The actor of the paper's setting.
pub fn paper_actor(spec: &Spec) -> ActorKind {
    match spec.paper {
        PaperSetting::One => ActorKind::Mlp,
        PaperSetting::Two => ActorKind::Gru,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_policies_hold_numbers() {
        for (id, _) in BUILTIN {
            let task = crate::environment::Task::parse(id).unwrap();
            PolicySource::Builtin.load(task.spec()).unwrap().checked(id).unwrap();
        }
    }
}
