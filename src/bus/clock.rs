//! The monotonic clock, by which all processes of a machine agree on the time. Other machines have others.

use std::num::NonZeroU64;
use std::time::Duration;

use crossbeam::utils::Backoff;
use rustix::thread::{clock_nanosleep_absolute, set_current_timer_slack};
use rustix::time::{ClockId, Timespec, clock_gettime};

use super::Wait;
use super::wait::LONGEST_SLEEP;

/// How long a spinning wait takes no notice of anything but the time.
const LONGEST_SPIN: Duration = Duration::from_millis(1);

/// Nanoseconds of the monotonic clock.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32).as_nanos() as u64
}

/// Has the kernel wake this thread when it asks for it. By default it may be 50 us later, so that several wake together.
pub fn wake_on_time() {
    // A thread that may not ask for this is late, no more.
    let _ = set_current_timer_slack(NonZeroU64::new(1));
}

/// Waits for a moment, in nanoseconds of the monotonic clock; true if it has come. A signal ends the wait early,
/// and no wait is long, so that the caller can look around.
pub fn wait_for_moment(wait: Wait, moment_ns: u64) -> bool {
    let now = now_ns();
    let until = |longest: Duration| moment_ns.min(now + longest.as_nanos() as u64);
    match wait {
        Wait::Block => {
            let until = Duration::from_nanos(until(LONGEST_SLEEP));
            let until = Timespec { tv_sec: until.as_secs() as i64, tv_nsec: until.subsec_nanos().into() };
            // The only error there can be is that a signal came.
            let _ = clock_nanosleep_absolute(ClockId::Monotonic, &until);
        }
        Wait::Spin => {
            let (until, backoff) = (until(LONGEST_SPIN), Backoff::new());
            while now_ns() < until {
                backoff.snooze();
            }
        }
    }
    now_ns() >= moment_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_waited_for_piece_by_piece() {
        for wait in [Wait::Block, Wait::Spin] {
            assert!(wait_for_moment(wait, 0), "it has passed");
            let began = now_ns();
            let moment = began + 2 * LONGEST_SLEEP.as_nanos() as u64;
            let mut pieces = 1;
            while !wait_for_moment(wait, moment) {
                assert!(now_ns() < moment || pieces > 1);
                pieces += 1;
            }
            assert!(now_ns() >= moment && pieces > 1, "{pieces}");
        }
    }
}
