//! Work that takes its time, and that Ctrl-C ends.

use std::time::Duration;

use crossbeam::channel::{RecvTimeoutError, unbounded};
use pyo3::prelude::*;

use super::errors::raised;
use crate::base::error::Result;
use crate::supervisor::signals;

/// How often Python looks whether somebody pressed Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

/// Works on a thread of its own, while this one lets Python handle its signals. If a handler raises, the work is asked to
/// stop, and what the handler raised is the result.
pub(super) fn interruptible<T: Send>(py: Python, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    let mut handler = None;
    let result = std::thread::scope(|scope| {
        let (working, done) = unbounded::<()>();
        let worker = scope.spawn(move || {
            let _working = working;
            work()
        });
        // It hangs up when it is done, however that came about.
        while py.detach(|| done.recv_timeout(LOOK)) == Err(RecvTimeoutError::Timeout) {
            if let Err(exception) = py.check_signals() {
                handler.get_or_insert(exception);
                signals::ask_to_stop(true);
            }
        }
        worker.join()
    });
    if let Some(exception) = handler {
        signals::ask_to_stop(false);
        return Err(exception);
    }
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    result.map_err(|error| raised(py, error))
}
