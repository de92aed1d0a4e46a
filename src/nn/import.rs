//! PyTorch state dicts with the names and shapes of the paper's published code become a [`Policy`].
//!
//! That code writes `agent.th`, the actors, and `network.th`, a predictor. Its names for our layers are in
//! [`key`]; its weights are `[outputs, inputs]` and get transposed.

use super::Dims;
use super::meta::Meta;
use super::networks::{ActorKind, Networks, PredictorSpec, Sharing};
use super::policy::Policy;
use super::state_dict::StateDict;
use crate::base::error::Result;
use crate::failed;
use std::path::{Path, PathBuf};

/// The policy in the state dict of actors at `agents` and those of named `predictors`.
///
/// The kind of actor, whether agents share it, and the hidden sizes follow from the state dicts; `meta` says
/// where they come from, and its task becomes that of `dims`.
///
/// # Errors
/// `Usage` if a file does not exist; `Failed` if one is no state dict, or its tensors are not those of a
/// policy for `dims`: missing, unexpected, of another shape, not f32 or not finite.
pub fn import(agents: &Path, predictors: &[(String, PathBuf)], dims: &Dims, meta: Meta) -> Result<Policy> {
    let actors = StateDict::read(agents)?;
    let sharing = if actors.has(SEPARATE) { Sharing::Separate } else { Sharing::Shared };
    let first = if sharing == Sharing::Separate { "agents.0." } else { "" };
    let actor = if actors.has(&format!("{first}rnn.weight_ih")) { ActorKind::Gru } else { ActorKind::Mlp };
    if sharing == Sharing::Shared && !actors.has(SHARED) {
        return Err(failed!(
            "{}: it holds no actors: neither {SHARED}, if all agents share one, nor {SEPARATE}, if each has its own",
            actors.source()
        ));
    }
    let hidden = actors.length(&format!("{first}fc1.bias"))?;

    let mut dicts = vec![("actors.".to_string(), actors)];
    let mut specs = Vec::new();
    for (name, path) in predictors {
        let dict = StateDict::read(path)?;
        specs.push(PredictorSpec { hidden: dict.length("linear_1.bias")?, ..PredictorSpec::paper(name) });
        dicts.push((format!("predictors.{name}."), dict));
    }
    let networks = Networks { sharing, hidden, predictors: specs, ..Networks::paper(actor) };
    networks.check().map_err(|error| crate::usage!("cannot import {}: {error}", agents.display()))?;

    let mut values = Vec::new();
    for tensor in networks.tensors(dims) {
        let dict = dicts.iter_mut().find(|(prefix, _)| tensor.name.starts_with(prefix));
        let (_, dict) = dict.expect("every network was found in a state dict");
        let key = key(&tensor.name);
        if key == PREDICTOR_INPUTS {
            check_inputs(dict, dims)?;
        }
        values.extend(dict.take(&key, &tensor.shape)?);
    }
    dicts.iter().try_for_each(|(_, dict)| dict.finish())?;
    Policy::new(dims, Meta { task: dims.task.clone(), ..meta }, networks, &values)
}

/// What the actors' state dict has if all agents share one.
const SHARED: &str = "fc1.bias";

/// What it has if each agent has its own.
const SEPARATE: &str = "agents.0.fc1.bias";

/// What tells how many values a predictor sees.
const PREDICTOR_INPUTS: &str = "linear_1.weight";

/// An error if a predictor sees more than the joint estimate, of which a state dict does not say what it is.
fn check_inputs(dict: &StateDict, dims: &Dims) -> Result<()> {
    let (inputs, joint) = (dict.inputs(PREDICTOR_INPUTS)?, dims.joint);
    if inputs <= joint {
        return Ok(());
    }
    Err(failed!(
        "{}: this predictor sees {inputs} values, but the joint estimate of {} has {joint}. A state dict does not say \
         what the others are, such as `own-action`; only predictors that see the estimate alone can be imported",
        dict.source(),
        dims.task
    ))
}

/// The name that the paper's code gives to our tensor `name`.
pub(crate) fn key(name: &str) -> String {
    let mut parts = name.rsplitn(3, '.');
    let mut next = || parts.next().expect("a tensor is called network.layer.tensor");
    let (tensor, layer, network) = (next(), next(), next());
    match (network.split_once('.'), layer) {
        (Some(("predictors", _)), "fc1") => format!("linear_1.{tensor}"),
        (Some(("predictors", _)), "lstm") => format!("lstm.{tensor}_l0"),
        (Some(("predictors", _)), _) => format!("linear_obs.{tensor}"),
        (Some(("critics", _)), layer) => {
            let layer = if layer == "out" { "fc3" } else { layer };
            format!("{network}.{layer}.{tensor}")
        }
        (Some((_, agent)), layer) => {
            let layer = match layer {
                "fc1" => "fc1",
                "out" => "fc2",
                _ => "rnn",
            };
            match agent {
                "shared" => format!("{layer}.{tensor}"),
                _ => format!("agents.{agent}.{layer}.{tensor}"),
            }
        }
        (None, _) => unreachable!("a network is called actors.agent, critics.agent or predictors.name"),
    }
}
