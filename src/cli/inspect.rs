//! `inspect`: what a file holds.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::{policy_file, print, print_json, table, tell};
use crate::base::error::Result;
use crate::base::stats::mean;
use crate::nn::{Input, Meta, OnnxSpec, PolicyFile, PredictorSpec, Said, Seen, Sigma};
use crate::recording::{Episode, Presence, Reader};
use crate::train::{Checkpoint, Progress};
use crate::usage;
use crate::verify::FileKind;

/// Show what a policy, checkpoint, trace or recording holds
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm inspect runs/hs-0
  vamaro-swarm inspect runs/hs-0/checkpoint.safetensors
  vamaro-swarm inspect trace.json --json")]
pub struct Inspect {
    /// A policy file or checkpoint (.safetensors), a description of ONNX files (.toml), a trace or recording, the folder of
    /// a training run, or, in a checkout, the name of a pretrained policy, such as hear-see/seed-1
    file: PathBuf,

    /// Print it as one JSON object
    #[arg(long)]
    json: bool,
}

/// What a file holds.
struct Content {
    text: String,
    /// See `docs/formats.md`.
    json: Value,
}

impl Inspect {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let file = &policy_file(&self.file);
        let Content { text, json } = match FileKind::of(file)? {
            FileKind::Policy => policy(file)?,
            FileKind::Tensors => match Checkpoint::open(file) {
                Ok(opened) => checkpoint(&opened),
                Err(_) => policy(file)?,
            },
            FileKind::Recording => recording(file)?,
            FileKind::StateDict => {
                return Err(usage!(
                    "{} is a PyTorch state dict; `vamaro-swarm import` converts it to a policy file",
                    file.display()
                ));
            }
            // If it says what a policy says, there is more to tell of what it says wrong.
            FileKind::Unknown if file.extension().is_some_and(|extension| extension == "toml") => {
                policy(file)?
            }
            FileKind::Updates | FileKind::Json(_) | FileKind::Unknown => {
                return Err(usage!("{} is neither a policy file nor a trace or recording", file.display()));
            }
        };
        if self.json { print_json(&json) } else { print(&text) }
    }
}

fn policy(path: &Path) -> Result<Content> {
    let file = PolicyFile::read(path)?;
    let (meta, networks) = (&file.meta, &file.networks);
    // The actors of a fitted imputer are there because every policy file has some.
    let is_imputer = meta.algorithm == Meta::IMPUTER;
    let tensors = file.tensors.iter().filter(|tensor| !(is_imputer && tensor.name.starts_with("actors.")));
    let tensors: Vec<_> = tensors.collect();
    let actors = (!is_imputer).then_some((networks.actor, networks.sharing, networks.hidden));
    let (kind, actor) = match actors {
        Some((actor, sharing, hidden)) => {
            let network = || format!("hidden {hidden}{}", senses_words(&networks.actor_inputs));
            let about = file.onnx.as_ref().map_or_else(network, onnx_words);
            ("policy", format!("{actor}, {sharing}, {about}"))
        }
        None => ("imputer", "none: the team acts elsewhere".to_owned()),
    };
    let parameters: usize = tensors.iter().map(|tensor| tensor.n_values()).sum();
    let rows = tensors.iter().map(|tensor| {
        vec![tensor.name.clone(), format!("{:?}", tensor.shape), tensor.n_values().to_string()]
    });
    let graphs = file
        .graphs
        .iter()
        .map(|(name, bytes)| vec![name.clone(), "ONNX".to_owned(), format!("{} bytes", bytes.len())]);
    let rows = table(&["tensor", "shape", "values"], rows.chain(graphs));
    let predictors: Vec<String> = networks.predictors.iter().map(predictor_words).collect();
    let imputer = meta.imputer.as_ref().map(|name| format!("imputer     {name}, as in training\n"));
    let text = format!(
        "{kind} for {}\nalgorithm   {}\norigin      {}\nwritten by  {}\nactor       {actor}\n{}\
         predictors  {}\ndynamics    {}\nparameters  {parameters}\n\n{rows}",
        meta.task,
        training_words(meta),
        meta.origin,
        meta.program,
        imputer.unwrap_or_default(),
        if predictors.is_empty() { "none".to_owned() } else { predictors.join(", ") },
        if file.dynamics.is_some() { "fitted" } else { "none" },
    );
    let tensors = tensors.iter().map(|tensor| json!({"name": tensor.name, "shape": tensor.shape}));
    let mut json = json!({
        "kind": kind,
        "task": meta.task,
        "algorithm": meta.algorithm,
        "steps": meta.steps,
        "seed": meta.seed,
        "origin": meta.origin,
        "program": meta.program,
        "actor": actors.map(|(actor, ..)| actor),
        "sharing": actors.map(|(_, sharing, _)| sharing),
        "hidden": actors.map(|(.., hidden)| hidden),
        "predictors": networks.predictors,
        "dynamics": file.dynamics.is_some(),
        "parameters": parameters,
        "tensors": tensors.collect::<Vec<_>>(),
    });
    if let Some(onnx) = &file.onnx {
        json["onnx"] = json!(onnx);
    }
    if networks.actors_have_senses() {
        json["actor_inputs"] = json!(networks.actor_inputs);
    }
    if let Some(imputer) = &meta.imputer {
        json["imputer"] = json!(imputer);
    }
    Ok(Content { text, json })
}

