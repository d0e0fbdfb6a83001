//! The loop's account of itself: distributions per phase, misses and their causes, skips.
//!
//! A tick *misses* when its last frame was handed to the bus after the end of its period, one
//! period after it was due; why, the inquest finds. A slot is *skipped* when it could not start
//! within half a period; it is not counted as missed besides. The wake-up that lost it is in the
//! histogram of `wake` though, or the worst ones would be missing from it. Histograms have a fixed
//! range, so counting never allocates; what exceeds the range is counted at its end, and `max` is
//! exact.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use law::{Decision, Outcome};
use traces::MissCause;

use crate::guard::Reason;
use crate::inquest::Finding;
use crate::laps::{PHASES, PhaseTimes};
use crate::pacer::Slot;
use crate::report::{Lapses, Percentiles, QpTotals};

/// Longest time a histogram tells apart \[ns\].
const RANGE_NS: u64 = 10_000_000_000;
/// Significant decimal digits of a histogram.
const DIGITS: u8 = 3;
/// Place of the wake-up among the phases.
const WAKE: usize = 0;
/// Causes of a miss, none among them.
const CAUSES: usize = MissCause::ALL.len();

/// Everything counted over a run.
#[derive(Debug, Clone)]
pub struct Statistics {
    phases: [Phase; PHASES],
    ticks: u64,
    misses: u64,
    skipped: u64,
    forgiven: u64,
    stale: u64,
    held: u64,
    miss_causes: [u64; CAUSES],
    skip_causes: [u64; CAUSES],
    /// After the grace, by first cause.
    lapses: [Lapses; CAUSES],
    /// The first cause of the lapse that is going on.
    lapse: Option<MissCause>,
    /// After the grace, from due to the last frame or to a wake-up that lost the slot \[ns\].
    slowest_ns: u64,
    guard: [u64; Reason::ALL.len()],
    qp: QpTotals,
}

#[derive(Debug, Clone)]
struct Phase {
    histogram: Histogram<u32>,
    max_ns: u64,
}

impl Default for Statistics {
    fn default() -> Self {
        Self::new()
    }
}

impl Statistics {
    /// Nothing counted yet; allocates all it will ever need.
    #[must_use]
    pub fn new() -> Self {
        let phases = core::array::from_fn(|_| Phase {
            histogram: Histogram::new_with_bounds(1, RANGE_NS, DIGITS)
                .expect("the constant bounds are valid"),
            max_ns: 0,
        });
        Self {
            phases,
            ticks: 0,
            misses: 0,
            skipped: 0,
            forgiven: 0,
            stale: 0,
            held: 0,
            miss_causes: [0; CAUSES],
            skip_causes: [0; CAUSES],
            lapses: [Lapses::default(); CAUSES],
            lapse: None,
            slowest_ns: 0,
            guard: [0; Reason::ALL.len()],
            qp: QpTotals::default(),
        }
    }

    /// Ticks run.
    #[must_use]
    pub const fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Ticks that missed their deadline.
    #[must_use]
    pub const fn misses(&self) -> u64 {
        self.misses
    }

