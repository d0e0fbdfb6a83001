//! When the loop runs: one slot per period, half a period after the rig publishes.
//!
//! Slot n stands for bench time n·T and is due at offset + n·T + T/2 on the clock, an absolute
//! deadline. A slot may start at most half a period late: until then the newest `EgoState` is still
//! the one the slot stands for. Later than that it is passed over and the next grid point is taken,
//! so starts are never closer than half a period and an overrun is never followed by a burst
//! (the Skip strategy of A. Cervin, *Analysis of overrun strategies in periodic control tasks*,
//! IFAC 2005). The law is told the slot's time, so the elapsed time it sees is always true.
//! A pacer that is told to queue (his Queue strategy) lets slots start later by that many periods,
//! and so makes up for them in a burst of at most that length.

use platoon_dbc::Clock;

use crate::laps::PhaseTimes;
use crate::phase_lock::{Arrival, PhaseLock};

/// One period of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Slot {
    /// Grid points since bench time 0.
    pub number: u32,
    /// Bench time the slot stands for \[ns\].
    pub time_ns: u64,
    /// Clock reading at which the slot was due \[ns\].
    pub due_ns: u64,
    /// Grid points passed over since the previous slot.
    pub skipped: u32,
    /// Those of them that were lost asleep: the loop was ready in time and woken too late.
    pub overslept: u32,
    /// How late the loop woke when it overslept \[ns\], the worst since the previous slot.
    pub overslept_ns: u64,
    /// Whether the slot has a deadline to miss; in virtual time it has none.
    pub has_deadline: bool,
    /// Whether its command is known to be held back as too late, as that of a recorded tick is.
    pub is_held: bool,
}

impl Slot {
    /// Whether a tick with these times sent its last frame after the end of its period.
    #[must_use]
    pub(crate) const fn has_missed(&self, times: &PhaseTimes, period_ns: u64) -> bool {
        self.has_deadline && times.total_ns > period_ns
    }

    /// Whether the period is over at `now_ns`.
    #[must_use]
    pub(crate) const fn is_over(&self, now_ns: u64, period_ns: u64) -> bool {
        self.has_deadline && now_ns > self.due_ns.saturating_add(period_ns)
    }

    /// Slot `number` of a loop with this period, due now: the slot of virtual time.
    #[must_use]
    pub fn on_time(number: u32, period_ns: u64, clock: &dyn Clock) -> Self {
        let time_ns = u64::from(number) * period_ns;
        Self {
            number,
            time_ns,
            due_ns: clock.now_ns(),
            skipped: 0,
            overslept: 0,
            overslept_ns: 0,
            has_deadline: false,
            is_held: false,
        }
    }
}

/// Hands out slots at their times.
#[derive(Debug, Clone)]
pub struct Pacer {
    period_ns: u64,
    /// How late a slot may start \[ns\].
    late_max_ns: u64,
    lock: PhaseLock,
    next: u64,
    skipped: u32,
    overslept: u32,
    overslept_ns: u64,
}

impl Pacer {
    /// A pacer whose first slot is the one of bench time `bench_ns`; `lock` must have an offset.
    #[must_use]
    pub fn new(period_ns: u64, lock: PhaseLock, bench_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        Self {
            period_ns,
            late_max_ns: period_ns / 2,
            lock,
            next: bench_ns / period_ns,
            skipped: 0,
            overslept: 0,
            overslept_ns: 0,
        }
    }

    /// The same, letting slots start late by this many periods more.
    #[must_use]
    pub fn queueing(mut self, slots: u32) -> Self {
        self.late_max_ns = self.period_ns / 2 + u64::from(slots) * self.period_ns;
        self
    }

    /// Sleeps until the next slot is due and returns it.
    ///
    /// `None` when the sleep ended too late for that slot: call again, it has been counted.
    pub fn wait(&mut self, clock: &dyn Clock) -> Option<Slot> {
        self.pass_over_late(clock.now_ns());
        let number = self.next;
        let due_ns = self.due_ns(number);
        clock.sleep_until_ns(due_ns);
        let woke_ns = clock.now_ns();
        let lost = self.pass_over_late(woke_ns);
        if lost > 0 {
            self.overslept = self.overslept.saturating_add(lost);
            self.overslept_ns = self.overslept_ns.max(woke_ns - due_ns);
            return None;
        }
        self.next += 1;
        let slot = Slot {
            number: u32::try_from(number).unwrap_or(u32::MAX),
            time_ns: number * self.period_ns,
            due_ns,
            skipped: core::mem::take(&mut self.skipped),
            overslept: core::mem::take(&mut self.overslept),
            overslept_ns: core::mem::take(&mut self.overslept_ns),
            has_deadline: true,
            is_held: false,
        };
        self.lock.creep(slot.skipped.saturating_add(1), self.period_ns);
        Some(slot)
    }

    /// Tells the pacer of an `EgoState`, for tracking the grid.
    pub fn note_ego(&mut self, bench_ns: u64, arrival: Arrival) {
        self.lock.note_ego(bench_ns, arrival, self.period_ns);
    }

    /// Clock reading at which slot `number` is due \[ns\].
    fn due_ns(&self, number: u64) -> u64 {
        let middle_ns = number * self.period_ns + self.period_ns / 2;
        middle_ns.saturating_add_signed(self.lock.offset_ns().unwrap_or(0))
    }

    /// Passes over every slot that may no longer start at `now_ns`; how many.
    fn pass_over_late(&mut self, now_ns: u64) -> u32 {
        let latest_start_ns = self.due_ns(self.next) + self.late_max_ns;
        let Some(late_ns) = now_ns.checked_sub(latest_start_ns + 1) else {
            return 0;
        };
        let passed = late_ns / self.period_ns + 1;
        self.next += passed;
        let passed = u32::try_from(passed).unwrap_or(u32::MAX);
        self.skipped = self.skipped.saturating_add(passed);
        passed
    }
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use super::*;

