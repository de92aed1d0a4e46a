//! A thread that starts the processes of a swarm, and notices when one of them ends.
//!
//! The thread must start them itself: the kernel's parent-death signal, which ends agents with their program, is sent
//! when the *thread* that started them ends. It notices ends by pidfd, one for each process. So it takes no signal
//! handler from the program around it, and two swarms in one program do not reap each other's agents.

use std::io;
use std::os::fd::OwnedFd;
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, TryRecvError, bounded};
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::base::error::Result;
use crate::failed;

/// A process that has been started, and the pidfd that tells when it has ended.
pub(super) type Started = (Child, Arc<OwnedFd>);

/// Starts processes and watches them. It must live as long as they do: they are killed when its thread ends.
#[derive(Debug)]
pub(super) struct Watcher {
    /// `None` once the thread is to end.
    commands: Option<Sender<Command>>,
    started: Receiver<io::Result<Started>>,
    /// Rung when there is a command, and when there will be none.
    bell: Arc<OwnedFd>,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread knows.
struct Watch<T> {
    commands: Receiver<Command>,
    started: Sender<io::Result<Started>>,
    bell: Arc<OwnedFd>,
    ended: Arc<AtomicBool>,
    tell: T,
    processes: Vec<Arc<OwnedFd>>,
}

impl Watcher {
    /// A watcher without processes. Its thread calls `tell` after a process has ended.
    pub(super) fn new(tell: impl FnMut() + Send + 'static) -> Result<Watcher> {
        let bell = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK);
        let bell = Arc::new(bell.map_err(|e| failed!("cannot watch processes: {e}"))?);
        let (commands, to_start) = bounded(1);
        let (have_started, started) = bounded(1);
        let ended = Arc::new(AtomicBool::new(false));
        let watch = Watch {
            commands: to_start,
            started: have_started,
            bell: bell.clone(),
            ended: ended.clone(),
            tell,
            processes: Vec::new(),
        };
        let thread = std::thread::Builder::new().name("vs-watcher".to_owned()).spawn(|| watch.run());
        let thread = thread.map_err(|e| failed!("cannot start a thread to watch processes: {e}"))?;
        Ok(Watcher { commands: Some(commands), started, bell, ended, thread: Some(thread) })
    }

    /// Starts a process.
    pub(super) fn start(&self, command: Command) -> io::Result<Started> {
        let gone = || io::Error::other("the thread that starts processes has ended");
        let commands = self.commands.as_ref().ok_or_else(gone)?;
        commands.send(command).map_err(|_| gone())?;
        self.ring();
        self.started.recv().map_err(|_| gone())?
    }

    /// True once after a process has ended; a look at memory.
    pub(super) fn take_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed) && self.ended.swap(false, Ordering::Acquire)
    }

    fn ring(&self) {
        // It fails only when the bell has been rung so often that it is heard anyway.
        let _ = rustix::io::write(&self.bell, &1u64.to_ne_bytes());
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.commands = None;
        self.ring();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl<T: FnMut()> Watch<T> {
    fn run(mut self) {
        loop {
            let ended = self.wait();
            if ended {
                self.ended.store(true, Ordering::Release);
                (self.tell)();
            }
            match self.commands.try_recv() {
                Ok(command) => {
                    let started = self.start(command);
                    if self.started.send(started).is_err() {
                        return;
                    }
                }
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => return,
            }
        }
    }

    /// Sleeps until the bell rings or a process ends. Returns whether one has ended; it is no longer watched.
    fn wait(&mut self) -> bool {
        let files = std::iter::once(&self.bell).chain(&self.processes);
        let mut polled: Vec<PollFd> = files.map(|file| PollFd::new(file, PollFlags::IN)).collect();
        // The only error there can be is that a signal came, or that the kernel is short of memory.
        if poll(&mut polled, None).is_err() {
            return false;
        }
        let mut ready =
            polled.iter().map(|file| !file.revents().is_empty()).collect::<Vec<bool>>().into_iter();
        if ready.next() == Some(true) {
            let _ = rustix::io::read(&self.bell, &mut [0; 8]);
        }
        let before = self.processes.len();
        self.processes.retain(|_| ready.next() != Some(true));
        self.processes.len() < before
    }

    fn start(&mut self, mut command: Command) -> io::Result<Started> {
        let mut child = command.spawn()?;
        match pidfd_open(Pid::from_child(&child), PidfdFlags::empty()) {
            Ok(pidfd) => {
                let pidfd = Arc::new(pidfd);
                self.processes.push(pidfd.clone());
                Ok((child, pidfd))
            }
            Err(e) => {
                // Nobody would notice its end.
                let _ = child.kill();
                let _ = child.wait();
                Err(io::Error::new(e.kind(), format!("it cannot be watched: {e}")))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::unix::process::{CommandExt, ExitStatusExt};
    use std::process::Stdio;
    use std::time::Duration;

    use rustix::process::Signal;

    use super::*;

    /// A watcher, and what hears it tell.
    fn watcher() -> (Watcher, Receiver<()>) {
        let (tell, told) = bounded(8);
        (Watcher::new(move || tell.send(()).unwrap()).unwrap(), told)
    }

    fn cat() -> Command {
        let mut command = Command::new("cat");
        command.stdin(Stdio::piped()).stdout(Stdio::null());
        command
    }

    const LONG: Duration = Duration::from_secs(30);

    #[test]
    fn each_watcher_notices_its_own_dead_once() {
        let ((ours, told), (others, others_told)) = (watcher(), watcher());
        let ((mut first, _), (mut second, _)) = (ours.start(cat()).unwrap(), ours.start(cat()).unwrap());
        let (mut other, _) = others.start(cat()).unwrap();
        assert!(!ours.take_ended());
        for child in [&mut first, &mut second] {
            child.kill().unwrap();
            told.recv_timeout(LONG).unwrap();
            assert!(ours.take_ended() && !ours.take_ended());
            child.wait().unwrap();
        }
        assert!(!others.take_ended() && others_told.is_empty());
        // A pipe that closes ends it by itself.
        drop(other.stdin.take());
        others_told.recv_timeout(LONG).unwrap();
        assert!(others.take_ended() && other.wait().unwrap().success());
    }

    #[test]
    fn processes_outlive_the_thread_that_wanted_them_and_not_the_watcher() {
        let start = || {
            let mut command = cat();
            command.stdout(Stdio::piped());
            let tie = || Ok(rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?);
            // SAFETY: it makes one system call.
            unsafe { command.pre_exec(tie) };
            let (watcher, _told) = watcher();
            let (child, _) = watcher.start(command).unwrap();
            (watcher, child, rustix::thread::gettid())
        };
        let (watcher, mut child, thread) = std::thread::spawn(start).join().unwrap();
        // It is joined a little before it has ended.
        while std::fs::exists(format!("/proc/self/task/{}", thread.as_raw_nonzero())).unwrap() {
            std::thread::yield_now();
        }
        let (mut to, mut from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        to.write_all(b"alive").unwrap();
        let mut answer = [0; 5];
        from.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"alive");
        drop(watcher);
        assert_eq!(child.wait().unwrap().signal(), Some(Signal::KILL.as_raw()));
    }

    #[test]
    fn a_program_that_is_not_there_cannot_be_started_and_the_next_one_can() {
        let (watcher, told) = watcher();
        let error = watcher.start(Command::new("/nowhere/at/all")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
        let (mut child, pidfd) = watcher.start(cat()).unwrap();
        rustix::process::pidfd_send_signal(pidfd, Signal::KILL).unwrap();
        told.recv_timeout(LONG).unwrap();
        child.wait().unwrap();
    }
}
