//! The loop's account of itself: distributions per phase, misses and their causes, skips.
//!
//! A tick *misses* when its last frame was handed to the bus after the end of its period, one
//! period after it was due. A slot is *skipped* when it could not start within half a period; it
//! is not counted as missed besides. The wake-up that lost it is in the histogram of `wake` though,
//! or the worst ones would be missing from it. Histograms have a fixed range, so counting never
//! allocates; what exceeds the range is counted at its end, and `max` is exact.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use law::{Decision, Outcome};
use traces::MissCause;

use crate::guard::Reason;
use crate::laps::PhaseTimes;
use crate::pacer::Slot;
use crate::report::{Percentiles, QpTotals};

/// Longest time a histogram tells apart \[ns\].
const RANGE_NS: u64 = 10_000_000_000;
/// Significant decimal digits of a histogram.
const DIGITS: u8 = 3;
const PHASES: usize = 8;
/// Place of the wake-up among the phases.
const WAKE: usize = 0;
const CAUSES: [(MissCause, &str); 7] = [
    (MissCause::Wake, "wake"),
    (MissCause::Drain, "drain"),
    (MissCause::Ucl, "ucl"),
    (MissCause::LmlBuild, "lml_build"),
    (MissCause::Qp, "qp"),
    (MissCause::Guard, "guard"),
    (MissCause::Send, "send"),
];

/// Everything counted over a run.
#[derive(Debug, Clone)]
pub struct Statistics {
    phases: [Phase; PHASES],
    ticks: u64,
    misses: u64,
    skipped: u64,
    overslept: u64,
    causes: [u64; CAUSES.len()],
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
            overslept: 0,
            causes: [0; CAUSES.len()],
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

    /// The QP solver's totals.
    #[must_use]
    pub const fn qp(&self) -> QpTotals {
        self.qp
    }

    /// Counts one tick's times; what made it miss, `None` when it did not.
    pub fn count_times(&mut self, slot: &Slot, times: &PhaseTimes, period_ns: u64) -> MissCause {
        self.ticks += 1;
        self.skipped += u64::from(slot.skipped);
        self.overslept += u64::from(slot.overslept);
        if slot.overslept > 0 {
            self.phases[WAKE].count(slot.overslept_ns);
        }
        for (phase, (_, took_ns)) in self.phases.iter_mut().zip(times.named()) {
            if let Some(took_ns) = took_ns {
                phase.count(took_ns);
            }
        }
        if !slot.has_deadline || times.total_ns <= period_ns {
            return MissCause::None;
        }
        self.misses += 1;
        let cause = largest(times);
        self.causes[cause] += 1;
        CAUSES[cause].0
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
        occurred(CAUSES.iter().map(|(_, name)| *name).zip(self.causes))
    }

    /// Skipped slots by cause, those that occurred: `wake` when the loop slept through them,
    /// `overrun` when it was still busy with an earlier one.
    #[must_use]
    pub fn skip_causes(&self) -> BTreeMap<String, u64> {
        let overrun = self.skipped - self.overslept;
        occurred([("wake", self.overslept), ("overrun", overrun)].into_iter())
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

/// The phase that took longest, as an index into [`CAUSES`]; the earliest of equals.
fn largest(times: &PhaseTimes) -> usize {
    let mut largest = (0, 0);
    for (index, (_, took_ns)) in times.named().into_iter().take(CAUSES.len()).enumerate() {
        let took_ns = took_ns.unwrap_or(0);
        if took_ns > largest.1 {
            largest = (index, took_ns);
        }
    }
    largest.0
}

fn occurred(counts: impl Iterator<Item = (&'static str, u64)>) -> BTreeMap<String, u64> {
    counts.filter(|&(_, count)| count > 0).map(|(name, count)| (name.to_owned(), count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000;

    const SLOT: Slot = Slot {
        number: 0,
        time_ns: 0,
        due_ns: 0,
        skipped: 0,
        overslept: 0,
        overslept_ns: 0,
        has_deadline: true,
    };

    fn times(wake_ns: u64, qp_ns: u64) -> PhaseTimes {
        PhaseTimes {
            wake_ns,
            drain_ns: 10,
            qp_ns: Some(qp_ns),
            total_ns: wake_ns + 10 + qp_ns,
            ..PhaseTimes::default()
        }
    }

    #[test]
    fn the_deadline_is_the_end_of_the_period_and_not_earlier() {
        let mut statistics = Statistics::new();
        let on_time = times(0, PERIOD_NS - 10);
        assert_eq!(statistics.count_times(&SLOT, &on_time, PERIOD_NS), MissCause::None);
        let late = times(0, PERIOD_NS - 9);
        assert_eq!(statistics.count_times(&SLOT, &late, PERIOD_NS), MissCause::Qp);
        assert_eq!((statistics.ticks(), statistics.misses()), (2, 1));
    }

    #[test]
    fn a_miss_is_blamed_on_the_phase_that_took_longest() {
        let mut statistics = Statistics::new();
        statistics.count_times(&SLOT, &times(900_000, 200_000), PERIOD_NS);
        statistics.count_times(&SLOT, &times(200_000, 900_000), PERIOD_NS);
        statistics.count_times(&SLOT, &times(100_000, 900_001), PERIOD_NS);
        let expected = [("qp".to_owned(), 2), ("wake".to_owned(), 1)];
        assert_eq!(statistics.miss_causes(), BTreeMap::from(expected));
    }

    #[test]
    fn percentiles_are_exact_to_three_digits_and_the_maximum_fully() {
        let mut statistics = Statistics::new();
        for n in 1..=1000 {
            statistics.count_times(&SLOT, &times(n * 1000, 0), u64::MAX);
        }
        statistics.count_times(&SLOT, &times(123_456_789_012, 0), u64::MAX);
        let wake = statistics.percentiles()["wake"];
        assert!((wake.p50 - 501.0).abs() < 1.0, "{wake:?}");
        assert!((wake.p99 - 991.0).abs() < 1.5, "{wake:?}");
        assert_eq!(wake.max, 123_456_789.012, "beyond the histogram's range");
        assert!(statistics.percentiles()["ucl"].max == 0.0, "a phase that never took place");
    }

    #[test]
    fn skipped_slots_are_counted_by_cause_and_apart_from_misses() {
        let mut statistics = Statistics::new();
        let slot = Slot { skipped: 7, overslept: 4, overslept_ns: 4_200_000, ..SLOT };
        statistics.count_times(&slot, &times(0, 1), PERIOD_NS);
        assert_eq!((statistics.ticks(), statistics.misses(), statistics.skipped()), (1, 0, 7));
        let expected = [("overrun".to_owned(), 3), ("wake".to_owned(), 4)];
        assert_eq!(statistics.skip_causes(), BTreeMap::from(expected));
    }

    #[test]
    fn the_wake_up_that_lost_a_slot_is_not_missing_from_the_distribution() {
        let mut statistics = Statistics::new();
        let slot = Slot { skipped: 4, overslept: 4, overslept_ns: 4_200_000, ..SLOT };
        statistics.count_times(&slot, &times(100_000, 1), PERIOD_NS);
        assert_eq!(statistics.percentiles()["wake"].max, 4_200.0);
        assert!(statistics.percentiles()["total"].max < 200.0);
    }
}
