//! The predictor: what the joint observation will change by, step after step.

use super::Dims;
use super::file::Precision;
use super::inference::{Inference, NetworkState, Scratch};
use super::networks::{Input, PredictorSpec};
use super::proximity::Proximity;
use super::senses::Hearing;
use super::weights::{Storage, Tensor};
use std::sync::Arc;

/// From the joint estimate of one step to the distribution of the change of its predicted dims until the next
/// step, see [`PredictorSpec::network`].
#[derive(Clone, Debug)]
pub struct Predictor {
    pub(super) spec: PredictorSpec,
    pub(super) network: Inference,
    /// Who is near whom, if it sees that.
    pub(super) proximity: Option<Proximity>,
    pub(super) dims: Dims,
}

/// What a predictor remembers of an episode, and what it has heard of the step under way.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictorState {
    network: NetworkState,
    /// The numbers of agents and of predicted dims, if it sees more than estimates and actions.
    sizes: Option<(usize, usize)>,
    /// Of no agent, if it sees only estimates and actions.
    hearing: Hearing,
    /// What it expected of the step under way, `[rows, predicted]`; nothing in the first one.
    expected: Vec<f32>,
    expects: bool,
    /// What it saw last, `[rows, inputs]`.
    seen: Vec<f32>,
}

impl Predictor {
    /// A predictor with these values: those of its tensors, one after the other.
    pub(crate) fn new(spec: &PredictorSpec, dims: &Dims, values: &[f32]) -> Predictor {
        let network = spec.network(dims);
        let mut rest = values;
        let parts = network
            .tensors()
            .into_iter()
            .map(|tensor| rest.split_off(..tensor.n_values()).expect("there are values for every tensor"));
        let (storage, ranges) = Storage::copy(parts);
        let storage = Arc::new(storage);
        let tensor = |range| Tensor::new(storage.clone(), range, Precision::Full);
        let tensors: Vec<_> = ranges.into_iter().map(tensor).collect();
        let network = Inference::new(&network, None, tensors.iter());
        Predictor { spec: spec.clone(), network, proximity: spec.proximity(dims), dims: dims.clone() }
    }

    /// What kind of predictor this is.
    pub fn spec(&self) -> &PredictorSpec {
        &self.spec
    }

    /// The state in which `rows` episodes start: zero.
    pub fn state(&self, rows: usize) -> PredictorState {
        let sizes = self.spec.has_senses().then_some((self.dims.n_agents, self.dims.predicted));
        let mut state = PredictorState {
            network: self.network.state(0),
            sizes,
            hearing: Hearing::of(sizes.unwrap_or_default().0),
            expected: Vec::new(),
            expects: false,
            seen: Vec::new(),
        };
        state.start(rows);
        state
    }

    /// One step of `rows` episodes: `state`, which has [heard](PredictorState::hear) what arrived, advances, and `out`
    /// becomes the prediction.
    ///
    /// `estimates` is `[rows, joint]`; `acts` `[rows]` what the agent does, as [`Dims::act`](super::Dims::act) counts,
    /// and ignored by a predictor that does not see it; `out` `[rows, 2 * predicted]`: first the mean of the change of each
    /// predicted dim, zero where the dim is held; then its raw log-std, to be read by the
    /// [sigma rule](super::Sigma).
    pub fn step(
        &self,
        rows: usize,
        estimates: &[f32],
        acts: &[usize],
        state: &mut PredictorState,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        self.see(rows, estimates, state);
        let PredictorState { network, sizes, seen, expected, expects, .. } = state;
        let seen = if sizes.is_some() { &seen[..] } else { estimates };
        self.network.step(rows, seen, acts, network, scratch, out);
        let predicted = self.dims.predicted;
        for row in out.chunks_exact_mut(2 * predicted) {
            self.spec.held.iter().for_each(|&dim| row[dim] = 0.0);
        }
        if sizes.is_some() {
            let rows = estimates.chunks_exact(self.dims.joint).zip(out.chunks_exact(2 * predicted));
            for (expected, (estimate, delta)) in expected.chunks_exact_mut(predicted).zip(rows) {
                let next = estimate.iter().zip(delta).map(|(value, delta)| value + delta);
                expected.iter_mut().zip(next).for_each(|(expected, next)| *expected = next);
            }
            *expects = true;
        }
    }

    /// Puts together what it sees, if that is more than estimates and actions.
    fn see(&self, rows: usize, estimates: &[f32], state: &mut PredictorState) {
        let PredictorState { sizes: Some((_, predicted)), hearing, expected, expects, seen, .. } = state
        else {
            return;
        };
        let estimates = estimates.chunks_exact(self.dims.joint).zip(expected.chunks_exact(*predicted));
        seen.clear();
        for (row, (estimate, expected)) in estimates.take(rows).enumerate() {
            for input in &self.spec.inputs {
                match input {
                    Input::Estimate => seen.extend_from_slice(estimate),
                    Input::Delivered | Input::Age => hearing.show(row, *input, seen),
                    Input::Innovation if *expects => {
                        seen.extend(estimate.iter().zip(expected).map(|(value, expected)| value - *expected));
                    }
                    Input::Innovation => seen.extend(expected.iter().map(|_| 0.0)),
                    Input::Proximity => {
                        let proximity =
                            self.proximity.as_ref().expect("it sees that only where places are told");
                        proximity.show(estimate, seen);
                    }
                    Input::OwnAction | Input::Egocentric => {}
                }
            }
        }
    }

    /// Takes new values, those of its tensors, one after the other. It allocates only while it shares its memory
    /// with other networks.
    ///
    /// # Panics
    /// If there are too few values or too many.
    pub fn renew(&mut self, values: &[f32]) {
        self.network.renew(values);
    }
}

impl PredictorState {
    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, rows: usize) {
        let PredictorState { network, sizes, hearing, expected, expects, .. } = self;
        network.start(rows);
        hearing.start(rows);
        let (_, predicted) = sizes.unwrap_or_default();
        expected.clear();
        expected.resize(rows * predicted, 0.0);
        *expects = false;
    }

    /// What arrives in this step, in a row, of what an agent observed: how many steps ago, if anything does. Of itself an
    /// agent hears in every step.
    pub fn hear(&mut self, row: usize, agent: usize, age: Option<u8>) {
        if self.sizes.is_some() {
            self.hearing.hear(row, agent, age);
        }
    }

    /// Becomes what `other` is, a state of the same predictor. Allocates only for more rows than ever before.
    pub(crate) fn copy_from(&mut self, other: &PredictorState) {
        self.network.copy_from(&other.network);
        self.hearing.copy_from(&other.hearing);
        self.expected.clone_from(&other.expected);
        self.expects = other.expects;
    }

    /// What it saw in the last step, `[rows, inputs]`; empty if that was just the estimates.
    pub fn seen(&self) -> &[f32] {
        &self.seen
    }
}
