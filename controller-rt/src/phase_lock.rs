//! Where the rig's grid lies on this machine's clock.
//!
//! The rig publishes `EgoState` at bench times n·T. All the loop needs is one number, the *offset*:
//! this machine's clock reading minus bench time at the moment a frame arrives undelayed. Delays
//! only ever make a frame late, so the smallest difference seen is the best estimate (a minimum
//! filter, as in NTP's clock filter, RFC 5905 section 10).
//!
//! Two things are learnt:
//! 1. *Stamp to clock*: kernel stamps are CLOCK_REALTIME, the loop runs on CLOCK_MONOTONIC. The
//!    smallest `now - stamp` over the start-up frames joins them, free of wake-up delays of many
//!    milliseconds. It is frozen once locked, because CLOCK_REALTIME may be stepped later.
//! 2. *Offset*: during the first [`LOCK_WINDOW_NS`] each smaller sample takes over at once; after
//!    that, windows of [`TRACK_WINDOW_NS`] each give one smallest sample, and the offset creeps to
//!    it by at most period / [`CREEP_DIVISOR`] per slot. A sample further off than a quarter
//!    of a period is no drift: the wall clock was stepped, or the rig was late for a whole window.
//!    Then the first estimate is shifted and the grid stays where it is.

/// How long after the first `EgoState` the minimum filter acts at once \[ns\] of bench time.
pub const LOCK_WINDOW_NS: i64 = 200_000_000;

/// Length of one tracking window \[ns\] of bench time.
pub const TRACK_WINDOW_NS: i64 = 1_000_000_000;

/// The offset moves by at most period / 10,000 per slot: 100 ppm, what two crystals differ by.
pub const CREEP_DIVISOR: i64 = 10_000;

/// One frame's arrival, seen two ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrival {
    /// Clock reading when the frame was taken from the bus \[ns\]; never before it arrived.
    pub now_ns: u64,
    /// The kernel's stamp of the arrival \[ns\], CLOCK_REALTIME; 0 when there is none.
    pub stamp_ns: u64,
}

/// The estimate of the rig's grid on this machine's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhaseLock {
    stamp_to_clock_ns: Option<i64>,
    offset_ns: Option<i64>,
    wanted_ns: i64,
    locked_from_ns: i64,
    window_end_ns: i64,
    window_least_ns: i64,
}

impl Default for PhaseLock {
    fn default() -> Self {
        Self::new()
    }
}

impl PhaseLock {
    /// Knows nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            stamp_to_clock_ns: None,
            offset_ns: None,
            wanted_ns: 0,
            locked_from_ns: 0,
            window_end_ns: 0,
            window_least_ns: i64::MAX,
        }
    }

    /// Clock reading minus bench time \[ns\]; `None` before the first `EgoState`.
    #[must_use]
    pub const fn offset_ns(&self) -> Option<i64> {
        self.offset_ns
    }

    /// Learns from any start-up frame how stamps and the clock relate.
    pub fn note_frame(&mut self, arrival: Arrival) {
        if arrival.stamp_ns == 0 {
            return;
        }
        let difference = difference_ns(arrival.now_ns, arrival.stamp_ns);
        self.stamp_to_clock_ns =
            Some(self.stamp_to_clock_ns.map_or(difference, |known| known.min(difference)));
    }

    /// Learns from an `EgoState` valid at bench time `bench_ns`.
    ///
    /// `period_ns` is the loop's, for the size that tells drift from a step.
    pub fn note_ego(&mut self, bench_ns: u64, arrival: Arrival, period_ns: u64) {
        let bench = signed(bench_ns);
        let Some(offset) = self.offset_ns else {
            self.note_frame(arrival);
            let first = self.sample_ns(bench_ns, arrival);
            (self.offset_ns, self.wanted_ns) = (Some(first), first);
            self.locked_from_ns = bench.saturating_add(LOCK_WINDOW_NS);
            self.window_end_ns = self.locked_from_ns.saturating_add(TRACK_WINDOW_NS);
            return;
        };
        if bench < self.locked_from_ns {
            self.note_frame(arrival);
            let least = offset.min(self.sample_ns(bench_ns, arrival));
            (self.offset_ns, self.wanted_ns) = (Some(least), least);
        } else if arrival.stamp_ns != 0 {
            // Without stamps there is no telling when a frame arrived before it was drained.
            self.track(bench, self.sample_ns(bench_ns, arrival), signed(period_ns));
        }
    }

    /// Moves the offset towards its target by the bounded step of `slots` periods.
    pub fn creep(&mut self, slots: u32, period_ns: u64) {
        if let Some(offset) = &mut self.offset_ns {
            let step = (signed(period_ns) / CREEP_DIVISOR).saturating_mul(i64::from(slots));
            *offset += (self.wanted_ns - *offset).clamp(-step, step);
        }
    }

    fn track(&mut self, bench_ns: i64, sample_ns: i64, period_ns: i64) {
        self.window_least_ns = self.window_least_ns.min(sample_ns);
        if bench_ns < self.window_end_ns {
            return;
        }
        let error = self.window_least_ns - self.offset_ns.unwrap_or(self.window_least_ns);
        if error.abs() <= period_ns / 4 {
            self.wanted_ns = self.window_least_ns;
        } else if let Some(known) = &mut self.stamp_to_clock_ns {
            *known -= error;
        }
        self.window_least_ns = i64::MAX;
        self.window_end_ns = bench_ns.saturating_add(TRACK_WINDOW_NS);
    }

    fn sample_ns(&self, bench_ns: u64, arrival: Arrival) -> i64 {
        match self.stamp_to_clock_ns {
            Some(known) if arrival.stamp_ns != 0 => {
                difference_ns(arrival.stamp_ns, bench_ns).saturating_add(known)
            }
            _ => difference_ns(arrival.now_ns, bench_ns),
        }
    }
}

