//! Running a network step by step: its weights, its state, and the scratch memory of a pass.

use super::kernels::{self, Start};
use super::network::{Layer, Network};
use super::weights::{Line, Tensor};

/// A network with its weights, ready to run: an actor, or what is inside a [`Predictor`](super::Predictor).
#[derive(Clone, Debug)]
pub struct Inference {
    inputs: usize,
    layers: Vec<Weighted>,
    /// Cache lines that all layers need room for, of each row.
    lines: usize,
    /// Where the one is of the one-hot behind every input, if it is always there: the agent's id in a network that all
    /// agents share.
    id: Option<usize>,
}

/// A layer with its weights.
#[derive(Clone, Debug)]
struct Weighted {
    layer: Layer,
    tensors: Vec<Tensor>,
    /// How many values of its first tensor are for its input. Those behind them are for the one-hot.
    seen: usize,
}

/// What a network remembers of an episode: the states of its cells.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkState(Vec<CellState>);

/// The state of a layer, empty unless it is a cell.
#[derive(Clone, Debug, Default, PartialEq)]
struct CellState {
    hidden: Vec<f32>,
    /// The cell state of an LSTM; what the hidden state of a GRU contributes to the gates of its next step.
    second: Vec<f32>,
    /// How many values of `hidden` and `second` a row has.
    sizes: [usize; 2],
    /// Whether `second` of a GRU is what it should be.
    is_ahead: bool,
}

