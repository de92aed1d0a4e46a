//! A training run: play, learn, test, and keep what must not be lost.

use std::path::Path;
use std::time::{Duration, Instant};

use super::checkpoint::Checkpoint;
use super::folder::RunFolder;
use super::rows::columns;
use super::trainer::{Diverged, Trainer};
use super::trial::{Trial, test};
use super::{Averages, Config};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::metrics::{Metrics, MetricsLog};
use crate::nn::PolicyFile;
use crate::supervisor;
use crate::{failed, plot, usage};

/// How a run is carried out; nothing here changes its result.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Threads that learn and test.
    pub threads: usize,
    /// The longest time between checkpoints.
    pub checkpoint_every: Duration,
}

/// A training run and its folder.
#[derive(Debug)]
pub struct Run {
    folder: RunFolder,
    trainer: Trainer,
    pace: Pace,
    log: MetricsLog,
    /// The latest tests, if there were any in this sitting.
    trials: Vec<Trial>,
    /// When the last checkpoint was made, and how long that took.
    saved: (Instant, Duration),
    /// When this sitting began, and the seconds of all before it.
    began: (Instant, f64),
    /// What the policy file held when this sitting began. Dynamics that were fitted to the environment stay in it.
    held: Option<PolicyFile>,
}

/// Checkpoints are no further apart.
const LONGEST: Duration = Duration::from_secs(55);

/// Why training stopped before its end.
enum Stopped {
    Diverged(Diverged),
    Otherwise(Error),
}

impl Run {
    /// A new run in a folder that holds none.
    ///
    /// # Errors
    /// `Usage` if there is a run already.
    pub fn create(folder: RunFolder, config: Config, pace: Pace) -> Result<Run> {
        RunFolder::check_free(folder.path())?;
        let trainer = Trainer::new(config, pace.threads)?;
        // The checkpoint is what makes it a run: from then on it can be resumed.
        trainer.state.save(&trainer.config, &folder.checkpoint())?;
        trainer.config.save(&folder.config())?;
        let log = MetricsLog::create(folder.path(), &columns(&trainer.config))?;
        Ok(Run::assemble(folder, trainer, pace, log))
    }

    /// Goes on with the run in a folder, as `config` says: the configuration it has, but perhaps more steps.
    ///
    /// # Errors
    /// `Usage` if there is no run, or `config` differs in more than its steps.
    pub fn resume(folder: RunFolder, config: Config, pace: Pace) -> Result<Run> {
        RunFolder::check_run(folder.path())?;
        let path = folder.checkpoint();
        let checkpoint = Checkpoint::open(&path)?;
        let differences = checkpoint.config.differences(&config);
        let differences: Vec<String> = differences
            .iter()
            .filter(|(key, ..)| key != "steps")
            .map(|(key, was, now)| format!("`{key}` was {was} and is now {now}"))
            .collect();
        if !differences.is_empty() {
            return Err(usage!(
                "{} belongs to a run with other settings: {}; a run continues with the settings it began with",
                path.display(),
                differences.join(", ")
            ));
        }
        let (done, wanted) = (checkpoint.progress.timestep(), config.steps);
        if wanted < done && wanted < checkpoint.config.steps {
            return Err(usage!(
                "{} is at {done} env steps already, beyond {wanted}",
                folder.path().display()
            ));
        }
        let held = held(&folder.policy(), &config)?;
        let trainer = Trainer::restore(config, pace.threads, &checkpoint)?;
        let columns = columns(&trainer.config);
        let log = match checkpoint.progress.rows {
            0 if !folder.metrics().exists() => MetricsLog::create(folder.path(), &columns)?,
            rows => MetricsLog::resume(folder.path(), &columns, rows)?,
        };
        if log.last() > Some(done) {
            return Err(failed!(
                "{} says that the run was beyond timestep {done}, where its checkpoint is: it is not the file of this run",
                folder.metrics().display()
            ));
        }
        trainer.config.save(&folder.config())?;
        Ok(Run { held, ..Run::assemble(folder, trainer, pace, log) })
    }

    fn assemble(folder: RunFolder, trainer: Trainer, pace: Pace, log: MetricsLog) -> Run {
        let began = (Instant::now(), trainer.state.progress.seconds);
        let saved = (Instant::now(), Duration::ZERO);
        Run { folder, trainer, pace, log, trials: Vec::new(), saved, began, held: None }
    }