/// What ONNX actors see and say.
fn onnx_words(spec: &OnnxSpec) -> String {
    let sees = match spec.input {
        Seen::Joint => "the joint estimate",
        Seen::OwnFirst => "the joint estimate, its own part first",
        Seen::Own => "its own observation",
    };
    let says = match spec.output {
        Said::Logits => "logits",
        Said::MeanLogStd => "means and log-stds",
    };
    let id = if spec.agent_id { " and its id" } else { "" };
    let normalised = if spec.normalise.is_some() { ", normalised" } else { "" };
    format!("sees {sees}{id}{normalised}, says {says}")
}

/// How it was trained, as far as it says.
fn training_words(meta: &Meta) -> String {
    match (&meta.algorithm[..], meta.steps, meta.seed) {
        ("unknown", 0, 0) => "unknown, and so are env steps and seed".to_owned(),
        (algorithm, steps, seed) => format!("{algorithm}, {steps} env steps, seed {seed}"),
    }
}

fn predictor_words(predictor: &PredictorSpec) -> String {
    let PredictorSpec { name, hidden, .. } = predictor;
    let sees = senses_words(&predictor.inputs);
    let skip = if predictor.skip { ", skip" } else { "" };
    let sigma = if predictor.sigma == Sigma::SoftBounded { ", soft-bounded sigma" } else { "" };
    format!("{name} (hidden {hidden}{sees}{skip}{sigma})")
}

/// What a network sees more than estimates.
fn senses_words(inputs: &[Input]) -> String {
    let words = inputs.iter().map(|input| match input {
        Input::Estimate => "",
        Input::Egocentric => ", egocentric",
        Input::Delivered => ", sees what arrives",
        Input::Age => ", sees ages",
        Input::Innovation => ", sees innovations",
        Input::Proximity => ", sees who is near",
        Input::OwnAction => ", sees the own action",
    });
    words.collect()
}

fn checkpoint(checkpoint: &Checkpoint) -> Content {
    let Progress { episodes, rows, seconds, .. } = checkpoint.progress;
    let text = format!(
        "checkpoint of a training run\nprogress    {} of {} env steps, {episodes} episodes, {rows} rows of metrics\n\
         time        {seconds:.1} s\n\n{}",
        checkpoint.progress.timestep(),
        checkpoint.config.steps,
        checkpoint.config.to_toml()
    );
    let json = json!({
        "kind": "checkpoint",
        "timesteps": checkpoint.progress.timestep(),
        "episodes": episodes,
        "rows": rows,
        "trained_s": seconds,
        "config": checkpoint.config,
    });
    Content { text, json }
}

