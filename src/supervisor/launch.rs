//! Processes: started by running this very program again, watched, and always reaped.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::base::error::{Error, Result};
use crate::failed;

/// This program, even if its file has been replaced since it started.
const SELF: &str = "/proc/self/exe";

/// How long a process that was told to leave may take.
const LEAVE_DEADLINE: Duration = Duration::from_secs(2);

/// A running process of this program. Dropping it ends and reaps the process.
#[derive(Debug)]
pub(crate) struct ChildProcess {
    name: String,
    child: Child,
    /// Passes stderr on; returns its last line.
    stderr: Option<JoinHandle<Option<String>>>,
}

impl ChildProcess {
    /// Starts a hidden command with these settings. `name` is what it is called in errors.
    pub(crate) fn start(
        name: &str,
        command: &str,
        settings: &impl Serialize,
        [stdin, stdout]: [Stdio; 2],
    ) -> Result<ChildProcess> {
        let json =
            serde_json::to_string(settings).expect("paths in settings are a swarm's own, which are text");
        let mut process = Command::new(SELF);
        // A group of its own: Ctrl-C reaches the supervisor alone, which takes its processes down in order.
        process.arg0("vamaro-swarm").args([command, &json]).process_group(0);
        process.stdin(stdin).stdout(stdout).stderr(Stdio::piped());
        let mut child = process.spawn().map_err(|e| failed!("cannot start {name}: {e}"))?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let name = name.to_owned();
        let passed_on = name.clone();
        let stderr = std::thread::spawn(move || pass_on(&passed_on, stderr));
        Ok(ChildProcess { name, child, stderr: Some(stderr) })
    }

    /// Its process id.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// An error if the process has ended, with what it said last.
    pub(crate) fn check_alive(&mut self) -> Result<()> {
        match self.child.try_wait() {
            Ok(None) => Ok(()),
            Ok(Some(status)) => Err(self.ended(status)),
            Err(e) => Err(failed!("cannot watch {}: {e}", self.name)),
        }
    }

    /// Waits for the process to end by itself until `deadline`; true if it did.
    fn wait_until(&mut self, deadline: Instant) -> bool {
        loop {
            match self.child.try_wait() {
                Ok(Some(_)) => return true,
                Ok(None) if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(1)),
                _ => return false,
            }
        }
    }

    fn ended(&mut self, status: ExitStatus) -> Error {
        let how = match (status.code(), status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (_, Some(signal)) => format!("was killed by signal {signal}"),
            _ => format!("ended: {status}"),
        };
        let last_words = self.stderr.take().and_then(|thread| thread.join().ok()).flatten();
        let last_words = last_words
            .map(|line| format!("; it said: {}", line.trim_start_matches("error: ")))
            .unwrap_or_default();
        failed!("{} (process {}) {how}{last_words}", self.name, self.child.id())
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // Harmless for a process that has been reaped already: the library remembers.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(thread) = self.stderr.take() {
            let _ = thread.join();
        }
    }
}

/// Lets processes that were told to leave do so, and ends those that do not.
pub(crate) fn reap(processes: &mut Vec<ChildProcess>) {
    let deadline = Instant::now() + LEAVE_DEADLINE;
    for process in processes.iter_mut() {
        process.wait_until(deadline);
    }
    processes.clear();
}

/// Copies a process's stderr to ours, line by line, with its name in front.
fn pass_on(name: &str, stderr: ChildStderr) -> Option<String> {
    let mut last = None;
    for line in BufReader::new(stderr).split(b'\n').map_while(|line| line.ok()) {
        let line = String::from_utf8_lossy(&line).into_owned();
        // Where stderr cannot be written the line is still told when the process fails.
        let _ = writeln!(std::io::stderr(), "[{name}] {line}");
        last = Some(line);
    }
    last
}
