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

impl HostClock {
    /// Keeps the CPU until then, as work does.
    pub fn compute_until_ns(&self, until_ns: u64) {
        while self.now_ns() < until_ns {
            std::hint::spin_loop();
        }
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

/// A clock for tests that moves only when slept on: everything else takes no time.
#[cfg(test)]
#[derive(Debug, Clone, Default)]
pub struct SleptClock(std::sync::Arc<std::sync::atomic::AtomicU64>);

#[cfg(test)]
impl Clock for SleptClock {
    fn now_ns(&self) -> u64 {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.0.fetch_max(deadline_ns, std::sync::atomic::Ordering::Relaxed);
    }
}
