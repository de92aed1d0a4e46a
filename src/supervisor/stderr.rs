//! What a process writes to stderr: passed on line by line, until the process ends.
//!
//! A process may start others, which inherit its stderr and can keep that open for as long as they like. So the end of the
//! process counts, not that of the pipe: what is in the pipe then is all that it ever said.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::fd::OwnedFd;
use std::process::ChildStderr;
use std::sync::{Arc, Mutex, PoisonError};

use rustix::event::{PollFd, PollFlags, poll};

/// The stderr of a process, which ends when the process does.
pub(super) struct OwnStderr {
    pipe: ChildStderr,
    pidfd: Arc<OwnedFd>,
    /// Bytes that are still to be read, known once the process has ended.
    left: Option<usize>,
}

impl OwnStderr {
    /// The stderr of the process with this pidfd.
    pub(super) fn new(pipe: ChildStderr, pidfd: Arc<OwnedFd>) -> OwnStderr {
        OwnStderr { pipe, pidfd, left: None }
    }

    /// Gives it to `say`, line by line. Returns the last line.
    pub(super) fn pass_on(self, say: impl Fn(&str)) -> Option<String> {
        /// A longer line is several.
        const LONGEST: u64 = 1 << 16;
        let (mut reader, mut bytes, mut last) = (BufReader::new(self), Vec::new(), None);
        while reader.by_ref().take(LONGEST).read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
            let line = String::from_utf8_lossy(bytes.strip_suffix(b"\n").unwrap_or(&bytes)).into_owned();
            say(&line);
            last = Some(line);
            bytes.clear();
        }
        last
    }

    /// Sleeps until there is something to read, or the process has ended.
    fn wait(&mut self) -> io::Result<()> {
        let mut polled = [PollFd::new(&self.pipe, PollFlags::IN), PollFd::new(&self.pidfd, PollFlags::IN)];
        poll(&mut polled, None)?;
        if !polled[1].revents().is_empty() {
            self.left = Some(rustix::io::ioctl_fionread(&self.pipe)? as usize);
        }
        Ok(())
    }
}

impl Read for OwnStderr {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.left.is_none() {
            self.wait()?;
        }
        let most = self.left.map_or(buffer.len(), |left| left.min(buffer.len()));
        let read = self.pipe.read(&mut buffer[..most])?;
        self.left = self.left.map(|left| left - read);
        Ok(read)
    }
}

/// Lines that are kept for later, while the terminal shows something else.
static HELD: Mutex<Option<Vec<String>>> = Mutex::new(None);

/// Writes a line to stderr, now or later.
pub(crate) fn say(line: String) {
    /// Whoever says more than this says the same again.
    const MOST: usize = 200;
    match &mut *HELD.lock().unwrap_or_else(PoisonError::into_inner) {
        Some(held) if held.len() >= MOST => {}
        Some(held) => held.push(line),
        // Where stderr cannot be written the line is still told when the process fails.
        None => drop(writeln!(io::stderr(), "{line}")),
    }
}

/// Keeps what processes write to stderr until it is [released](release_words).
#[cfg(feature = "view")]
pub(crate) fn hold_words() {
    HELD.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_default();
}

/// Writes what was held, and all that comes from now on.
#[cfg(feature = "view")]
pub(crate) fn release_words() {
    let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
    held.into_iter().flatten().for_each(say);
}

#[cfg(test)]
mod tests {
    use std::process::{Command, Stdio};
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use rustix::process::{Pid, PidfdFlags, pidfd_open};

    use super::*;

    /// What is read of the stderr of a shell that runs a script, to its end. The shell's stdin stays open until then.
    fn read(script: &str) -> String {
        let mut command = Command::new("sh");
        command.args(["-c", script]).stdin(Stdio::piped()).stderr(Stdio::piped());
        let mut shell = command.spawn().unwrap();
        let pidfd = Arc::new(pidfd_open(Pid::from_child(&shell), PidfdFlags::empty()).unwrap());
        let mut stderr = OwnStderr::new(shell.stderr.take().unwrap(), pidfd);
        let (done, text) = channel();
        std::thread::spawn(move || {
            let mut text = String::new();
            stderr.read_to_string(&mut text).unwrap();
            done.send(text).unwrap();
        });
        let text = text.recv_timeout(Duration::from_secs(30)).expect("it ends with the shell");
        drop(shell.stdin.take());
        shell.wait().unwrap();
        text
    }

    #[test]
    fn everything_a_process_said_is_read() {
        assert_eq!(read("echo one >&2; printf two >&2"), "one\ntwo");
        // It closes the pipe before it ends.
        assert_eq!(read("echo one >&2; exec 2>&-; cat"), "one\n");
        // More than a pipe holds.
        assert_eq!(read("head -c 300000 /dev/zero >&2").len(), 300_000);
    }

    #[test]
    fn nobody_waits_for_what_others_may_say() {
        // They hold the pipe until their stdin is closed, silent or not.
        assert_eq!(read("exec 3<&0; cat <&3 >&2 & echo last words >&2"), "last words\n");
        assert!(read("yes >&2 & exit 3").lines().all(|line| line == "y"));
    }
}
