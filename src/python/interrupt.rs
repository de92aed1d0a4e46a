//! Work that takes its time, and that Ctrl-C ends.

use std::sync::{Mutex, MutexGuard, TryLockError};
use std::thread::Builder;
use std::time::Duration;

use crossbeam::channel::{RecvTimeoutError, unbounded};
use pyo3::prelude::*;

use super::errors::raised;
use crate::base::error::Result;
use crate::failed;
use crate::supervisor::signals;

/// How often Python looks whether somebody pressed Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

/// Held by who works. What asks to stop is the same for all, so that only one may.
static WORKS: Mutex<()> = Mutex::new(());

/// Works on a thread of its own, while this one lets Python handle its signals. If a handler raises, the work is asked to
/// stop, and what the handler raised is the result. Work of other threads of Python comes before or after.
pub(super) fn interruptible<T: Send>(py: Python, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    let turn = turn(py)?;
    let mut handler = None;
    let result = std::thread::scope(|scope| {
        let (working, done) = unbounded::<()>();
        let worker = Builder::new().spawn_scoped(scope, move || {
            let _working = working;
            work()
        });
        let worker = worker.map_err(|error| failed!("cannot start a thread: {error}"))?;
        // It hangs up when it is done, however that came about.
        while py.detach(|| done.recv_timeout(LOOK)) == Err(RecvTimeoutError::Timeout) {
            if let Err(exception) = py.check_signals() {
                handler.get_or_insert(exception);
                signals::ask_to_stop(true);
            }
        }
        Ok(worker.join())
    });
    if let Some(exception) = handler {
        signals::ask_to_stop(false);
        return Err(exception);
    }
    drop(turn);
    let result = result.and_then(|ended| ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
    result.map_err(|error| raised(py, error))
}

/// Waits until nobody else works, or a handler raises.
fn turn(py: Python) -> PyResult<MutexGuard<'static, ()>> {
    loop {
        match WORKS.try_lock() {
            Ok(turn) => return Ok(turn),
            Err(TryLockError::Poisoned(turn)) => return Ok(turn.into_inner()),
            Err(TryLockError::WouldBlock) => py.detach(|| std::thread::sleep(LOOK)),
        }
        py.check_signals()?;
    }
}