fn recording(path: &Path) -> Result<Content> {
    let mut recording = Reader::open(path)?;
    let (header, is_trace) = (recording.header.clone(), recording.is_trace());
    let (mut episodes, mut befell) = (Vec::new(), Befell::default());
    for (number, episode) in (0..).zip(recording.by_ref()) {
        let episode = episode?;
        let of_this = Befell::of(&episode);
        befell = befell.and(&of_this);
        episodes.push(Listed {
            number: episode.episode.unwrap_or(number),
            p: episode.p,
            episode_return: episode.episode_return,
            delivery_rate: delivered_share(&episode),
            befell: of_this,
        });
    }
    if let Some(what) = recording.unfinished() {
        tell(&format!("note: {}: {what}", path.display()));
    }
    let returns: Vec<f64> = episodes.iter().map(|episode| episode.episode_return).collect();
    let rows = episodes.iter().take(MOST_ROWS).map(|episode| {
        vec![
            episode.number.to_string(),
            episode.p.map_or("-".to_owned(), |p| format!("{p:.3}")),
            format!("{:.2}", episode.episode_return),
            episode.delivery_rate.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share)),
        ]
    });
    let rows = table(&["episode", "p", "return", "delivered"], rows);
    let more = match returns.len() {
        0..=MOST_ROWS => String::new(),
        all => format!("and {} more\n", all - MOST_ROWS),
    };
    let named = |value: &Option<String>| value.clone().unwrap_or_else(|| "unknown".to_owned());
    let kind = if is_trace { "trace" } else { "recording" };
    let text = format!(
        "{} of {}{}{}\nagents      {}\nepisodes    {} of {} steps, mean return {:.2}\nactor       {}\nimputer     {}\n\
         policy      {}\n{}\n{rows}{more}",
        kind,
        header.task,
        header.physics.if_other(),
        if header.relay { ", relayed" } else { "" },
        header.n_agents,
        episodes.len(),
        header.episode_steps,
        mean(&returns),
        named(&header.actor),
        named(&header.imputer),
        named(&header.policy),
        befell.words()
    );
    let listed = episodes.iter().map(|episode| {
        let Befell { absent, missed, late } = episode.befell;
        json!({
            "episode": episode.number,
            "p": episode.p,
            "return": episode.episode_return,
            "delivery_rate": episode.delivery_rate,
            "absent": absent,
            "missed": missed,
            "late": late,
        })
    });
    let json = json!({
        "kind": kind,
        "about": header,
        "return_mean": mean(&returns),
        "episodes": listed.collect::<Vec<_>>(),
    });
    Ok(Content { text, json })
}

/// What is said of an episode.
struct Listed {
    number: u64,
    p: Option<f64>,
    episode_return: f64,
    delivery_rate: Option<f64>,
    befell: Befell,
}

/// Episodes that are listed one by one.
const MOST_ROWS: usize = 20;

/// Over i != j and t >= 1, of those who were there; `None` if nothing was sent.
fn delivered_share(episode: &Episode) -> Option<f64> {
    let (mut sent, mut received) = (0, 0);
    for (step, rows) in episode.delivered.iter().enumerate().skip(1) {
        for (i, row) in rows.iter().enumerate().filter(|(i, _)| episode.presence(step, *i).decided()) {
            for (j, up) in row.iter().enumerate().filter(|(j, _)| *j != i) {
                sent += usize::from(episode.presence(step, j) != Presence::Absent);
                received += usize::from(*up == 1);
            }
        }
    }
    (sent > 0).then(|| received as f64 / sent as f64)
}

/// What befell the agents: decisions that were not made, and observations that were late.
#[derive(Clone, Copy, Default)]
struct Befell {
    absent: usize,
    missed: usize,
    late: usize,
}

impl Befell {
    fn of(episode: &Episode) -> Befell {
        let count = |which| episode.presence.iter().flatten().filter(|it| **it == which).count();
        let late = episode.late.iter().flatten().flatten().filter(|it| **it == 1).count();
        Befell { absent: count(Presence::Absent), missed: count(Presence::Missed), late }
    }

    fn and(&self, more: &Befell) -> Befell {
        Befell {
            absent: self.absent + more.absent,
            missed: self.missed + more.missed,
            late: self.late + more.late,
        }
    }

    /// A line, if anything did.
    fn words(&self) -> String {
        let Befell { absent, missed, late } = self;
        if absent + missed + late == 0 {
            return String::new();
        }
        format!(
            "faults      {absent} decisions of absent agents, {missed} missed, {late} observations late\n"
        )
    }
}
