//! Processes: started, watched, and always reaped.

use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam::channel::Sender;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, Signal, WaitId, WaitIdOptions, getpgid, kill_process_group, pidfd_send_signal, waitid,
};
use serde::Serialize;

use super::command::AgentCommand;
use super::stderr::{OwnStderr, say};
use super::watcher::Watcher;
use crate::base::error::{Error, Result};
use crate::failed;

/// The processes of a swarm. Dropping them ends and reaps them.
#[derive(Debug)]
pub(crate) struct Children {
    command: AgentCommand,
    /// For some of them others, by index.
    others: Vec<(usize, AgentCommand)>,
    /// `None` where one was lost, until it is started anew, or runs elsewhere.
    processes: Vec<Option<ChildProcess>>,
    /// Who else hears what they say, and which of them says it.
    heard_by: Option<Sender<(usize, String)>>,
    // Declared last: they are killed when it ends.
    watcher: Watcher,
}

impl Children {
    /// None yet. They will be run by this command, and a thread will call `tell` after one has ended.
    pub(crate) fn new(command: AgentCommand, tell: impl FnMut() + Send + 'static) -> Result<Children> {
        let watcher = Watcher::new(tell)?;
        Ok(Children { command, others: Vec::new(), processes: Vec::new(), heard_by: None, watcher })
    }

    /// Has somebody else hear what they write to stderr, too.
    #[cfg(feature = "hosts")]
    pub(crate) fn heard_by(self, listener: Sender<(usize, String)>) -> Children {
        Children { heard_by: Some(listener), ..self }
    }

    /// Runs some of them by other commands, by index.
    pub(super) fn with_others(self, others: Vec<(usize, AgentCommand)>) -> Children {
        Children { others, ..self }
    }

    /// Starts one that does `what` with these settings. `name` is what it is called in errors.
    pub(crate) fn start(
        &mut self,
        name: &str,
        what: &str,
        settings: &impl Serialize,
        stdio: [Stdio; 2],
    ) -> Result<()> {
        let process = self.launch(self.processes.len(), name, what, settings, stdio)?;
        self.processes.push(Some(process));
        Ok(())
    }

    /// Leaves out the next one, which runs elsewhere or is started later.
    pub(crate) fn leave_out(&mut self) {
        self.processes.push(None);
    }

    /// Starts one in the place of one that was lost or left out.
    pub(crate) fn start_anew(
        &mut self,
        index: usize,
        name: &str,
        what: &str,
        settings: &impl Serialize,
        stdio: [Stdio; 2],
    ) -> Result<()> {
        self.processes[index] = Some(self.launch(index, name, what, settings, stdio)?);
        Ok(())
    }

    fn launch(
        &self,
        index: usize,
        name: &str,
        what: &str,
        settings: &impl Serialize,
        [stdin, stdout]: [Stdio; 2],
    ) -> Result<ChildProcess> {
        let json =
            serde_json::to_string(settings).expect("paths in settings are a swarm's own, which are text");
        let other = self.others.iter().find(|(other, _)| *other == index);
        let mut command = other.map_or(&self.command, |(_, command)| command).command(what, &json);
        // A group of its own: Ctrl-C reaches the supervisor alone, which takes its processes down in order.
        command.process_group(0);
        command.stdin(stdin).stdout(stdout).stderr(Stdio::piped());
        let (mut child, pidfd) = self.watcher.start(command).map_err(|e| {
            failed!(
                "cannot start {name}{}: {e}",
                other.map_or(String::new(), |(_, command)| format!(" ({command})"))
            )
        })?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let stderr = OwnStderr::new(stderr, pidfd.clone());
        let name = name.to_owned();
        let (speaker, heard_by) = (name.clone(), self.heard_by.clone());
        let say = move |line: &str| {
            say(format!("[{speaker}] {line}"));
            // Nobody hears it once the listener is gone.
            heard_by.iter().for_each(|listener| drop(listener.send((index, line.to_owned()))));
        };
        let thread = std::thread::Builder::new().spawn(move || stderr.pass_on(say));
        let mut process = ChildProcess { name, child, pidfd, stderr: None };
        let thread = thread.map_err(|e| {
            failed!("cannot start a thread to listen to {}: {e}; allow more with `ulimit -u`", process.name)
        });
        process.stderr = Some(thread?);
        Ok(process)
    }

    /// How many have been started.
    pub(crate) fn len(&self) -> usize {
        self.processes.len()
    }