/// Nanoseconds as a signed number; 292 years fit.
fn signed(time_ns: u64) -> i64 {
    i64::try_from(time_ns).unwrap_or(i64::MAX)
}

fn difference_ns(a_ns: u64, b_ns: u64) -> i64 {
    signed(a_ns).saturating_sub(signed(b_ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000;
    /// CLOCK_REALTIME minus the clock in these tests.
    const REAL_NS: u64 = 1_700_000_000_000_000_000;

    /// A frame that arrived at `at_ns` on the clock and was read `wake_ns` later.
    fn read_after(at_ns: u64, wake_ns: u64) -> Arrival {
        Arrival { now_ns: at_ns + wake_ns, stamp_ns: at_ns + REAL_NS }
    }

    /// Locked at offset 5 s exactly, with bench time past the lock window.
    fn locked() -> PhaseLock {
        let mut lock = PhaseLock::new();
        for n in 0..=200 {
            lock.note_ego(n * PERIOD_NS, read_after(5_000_000_000 + n * PERIOD_NS, 0), PERIOD_NS);
        }
        assert_eq!(lock.offset_ns(), Some(5_000_000_000));
        lock
    }

    /// Feeds `seconds` of ticks whose arrivals are `late_ns(n)` off, creeping after each.
    fn feed(lock: &mut PhaseLock, seconds: u64, stamp_step_ns: i64, late_ns: impl Fn(u64) -> i64) {
        for n in 201..201 + seconds * 1000 {
            let at = 5_000_000_000_i64 + (n * PERIOD_NS) as i64 + late_ns(n);
            let mut arrival = read_after(at as u64, 500_000);
            arrival.stamp_ns = (arrival.stamp_ns as i64 + stamp_step_ns) as u64;
            lock.note_ego(n * PERIOD_NS, arrival, PERIOD_NS);
            lock.creep(1, PERIOD_NS);
        }
    }

    #[test]
    fn a_late_wake_up_at_the_first_tick_is_undone_by_start_up_stamps() {
        let mut lock = PhaseLock::new();
        lock.note_frame(read_after(1_000_000_000, 4_000_000));
        lock.note_frame(read_after(1_100_000_000, 30_000));
        lock.note_ego(0, read_after(2_000_000_000, 9_000_000), PERIOD_NS);
        assert_eq!(lock.offset_ns(), Some(2_000_030_000));
    }

    #[test]
    fn the_smallest_sample_of_the_lock_window_wins() {
        let mut lock = PhaseLock::new();
        for (n, late_ns) in [(0, 300_000), (1, 80_000), (2, 250_000), (3, 90_000)] {
            lock.note_ego(
                n * PERIOD_NS,
                read_after(7_000_000 + n * PERIOD_NS + late_ns, 0),
                PERIOD_NS,
            );
        }
        assert_eq!(lock.offset_ns(), Some(7_080_000));
    }

    #[test]
    fn without_stamps_the_first_provisional_offset_stands_and_never_grows() {
        let mut lock = PhaseLock::new();
        let bare = |now_ns| Arrival { now_ns, stamp_ns: 0 };
        lock.note_ego(0, bare(5_000_000), PERIOD_NS);
        lock.note_ego(PERIOD_NS, bare(6_500_000), PERIOD_NS);
        lock.note_ego(2 * LOCK_WINDOW_NS as u64, bare(900_000_000), PERIOD_NS);
        assert_eq!(lock.offset_ns(), Some(5_000_000));
    }

    #[test]
    fn drift_of_50_ppm_is_followed_within_the_slew_bound() {
        let mut lock = locked();
        feed(&mut lock, 60, 0, |n| (n * 50) as i64);
        let drift = lock.offset_ns().expect("locked") - 5_000_000_000;
        // 60 s at 50 ppm is 3 ms; tracking lags two windows at most.
        assert!((2_890_000..=3_010_050).contains(&drift), "{drift} ns");
    }

    #[test]
    fn the_offset_never_moves_faster_than_100_ppm() {
        let mut lock = locked();
        lock.wanted_ns += 200_000;
        let before = lock.offset_ns().expect("locked");
        lock.creep(1, PERIOD_NS);
        assert_eq!(lock.offset_ns().expect("locked") - before, 100);
        lock.creep(10, PERIOD_NS);
        assert_eq!(lock.offset_ns().expect("locked") - before, 1_100);
    }

    #[test]
    fn a_step_of_the_wall_clock_does_not_move_the_grid() {
        for step_ns in [3_600_000_000_000, -400_000] {
            let mut lock = locked();
            feed(&mut lock, 10, step_ns, |_| 0);
            let moved = lock.offset_ns().expect("locked") - 5_000_000_000;
            assert_eq!(moved, 0, "step of {step_ns} ns");
        }
    }

    #[test]
    fn single_late_frames_do_not_move_the_grid() {
        let mut lock = locked();
        feed(&mut lock, 20, 0, |n| if n % 3 == 0 { 0 } else { 700_000 });
        assert_eq!(lock.offset_ns(), Some(5_000_000_000));
    }
}
