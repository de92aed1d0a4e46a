//! How far a sweep is.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

use super::tell;

/// Tells how far a sweep is: a bar on a terminal, and else a line now and then.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    began: Instant,
    /// When it was last told, and how many cells were there at the beginning.
    state: Mutex<(Instant, Option<usize>)>,
}

impl Progress {
    pub(super) fn new() -> Progress {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:20} {pos}/{len} cells{msg}");
            ProgressBar::new(0).with_style(style.expect("the template is well-formed"))
        });
        let now = Instant::now();
        Progress { bar, began: now, state: Mutex::new((now, None)) }
    }

    pub(super) fn note(&self, done: usize, of: usize) {
        const BETWEEN_LINES: Duration = Duration::from_secs(10);
        let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let first = *state.1.get_or_insert(done);
        let left = (done > first).then(|| {
            let per_cell = self.began.elapsed().as_secs_f64() / (done - first) as f64;
            let left = HumanDuration(Duration::from_secs_f64(per_cell * (of - done) as f64));
            format!(", {left:#} left")
        });
        let left = left.unwrap_or_default();
        if let Some(bar) = &self.bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
            bar.set_message(left);
        } else if state.0.elapsed() >= BETWEEN_LINES {
            state.0 = Instant::now();
            tell(&format!("{done} of {of} cells{left}"));
        }
    }

    pub(super) fn finish(self) {
        self.bar.iter().for_each(ProgressBar::finish_and_clear);
    }
}