    /// What it was told.
    pub fn config(&self) -> &Config {
        &self.trainer.config
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The team.
    pub fn trainer(&self) -> &Trainer {
        &self.trainer
    }

    /// Environment steps so far.
    pub fn timestep(&self) -> u64 {
        self.trainer.timestep()
    }

    /// Seconds spent training, in all sittings together.
    pub fn seconds(&self) -> f64 {
        self.began.1 + self.began.0.elapsed().as_secs_f64()
    }

    /// The latest tests of this sitting.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// Trains to the last step with `agents` that run the trainer's policy, and tells `note` after every update.
    /// However that ends, what was learned is kept, unless it has numbers that are not finite.
    pub fn train(&mut self, agents: &mut impl supervisor::Team, mut note: impl FnMut(&Run)) -> Result<()> {
        let ended = self.play_and_learn(agents, &mut note).and_then(|()| Ok(self.finish()?));
        let stopped = match ended {
            Ok(()) => return Ok(()),
            Err(Stopped::Diverged(Diverged(why))) => {
                return Err(failed!(
                    "training has diverged at timestep {}: {why}; the last good checkpoint is {}; try a smaller \
                     learning rate",
                    self.timestep(),
                    self.folder.checkpoint().display()
                ));
            }
            Err(Stopped::Otherwise(error)) => error,
        };
        let kept = match self.save() {
            Ok(()) => format!("all up to timestep {} is kept", self.timestep()),
            // Such as a full disk, which may be what stopped it, too.
            Err(unsaved) if unsaved.to_string() == stopped.to_string() => {
                "the last checkpoint stays".to_owned()
            }
            Err(unsaved) => format!("{unsaved}; the last checkpoint stays"),
        };
        let on =
            format!("{kept}; continue with `vamaro-swarm train --resume --out {}`", self.folder().display());
        Err(stopped.and(on))
    }

    fn play_and_learn(
        &mut self,
        agents: &mut impl supervisor::Team,
        note: &mut impl FnMut(&Run),
    ) -> std::result::Result<(), Stopped> {
        loop {
            if self.row_is_due() {
                self.write_row()?;
                let progress = &mut self.trainer.state.progress;
                progress.rows += 1;
                progress.averages = Averages::default();
            }
            note(self);
            if self.timestep() >= self.config().steps {
                return Ok(());
            }
            if self.checkpoint_is_due() {
                self.save()?;
            }
            self.trainer.play(agents)?;
            if let Some(weights) = self.trainer.learn()? {
                agents.renew(weights)?;
            }
        }
    }

    /// Row k belongs to the first timestep from k times the interval on. Where an update is longer than the
    /// interval rows fall behind, but a timestep never has two.
    fn row_is_due(&self) -> bool {
        let (timestep, rows) = (self.timestep(), self.trainer.state.progress.rows as u64);
        timestep >= rows.saturating_mul(self.config().test_interval) && self.log.last() < Some(timestep)
    }

    /// Tests, and writes a row of `metrics.csv`.
    fn write_row(&mut self) -> Result<()> {
        let Trainer { config, task, state, .. } = &self.trainer;
        let progress = &state.progress;
        if config.test_episodes > 0 {
            let policy = self.trainer.policy()?;
            self.trials = test(config, task, &policy, progress.rows, self.pace.threads)?;
        }
        let values = progress.averages.row(config, progress.episodes, state.learner.updates(), &self.trials);
        self.log.push(progress.timestep(), &values)
    }

    fn checkpoint_is_due(&self) -> bool {
        let (when, cost) = self.saved;
        when.elapsed() >= (50 * cost).max(self.pace.checkpoint_every).min(LONGEST)
    }

    /// Keeps everything, the checkpoint first: the rest follows from it.
    fn save(&mut self) -> Result<()> {
        let started = Instant::now();
        self.log.sync()?;
        self.trainer.state.progress.seconds = self.seconds();
        self.trainer.state.save(self.config(), &self.folder.checkpoint())?;
        let policy = self.trainer.policy()?;
        let dynamics = self.held.as_ref().and_then(|held| held.dynamics.clone());
        let policy = match dynamics {
            Some(dynamics) => policy.with_dynamics(dynamics),
            None => policy,
        };
        policy.save(&self.folder.policy())?;
        self.draw_curves()?;
        self.saved = (Instant::now(), started.elapsed());
        Ok(())
    }

    fn draw_curves(&self) -> Result<()> {
        if self.config().test_episodes == 0 || self.log.rows() == 0 {
            return Ok(());
        }
        let Config { task, seed, .. } = self.config();
        let svg = plot::curves(&[Metrics::read(&self.folder.metrics())?], &format!("{task}, seed {seed}"))?
            .to_svg();
        AtomicFile::write(&self.folder.curves(), svg.as_bytes())
    }

    /// The end of the run. Its last row belongs to no interval unless the run ends with one, so it is not counted
    /// in the checkpoint, from which a longer run would go on.
    fn finish(&mut self) -> Result<()> {
        if self.trainer.state.progress.averages != Averages::default() {
            self.write_row()?;
        }
        self.save()
    }
}

impl From<Diverged> for Stopped {
    fn from(diverged: Diverged) -> Stopped {
        Stopped::Diverged(diverged)
    }
}

impl From<Error> for Stopped {
    fn from(error: Error) -> Stopped {
        Stopped::Otherwise(error)
    }
}

/// What the policy file of a run holds, if there is one.
///
/// # Errors
/// `Usage` if that is a predictor which the run does not train: it was fitted to a policy that is about to change.
fn held(path: &Path, config: &Config) -> Result<Option<PolicyFile>> {
    if !path.exists() {
        return Ok(None);
    }
    let file = PolicyFile::read(path)?;
    let mut predictors = file.networks.predictors.iter().map(|predictor| &predictor.name);
    if let Some(name) = predictors.find(|name| !config.predictors.contains(name)) {
        return Err(usage!(
            "{} holds the predictor `{name}`, which was fitted to the policy as it is, and would be lost; copy the file \
             elsewhere and remove it from there, and fit again when the run is over",
            path.display()
        ));
    }
    Ok(Some(file))
}
