//! The terminal: taken for a view, and given back on every way out.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
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
/// Nothing here waits for whoever reads it: what is written is kept, and goes out as the terminal takes it.
#[derive(Clone, Debug)]
pub(super) struct Terminal {
    file: Arc<File>,
    /// What is still to go out.
    rest: Arc<Mutex<Vec<u8>>>,
}

/// How it was before it was taken.
static BEFORE: OnceLock<(Arc<File>, Termios)> = OnceLock::new();

/// Which of these three it is. Whoever makes it [`FREE`] gives it back.
static STATE: AtomicU8 = AtomicU8::new(FREE);

/// As if there were no view.
const FREE: u8 = 0;

/// Pictures are drawn on it.
const TAKEN: u8 = 1;

/// To be given back, as soon as it takes [`LEAVE`].
const OWED: u8 = 2;

/// Whether a write is under way.
static WRITING: AtomicBool = AtomicBool::new(false);

/// To the other screen, without a cursor.
const ENTER: &[u8] = b"\x1b[?1049h\x1b[?25l\x1b[2J";

/// What was begun is cancelled; no colours, a cursor, and back to the screen as it was.
const LEAVE: &[u8] = b"\x18\x1b[0m\x1b[?25h\x1b[?1049l";

/// How long one that is given back may leave that unread, where the program is about to end.
const LONGEST_LAST_WRITE: Duration = Duration::from_millis(100);

impl Terminal {
    /// Finds the terminal, and leaves it as it is. Where there is none, `remedy` says what to do.
    ///
    /// # Errors
    /// `Usage` if there is none, or it can show nothing but lines.
    pub(super) fn find(remedy: &str) -> Result<Terminal> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32)
            .open("/dev/tty")
            .map_err(|e| usage!("there is no terminal to show a view in ({e}); {remedy}"))?;
        if std::env::var_os("TERM").is_some_and(|term| term == "dumb") {
            return Err(usage!("a view needs a terminal that can move its cursor, not TERM=dumb; {remedy}"));
        }
        Ok(Terminal { file: Arc::new(file), rest: Arc::default() })
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
        if BEFORE.set((self.file.clone(), before)).is_err() {
            return Err(failed!("this process has shown a view before; a view can be shown once"));
        }
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            give_back();
            hook(panic);
        }));
        before_the_end(give_back);
        STATE.store(TAKEN, Ordering::SeqCst);
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

    /// The keys that are pressed until then, once there are any. If something is still to go out, it comes back as soon
    /// as that can go on.
    pub(super) fn await_keys(&self, deadline: Instant) -> io::Result<Vec<Key>> {
        let out = if self.rest().is_empty() { PollFlags::empty() } else { PollFlags::OUT };
        let left = deadline.saturating_duration_since(Instant::now());
        if !wait(&self.file, PollFlags::IN | out, left)? {
            return Ok(Vec::new());
        }
        let mut bytes = [0; 256];
        match (&*self.file).read(&mut bytes) {
            // Nobody is at the other end any more.
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => Ok(keys(&bytes[..read])),
            Err(e) if is_passing(&e) => Ok(Vec::new()),
            Err(e) => Err(e),
        }
    }

    /// Sends out as much as the terminal takes now. Whether that was all.
    pub(super) fn send(&self) -> io::Result<bool> {
        let mut rest = self.rest();
        while !rest.is_empty() {
            WRITING.store(true, Ordering::SeqCst);
            let taken = STATE.load(Ordering::SeqCst) == TAKEN;
            let sent = if taken { (&*self.file).write(&rest) } else { Ok(rest.len()) };
            WRITING.store(false, Ordering::SeqCst);
            match sent {
                Ok(sent) => drop(rest.drain(..sent)),
                Err(e) if is_passing(&e) => return Ok(false),
                Err(e) => return Err(e),
            }
        }
        Ok(true)
    }

    fn rest(&self) -> MutexGuard<'_, Vec<u8>> {
        self.rest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What is written here goes out by [`Terminal::send`], as long as the terminal is taken, and later goes nowhere.
impl Write for Terminal {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.rest().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Gives the terminal back as it was, if it is taken. It does nothing that a signal handler may not do.
pub(super) fn give_back() {
    give_back_within(LONGEST_LAST_WRITE);
}

/// The same, and waits for so long for a terminal that nobody reads. One that was not given back whole can be given back
/// again.
pub(super) fn give_back_within(longest: Duration) {
    let Some((file, before)) = BEFORE.get() else { return };
    if STATE.swap(FREE, Ordering::SeqCst) == FREE {
        return;
    }
    let pause = Duration::from_millis(5);
    for _ in 0..20 {
        if !WRITING.load(Ordering::SeqCst) {
            break;
        }
        std::thread::sleep(pause);
    }
    let deadline = Instant::now() + longest;
    let mut rest = LEAVE;
    while !rest.is_empty() {
        match (&**file).write(rest) {
            Ok(written) => rest = &rest[written..],
            Err(e) if is_passing(&e) => {
                if Instant::now() > deadline {
                    STATE.store(OWED, Ordering::SeqCst);
                    break;
                }
                std::thread::sleep(pause);
            }
            // It is gone.
            Err(_) => break,
        }
    }
    let _ = tcsetattr(file, OptionalActions::Now, before);
}

/// Whether it may work the next time.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
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