    /// Slots skipped.
    #[must_use]
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Slots lost that count: missed or skipped, but not forgiven.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.misses + self.skipped - self.forgiven
    }

    /// Slots lost while the run was starting up.
    #[must_use]
    pub const fn forgiven(&self) -> u64 {
        self.forgiven
    }

    /// Ticks that ran on an older `EgoState` than their own.
    #[must_use]
    pub const fn stale(&self) -> u64 {
        self.stale
    }

    /// Commands that came too late and were not sent.
    #[must_use]
    pub const fn held(&self) -> u64 {
        self.held
    }

    /// The QP solver's totals.
    #[must_use]
    pub const fn qp(&self) -> QpTotals {
        self.qp
    }

    /// Counts one tick's times, and why it and the slots before it were lost, if they were.
    pub fn count_times(
        &mut self,
        slot: &Slot,
        times: &PhaseTimes,
        finding: &Finding,
        is_forgiven: bool,
    ) {
        self.ticks += 1;
        if slot.overslept > 0 {
            self.phases[WAKE].count(slot.overslept_ns);
        }
        for (phase, (_, took_ns)) in self.phases.iter_mut().zip(times.named()) {
            if let Some(took_ns) = took_ns {
                phase.count(took_ns);
            }
        }
        let (missed, skipped) = (finding.miss != MissCause::None, u64::from(slot.skipped));
        self.misses += u64::from(missed);
        self.skipped += skipped;
        self.miss_causes[finding.miss as usize] += u64::from(missed);
        self.skip_causes[finding.skip as usize] += skipped;
        if is_forgiven {
            self.forgiven += u64::from(missed) + skipped;
            return;
        }
        self.slowest_ns = self.slowest_ns.max(times.total_ns).max(slot.overslept_ns);
        self.count_lapse(finding, skipped, u64::from(missed));
    }

    /// Counts slots lost without a good tick between them as one lapse.
    fn count_lapse(&mut self, finding: &Finding, skipped: u64, missed: u64) {
        if skipped + missed == 0 {
            self.lapse = None;
            return;
        }
        let begins = if skipped > 0 { finding.skip } else { finding.miss };
        let is_new = self.lapse.is_none();
        let cause = *self.lapse.get_or_insert(begins);
        let lapses = &mut self.lapses[cause as usize];
        lapses.times += u64::from(is_new);
        lapses.slots += skipped + missed;
        if missed == 0 {
            self.lapse = None;
        }
    }

    /// Counts what a tick had to do without: its own `EgoState`, its own command.
    pub fn count_lacks(&mut self, is_stale: bool, is_held: bool) {
        self.stale += u64::from(is_stale);
        self.held += u64::from(is_held);
    }

    /// Counts what the guard did.
    pub fn count_guard(&mut self, reason: Reason) {
        self.guard[reason as usize] += 1;
    }

    /// Counts how the law came to its decision.
    pub fn count_decision(&mut self, decision: &Decision) {
        match decision.outcome {
            Outcome::Held => return,
            Outcome::Solved => {}
            Outcome::IterationCap | Outcome::Infeasible => self.qp.failures += 1,
        }
        self.qp.solves += 1;
        self.qp.iterations_max = self.qp.iterations_max.max(decision.lml.qp.iterations);
    }

    /// Percentiles of every phase \[µs\]; allocates, for the report only.
    #[must_use]
    pub fn percentiles(&self) -> BTreeMap<String, Percentiles> {
        let names = PhaseTimes::default().named().map(|(name, _)| name);
        names
            .into_iter()
            .zip(&self.phases)
            .map(|(name, phase)| (name.to_owned(), phase.percentiles()))
            .collect()
    }

    /// Misses by cause, those that occurred.
    #[must_use]
    pub fn miss_causes(&self) -> BTreeMap<String, u64> {
        occurred(MissCause::ALL.iter().map(|cause| cause.word()).zip(self.miss_causes))
    }

    /// Skipped slots by cause, those that occurred.
    #[must_use]
    pub fn skip_causes(&self) -> BTreeMap<String, u64> {
        occurred(MissCause::ALL.iter().map(|cause| cause.word()).zip(self.skip_causes))
    }

    /// Runs of lost slots by the cause of the first, those that occurred after the grace.
    #[must_use]
    pub fn lapses(&self) -> BTreeMap<String, Lapses> {
        let named = MissCause::ALL.iter().map(|cause| cause.word().to_owned()).zip(self.lapses);
        named.filter(|(_, lapses)| lapses.times > 0).collect()
    }

    /// The longest that a tick after the grace took from due to its last frame, or a wake-up that
    /// lost its slot \[µs\].
    #[must_use]
    pub fn slowest_us(&self) -> f64 {
        self.slowest_ns as f64 / 1e3
    }

    /// Guard interventions by reason, those that occurred.
    #[must_use]
    pub fn guard_reasons(&self) -> BTreeMap<String, u64> {
        let names = Reason::ALL.map(Reason::name);
        occurred(names.into_iter().zip(self.guard).skip(1))
    }
}

impl Phase {
    fn count(&mut self, took_ns: u64) {
        self.histogram.saturating_record(took_ns);
        self.max_ns = self.max_ns.max(took_ns);
    }

    fn percentiles(&self) -> Percentiles {
        let us = |quantile: f64| {
            self.histogram.value_at_quantile(quantile).min(self.max_ns) as f64 / 1000.0
        };
        Percentiles {
            p50: us(0.5),
            p90: us(0.9),
            p99: us(0.99),
            p999: us(0.999),
            max: self.max_ns as f64 / 1000.0,
        }
    }
}

