//! Work side by side.

use std::sync::{Mutex, PoisonError};
use std::thread::Builder;

/// The cores this program may use; 1 if nobody can tell.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Does `work` on every task, on `threads` threads, this one among them. A free thread takes the next task; no
/// task sees another, so who does it makes no difference.
pub fn side_by_side<T: Send>(threads: usize, tasks: impl Iterator<Item = T> + Send, work: impl Fn(T) + Sync) {
    if threads <= 1 {
        return tasks.for_each(work);
    }
    let queue = Mutex::new(tasks);
    let take_turns = || {
        loop {
            // The queue is free again before the work begins.
            let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            match next {
                Some(task) => work(task),
                None => break,
            }
        }
    };
    std::thread::scope(|scope| {
        // Where the user may have no more threads, fewer do the same.
        (1..threads).for_each(|_| drop(Builder::new().spawn_scoped(scope, take_turns)));
        take_turns();
    });
}
