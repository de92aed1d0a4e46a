//! Telling how a training run goes: a bar on a terminal, and else a line now and then.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::tell;
use crate::train::{Run, Trial};

/// Tells how a run goes.
pub struct Reporter {
    /// On a terminal.
    bar: Option<ProgressBar>,
    began: Instant,
    /// Where this sitting began.
    from: u64,
    told: Instant,
}

/// Time between lines where there is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Before that, speed and time left are guesses.
const SETTLED: Duration = Duration::from_secs(1);

impl Reporter {
    /// Begins with the run.
    pub fn new(run: &Run) -> Reporter {
        let bar = std::io::stderr().is_terminal().then(|| {
            // Not wider than 80 columns with two predictors; a return is that of the latest test.
            let style = ProgressStyle::with_template("{bar:10} {percent:>2}% {wide_msg}");
            let style = style.expect("the template is well-formed");
            ProgressBar::with_draw_target(Some(run.config().steps), ProgressDrawTarget::stderr())
                .with_style(style)
        });
        let now = Instant::now();
        Reporter { bar, began: now, from: run.timestep(), told: now }
    }

    /// Tells how far the run is.
    pub fn note(&mut self, run: &Run) {
        let (timestep, steps) = (run.timestep(), run.config().steps);
        if let Some(bar) = &self.bar {
            bar.set_position(timestep.min(steps));
            bar.set_message(format!("{}{}", self.speed(run), latest_returns(run.trials())));
        } else if self.told.elapsed() >= BETWEEN_LINES {
            self.told = Instant::now();
            let (speed, returns) = (self.speed(run), latest_returns(run.trials()));
            tell(&format!("{timestep} of {steps} env steps, {speed}{returns}"));
        }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.iter().for_each(ProgressBar::finish_and_clear);
    }

    fn speed(&self, run: &Run) -> String {
        let elapsed = self.began.elapsed();
        let per_second = (run.timestep() - self.from) as f64 / elapsed.as_secs_f64();
        if elapsed < SETTLED || per_second == 0.0 {
            return "..".to_owned();
        }
        let left = run.config().steps.saturating_sub(run.timestep()) as f64 / per_second;
        let left = HumanDuration(Duration::from_secs_f64(left.min(1e9)));
        format!("{per_second:.0}/s, {left:#} left")
    }
}

/// The latest returns with everything and with nothing delivered.
fn latest_returns(trials: &[Trial]) -> String {
    let Some(everything) = trials.first() else { return String::new() };
    let nothing = trials.iter().filter(|trial| trial.level == 0.0);
    let nothing = nothing.map(|trial| format!(" {} {:.0}", trial.imputer, trial.return_mean));
    format!("; p=1: {:.1}, p=0:{}", everything.return_mean, nothing.collect::<String>())
}