    /// Their process ids.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.processes.iter().flatten().map(|process| process.child.id())
    }

    /// Which of them a process belongs to: it is that one, or was started by it and has stayed in its group.
    pub(super) fn whose(&self, process: Pid) -> Option<usize> {
        let group = getpgid(Some(process)).ok()?;
        let leads = |slot: &Option<ChildProcess>| {
            slot.as_ref().is_some_and(|process| Pid::from_child(&process.child) == group)
        };
        self.processes.iter().position(leads)
    }

    /// An error if one has ended, with what it said last. As long as none has, this is a look at memory.
    pub(crate) fn check_alive(&mut self) -> Result<()> {
        match self.take_dead()?.into_iter().next() {
            None => Ok(()),
            Some((_, name, how)) => Err(Error::Lost { names: vec![name], how }),
        }
    }

    /// Those that have ended, which are reaped: which, what it is called, how it ended and what it said last. As long as none
    /// has, this is a look at memory.
    pub(crate) fn take_dead(&mut self) -> Result<Vec<(usize, String, String)>> {
        let mut dead = Vec::new();
        if !self.watcher.take_ended() {
            return Ok(dead);
        }
        for (index, slot) in self.processes.iter_mut().enumerate() {
            let Some(process) = slot else { continue };
            if let Some(how) = process.ended()? {
                dead.push((index, process.name.clone(), how));
                *slot = None;
            }
        }
        Ok(dead)
    }

    /// Ends and reaps one, if it is not gone already.
    pub(crate) fn end(&mut self, index: usize) {
        self.processes[index] = None;
    }

    /// Sends one a signal, if it is not gone.
    pub(crate) fn signal(&self, index: usize, signal: Signal) {
        if let Some(process) = &self.processes[index] {
            // It fails for one that has ended, which is noticed by its pidfd.
            let _ = pidfd_send_signal(&process.pidfd, signal);
        }
    }

    /// Waits for the first to end by itself. Its exit code, -1 if it was killed; `None` if it is still there after `longest`.
    pub(super) fn await_exit(&mut self, longest: Duration) -> Result<Option<i32>> {
        let Some(process) = self.processes.first_mut().and_then(Option::as_mut) else { return Ok(None) };
        if !process.await_end(Instant::now() + longest) {
            return Ok(None);
        }
        process.end_group();
        let status = process.child.wait().map_err(|e| failed!("cannot watch {}: {e}", process.name))?;
        Ok(Some(status.code().unwrap_or(-1)))
    }

    /// Lets processes that were told to leave do so within `longest`, and ends those that do not.
    pub(crate) fn reap(&mut self, longest: Duration) {
        let deadline = Instant::now() + longest;
        self.processes.iter().flatten().for_each(|process| {
            process.await_end(deadline);
        });
        self.processes.clear();
    }
}

/// How long a process that was killed may take to be gone.
const LONGEST_DEATH: Duration = Duration::from_secs(5);

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
    /// How it ended, and what it said last, if it has ended.
    fn ended(&mut self) -> Result<Option<String>> {
        let ended = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        let ended = waitid(WaitId::PidFd(self.pidfd.as_fd()), ended);
        if ended.map_err(|e| failed!("cannot watch {}: {e}", self.name))?.is_none() {
            return Ok(None);
        }
        self.end_group();
        let status = self.child.wait().map_err(|e| failed!("cannot watch {}: {e}", self.name))?;
        Ok(Some(self.words_of_end(status)))
    }

    /// Ends all that it has started and that has stayed in its group. It must not have been reaped: until then nobody
    /// else gets its number.
    fn end_group(&self) {
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
    }

    /// Waits for the process to end, until `deadline`. Returns whether it has.
    fn await_end(&self, deadline: Instant) -> bool {
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
            match poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&left)) {
                Err(rustix::io::Errno::INTR) => {}
                ready => return ready != Ok(0),
            }
        }
    }

    fn words_of_end(&mut self, status: ExitStatus) -> String {
        let how = match (status.code(), status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (_, Some(signal)) => format!("was killed by signal {signal}"),
            _ => format!("ended: {status}"),
        };
        let last_words = self.stderr.take().and_then(|thread| thread.join().ok()).flatten();
        let last_words = last_words
            .map(|line| format!("; it said: {}", line.trim_start_matches("error: ")))
            .unwrap_or_default();
        format!("(process {}) {how}{last_words}", self.child.id())
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        if let Ok(None) = self.ended() {
            // It leads its group unless it has left it. By pidfd, since a number may be somebody else's.
            let _ = pidfd_send_signal(&self.pidfd, Signal::KILL);
            self.end_group();
            // One that sleeps in the kernel, where no signal reaches it, dies when it wakes. Nobody waits for that.
            if !self.await_end(Instant::now() + LONGEST_DEATH) {
                return;
            }
            let _ = self.child.wait();
        }
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
