//! How well played frames kept their times.

use std::collections::BTreeMap;
use std::fmt;

use hdrhistogram::Histogram;
use serde::{Serialize, Serializer};
use vcan_setup::floor::Floor;

use crate::summary::Lateness;

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
    #[serde(flatten)]
    beside: Option<Beside>,
    #[serde(skip)]
    before: BTreeMap<u8, (u64, u64)>,
}

/// What the machine did meanwhile.
#[derive(Debug, Serialize)]
struct Beside {
    /// How late it woke a thread that did nothing else \[µs\].
    machine_floor_us: Lateness,
    /// On how many wake-ups that stands.
    machine_wakeups: u64,
    net_of_floor_us: Net,
}

/// What of the 99th percentiles the machine does not explain, at least 0 \[µs\]: a frame can be
/// sent no earlier than its thread is woken, and a gap is wrong by no more than one of its ends was
/// late.
#[derive(Debug, Serialize)]
struct Net {
    late_p99: f64,
    between_p99: f64,
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

    /// Takes over how late the machine was by itself while the frames were played.
    pub fn set_beside(&mut self, floor: &Floor) {
        let machine_floor_us = Lateness::new(floor);
        let net = |times: &Times| (times.us(0.99) - machine_floor_us.p99).max(0.0);
        let net_of_floor_us =
            Net { late_p99: net(&self.late_us), between_p99: net(&self.between_us) };
        let machine_wakeups = floor.samples();
        self.beside = Some(Beside { machine_floor_us, machine_wakeups, net_of_floor_us });
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
        self.beside.as_ref().map_or(Ok(()), |beside| beside.fmt(f))
    }
}

impl fmt::Display for Beside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Lateness { p50, p99, p999, max } = self.machine_floor_us;
        let Net { late_p99, between_p99 } = self.net_of_floor_us;
        writeln!(
            f,
            "  machine late  p50 {p50:.0}, p99 {p99:.0}, p99.9 {p999:.0}, at most {max:.0} µs"
        )?;
        writeln!(f, "  net of it     p99 {late_p99:.0} late, {between_p99:.0} µs of gaps")
    }
}

#[cfg(test)]
mod tests {
    use vcan_setup::floor::CpuFloor;
    use vcan_setup::realtime::Policy;

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

    #[test]
    fn what_the_machine_is_late_by_itself_is_not_the_players() {
        let mut timing = Timing::default();
        for n in 0..1000 {
            timing.note(0, n * 1_000_000, n * 1_000_000 + 70_000, false);
        }
        let told = serde_json::to_value(&timing).expect("plain numbers");
        assert!(told.get("machine_floor_us").is_none(), "nobody measured it: {told}");
        let mut lateness_ns = Histogram::new_with_bounds(1, ERROR_MAX_NS, 3).expect("bounds");
        lateness_ns.record_n(50_000, 1000).expect("in bounds");
        let cpu = CpuFloor {
            cpu: 0,
            policy: Policy::Fifo,
            priority: 81,
            refused: Vec::new(),
            lateness_ns,
            slept_through: 0,
        };
        timing.set_beside(&Floor { cpus: vec![cpu] });
        let told = serde_json::to_value(&timing).expect("plain numbers");
        assert_eq!(told["machine_wakeups"], 1000);
        let late = told["net_of_floor_us"]["late_p99"].as_f64().expect("a number");
        assert!((late - 20.0).abs() < 0.2, "{told}");
        assert_eq!(told["net_of_floor_us"]["between_p99"], 0.0);
    }
}
