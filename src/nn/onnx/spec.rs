//! What is said of ONNX files that decide for agents: what they see, and what they say.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::base::error::Result;
use crate::base::regular;
use crate::nn::networks::{ActorKind, Networks, Sharing};
use crate::nn::{Dims, Meta};
use crate::{failed, usage};

/// What an ONNX actor sees and says; the table `[actor]` of their description. See `docs/onnx.md`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct OnnxSpec {
    /// What it sees.
    pub input: Seen,
    /// Whether it sees which agent it is, as a one-hot behind its other inputs.
    pub agent_id: bool,
    /// What it says.
    pub output: Said,
    /// What is done to what it sees, unless the graph does it itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normalise: Option<Normalisation>,
    /// How an action is chosen.
    pub actions: Choice,
    /// Inputs that carry a state from step to step, and the outputs they are taken from. Those called `X` and `next_X` need
    /// not be named.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub states: BTreeMap<String, String>,
}

/// What an ONNX actor sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Seen {
    /// The joint estimate: the parts of all agents in order, then what is common to all.
    #[default]
    Joint,
    /// The joint estimate, the agent's own part first.
    OwnFirst,
    /// What the agent itself observes, which no link can lose.
    Own,
}

/// What an ONNX actor says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Said {
    /// A logit for each action.
    #[default]
    Logits,
    /// Of each value of an action the mean, then of each the logarithm of the standard deviation; in one output or two.
    MeanLogStd,
}

/// How an action is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// Drawn by its probability, unless the user asks for greedy ones.
    #[default]
    Sampled,
    /// Always the most probable one.
    Greedy,
}

/// `(x - mean) / std`, for each value that is seen, without the agent's id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalisation {
    /// What is taken off.
    pub mean: Vec<f32>,
    /// What the rest is divided by.
    pub std: Vec<f32>,
}

/// A team of ONNX files: the TOML file beside them.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Description {
    /// The task they are for.
    pub task: String,
    /// The file of each agent, or the one of all.
    pub onnx: Files,
    /// What trained them, if it is known.
    pub algorithm: Option<String>,
    /// For how many env steps.
    pub steps: u64,
    /// With which seed.
    pub seed: u64,
    /// What else a reader should know.
    pub origin: Option<String>,
    /// What they see and say.
    pub actor: OnnxSpec,
}

/// Names of files.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected a file name, or a list with one for each agent")]
pub(crate) enum Files {
    /// All agents share it.
    Shared(PathBuf),
    /// That of each agent.
    Separate(Vec<PathBuf>),
}

impl Default for Files {
    fn default() -> Files {
        Files::Separate(Vec::new())
    }
}

impl Description {
    /// More bytes than any description has.
    const LARGEST: u64 = 1 << 20;

    /// What the file at `path` says; `None` if it is no text, but something else.
    ///
    /// # Errors
    /// `Usage` if there is no such file, or it is a text that says something else.
    pub fn read(path: &Path) -> Result<Option<Description>> {
        if path.extension().is_some_and(|extension| extension == "onnx") && path.is_file() {
            let file = path.display();
            return Err(usage!(
                "{file} is an ONNX file, which does not say what it sees; describe it in a TOML file (docs/onnx.md), or make a \
                 policy file of it with `vamaro-swarm import --onnx {file} --task TASK`"
            ));
        }
        // Safetensors begin with a length of eight bytes; of a header that is short enough to be one, the last are zero.
        if path.is_file() && regular::beginning(path, 8)?.iter().any(|byte| *byte < b'\t') {
            return Ok(None);
        }
        let text = regular::read_text(path, Self::LARGEST).unwrap_or_default();
        let says_something = || text.parse::<toml::Table>().is_ok_and(|table| !table.is_empty());
        if path.extension().is_none_or(|extension| extension != "toml") && !says_something() {
            return Ok(None);
        }
        Description::parse(&text, path).map(Some)
    }

    /// What the file at `path` says, which has to be a description.
    ///
    /// # Errors
    /// `Usage` if it is none.
    pub fn open(path: &Path) -> Result<Description> {
        Description::parse(&regular::read_text(path, Self::LARGEST)?, path)
    }

