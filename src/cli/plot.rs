//! `plot`: learning curves of training runs, and what links do.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{print, print_bytes};
use crate::base::error::Result;
use crate::base::file::AtomicFile;
use crate::environment::Task;
use crate::link::LinkSpec;
use crate::metrics::{self, Metrics};
use crate::plot::{Figure, curves, links};
use crate::train::{Config, Layer, Preset};
use crate::usage;

/// Draw the learning curves of a training run, or the mean of several; or what links do
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  # writes runs/hs-0/curves.svg, or curves.pdf
  vamaro-swarm plot runs/hs-0
  vamaro-swarm plot runs/hs-0 --paper
  # mean and standard deviation over three seeds
  vamaro-swarm plot runs/hs-0 runs/hs-1 runs/hs-2
  vamaro-swarm plot runs/hs-* --out hear-see.svg
  vamaro-swarm plot runs/hs-0 --out - > curves.svg
  # losses at each step, in a row and over the distance, and delays
  vamaro-swarm plot --links 'gilbert(loss=0.8, burst=10) + delay(2, 1)'

One panel per level p of communication, one line per predictor: the mean return
of the tests. Runs that are still training can be plotted too. Open the file in
a browser.")]
pub struct Plot {
    /// Folders of runs of one task (each with a metrics.csv), or metrics files
    #[arg(required_unless_present = "links", value_name = "RUN")]
    runs: Vec<PathBuf>,

    /// Draw what these links do in 1,000 episodes, as `spawn --links` takes them
    #[arg(long, value_name = "LINKS|FILE", conflicts_with = "runs")]
    links: Option<String>,

    /// With --links: the task to play, with uniform random actions
    #[arg(long, value_name = "T", default_value = "spread-xy-4", conflicts_with = "runs")]
    task: String,

    /// Where to write the chart; - for stdout [default: curves.svg in the folder of the run; of several runs, in the
    /// working directory; with --links, links.svg]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Write PDF instead of SVG, sized for a column of a paper (252 pt wide, text of 8 pt in Helvetica) [default --out:
    /// curves.pdf]
    #[arg(long)]
    paper: bool,
}

impl Plot {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        match &self.links {
            Some(links) => self.plot_links(links),
            None => self.plot_runs(),
        }
    }

    fn plot_links(&self, text: &str) -> Result<()> {
        let task = Task::parse(&self.task)?;
        let figure = links(&LinkSpec::parse(text, task.spec())?, &task)?;
        let out = self.out.clone().unwrap_or_else(|| PathBuf::from(self.name("links")));
        self.write(&figure, &out, &figure.title)
    }

    fn plot_runs(&self) -> Result<()> {
        let runs: Vec<Run> = self.runs.iter().map(|path| Run::read(path)).collect::<Result<_>>()?;
        check_alike(&runs)?;
        let config = runs.iter().find_map(|run| run.config.as_ref());
        let name = config.map_or(String::new(), |config| format!("{}: ", config.task));
        let metrics: Vec<Metrics> = runs.iter().map(|run| run.metrics.clone()).collect();
        let figure = curves(&metrics, &format!("{name}return of tests while training"))?;
        let file = self.name("curves");
        let out = match (&self.out, &runs[..]) {
            (Some(out), _) => out.clone(),
            (None, [run]) => run.file.with_file_name(file),
            (None, _) => PathBuf::from(file),
        };
        let what = format!(
            "{name}{} run{}, up to {} env steps",
            runs.len(),
            if runs.len() == 1 { "" } else { "s" },
            last_in_common(&runs).unwrap_or(0)
        );
        self.write(&figure, &out, &what)
    }

    /// A file of this name, in the format that was asked for.
    fn name(&self, name: &str) -> String {
        format!("{name}.{}", if self.paper { "pdf" } else { "svg" })
    }

    /// Writes a chart, and says what is in it.
    fn write(&self, figure: &Figure, out: &Path, what: &str) -> Result<()> {
        let chart = if self.paper { figure.to_pdf() } else { figure.to_svg().into_bytes() };
        if out.as_os_str() == "-" {
            return print_bytes(&chart);
        }
        AtomicFile::write(out, &chart)?;
        print(&format!("wrote {}: {what}\n", out.display()))
    }
}

/// What is read of a run.
struct Run {
    file: PathBuf,
    /// `None` for metrics without the settings of their run.
    config: Option<Config>,
    metrics: Metrics,
}

impl Run {
    fn read(path: &Path) -> Result<Run> {
        if !path.is_dir() {
            return Ok(Run { file: path.to_owned(), config: None, metrics: Metrics::read(path)? });
        }
        let file = path.join(metrics::FILE);
        if !file.exists() {
            return Err(usage!(
                "there is no {} in {}: it is not the folder of a training run",
                metrics::FILE,
                path.display()
            ));
        }
        let settings = path.join("config.toml");
        let config = if settings.exists() {
            Some(Config::resolve(Preset::Paper, &[Layer::read(&settings)?])?)
        } else {
            None
        };
        Ok(Run { config, metrics: Metrics::read(&file)?, file })
    }
}

/// Runs have a mean if they differ in their seed and length only.
fn check_alike(runs: &[Run]) -> Result<()> {
    for (at, run) in runs.iter().enumerate() {
        let same = |other: &&Run| other.file.canonicalize().ok() == run.file.canonicalize().ok();
        if runs[..at].iter().any(|other| same(&other)) {
            return Err(usage!("{} is named twice", run.file.display()));
        }
    }
    let mut known = runs.iter().filter_map(|run| Some((run, run.config.as_ref()?)));
    let Some((first, config)) = known.next() else { return Ok(()) };
    for (run, other) in known {
        let differences = config.differences(other);
        let differ = |wanted: &dyn Fn(&str) -> bool| differences.iter().find(|(key, ..)| wanted(key));
        // Other tasks have other settings; that it is another task says it all.
        let what = differ(&|key| key == "task").or_else(|| differ(&|key| key != "seed" && key != "steps"));
        if let Some((key, here, there)) = what {
            return Err(usage!(
                "runs with different settings cannot be averaged: `{key}` is {here} in {} and {there} in {}; plot them \
                 separately",
                first.file.display(),
                run.file.display()
            ));
        }
    }
    Ok(())
}

/// The last timestep that all runs have.
fn last_in_common(runs: &[Run]) -> Option<u64> {
    let (first, others) = runs.split_first()?;
    let in_all =
        |timestep: &&u64| others.iter().all(|run| run.metrics.timesteps.binary_search(timestep).is_ok());
    first.metrics.timesteps.iter().rev().find(in_all).copied()
}
