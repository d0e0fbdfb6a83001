//! The machine's monotonic clock, as both sides of the bench want to see it.

use platoon_dbc::Clock;
use vcan_setup::clock::MonotonicClock;

/// CLOCK_MONOTONIC with absolute sleeps.
#[derive(Debug, Clone, Copy, Default)]
pub struct HostClock(MonotonicClock);

impl Clock for HostClock {
    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.0.sleep_until_ns(deadline_ns);
    }
}

/// Wall-clock time now \[ns since 1970\]; 0 on a machine whose clock is before that.
pub fn wall_ns() -> u64 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .ok()
        .and_then(|since| u64::try_from(since.as_nanos()).ok())
        .unwrap_or(0)
}
