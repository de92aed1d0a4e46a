//! Signals as a flag: somebody asked us to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use crate::base::error::{Error, Result};
use crate::failed;

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Turns SIGINT, SIGTERM and SIGHUP into a flag from here on. A signal also ends a wait early.
pub fn install() -> Result<()> {
    let stop = STOP.get_or_init(Arc::default);
    let ignored = ignored_signals();
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // Whoever started us under `nohup` means it.
        if ignored >> (signal - 1) & 1 == 0 {
            flag::register(signal, stop.clone())
                .map_err(|e| failed!("cannot handle signal {signal}: {e}"))?;
        }
    }
    Ok(())
}

/// The signals that were ignored when the program started, bit n for signal n + 1.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Asks the program to stop, as a signal would, or takes that back.
#[cfg(feature = "python")]
pub(crate) fn ask_to_stop(stop: bool) {
    STOP.get_or_init(Arc::default).store(stop, Ordering::Relaxed);
}

/// An error if the program was asked to stop.
pub fn check_stop() -> Result<()> {
    match STOP.get() {
        Some(stop) if stop.load(Ordering::Relaxed) => Err(Error::Interrupted("interrupted".into())),
        _ => Ok(()),
    }
}
