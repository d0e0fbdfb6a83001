//! What ticks usually take: the measure for "longer than usual".

use crate::inquest::Work;
use crate::laps::PhaseTimes;

/// Ticks over which the averages forget: a new value counts for one in so many.
const FORGETTING: u64 = 64;

/// Averages over the ticks that met their deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Usual {
    drain_ns: Average,
    law_ns: Average,
    qp_ns: Average,
    frames: Average,
    iterations: Average,
}

/// An exponentially forgetting average in whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Average {
    /// The average times [`FORGETTING`]; `None` before the first value.
    scaled: Option<u64>,
}

impl Usual {
    /// Takes a tick that met its deadline into the averages.
    pub fn learn(&mut self, times: &PhaseTimes, work: Work) {
        self.drain_ns.learn(times.drain_ns);
        self.law_ns.learn(law_ns(times));
        self.frames.learn(u64::from(work.frames));
        if let (Some(qp_ns), Some(iterations)) = (times.qp_ns, work.iterations) {
            self.qp_ns.learn(qp_ns);
            self.iterations.learn(u64::from(iterations));
        }
    }

    /// How much longer than usual draining took \[ns\].
    #[must_use]
    pub fn drain_excess_ns(&self, times: &PhaseTimes) -> u64 {
        times.drain_ns.saturating_sub(self.drain_ns.value())
    }

    /// How much longer than usual everything that computes, but the QP, took \[ns\].
    #[must_use]
    pub fn law_excess_ns(&self, times: &PhaseTimes) -> u64 {
        law_ns(times).saturating_sub(self.law_ns.value())
    }

    /// How much longer than usual the QP took \[ns\].
    #[must_use]
    pub fn qp_excess_ns(&self, times: &PhaseTimes) -> u64 {
        times.qp_ns.unwrap_or(0).saturating_sub(self.qp_ns.value())
    }

    /// Frames in a tick.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.frames.value()
    }

    /// Iterations of a QP.
    #[must_use]
    pub fn iterations(&self) -> u64 {
        self.iterations.value()
    }
}

impl Average {
    fn learn(&mut self, value: u64) {
        self.scaled = Some(match self.scaled {
            None => value * FORGETTING,
            Some(scaled) => scaled - scaled / FORGETTING + value,
        });
    }

    fn value(self) -> u64 {
        self.scaled.map_or(0, |scaled| scaled.div_ceil(FORGETTING))
    }
}

fn law_ns(times: &PhaseTimes) -> u64 {
    let optional = times.ucl_ns.unwrap_or(0) + times.lml_build_ns.unwrap_or(0);
    times.observe_ns + optional + times.guard_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(drain_ns: u64, qp_ns: u64) -> PhaseTimes {
        PhaseTimes { drain_ns, qp_ns: Some(qp_ns), ..PhaseTimes::default() }
    }

    #[test]
    fn the_first_tick_is_usual_and_later_ones_move_it_slowly() {
        let (mut usual, work) = (Usual::default(), Work { frames: 4, iterations: Some(2) });
        usual.learn(&tick(8_000, 7_000), work);
        assert_eq!((usual.frames(), usual.iterations()), (4, 2));
        assert_eq!(usual.drain_excess_ns(&tick(9_000, 0)), 1_000);
        usual.learn(&tick(72_000, 7_000), work);
        assert_eq!(usual.drain_excess_ns(&tick(9_000, 0)), 0, "it is 9000 now");
        for _ in 0..1_000 {
            usual.learn(&tick(50_000, 7_000), work);
        }
        let excess_ns = usual.drain_excess_ns(&tick(60_000, 0));
        assert!((9_900..=10_100).contains(&excess_ns), "{excess_ns}");
    }

    #[test]
    fn a_tick_without_a_qp_says_nothing_about_qps() {
        let mut usual = Usual::default();
        usual.learn(&tick(1, 7_000), Work { frames: 1, iterations: Some(2) });
        usual.learn(&PhaseTimes::default(), Work { frames: 1, iterations: None });
        assert_eq!((usual.qp_excess_ns(&tick(1, 7_000)), usual.iterations()), (0, 2));
    }
}
