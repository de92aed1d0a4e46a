//! Agent processes: started by running this very program again, watched, and always reaped.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::agents::process::ProcessSettings;
use crate::error::{Error, Result};
use crate::{failed, usage};

/// This program, even if its file has been replaced since it started.
const SELF: &str = "/proc/self/exe";

/// How long an agent that was told to leave may take.
const LEAVE_DEADLINE: Duration = Duration::from_secs(2);

/// A running agent. Dropping it ends and reaps the process.
#[derive(Debug)]
pub(super) struct AgentProcess {
    index: usize,
    child: Child,
    /// Passes stderr on; returns its last line.
    stderr: Option<JoinHandle<Option<String>>>,
}

impl AgentProcess {
    /// Starts an agent.
    pub(super) fn start(settings: &ProcessSettings) -> Result<AgentProcess> {
        let index = settings.agent;
        // Only a path can be no text.
        let json = serde_json::to_string(settings)
            .map_err(|_| usage!("the path of the policy is not UTF-8; move it to a folder whose name is"))?;
        let mut command = Command::new(SELF);
        // A group of its own: Ctrl-C reaches the supervisor alone, which takes the agents down in order.
        command.arg0("vamaro-swarm").args(["agent", &json]).process_group(0);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| failed!("cannot start agent-{index}: {e}"))?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let stderr = std::thread::spawn(move || pass_on(index, stderr));
        Ok(AgentProcess { index, child, stderr: Some(stderr) })
    }

    /// Its process id.
    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    /// An error if the process has ended, with what it said last.
    pub(super) fn check_alive(&mut self) -> Result<()> {
        match self.child.try_wait() {
            Ok(None) => Ok(()),
            Ok(Some(status)) => Err(self.ended(status)),
            Err(e) => Err(failed!("cannot watch agent-{}: {e}", self.index)),
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
        failed!("agent-{} (process {}) {how}{last_words}", self.index, self.child.id())
    }
}

impl Drop for AgentProcess {
    fn drop(&mut self) {
        // Harmless for a process that has been reaped already: the library remembers.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(thread) = self.stderr.take() {
            let _ = thread.join();
        }
    }
}

/// Lets agents that were told to leave do so, and ends those that do not.
pub(super) fn reap(agents: &mut Vec<AgentProcess>) {
    let deadline = Instant::now() + LEAVE_DEADLINE;
    for agent in agents.iter_mut() {
        agent.wait_until(deadline);
    }
    agents.clear();
}

/// Copies an agent's stderr to ours, line by line, with its name in front.
fn pass_on(index: usize, stderr: ChildStderr) -> Option<String> {
    let mut last = None;
    for line in BufReader::new(stderr).split(b'\n').map_while(|line| line.ok()) {
        let line = String::from_utf8_lossy(&line).into_owned();
        // Where stderr cannot be written the line is still told when the agent fails.
        let _ = writeln!(std::io::stderr(), "[agent-{index}] {line}");
        last = Some(line);
    }
    last
}
