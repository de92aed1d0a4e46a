//! What decides for an agent: a network of ours, or an ONNX graph. Only here is it known which.

use super::inference::{Inference, NetworkState, Scratch};
use super::onnx::{OnnxActor, OnnxState, at_home};
use crate::base::error::Result;

/// The actor of an agent: from joint estimates to logits.
#[derive(Clone, Debug)]
pub struct Actor(Kind);

#[derive(Clone, Debug)]
enum Kind {
    Network(Inference),
    Onnx(OnnxActor),
}

/// What an actor remembers of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct ActorState(State);

#[derive(Clone, Debug, PartialEq)]
enum State {
    Network(NetworkState),
    Onnx(OnnxState),
}

impl Actor {
    /// How many values of each row it is given: a joint estimate.
    pub fn n_inputs(&self) -> usize {
        match &self.0 {
            Kind::Network(network) => network.n_inputs(),
            Kind::Onnx(actor) => actor.n_inputs(),
        }
    }

    /// The same actor where each row says whose it is, if it is a network that agents share. See [`Inference::by_row`].
    pub(crate) fn by_row(&self) -> Actor {
        match &self.0 {
            Kind::Network(network) => network.by_row().into(),
            Kind::Onnx(_) => self.clone(),
        }
    }

    /// The same actor for a guess of what it would do, if it is a network of ours. See [`Inference::roughly`].
    pub(crate) fn roughly(&self) -> Actor {
        match &self.0 {
            Kind::Network(network) => network.roughly().into(),
            Kind::Onnx(_) => self.clone(),
        }
    }

    /// One step of `rows` episodes: `state` advances, and `out` `[rows, actions]` becomes the logits of what is seen in
    /// `estimates` `[rows, joint]`. Where each row says whose it is, `ids` `[rows]` has that; others do
    /// not look at it.
    ///
    /// # Errors
    /// `Failed` if the graph of an ONNX file fails, or says something that is not finite; a network of ours never does.
    ///
    /// # Panics
    /// If the state is that of another kind of actor.
    pub fn step(
        &self,
        rows: usize,
        estimates: &[f32],
        ids: &[usize],
        state: &mut ActorState,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) -> Result<()> {
        match (&self.0, &mut state.0) {
            (Kind::Network(network), State::Network(state)) => {
                network.step(rows, estimates, ids, state, scratch, out);
                Ok(())
            }
            (Kind::Onnx(actor), State::Onnx(state)) => actor.step(rows, estimates, state, out),
            _ => unreachable!("a state is that of its actor"),
        }
    }

    /// Computes what the next step takes of the state alone. See [`Inference::prepare`].
    pub fn prepare(&self, rows: usize, state: &mut ActorState) {
        if let (Kind::Network(network), State::Network(state)) = (&self.0, &mut state.0) {
            network.prepare(rows, state);
        }
    }

    /// The state in which `rows` episodes start.
    pub fn state(&self, rows: usize) -> ActorState {
        ActorState(match &self.0 {
            Kind::Network(network) => State::Network(network.state(rows)),
            Kind::Onnx(actor) => State::Onnx(actor.state(rows)),
        })
    }

    /// The network that it is.
    #[cfg(test)]
    pub(super) fn network(&self) -> &Inference {
        match &self.0 {
            Kind::Network(network) => network,
            Kind::Onnx(_) => panic!("it is an ONNX graph"),
        }
    }

    /// Does `work` on the thread where its steps are computed anyway, so that none of them has to change threads, and what the
    /// kernel is asked for holds for them. For our networks that is this one.
    pub(crate) fn at_home<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.0 {
            Kind::Network(_) => work(),
            Kind::Onnx(_) => at_home(work),
        }
    }

    /// Takes new values of its weights. An ONNX graph has none that change.
    pub fn renew(&mut self, values: &[f32]) {
        if let Kind::Network(network) = &mut self.0 {
            network.renew(values);
        }
    }
}

impl ActorState {
    /// Forgets everything: `rows` episodes start.
    pub fn start(&mut self, rows: usize) {
        match &mut self.0 {
            State::Network(state) => state.start(rows),
            State::Onnx(state) => state.start(rows),
        }
    }

    /// Remembers in the row `to` what it does in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        match &mut self.0 {
            State::Network(state) => state.copy_row(from, to),
            State::Onnx(state) => state.copy_row(from, to),
        }
    }
}

impl From<Inference> for Actor {
    fn from(network: Inference) -> Actor {
        Actor(Kind::Network(network))
    }
}

impl From<OnnxActor> for Actor {
    fn from(actor: OnnxActor) -> Actor {
        Actor(Kind::Onnx(actor))
    }
}
