//! The terminal: taken for a view, and given back on every way out.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use ratatui::layout::Rect;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcgetwinsize, tcsetattr};

use super::keys::{Key, keys};
use crate::base::error::Result;
use crate::base::faults::before_the_end;
use crate::{failed, usage};

/// The terminal that the program was started from, whatever its stdin and stdout are.
///
/// Its reads and writes never block: a terminal that nobody reads holds up whoever draws, for so long, and nobody else.
#[derive(Clone, Debug)]
pub(super) struct Terminal {
    file: Arc<File>,
}

/// How it was before it was taken.
static BEFORE: OnceLock<(Terminal, Termios)> = OnceLock::new();

/// Whether it is taken. Whoever resets this gives it back.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Whether a write is under way.
static WRITING: AtomicBool = AtomicBool::new(false);

/// To the other screen, without a cursor.
const ENTER: &[u8] = b"\x1b[?1049h\x1b[?25l\x1b[2J";

/// What was begun is cancelled; no colours, a cursor, and back to the screen as it was.
const LEAVE: &[u8] = b"\x18\x1b[0m\x1b[?25h\x1b[?1049l";

/// How long a terminal may leave unread what is written to it.
const LONGEST_WRITE: Duration = Duration::from_millis(500);

impl Terminal {
    /// Finds the terminal, and leaves it as it is.
    ///
    /// # Errors
    /// `Usage` if there is none, or it can show nothing but lines.
    pub(super) fn find() -> Result<Terminal> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32)
            .open("/dev/tty")
            .map_err(|e| usage!("there is no terminal to show a view in ({e}); leave out --view"))?;
        if std::env::var_os("TERM").is_some_and(|term| term == "dumb") {
            return Err(usage!(
                "a view needs a terminal that can move its cursor, not TERM=dumb; leave out --view"
            ));
        }
        Ok(Terminal { file: Arc::new(file) })
    }

    /// Takes it: keys come one by one, and what was on the screen is kept for later. [`give_back`] undoes it, also when
    /// the program panics.
    ///
    /// # Errors
    /// `Failed` if it is gone, or was taken before.
    pub(super) fn take(&self) -> Result<()> {
        let failed = |e: io::Error| failed!("cannot set up the terminal for a view: {e}");
        let before = tcgetattr(&self.file).map_err(|e| failed(e.into()))?;
        let mut raw = before.clone();
        raw.make_raw();
        if BEFORE.set((self.clone(), before)).is_err() {
            return Err(failed!("this process has shown a view before; a view can be shown once"));
        }
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            give_back();
            hook(panic);
        }));
        before_the_end(give_back);
        TAKEN.store(true, Ordering::SeqCst);
        let entered = tcsetattr(&self.file, OptionalActions::Now, &raw).map_err(io::Error::from);
        entered.and_then(|()| self.clone().write_all(ENTER)).map_err(|e| {
            give_back();
            failed(e)
        })
    }

    /// All of it.
    pub(super) fn area(&self) -> io::Result<Rect> {
        let size = tcgetwinsize(&self.file)?;
        Ok(Rect::new(0, 0, size.ws_col, size.ws_row))
    }

    /// The keys that are pressed until then, once there are any.
    pub(super) fn await_keys(&self, deadline: Instant) -> io::Result<Vec<Key>> {
        let left = deadline.saturating_duration_since(Instant::now());
        if !wait(&self.file, PollFlags::IN, left)? {
            return Ok(Vec::new());
        }
        let mut bytes = [0; 256];
        match (&*self.file).read(&mut bytes) {
            // Nobody is at the other end any more.
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => Ok(keys(&bytes[..read])),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => Ok(Vec::new()),
            Err(e) => Err(e),
        }
    }
}

/// Writes as long as the terminal is taken. What comes later goes nowhere.
impl Write for Terminal {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let deadline = Instant::now() + LONGEST_WRITE;
        loop {
            WRITING.store(true, Ordering::SeqCst);
            let taken = TAKEN.load(Ordering::SeqCst);
            let written = if taken { (&*self.file).write(bytes) } else { Ok(bytes.len()) };
            WRITING.store(false, Ordering::SeqCst);
            match written {
                Err(e) if e.kind() == io::ErrorKind::WouldBlock && Instant::now() < deadline => {
                    wait(&self.file, PollFlags::OUT, Duration::from_millis(50))?;
                }
                written => return written,
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Gives the terminal back as it was, if it is taken. It does nothing that a signal handler may not do.
pub(super) fn give_back() {
    let Some((terminal, before)) = BEFORE.get() else { return };
    if !TAKEN.swap(false, Ordering::SeqCst) {
        return;
    }
    let pause = Duration::from_millis(5);
    for _ in 0..20 {
        if !WRITING.load(Ordering::SeqCst) {
            break;
        }
        std::thread::sleep(pause);
    }
    let mut rest = LEAVE;
    for _ in 0..20 {
        match (&*terminal.file).write(rest) {
            Ok(written) => rest = &rest[written..],
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(pause),
            // It is gone.
            Err(_) => break,
        }
        if rest.is_empty() {
            break;
        }
    }
    let _ = tcsetattr(&terminal.file, OptionalActions::Now, before);
}

/// Waits until a file can be read or written, or has come to its end; false if the time passed before.
fn wait(file: &File, what: PollFlags, longest: Duration) -> io::Result<bool> {
    let longest = Timespec { tv_sec: longest.as_secs() as i64, tv_nsec: longest.subsec_nanos().into() };
    match poll(&mut [PollFd::new(file, what)], Some(&longest)) {
        Ok(ready) => Ok(ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(e) => Err(e.into()),
    }
}