impl Inference {
    /// With the tensors of [`Network::tensors`].
    pub(super) fn new<'a>(
        network: &Network,
        id: Option<usize>,
        mut tensors: impl Iterator<Item = &'a Tensor>,
    ) -> Inference {
        let of = |(at, &layer): (usize, &Layer)| {
            let tensors: Vec<_> = tensors.by_ref().take(layer.n_tensors()).cloned().collect();
            let sees_inputs = at == 0 || matches!(layer, Layer::Skip { .. });
            let ones = if sees_inputs { network.ones } else { 0 };
            Weighted { layer, seen: tensors[0].len() - ones * layer.room(), tensors }
        };
        let layers = network.layers.iter().enumerate().map(of).collect();
        let lines = network.layers.iter().map(|layer| layer.room().div_ceil(Line::VALUES)).sum();
        Inference { inputs: network.inputs, layers, lines, id }
    }

    /// How many values of each row it is given.
    pub fn n_inputs(&self) -> usize {
        self.inputs
    }

    /// Whether agents share it.
    pub fn is_shared(&self) -> bool {
        self.id.is_some()
    }

    /// The same network where each row says whose it is: `acts` of [`step`](Inference::step) has the agent's id, if it sees
    /// that.
    pub(crate) fn by_row(&self) -> Inference {
        Inference { id: None, ..self.clone() }
    }

    /// The same network for a guess of what it says: the weights between its hidden layers, which are most of what it has,
    /// are taken as [`Nibbles`](kernels::Nibbles).
    pub(crate) fn roughly(&self) -> Inference {
        let mut network = self.clone();
        let [_, hidden @ .., _] = &mut network.layers[..] else { return network };
        for Weighted { layer, tensors, .. } in hidden {
            // Behind the weights of a layer come as many biases.
            for weight in &mut tensors[..layer.n_tensors() / 2] {
                *weight = weight.roughly();
            }
        }
        network
    }

    /// One step of `rows` episodes: `state` advances, and `out` `[rows, outputs]` becomes what the network makes of
    /// `inputs` `[rows, inputs]`. A network that sees an agent's action has the number of that in `acts` `[rows]`; others do
    /// not look at it.
    pub fn step(
        &self,
        rows: usize,
        inputs: &[f32],
        acts: &[usize],
        state: &mut NetworkState,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        assert_eq!(inputs.len(), rows * self.inputs, "the inputs of a network are not [rows, inputs]");
        let (skip, layers) = match &self.layers[..] {
            [layers @ .., skip @ Weighted { layer: Layer::Skip { .. }, .. }] => (Some(skip), layers),
            layers => (None, layers),
        };
        let (last, layers) = layers.split_last().expect("a network has layers");
        let mut room = scratch.room(rows * self.lines);
        let mut x = inputs;
        for (weighted, state) in layers.iter().zip(&mut state.0) {
            let Weighted { layer, tensors, .. } = weighted;
            let part = room.take(rows * layer.room());
            x = match *layer {
                Layer::Linear { relu, .. } => {
                    self.linear(rows, x, acts, weighted, part);
                    if relu {
                        kernels::relu(part);
                    }
                    part
                }
                Layer::Gru(_) => {
                    state.look_ahead(rows, tensors);
                    let [w_ih, _, b_ih, _] = each(tensors);
                    product(rows, x, w_ih, 0, Start::Bias(b_ih.values()), part);
                    kernels::gru_gates(rows, part, &state.second, &mut state.hidden);
                    state.is_ahead = false;
                    &state.hidden
                }
                Layer::Lstm(_) => {
                    let [w_ih, w_hh, b_ih, b_hh] = each(tensors);
                    product(rows, x, w_ih, 0, Start::Bias(b_ih.values()), part);
                    product(rows, &state.hidden, w_hh, 0, Start::Output, part);
                    kernels::lstm_gates(rows, part, b_hh.values(), &mut state.hidden, &mut state.second);
                    &state.hidden
                }
                Layer::Skip { .. } => unreachable!("a skip is the last layer"),
            };
        }
        self.linear(rows, x, acts, last, out);
        if let Some(skip) = skip {
            self.linear(rows, inputs, acts, skip, out);
        }
    }

    /// `y = x @ weight + bias`, or `y += x @ weight` where there is no bias. Of a one-hot behind `x` the one multiplies one
    /// row of the weight and zeros all others, so adding that row last is bit-identical to the whole product.
    fn linear(&self, rows: usize, x: &[f32], acts: &[usize], weighted: &Weighted, y: &mut [f32]) {
        let Weighted { tensors, seen, .. } = weighted;
        let start = tensors.get(1).map_or(Start::Output, |bias| Start::Bias(bias.values()));
        product(rows, x, &tensors[0], 0, start, y);
        if *seen < tensors[0].len() {
            let outputs = y.len() / rows;
            assert!(self.id.is_some() || acts.len() == rows, "every row has its act");
            for (row, y) in y.chunks_exact_mut(outputs).enumerate() {
                let one = self.id.unwrap_or_else(|| acts[row]);
                product(1, &[1.0], &tensors[0], seen + one * outputs, Start::Output, y);
            }
        }
    }

    /// Computes what the next step takes of the state alone, half the work of a GRU. A step sees to it itself, but
    /// whoever calls this when an action is out has the next one sooner, by the same bits.
    pub fn prepare(&self, rows: usize, state: &mut NetworkState) {
        for (Weighted { layer, tensors, .. }, state) in self.layers.iter().zip(&mut state.0) {
            if let Layer::Gru(_) = layer {
                state.look_ahead(rows, tensors);
            }
        }
    }

    /// The state in which `rows` episodes start: zero.
    pub fn state(&self, rows: usize) -> NetworkState {
        let sizes = self.layers.iter().map(|weighted| match weighted.layer {
            Layer::Linear { .. } | Layer::Skip { .. } => [0, 0],
            Layer::Gru(size) => [size, 3 * size],
            Layer::Lstm(size) => [size, size],
        });
        let cells = sizes.map(|sizes| CellState { sizes, ..CellState::default() });
        let mut state = NetworkState(cells.collect());
        state.start(rows);
        state
    }

    /// Takes new values, those of [`Network::tensors`], one tensor after the other. It allocates only while it shares
    /// its memory with other networks.
    ///
    /// # Panics
    /// If there are too few values or too many.
    pub fn renew(&mut self, mut values: &[f32]) {
        let tensors = self.layers.iter_mut().flat_map(|weighted| &mut weighted.tensors);
        tensors.for_each(|tensor| tensor.renew(&mut values));
        assert!(values.is_empty(), "a network got more values than it has weights");
    }
}