    /// What a text from the file at `path` says. The names of ONNX files are relative to it.
    pub fn parse(text: &str, path: &Path) -> Result<Description> {
        let read = toml::from_str(text);
        let mut description: Description = read.map_err(|error| {
            usage!(
                "{} is no policy file, and no description of ONNX files either (docs/onnx.md): {}",
                path.display(),
                error.to_string().trim_end()
            )
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        match &mut description.onnx {
            Files::Shared(file) => *file = folder.join(&file),
            Files::Separate(files) => files.iter_mut().for_each(|file| *file = folder.join(&file)),
        }
        description.actor.check().map_err(|error| usage!("{}: {error}", path.display()))?;
        Ok(description)
    }

    /// Where the policy comes from.
    pub fn meta(&self) -> Meta {
        let named = |text: &Option<String>, other: &str| text.clone().unwrap_or_else(|| other.to_owned());
        Meta {
            algorithm: named(&self.algorithm, "unknown"),
            steps: self.steps,
            origin: named(&self.origin, "ONNX files"),
            ..Meta::new(&self.task, self.seed)
        }
    }

    /// What the policy is made of.
    pub fn networks(&self) -> Networks {
        let sharing = match self.onnx {
            Files::Shared(_) => Sharing::Shared,
            Files::Separate(_) => Sharing::Separate,
        };
        Networks { sharing, hidden: 0, predictors: Vec::new(), ..Networks::paper(ActorKind::Onnx) }
    }

    /// The content of the files.
    pub fn graphs(&self, dims: &Dims) -> Result<Vec<Vec<u8>>> {
        let files = match &self.onnx {
            Files::Shared(file) => std::slice::from_ref(file),
            Files::Separate(files) => files,
        };
        let expected = self.networks().graph_names(dims).len();
        if files.len() != expected {
            return Err(usage!(
                "{} has {expected} agents, and there are {} ONNX files; name one for each agent, or one that all \
                 share (`onnx = \"FILE\"`)",
                dims.task,
                files.len()
            ));
        }
        files.iter().map(|file| regular::read(file, LARGEST_GRAPH)).collect()
    }
}

/// The most bytes that an ONNX file may have.
pub(crate) const LARGEST_GRAPH: u64 = 64 << 20;

impl OnnxSpec {
    /// Says what is wrong with it by itself.
    pub(crate) fn check(&self) -> std::result::Result<(), String> {
        let Some(Normalisation { mean, std }) = &self.normalise else { return Ok(()) };
        if mean.len() != std.len() {
            return Err(format!("normalise: {} values of `mean`, but {} of `std`", mean.len(), std.len()));
        }
        if !mean.iter().chain(std).all(|value| value.is_finite()) || std.iter().any(|std| *std <= 0.0) {
            return Err("normalise: `mean` and `std` are finite, and no `std` is zero or less".to_owned());
        }
        Ok(())
    }

    /// Which values of the joint estimate agent `agent` sees, in this order, if it sees `width` of them.
    pub(super) fn view(&self, agent: usize, dims: &Dims, width: usize) -> Result<Vec<Range<usize>>> {
        let unique = dims.predicted / dims.n_agents;
        let part = |agent: usize| agent * unique..(agent + 1) * unique;
        let common = dims.predicted..dims.joint;
        let id = if self.agent_id { dims.n_agents } else { 0 };
        // Without its padding or with it: a file that agents share sees them alike.
        let own = dims.agents.get(agent).map_or(unique, |agent| agent.observation.len());
        let bare = part(agent).start..part(agent).start + own;
        let views = match self.input {
            Seen::Joint => vec![vec![0..dims.joint]],
            Seen::OwnFirst => {
                let others = (0..dims.n_agents).filter(|other| *other != agent);
                vec![std::iter::once(agent).chain(others).map(part).chain([common]).collect()]
            }
            Seen::Own => vec![vec![bare, common.clone()], vec![part(agent), common]],
        };
        let length = |view: &[Range<usize>]| view.iter().map(Range::len).sum::<usize>();
        if let Some(view) = views.iter().find(|view| length(view) + id == width) {
            return self.fits(length(view)).map(|()| view.clone());
        }
        let (whole, own) = (dims.joint, own + dims.joint - dims.predicted);
        Err(usage!(
            "its actor sees {width} values, but {}{} has {} (a joint estimate of {} has {whole}, an own observation {own}); \
             say what it sees by `input` and `agent-id` in the description",
            match self.input {
                Seen::Joint | Seen::OwnFirst => "a joint estimate",
                Seen::Own => "its own observation",
            },
            if self.agent_id { " with the agent's id" } else { "" },
            length(&views[0]) + id,
            dims.task,
        ))
    }

    /// An error if what is seen is not what can be normalised.
    fn fits(&self, seen: usize) -> Result<()> {
        match &self.normalise {
            Some(Normalisation { mean, .. }) if mean.len() != seen => {
                Err(usage!("normalise: {} values of `mean` and `std`, but the actor sees {seen}", mean.len()))
            }
            _ => Ok(()),
        }
    }

    /// What the metadata of a policy file says.
    pub(crate) fn from_json(text: &str, source: &str) -> Result<OnnxSpec> {
        let read: std::result::Result<OnnxSpec, _> = serde_json::from_str(text);
        let spec = read.map_err(|error| failed!("{source}: cannot read `onnx` in its metadata: {error}"))?;
        spec.check().map_err(|error| failed!("{source}: `onnx` in its metadata: {error}"))?;
        Ok(spec)
    }
}
