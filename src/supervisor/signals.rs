//! Signals as flags: somebody asked us to stop, or a child has ended.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use crate::base::error::{Error, Result};
use crate::failed;

#[derive(Debug, Default)]
struct Flags {
    stop: Arc<AtomicBool>,
    child_ended: Arc<AtomicBool>,
}

static FLAGS: OnceLock<Flags> = OnceLock::new();

/// Turns SIGINT, SIGTERM, SIGHUP and SIGCHLD into flags from here on. A signal also ends a wait early.
pub fn install() -> Result<()> {
    let flags = FLAGS.get_or_init(Flags::default);
    let handle = |signal, flag: &Arc<AtomicBool>| {
        flag::register(signal, flag.clone()).map_err(|e| failed!("cannot handle signal {signal}: {e}"))
    };
    let ignored = ignored_signals();
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // Whoever started us under `nohup` means it.
        if ignored >> (signal - 1) & 1 == 0 {
            handle(signal, &flags.stop)?;
        }
    }
    handle(SIGCHLD, &flags.child_ended)?;
    Ok(())
}

/// The signals that were ignored when the program started, bit n for signal n + 1.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// An error if the program was asked to stop.
pub fn check_stop() -> Result<()> {
    match FLAGS.get() {
        Some(flags) if flags.stop.load(Ordering::Relaxed) => Err(Error::Interrupted("interrupted".into())),
        _ => Ok(()),
    }
}

/// True once after a child has ended.
pub(super) fn take_child_ended() -> bool {
    FLAGS.get().is_some_and(|flags| {
        flags.child_ended.load(Ordering::Relaxed) && flags.child_ended.swap(false, Ordering::Relaxed)
    })
}
