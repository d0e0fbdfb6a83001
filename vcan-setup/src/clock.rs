//! CLOCK_MONOTONIC as nanoseconds, and sleeping until an absolute instant of it.
//!
//! The scheduling clock of a real-time run. Sleeps are absolute (`TIMER_ABSTIME`), so a late wake
//! does not shift the ones after it.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};

/// Nanoseconds in a second.
const NS_PER_S: u64 = 1_000_000_000;

/// The kernel's monotonic clock. It has no state: every value of the type reads the same clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MonotonicClock;

impl MonotonicClock {
    /// Nanoseconds since an arbitrary origin, the same for all processes until the next boot.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        let now = clock_gettime(rustix::time::ClockId::Monotonic);
        now.tv_sec.unsigned_abs() * NS_PER_S + now.tv_nsec.unsigned_abs()
    }

    /// Returns once the clock has reached `deadline_ns`; at once when it already has.
    ///
    /// A signal does not end the sleep early.
    pub fn sleep_until_ns(&self, deadline_ns: u64) {
        let deadline = Timespec {
            tv_sec: (deadline_ns / NS_PER_S).cast_signed(),
            tv_nsec: (deadline_ns % NS_PER_S).cast_signed(),
        };
        // The only error a valid deadline can meet is an interrupting signal; the absolute deadline
        // makes going back to sleep exact.
        while clock_nanosleep_absolute(ClockId::Monotonic, &deadline)
            == Err(rustix::io::Errno::INTR)
        {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_never_runs_backwards() {
        let clock = MonotonicClock;
        let mut before_ns = clock.now_ns();
        for _ in 0..10_000 {
            let now_ns = clock.now_ns();
            assert!(now_ns >= before_ns);
            before_ns = now_ns;
        }
    }

    #[test]
    fn a_sleep_never_ends_before_its_deadline() {
        let clock = MonotonicClock;
        for ahead_ns in [1, 50_000, 2_000_000] {
            let deadline_ns = clock.now_ns() + ahead_ns;
            clock.sleep_until_ns(deadline_ns);
            assert!(clock.now_ns() >= deadline_ns);
        }
    }

    #[test]
    fn a_deadline_in_the_past_returns() {
        MonotonicClock.sleep_until_ns(0);
    }
}