impl NetworkState {
    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, rows: usize) {
        for CellState { hidden, second, sizes, is_ahead } in &mut self.0 {
            for (values, size) in [hidden, second].into_iter().zip(sizes) {
                values.clear();
                values.resize(rows * *size, 0.0);
            }
            *is_ahead = false;
        }
    }

    /// Remembers in the row `to` what it does in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        for CellState { hidden, second, sizes, .. } in &mut self.0 {
            for (values, size) in [hidden, second].into_iter().zip(*sizes) {
                values.copy_within(from * size..(from + 1) * size, to * size);
            }
        }
    }

    /// Becomes what `other` is, a state of the same network. Allocates only for more rows than ever before.
    pub fn copy_from(&mut self, other: &NetworkState) {
        for (to, from) in self.0.iter_mut().zip(&other.0) {
            to.hidden.clone_from(&from.hidden);
            to.second.clone_from(&from.second);
            to.is_ahead = from.is_ahead;
        }
    }
}

impl CellState {
    /// Computes what a GRU's next step takes of its state alone, unless that has been done.
    fn look_ahead(&mut self, rows: usize, tensors: &[Tensor]) {
        if !self.is_ahead {
            let [_, w_hh, _, b_hh] = each(tensors);
            product(rows, &self.hidden, w_hh, 0, Start::Bias(b_hh.values()), &mut self.second);
            self.is_ahead = true;
        }
    }
}

impl Layer {
    /// How many values it needs room for, of each row: an output, or gates.
    fn room(self) -> usize {
        match self {
            Layer::Linear { outputs, .. } | Layer::Skip { outputs, .. } => outputs,
            Layer::Gru(size) => 3 * size,
            Layer::Lstm(size) => 4 * size,
        }
    }
}

fn each<const N: usize>(tensors: &[Tensor]) -> [&Tensor; N] {
    std::array::from_fn(|at| &tensors[at])
}

/// Whether steps of so many rows run on f16 as it is. With more, a product is about arithmetic, not about reading its weight.
pub(super) fn run_on_halves(rows: usize) -> bool {
    rows < 4 && kernels::take_halves()
}

/// `y = x @ weight + start`, of that part of the weight which begins `from` there and meets `x`. Of few rows it reads f16
/// where the weight is that: half as much, and the same bits. A weight that is taken roughly is taken as a whole.
fn product(rows: usize, x: &[f32], weight: &Tensor, from: usize, start: Start, y: &mut [f32]) {
    let (k, n) = (x.len().checked_div(rows).unwrap_or(0), y.len().checked_div(rows).unwrap_or(0));
    let part = from..from + k * n;
    match (weight.nibbles(n), weight.halves()) {
        (Some(nibbles), _) => kernels::linear_of_nibbles(rows, x, nibbles, start, y),
        (None, Some(halves)) if run_on_halves(rows) => {
            kernels::linear_of_halves(rows, x, &halves[part], start, y);
        }
        _ => kernels::linear(rows, x, &weight.values()[part], start, y),
    }
}

/// Memory for what lies between the layers of a forward pass.
///
/// It grows to the largest pass that it sees; from then on a pass allocates nothing. Any network can use any
/// scratch: nothing in it outlives a pass.
#[derive(Clone, Debug, Default)]
pub struct Scratch(Vec<Line>);

/// What is left of a scratch.
struct Room<'a>(&'a mut [Line]);

impl Scratch {
    /// Room for so many cache lines.
    fn room(&mut self, lines: usize) -> Room<'_> {
        if self.0.len() < lines {
            self.0.resize(lines, Line::ZERO);
        }
        Room(&mut self.0)
    }
}

impl<'a> Room<'a> {
    /// The next part, on a cache line, with arbitrary content.
    fn take(&mut self, length: usize) -> &'a mut [f32] {
        let part =
            self.0.split_off_mut(..length.div_ceil(Line::VALUES)).expect("there is room for every part");
        &mut bytemuck::cast_slice_mut(part)[..length]
    }
}