fn occurred(counts: impl Iterator<Item = (&'static str, u64)>) -> BTreeMap<String, u64> {
    counts.filter(|&(_, count)| count > 0).map(|(name, count)| (name.to_owned(), count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::witness::ThreadTotals;

    const IN_TIME: Finding = Finding {
        miss: MissCause::None,
        skip: MissCause::None,
        late_ns: 0,
        before: ThreadTotals::NOTHING,
        during: ThreadTotals::NOTHING,
        standstill_ns: 0,
        record_before_ns: 0,
    };

    fn wake(wake_ns: u64) -> PhaseTimes {
        PhaseTimes { wake_ns, total_ns: wake_ns, ..PhaseTimes::default() }
    }

    #[test]
    fn percentiles_are_exact_to_three_digits_and_the_maximum_fully() {
        let mut statistics = Statistics::new();
        let slot = Slot::default();
        for n in 1..=1000 {
            statistics.count_times(&slot, &wake(n * 1000), &IN_TIME, false);
        }
        statistics.count_times(&slot, &wake(123_456_789_012), &IN_TIME, false);
        let wake = statistics.percentiles()["wake"];
        assert!((wake.p50 - 501.0).abs() < 1.0, "{wake:?}");
        assert!((wake.p99 - 991.0).abs() < 1.5, "{wake:?}");
        assert_eq!(wake.max, 123_456_789.012, "beyond the histogram's range");
        assert!(statistics.percentiles()["ucl"].max == 0.0, "a phase that never took place");
    }

    #[test]
    fn misses_and_skipped_slots_are_counted_apart_each_by_cause() {
        let mut statistics = Statistics::new();
        let missed = Finding { miss: MissCause::Law, ..IN_TIME };
        statistics.count_times(&Slot::default(), &wake(1), &missed, false);
        let slot = Slot { skipped: 7, overslept: 7, overslept_ns: 7_200_000, ..Slot::default() };
        let skipped = Finding { skip: MissCause::HostPause, ..IN_TIME };
        statistics.count_times(&slot, &wake(1), &skipped, false);
        assert_eq!((statistics.ticks(), statistics.misses(), statistics.skipped()), (2, 1, 7));
        assert_eq!(statistics.miss_causes(), BTreeMap::from([("law".to_owned(), 1)]));
        assert_eq!(statistics.skip_causes(), BTreeMap::from([("host_pause".to_owned(), 7)]));
        assert_eq!(statistics.percentiles()["wake"].max, 7_200.0, "the wake-up that lost them");
    }

    #[test]
    fn slots_lost_in_a_row_are_one_lapse_of_the_first_cause() {
        let mut statistics = Statistics::new();
        let mut count = |skipped: u32, finding: &Finding, is_forgiven| {
            let slot = Slot { skipped, ..Slot::default() };
            statistics.count_times(&slot, &wake(1_000), finding, is_forgiven);
        };
        let missed = Finding { miss: MissCause::Law, ..IN_TIME };
        let skipped = Finding { skip: MissCause::HostPause, ..IN_TIME };
        count(9, &skipped, true);
        // A long tick, the two slots it cost, and one in time: a lapse of three slots.
        count(0, &missed, false);
        count(2, &Finding { skip: MissCause::Law, ..IN_TIME }, false);
        count(0, &IN_TIME, false);
        count(0, &missed, false);
        count(4, &skipped, false);
        count(5, &skipped, false);
        let expected = [
            ("host_pause".to_owned(), Lapses { times: 1, slots: 5 }),
            ("law".to_owned(), Lapses { times: 2, slots: 8 }),
        ];
        assert_eq!(statistics.lapses(), BTreeMap::from(expected));
    }

    #[test]
    fn what_is_lost_at_the_start_is_counted_and_forgiven() {
        let mut statistics = Statistics::new();
        let missed = Finding { miss: MissCause::Law, ..IN_TIME };
        let slot = Slot { skipped: 2, ..Slot::default() };
        statistics.count_times(&slot, &wake(1), &missed, true);
        statistics.count_times(&slot, &wake(1), &missed, false);
        assert_eq!((statistics.misses(), statistics.skipped()), (2, 4));
        assert_eq!((statistics.forgiven(), statistics.lost()), (3, 3));
    }
}
