//! Processes: started, watched, and always reaped.

use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};
use serde::Serialize;

use super::command::AgentCommand;
use super::stderr::OwnStderr;
use super::watcher::Watcher;
use crate::base::error::{Error, Result};
use crate::failed;

/// The processes of a swarm. Dropping them ends and reaps them.
#[derive(Debug)]
pub(crate) struct Children {
    command: AgentCommand,
    processes: Vec<ChildProcess>,
    // Declared last: they are killed when it ends.
    watcher: Watcher,
}

impl Children {
    /// None yet. They will be run by this command, and a thread will call `tell` after one has ended.
    pub(crate) fn new(command: AgentCommand, tell: impl FnMut() + Send + 'static) -> Result<Children> {
        Ok(Children { command, processes: Vec::new(), watcher: Watcher::new(tell)? })
    }

    /// Starts one that does `what` with these settings. `name` is what it is called in errors.
    pub(crate) fn start(
        &mut self,
        name: &str,
        what: &str,
        settings: &impl Serialize,
        [stdin, stdout]: [Stdio; 2],
    ) -> Result<()> {
        let json =
            serde_json::to_string(settings).expect("paths in settings are a swarm's own, which are text");
        let mut command = self.command.command(what, &json);
        // A group of its own: Ctrl-C reaches the supervisor alone, which takes its processes down in order.
        command.process_group(0);
        command.stdin(stdin).stdout(stdout).stderr(Stdio::piped());
        let (mut child, pidfd) =
            self.watcher.start(command).map_err(|e| failed!("cannot start {name}: {e}"))?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let stderr = OwnStderr::new(stderr, pidfd.clone());
        let name = name.to_owned();
        let passed_on = name.clone();
        let stderr = Some(std::thread::spawn(move || stderr.pass_on(&passed_on)));
        self.processes.push(ChildProcess { name, child, pidfd, stderr });
        Ok(())
    }

    /// How many have been started.
    pub(crate) fn len(&self) -> usize {
        self.processes.len()
    }

    /// Their process ids.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.processes.iter().map(|process| process.child.id())
    }

    /// An error if one has ended, with what it said last. As long as none has, this is a look at memory.
    pub(crate) fn check_alive(&mut self) -> Result<()> {
        if self.watcher.take_ended() {
            self.processes.iter_mut().try_for_each(ChildProcess::check_alive)?;
        }
        Ok(())
    }

    /// Lets processes that were told to leave do so within `longest`, and ends those that do not.
    pub(crate) fn reap(&mut self, longest: Duration) {
        let deadline = Instant::now() + longest;
        self.processes.iter().for_each(|process| process.await_end(deadline));
        self.processes.clear();
    }
}

/// A running process. Dropping it ends and reaps it.
#[derive(Debug)]
struct ChildProcess {
    name: String,
    child: Child,
    pidfd: Arc<OwnedFd>,
    /// Passes stderr on until the process has ended; returns its last line.
    stderr: Option<JoinHandle<Option<String>>>,
}

impl ChildProcess {
    fn check_alive(&mut self) -> Result<()> {
        match self.child.try_wait() {
            Ok(None) => Ok(()),
            Ok(Some(status)) => Err(self.ended(status)),
            Err(e) => Err(failed!("cannot watch {}: {e}", self.name)),
        }
    }

    /// Waits for the process to end by itself, until `deadline`.
    fn await_end(&self, deadline: Instant) {
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
            match poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&left)) {
                Err(rustix::io::Errno::INTR) => {}
                _ => return,
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
        let how = format!("(process {}) {how}{last_words}", self.child.id());
        Error::Lost { names: vec![self.name.clone()], how }
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // By pidfd, since a number may be somebody else's by now. Harmless for a process that has been reaped.
        let _ = pidfd_send_signal(&self.pidfd, Signal::KILL);
        let _ = self.child.wait();
        if let Some(thread) = self.stderr.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    const LONG: Duration = Duration::from_secs(30);

    #[test]
    fn a_process_that_leaves_others_behind_goes_with_its_last_words() {
        // They keep its stderr until the test lets go of the other end of their stdin.
        let script = "exec 3<&0; cat <&3 & echo 'error: out of paper' >&2; exit 3";
        let (stdin, held) = std::io::pipe().unwrap();
        let ((tell, told), (done, error)) = (channel(), channel());
        let command = AgentCommand::new("sh").word("-c").word(script);
        let mut children = Children::new(command, move || tell.send(()).unwrap()).unwrap();
        children.start("printer", "print", &0, [stdin.into(), Stdio::null()]).unwrap();
        told.recv_timeout(LONG).unwrap();
        std::thread::spawn(move || {
            let error = children.check_alive().unwrap_err().to_string();
            drop(children);
            done.send(error).unwrap();
        });
        let error = error.recv_timeout(LONG).expect("nobody waits for the others");
        drop(held);
        assert!(error.contains("printer") && error.contains("exit code 3; it said: out of paper"), "{error}");
    }
}
