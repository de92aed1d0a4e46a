//! `train --seeds`: a run for each seed, some at the same time, each in a process of its own.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::str::FromStr;
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use super::{print, tell};
use crate::base::error::Result;
use crate::failed;
use crate::supervisor::{AgentCommand, signals};

/// The seeds of a campaign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(Vec<u64>);

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Seeds, String> {
        const WANTED: &str = "expected seeds, such as 0..3 (0, 1, 2), 0..=3 or 0,5,7";
        const MOST: u64 = 1000;
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| WANTED.to_owned());
        let seeds = match text.split_once("..") {
            Some((first, last)) => {
                let (first, end) = match last.strip_prefix('=') {
                    Some(last) => (number(first)?, number(last)?.saturating_add(1)),
                    None => (number(first)?, number(last)?),
                };
                if end.saturating_sub(first) > MOST {
                    return Err(format!("more than {MOST} seeds"));
                }
                (first..end).collect()
            }
            None => text.split(',').map(number).collect::<std::result::Result<Vec<_>, _>>()?,
        };
        let twice = seeds.iter().enumerate().find(|(at, seed)| seeds[..*at].contains(seed));
        match twice {
            Some((_, seed)) => Err(format!("seed {seed} is named twice")),
            None if seeds.is_empty() => Err(WANTED.to_owned()),
            None => Ok(Seeds(seeds)),
        }
    }
}

/// Runs that are waiting, and runs that are going on.
#[derive(Debug)]
pub struct Campaign {
    waiting: VecDeque<(u64, Vec<OsString>)>,
    running: Vec<Job>,
    jobs: usize,
    /// Seeds whose runs failed.
    failed: Vec<u64>,
}

/// A run in a process of its own.
#[derive(Debug)]
struct Job {
    seed: u64,
    child: Child,
    /// Passes progress on.
    progress: JoinHandle<()>,
    /// Collects the summary.
    summary: JoinHandle<String>,
}

/// How long runs that were told to stop may take to write their checkpoints.
const STOP_DEADLINE: Duration = Duration::from_secs(60);

impl Campaign {
    /// A campaign of a run for every seed, `jobs` at the same time; `arguments` says with which words a seed's begins,
    /// if so many go on at once.
    pub fn new(
        seeds: Seeds,
        jobs: usize,
        arguments: impl Fn(u64, usize) -> Result<Vec<OsString>>,
    ) -> Result<Campaign> {
        let jobs = jobs.min(seeds.0.len());
        let waiting = seeds.0.iter().map(|&seed| Ok((seed, arguments(seed, jobs)?)));
        Ok(Campaign {
            waiting: waiting.collect::<Result<_>>()?,
            running: Vec::new(),
            jobs,
            failed: Vec::new(),
        })
    }

    /// Runs all of them. One that fails does not keep the others from going on.
    pub fn run(mut self) -> Result<()> {
        signals::install()?;
        while !(self.waiting.is_empty() && self.running.is_empty()) {
            while self.running.len() < self.jobs
                && let Some((seed, arguments)) = self.waiting.pop_front()
            {
                self.running.push(Job::start(seed, &arguments)?);
            }
            if let Err(interrupted) = signals::check_stop() {
                self.stop();
                return Err(interrupted);
            }
            self.collect()?;
            std::thread::sleep(Duration::from_millis(50));
        }
        // In whatever order they ended.
        self.failed.sort_unstable();
        let failed: Vec<String> = self.failed.iter().map(u64::to_string).collect();
        if failed.is_empty() {
            Ok(())
        } else {
            Err(failed!("these seeds failed (see the messages above): {}", failed.join(", ")))
        }
    }

    /// Takes in the runs that have ended.
    fn collect(&mut self) -> Result<()> {
        let mut at = 0;
        while at < self.running.len() {
            match self.running[at].child.try_wait() {
                Ok(None) => at += 1,
                ended => {
                    let job = self.running.remove(at);
                    if !ended.is_ok_and(|status| status.is_some_and(|status| status.success())) {
                        self.failed.push(job.seed);
                    }
                    print(&job.finish())?;
                }
            }
        }
        Ok(())
    }

    /// Has all runs write their checkpoints and end.
    fn stop(&mut self) {
        self.running.iter().for_each(Job::terminate);
        let deadline = Instant::now() + STOP_DEADLINE;
        for mut job in self.running.drain(..) {
            while matches!(job.child.try_wait(), Ok(None)) && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(20));
            }
            // Harmless where it has ended.
            let _ = job.child.kill();
            let _ = job.child.wait();
            job.finish();
        }
    }
}

impl Drop for Campaign {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Job {
    fn start(seed: u64, arguments: &[OsString]) -> Result<Job> {
        let mut command = AgentCommand::this_program()?.start();
        // A group of its own: Ctrl-C reaches the campaign alone, which stops its runs in order.
        command.args(arguments).process_group(0);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| failed!("cannot start the run of seed {seed}: {e}"))?;
        let stderr = BufReader::new(child.stderr.take().expect("stderr is piped"));
        let mut stdout = child.stdout.take().expect("stdout is piped");
        let progress = Builder::new().spawn(move || {
            for line in stderr.lines().map_while(|line| line.ok()) {
                tell(&format!("[seed {seed}] {line}"));
            }
        });
        let summary = Builder::new().spawn(move || {
            let mut text = String::new();
            let _ = stdout.read_to_string(&mut text);
            text
        });
        match (progress, summary) {
            (Ok(progress), Ok(summary)) => Ok(Job { seed, child, progress, summary }),
            (Err(e), _) | (_, Err(e)) => {
                // Nobody would read what it says.
                let _ = child.kill();
                let _ = child.wait();
                Err(failed!("cannot start a thread for the run of seed {seed}: {e}; raise `ulimit -u`"))
            }
        }
    }

    fn terminate(&self) {
        if let Some(pid) = Pid::from_raw(self.child.id() as i32) {
            // It may have ended already.
            let _ = kill_process(pid, Signal::TERM);
        }
    }

    /// What a run that has ended said at last.
    fn finish(self) -> String {
        let _ = self.progress.join();
        self.summary.join().unwrap_or_default()
    }
}

/// The folder of a seed's run.
pub fn out_of_seed(out: &std::path::Path, seed: u64) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(format!("-{seed}"));
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_read_as_ranges_and_lists() {
        let seeds = |text: &str| text.parse::<Seeds>().map(|seeds| seeds.0);
        assert_eq!(seeds("0..3"), Ok(vec![0, 1, 2]));
        assert_eq!(seeds("2..=3"), Ok(vec![2, 3]));
        assert_eq!(seeds("7, 5"), Ok(vec![7, 5]));
        for wrong in ["", "3..3", "5..2", "a", "1,", "0..=18446744073709551615", "1,1", "-1"] {
            assert!(seeds(wrong).is_err(), "{wrong}");
        }
    }
}
