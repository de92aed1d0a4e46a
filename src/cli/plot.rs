//! `plot`: learning curves of training runs.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Deserialize;

use super::print;
use crate::error::{Error, Result};
use crate::file::AtomicFile;
use crate::metrics::{self, Metrics};
use crate::plot::curves;
use crate::{failed, usage};

/// Draw the learning curves of a training run, or the mean of several
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm plot runs/hs-0                         writes runs/hs-0/curves.svg
  vamaro-swarm plot runs/hs-0 runs/hs-1 runs/hs-2     mean and standard deviation over three seeds
  vamaro-swarm plot runs/hs-* --out hear-see.svg
  vamaro-swarm plot runs/hs-0 --out - > curves.svg

One panel per level p of communication, one line per predictor: the mean return of the tests.
A run that is still in training can be plotted. A browser shows the file.")]
pub struct Plot {
    /// Folders of runs of one task (each with a metrics.csv), or metrics files
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,

    /// Where to write the chart; - for stdout [default: curves.svg in the folder of the run, or here if there are
    /// several]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Plot {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let runs: Vec<Run> = self.runs.iter().map(|path| Run::read(path)).collect::<Result<_>>()?;
        let task = common_task(&runs)?;
        let name = task.map_or(String::new(), |task| format!("{task}: "));
        let metrics: Vec<Metrics> = runs.iter().map(|run| run.metrics.clone()).collect();
        let chart = curves(&metrics, &format!("{name}return of tests while training"))?;
        let out = match (&self.out, &runs[..]) {
            (Some(out), _) if out.as_os_str() == "-" => return print(&chart),
            (Some(out), _) => out.clone(),
            (None, [run]) => run.file.with_file_name("curves.svg"),
            (None, _) => PathBuf::from("curves.svg"),
        };
        let mut file = AtomicFile::create(&out)?;
        file.write_all(chart.as_bytes()).map_err(|e| Error::io("write", &out, e))?;
        file.commit()?;
        let steps = metrics.iter().filter_map(|metrics| metrics.timesteps.last()).max();
        print(&format!(
            "wrote {}: {name}{} run{}, {} environment steps\n",
            out.display(),
            runs.len(),
            if runs.len() == 1 { "" } else { "s" },
            steps.unwrap_or(&0)
        ))
    }
}

/// What is read of a run.
struct Run {
    file: PathBuf,
    /// `None` for metrics without the settings of their run.
    task: Option<String>,
    metrics: Metrics,
}

impl Run {
    fn read(path: &Path) -> Result<Run> {
        if !path.is_dir() {
            return Ok(Run { file: path.to_owned(), task: None, metrics: Metrics::read(path)? });
        }
        let file = path.join(metrics::FILE);
        if !file.exists() {
            return Err(usage!(
                "there is no {} in {}: it is not the folder of a training run",
                metrics::FILE,
                path.display()
            ));
        }
        Ok(Run { task: task(&path.join("config.toml"))?, metrics: Metrics::read(&file)?, file })
    }
}

/// The task of a run with these settings; `None` if there is no such file.
fn task(settings: &Path) -> Result<Option<String>> {
    #[derive(Deserialize)]
    struct Settings {
        task: String,
    }
    if !settings.exists() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(settings).map_err(|e| Error::io("read", settings, e))?;
    let Settings { task } = toml::from_str(&text).map_err(|e| failed!("{}: {e}", settings.display()))?;
    Ok(Some(task))
}

/// The task of all runs that know theirs.
fn common_task(runs: &[Run]) -> Result<Option<&str>> {
    let mut known = runs.iter().filter_map(|run| Some((run, run.task.as_deref()?)));
    let Some((first, task)) = known.next() else { return Ok(None) };
    match known.find(|(_, other)| *other != task) {
        None => Ok(Some(task)),
        Some((run, other)) => Err(usage!(
            "runs of different tasks have no mean: {} is of {task}, {} of {other}",
            first.file.display(),
            run.file.display()
        )),
    }
}
