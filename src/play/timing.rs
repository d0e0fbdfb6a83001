//! How well played frames kept their times.

use std::collections::BTreeMap;
use std::fmt;

use hdrhistogram::Histogram;
use serde::{Serialize, Serializer};

/// Largest error that is told apart \[ns\]: ten seconds.
const ERROR_MAX_NS: u64 = 10_000_000_000;

/// A distribution of times.
#[derive(Debug)]
struct Times(Histogram<u64>);

impl Default for Times {
    fn default() -> Self {
        Self(Histogram::new_with_bounds(1, ERROR_MAX_NS, 3).expect("the bounds are constants"))
    }
}

impl Times {
    fn note(&mut self, time_ns: u64) {
        self.0.saturating_record(time_ns);
    }

    fn us(&self, share: f64) -> f64 {
        self.0.value_at_quantile(share) as f64 * 1e-3
    }
}

impl Serialize for Times {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let told = [("p50", 0.5), ("p99", 0.99), ("p999", 0.999), ("max", 1.0)];
        serializer.collect_map(told.map(|(name, share)| (name, self.us(share))))
    }
}

/// How well played frames kept their times.
#[derive(Debug, Default, Serialize)]
pub struct Timing {
    /// Frames played.
    pub frames: u64,
    /// Those that the bus did not take.
    pub refused: u64,
    /// How late frames were \[µs\].
    late_us: Times,
    /// By how much the time since the frame before on the same bus was wrong \[µs\].
    between_us: Times,
    #[serde(skip)]
    before: BTreeMap<u8, (u64, u64)>,
}

impl Timing {
    /// Takes a frame that was due and sent at these readings of the clock \[ns\].
    pub fn note(&mut self, bus: u8, due_ns: u64, sent_ns: u64, is_refused: bool) {
        self.frames += 1;
        self.refused += u64::from(is_refused);
        self.late_us.note(sent_ns.saturating_sub(due_ns));
        if let Some((due_before_ns, sent_before_ns)) = self.before.insert(bus, (due_ns, sent_ns)) {
            let (asked_ns, was_ns) = (due_ns - due_before_ns, sent_ns - sent_before_ns);
            self.between_us.note(asked_ns.abs_diff(was_ns));
        }
    }
}

impl fmt::Display for Timing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} frames played, {} refused by the bus", self.frames, self.refused)?;
        for (what, times) in [("late by", &self.late_us), ("gap wrong by", &self.between_us)] {
            writeln!(
                f,
                "  {what:13} p50 {:.0}, p99 {:.0}, p99.9 {:.0}, at most {:.0} µs",
                times.us(0.5),
                times.us(0.99),
                times.us(0.999),
                times.us(1.0)
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lateness_and_gaps_are_told_apart() {
        let mut timing = Timing::default();
        for n in 0..1000 {
            // Always 70 µs late: no gap is wrong.
            timing.note(0, n * 1_000_000, n * 1_000_000 + 70_000, false);
        }
        assert!((timing.late_us.us(0.99) - 70.0).abs() < 0.1);
        assert!(timing.between_us.us(1.0) < 0.1, "{timing}");
    }
}
