//! When a frame of a standard rate is due.

use serde::{Deserialize, Serialize};

/// A frame early by at most this counts as due \[ns\]: a quarter of the fastest period.
const SLACK_NS: u64 = 2_500_000;
const MS: u64 = 1_000_000;

/// A standard period, and where on its grid of multiples the frame goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Period {
    period_ns: u64,
    phase_ns: u64,
}

impl Period {
    /// Every `period_ms`, at once and then on multiples of the period.
    pub(super) const fn ms(period_ms: u64) -> Self {
        Self { period_ns: period_ms * MS, phase_ns: 0 }
    }

    /// Every `period_ms`, `phase_ms` after multiples of the period, as from a node of its own.
    pub(super) const fn ms_after(period_ms: u64, phase_ms: u64) -> Self {
        Self { period_ns: period_ms * MS, phase_ns: phase_ms * MS }
    }

    /// The first point of the grid that is later than `time_ns`.
    fn after(self, time_ns: u64) -> u64 {
        match time_ns.checked_sub(self.phase_ns) {
            None => self.phase_ns,
            Some(since_ns) => self.phase_ns + (since_ns / self.period_ns + 1) * self.period_ns,
        }
    }
}

/// Remembers when a frame is due next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Rate {
    next_ns: Option<u64>,
}

impl Rate {
    /// Whether the frame is due at `now_ns`; then it is due again at the next point of the grid.
    ///
    /// A clock that jumped back starts anew.
    pub(super) fn is_due(&mut self, now_ns: u64, period: Period) -> bool {
        let soon_ns = now_ns.saturating_add(SLACK_NS);
        let is_sane = |next_ns: &u64| *next_ns <= soon_ns.saturating_add(period.period_ns);
        let is_due = match self.next_ns.filter(is_sane) {
            Some(next_ns) => soon_ns >= next_ns,
            None => period.phase_ns == 0,
        };
        if is_due || self.next_ns.filter(is_sane).is_none() {
            self.next_ns = Some(period.after(soon_ns));
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times_ms(period: Period, calls_ns: impl Iterator<Item = u64>) -> Vec<u64> {
        let mut rate = Rate::default();
        calls_ns.filter(|now_ns| rate.is_due(*now_ns, period)).map(|ns| ns / MS).collect()
    }

    #[test]
    fn a_frame_goes_out_on_its_grid_from_the_first_call_on() {
        let calls = || (0..50).map(|tick| tick * 10 * MS);
        assert_eq!(times_ms(Period::ms(100), calls()), [0, 100, 200, 300, 400]);
        assert_eq!(times_ms(Period::ms_after(100, 20), calls()), [20, 120, 220, 320, 420]);
        assert_eq!(times_ms(Period::ms(10), calls()).len(), 50);
        assert_eq!(times_ms(Period::ms(100), calls().skip(3)), [30, 100, 200, 300, 400]);
    }

    #[test]
    fn calls_a_little_early_or_late_lose_no_frame_and_add_none() {
        for period_ms in [10, 20, 100] {
            let calls = (0..1_000).map(|tick| tick * 10 * MS + tick * 7_919 % 4 * MS / 2);
            let early = calls.map(|now_ns| now_ns.saturating_sub(MS));
            let times = times_ms(Period::ms(period_ms), early);
            assert_eq!(times.len() as u64, 10_000 / period_ms, "{period_ms} ms");
        }
    }

    #[test]
    fn faster_calls_send_no_more_often() {
        let calls = (0..10_000).map(|tick| tick * MS);
        let times = times_ms(Period::ms(10), calls);
        assert!(times[1..].windows(2).all(|pair| pair[1] - pair[0] == 10), "{times:?}");
    }

    #[test]
    fn a_clock_that_jumps_back_starts_anew() {
        let calls = [5_000, 5_010, 0, 10, 100].map(|ms| ms * MS);
        assert_eq!(times_ms(Period::ms(100), calls.into_iter()), [5_000, 0, 100]);
    }
}
