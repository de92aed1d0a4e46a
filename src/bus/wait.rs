//! Waiting for a state of the bus, never for a count of wake-ups, and never without a bound.

use std::time::{Duration, Instant};

use crossbeam::utils::Backoff;

use crate::base::error::Result;

/// How a process waits for the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Wait {
    /// Sleep until woken: one wake-up per phase, right for more processes than cores.
    #[default]
    Block,
    /// Poll without sleeping: fastest where every process has a core of its own.
    Spin,
}

/// The longest a process sleeps before it looks again: a lost wake-up costs this, not a deadlock.
pub(super) const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// Waits until `ready` holds or the deadline passes; true if it held.
///
/// `sleep(target, d)` returns when the process is woken, after d at the latest. Wake-ups may coalesce or
/// be left over from earlier, so they only ever cause another look at the state of `target`.
pub fn wait_until<T>(
    target: &mut T,
    wait: Wait,
    deadline: Instant,
    sleep: impl Fn(&T, Duration) -> Result<()>,
    mut ready: impl FnMut(&mut T) -> Result<bool>,
) -> Result<bool> {
    let backoff = Backoff::new();
    loop {
        if ready(target)? {
            return Ok(true);
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(false);
        }
        match wait {
            Wait::Block => sleep(target, left.min(LONGEST_SLEEP))?,
            Wait::Spin => backoff.snooze(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_ends_when_ready_or_at_its_deadline() {
        for wait in [Wait::Block, Wait::Spin] {
            let mut looks = 0;
            let soon = Instant::now() + Duration::from_secs(60);
            let third_look = |looks: &mut i32| {
                *looks += 1;
                Ok(*looks == 3)
            };
            assert!(wait_until(&mut looks, wait, soon, |_, _| Ok(()), third_look).unwrap());
            assert_eq!(looks, 3);
            let now = Instant::now();
            assert!(!wait_until(&mut (), wait, now, |_, _| Ok(()), |_| Ok(false)).unwrap());
            // Ready wins over a deadline that has passed.
            assert!(wait_until(&mut (), wait, now, |_, _| Ok(()), |_| Ok(true)).unwrap());
        }
    }
}