    const PERIOD_NS: u64 = 1_000_000;
    const OFFSET_NS: u64 = 50_000_000;

    /// A clock that moves only when slept on, and oversleeps once by `oversleep_ns`.
    struct FakeClock {
        now_ns: Cell<u64>,
        oversleep_ns: Cell<u64>,
    }

    impl FakeClock {
        fn at(now_ns: u64) -> Self {
            Self { now_ns: Cell::new(now_ns), oversleep_ns: Cell::new(0) }
        }

        fn advance(&self, by_ns: u64) {
            self.now_ns.set(self.now_ns.get() + by_ns);
        }
    }

    impl Clock for FakeClock {
        fn now_ns(&self) -> u64 {
            self.now_ns.get()
        }

        fn sleep_until_ns(&self, deadline_ns: u64) {
            self.now_ns.set(self.now_ns.get().max(deadline_ns) + self.oversleep_ns.take());
        }
    }

    fn pacer() -> Pacer {
        let mut lock = PhaseLock::new();
        lock.note_ego(0, Arrival { now_ns: OFFSET_NS, stamp_ns: 0 }, PERIOD_NS);
        Pacer::new(PERIOD_NS, lock, 0)
    }

    fn next(pacer: &mut Pacer, clock: &FakeClock) -> Slot {
        (0..3).find_map(|_| pacer.wait(clock)).expect("a slot within three sleeps")
    }

    #[test]
    fn slots_fall_half_a_period_after_the_rig_publishes() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        for number in 0..5_u32 {
            let slot = next(&mut pacer, &clock);
            assert_eq!((slot.number, slot.skipped), (number, 0));
            assert_eq!(slot.time_ns, u64::from(number) * PERIOD_NS);
            assert_eq!(clock.now_ns(), OFFSET_NS + u64::from(number) * PERIOD_NS + PERIOD_NS / 2);
        }
    }

    #[test]
    fn work_that_ends_before_the_deadline_skips_nothing() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        for number in 0..5 {
            assert_eq!(next(&mut pacer, &clock).number, number);
            clock.advance(PERIOD_NS - 1);
        }
    }

    #[test]
    fn a_short_overrun_starts_the_next_slot_late_but_costs_none() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        next(&mut pacer, &clock);
        clock.advance(PERIOD_NS + PERIOD_NS / 2);
        let slot = next(&mut pacer, &clock);
        assert_eq!((slot.number, slot.skipped), (1, 0));
        assert_eq!(clock.now_ns() - slot.due_ns, PERIOD_NS / 2);
    }

    #[test]
    fn a_long_overrun_skips_to_the_next_grid_point() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        next(&mut pacer, &clock);
        clock.advance(PERIOD_NS + PERIOD_NS / 2 + 1);
        let slot = next(&mut pacer, &clock);
        assert_eq!((slot.number, slot.skipped, slot.overslept), (2, 1, 0));
        assert_eq!(clock.now_ns(), slot.due_ns, "it waited for the grid point");
    }

    #[test]
    fn a_long_pause_is_never_caught_up_in_a_burst() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        next(&mut pacer, &clock);
        clock.advance(5_000_700_000);
        let (mut last_ns, mut total) = (0, 1);
        for _ in 0..10 {
            let slot = next(&mut pacer, &clock);
            let now_ns = clock.now_ns();
            assert!(now_ns - last_ns >= PERIOD_NS / 2, "starts are half a period apart");
            last_ns = now_ns;
            total += 1 + slot.skipped;
            assert_eq!(slot.number + 1, total, "every grid point is run or counted as skipped");
        }
    }

    #[test]
    fn a_queue_runs_late_slots_at_once_until_it_is_too_long() {
        let (pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        let mut pacer = pacer.queueing(4);
        next(&mut pacer, &clock);
        clock.advance(3 * PERIOD_NS + PERIOD_NS / 2);
        let (late_ns, slots) = (clock.now_ns(), [(); 3].map(|()| next(&mut pacer, &clock)));
        assert_eq!(slots.map(|slot| (slot.number, slot.skipped)), [(1, 0), (2, 0), (3, 0)]);
        assert_eq!(clock.now_ns(), late_ns, "without waiting");
        clock.advance(6 * PERIOD_NS);
        let slot = next(&mut pacer, &clock);
        assert_eq!((slot.number, slot.skipped), (5, 1), "four and a half periods late at most");
    }

    #[test]
    fn an_overslept_slot_is_counted_and_the_next_one_is_true_to_the_grid() {
        let (mut pacer, clock) = (pacer(), FakeClock::at(OFFSET_NS));
        next(&mut pacer, &clock);
        clock.oversleep_ns.set(2 * PERIOD_NS + 600_000);
        assert_eq!(pacer.wait(&clock), None);
        let slot = next(&mut pacer, &clock);
        assert_eq!((slot.number, slot.skipped, slot.overslept), (4, 3, 3));
        assert_eq!(slot.overslept_ns, 2_600_000);
        assert_eq!(slot.time_ns, 4 * PERIOD_NS);
        assert_eq!(next(&mut pacer, &clock).overslept_ns, 0, "told once");
    }

    #[test]
    fn a_pacer_that_joins_late_numbers_its_slots_by_bench_time() {
        let mut lock = PhaseLock::new();
        lock.note_ego(7 * PERIOD_NS, Arrival { now_ns: 9_000_000, stamp_ns: 0 }, PERIOD_NS);
        let mut pacer = Pacer::new(PERIOD_NS, lock, 7 * PERIOD_NS);
        assert_eq!(next(&mut pacer, &FakeClock::at(9_000_000)).number, 7);
    }
}
