//! Actors that are ONNX files. See `docs/onnx.md`.
//!
//! ```text
//!     joint estimate -> what the actor sees, normalised, its state -> graph -> logits, its next state
//! ```
//!
//! A [`Description`] names files and says what they see and say; a policy file holds both, with the predictors and dynamics
//! that have been fitted to them.

mod actor;
#[cfg_attr(not(feature = "onnx"), path = "no_runtime.rs")]
mod runtime;
mod spec;
#[cfg(any(feature = "onnx", test))]
mod wire;

pub(super) use actor::{OnnxActor, OnnxState};
pub(super) use runtime::at_home;
pub use spec::{Choice, Normalisation, OnnxSpec, Said, Seen};
pub(crate) use spec::{Description, Files, LARGEST_GRAPH};

use std::sync::Arc;

use runtime::Runtime;

use super::Dims;
use crate::base::error::{Error, Result};

/// The ONNX files of a policy.
#[derive(Clone, Debug)]
pub(super) struct Graphs {
    pub spec: OnnxSpec,
    /// That of each agent, or the one of all.
    pub graphs: Vec<Arc<Graph>>,
}

/// An ONNX file.
#[derive(Debug)]
pub(super) struct Graph {
    /// Its content.
    pub bytes: Vec<u8>,
    runtime: Runtime,
}

/// An input or output of a graph.
#[derive(Clone, Debug)]
struct Port {
    name: String,
    /// One where a size is left open.
    shape: Vec<usize>,
    /// Whether its values are whole numbers, or true and false.
    whole: bool,
}

impl Graphs {
    /// Those in the content of these files.
    ///
    /// # Errors
    /// `Usage` if one cannot be run.
    pub fn load(files: Vec<Vec<u8>>, spec: OnnxSpec, source: &str) -> Result<Graphs> {
        let count = files.len();
        let graph = |(at, bytes): (usize, Vec<u8>)| {
            let runtime = Runtime::load(bytes.clone());
            let runtime =
                runtime.map_err(|error| Error::Usage(format!("{source}: {}: {error}", name(at, count))))?;
            Ok(Arc::new(Graph { bytes, runtime }))
        };
        Ok(Graphs { spec, graphs: files.into_iter().enumerate().map(graph).collect::<Result<_>>()? })
    }

    /// The content of its files.
    pub fn files(&self) -> impl Iterator<Item = &[u8]> {
        self.graphs.iter().map(|graph| &graph.bytes[..])
    }

    /// The actor of an agent.
    ///
    /// # Errors
    /// `Usage` if its graph does not see or say what it should.
    pub fn actor(&self, agent: usize, dims: &Dims, source: &str) -> Result<OnnxActor> {
        let count = self.graphs.len();
        let graph = &self.graphs[agent.min(count - 1)];
        let actor = OnnxActor::new(graph.clone(), &self.spec, agent, dims);
        actor.map_err(|error| Error::Usage(format!("{source}: {}: {error}", name(agent, count))))
    }
}

/// What the file of an agent is called in words.
fn name(agent: usize, count: usize) -> String {
    if count == 1 { "the ONNX file".to_owned() } else { format!("the ONNX file of agent {agent}") }
}
