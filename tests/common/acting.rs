//! Policies whose predictors see what their agent does.

use std::path::Path;

use vamaro_swarm::agent::{PolicySource, dims, paper_actor};
use vamaro_swarm::environment::Spec;
use vamaro_swarm::nn::{Input, Networks, Policy, PredictorSpec};

/// The names of their predictors: one sees the own action beside the estimate, one beside everything there is.
pub const ACTING: [&str; 2] = ["acting", "seeing-all"];

/// A small one that has learned nothing.
pub fn acting(spec: &Spec) -> Policy {
    let inputs = [
        vec![Input::Estimate, Input::OwnAction],
        vec![
            Input::Estimate,
            Input::Delivered,
            Input::Age,
            Input::Innovation,
            Input::Proximity,
            Input::OwnAction,
        ],
    ];
    let predictor = |(name, inputs)| PredictorSpec { inputs, hidden: 16, ..PredictorSpec::paper(name) };
    let predictors = ACTING.into_iter().zip(inputs).map(predictor).collect();
    let networks = Networks { predictors, hidden: 16, ..Networks::paper(paper_actor(spec)) };
    Policy::untrained(&dims(spec), 1, networks).unwrap()
}

/// The same, in a file of this folder.
pub fn acting_in(folder: &Path, spec: &Spec) -> PolicySource {
    let path = folder.join(format!("{}.safetensors", spec.id()));
    acting(spec).save(&path).unwrap();
    PolicySource::File(path)
}
