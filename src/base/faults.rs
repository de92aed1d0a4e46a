//! Signals with which the kernel says that memory ran out or a file is too large: an error message, not a silent death.

use std::os::fd::AsFd;
use std::sync::OnceLock;

use signal_hook::consts::{SIGBUS, SIGXFSZ};
use signal_hook::low_level;

use crate::base::error::Result;
use crate::failed;

const NO_MEMORY: &[u8] =
    b"error: shared memory ran out, or a file in use was cut short (SIGBUS); see what `vamaro-swarm doctor` finds\n";

/// What else is to be done before the program ends by a signal.
static LAST_DEED: OnceLock<fn()> = OnceLock::new();

/// Has the program do this, too, before a signal ends it. It must be something that a signal handler may do.
#[cfg(feature = "view")]
pub(crate) fn before_the_end(deed: fn()) {
    LAST_DEED.get_or_init(|| deed);
}

/// From here on SIGBUS ends the program with an error and exit code 1, and a file that reaches the limit of this user
/// (`ulimit -f`) is an error of the write.
pub(crate) fn say_what_ended() -> Result<()> {
    let failed = |e: std::io::Error| failed!("cannot handle signals: {e}");
    let end = || {
        if let Some(deed) = LAST_DEED.get() {
            deed();
        }
        // Where stderr cannot be written the exit code says it all.
        let _ = rustix::io::write(std::io::stderr().as_fd(), NO_MEMORY);
        low_level::exit(1);
    };
    // SAFETY: it only does the last deed, writes and exits, which a signal handler may do.
    unsafe { low_level::register(SIGBUS, end) }.map_err(failed)?;
    // SAFETY: it does nothing. That it is there keeps the signal from ending the program, so that the write fails.
    unsafe { low_level::register(SIGXFSZ, || {}) }.map_err(failed)?;
    Ok(())
}
