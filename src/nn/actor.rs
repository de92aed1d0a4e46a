//! What decides for an agent: a network of ours, or an ONNX graph. Only here is it known which.

use super::inference::{Inference, NetworkState, Scratch};
use super::onnx::{OnnxActor, OnnxState, at_home};
use super::senses::Senses;
use crate::base::error::Result;

/// The actor of an agent: from joint estimates, and what it hears if it sees that, to logits.
#[derive(Clone, Debug)]
pub struct Actor(Kind);

#[derive(Clone, Debug)]
enum Kind {
    /// With its senses before anything is heard, unless it just sees estimates.
    Network(Inference, Option<Senses>),
    Onnx(OnnxActor),
}

/// What an actor remembers of an episode, and what it has heard of the step under way.
#[derive(Clone, Debug, PartialEq)]
pub struct ActorState(State);

#[derive(Clone, Debug, PartialEq)]
enum State {
    Network(NetworkState, Option<Senses>),
    Onnx(OnnxState),
}

impl Actor {
    /// A network with these senses, if it has any.
    pub(super) fn of_network(network: Inference, senses: Option<Senses>) -> Actor {
        Actor(Kind::Network(network, senses))
    }

    /// How many values of each row it is given: a joint estimate.
    pub fn n_inputs(&self) -> usize {
        match &self.0 {
            Kind::Network(network, senses) => network.n_inputs() - senses.as_ref().map_or(0, Senses::width),
            Kind::Onnx(actor) => actor.n_inputs(),
        }
    }

    /// The same actor where each row says whose it is, if it is a network that agents share. See [`Inference::by_row`].
    pub(crate) fn by_row(&self) -> Actor {
        match &self.0 {
            Kind::Network(network, senses) if network.is_shared() => {
                Actor::of_network(network.by_row(), senses.as_ref().map(Senses::by_row))
            }
            Kind::Network(..) | Kind::Onnx(_) => self.clone(),
        }
    }

    /// The same actor for a guess of what it would do, if it is a network of ours. See [`Inference::roughly`].
    pub(crate) fn roughly(&self) -> Actor {
        match &self.0 {
            Kind::Network(network, senses) => Actor::of_network(network.roughly(), senses.clone()),
            Kind::Onnx(_) => self.clone(),
        }
    }

    /// One step of `rows` episodes: `state`, which has [heard](ActorState::hear) what arrived, advances, and `out`
    /// `[rows, actions]` becomes the logits of what is seen in `estimates` `[rows, joint]`. Where each row says whose it is,
    /// `ids` `[rows]` has that; others do not look at it.
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
            (Kind::Network(network, _), State::Network(state, senses)) => {
                let seen = senses.as_mut().map_or(estimates, |senses| senses.see(rows, estimates, ids));
                network.step(rows, seen, ids, state, scratch, out);
                Ok(())
            }
            (Kind::Onnx(actor), State::Onnx(state)) => actor.step(rows, estimates, state, out),
            _ => unreachable!("a state is that of its actor"),
        }
    }

    /// Computes what the next step takes of the state alone. See [`Inference::prepare`].
    pub fn prepare(&self, rows: usize, state: &mut ActorState) {
        if let (Kind::Network(network, _), State::Network(state, _)) = (&self.0, &mut state.0) {
            network.prepare(rows, state);
        }
    }

    /// The state in which `rows` episodes start.
    pub fn state(&self, rows: usize) -> ActorState {
        ActorState(match &self.0 {
            Kind::Network(network, senses) => {
                let mut senses = senses.clone();
                senses.iter_mut().for_each(|senses| senses.start(rows));
                State::Network(network.state(rows), senses)
            }
            Kind::Onnx(actor) => State::Onnx(actor.state(rows)),
        })
    }

    /// The network that it is.
    #[cfg(test)]
    pub(super) fn network(&self) -> &Inference {
        match &self.0 {
            Kind::Network(network, _) => network,
            Kind::Onnx(_) => panic!("it is an ONNX graph"),
        }
    }

    /// Does `work` on the thread where its steps are computed anyway, so that none of them has to change threads, and what the
    /// kernel is asked for holds for them. For our networks that is this one.
    pub(crate) fn at_home<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.0 {
            Kind::Network(..) => work(),
            Kind::Onnx(_) => at_home(work),
        }
    }

    /// Takes new values of its weights. An ONNX graph has none that change.
    pub fn renew(&mut self, values: &[f32]) {
        if let Kind::Network(network, _) = &mut self.0 {
            network.renew(values);
        }
    }
}

impl ActorState {
    /// Forgets everything: `rows` episodes start.
    pub fn start(&mut self, rows: usize) {
        match &mut self.0 {
            State::Network(state, senses) => {
                state.start(rows);
                senses.iter_mut().for_each(|senses| senses.start(rows));
            }
            State::Onnx(state) => state.start(rows),
        }
    }

    /// What arrives in this step, in a row, of what an agent observed: how many steps ago, if anything does. Of itself an
    /// agent hears in every step. An actor that sees estimates alone does not mind.
    pub fn hear(&mut self, row: usize, agent: usize, age: Option<u8>) {
        if let State::Network(_, Some(senses)) = &mut self.0 {
            senses.hear(row, agent, age);
        }
    }

    /// Remembers in the row `to` what it does in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        match &mut self.0 {
            State::Network(state, senses) => {
                state.copy_row(from, to);
                senses.iter_mut().for_each(|senses| senses.copy_row(from, to));
            }
            State::Onnx(state) => state.copy_row(from, to),
        }
    }
}

impl From<OnnxActor> for Actor {
    fn from(actor: OnnxActor) -> Actor {
        Actor(Kind::Onnx(actor))
    }
}
