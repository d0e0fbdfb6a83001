//! Stamped states of one truck, looked up by time.
//!
//! Eq. 4 subtracts states *of the same instant*, both as old as the message. The receiver therefore
//! remembers its own states, and interpolates between messages of its predecessor.

use serde::{Deserialize, Serialize};

/// Where a truck was along the road, and how it moved.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Motion {
    /// When \[ns\] of bench time.
    pub time_ns: u64,
    /// CG position along the road \[m\].
    pub x_m: f64,
    /// Speed along the truck \[m/s\].
    pub speed_mps: f64,
    /// Acceleration \[m/s²\].
    pub accel_mps2: f64,
}

impl Motion {
    /// The motion continued to `time_ns` at constant acceleration, for at most `limit_s`.
    pub fn extrapolated(&self, time_ns: u64, limit_s: f64) -> Self {
        let t = seconds_between(self.time_ns, time_ns).clamp(-limit_s, limit_s);
        Self {
            time_ns,
            x_m: self.x_m + self.speed_mps * t + 0.5 * self.accel_mps2 * t * t,
            speed_mps: self.speed_mps + self.accel_mps2 * t,
            accel_mps2: self.accel_mps2,
        }
    }

    /// The motion at `time_ns` on the straight line between two stamped ones.
    fn between(&self, later: &Self, time_ns: u64) -> Self {
        let span = seconds_between(self.time_ns, later.time_ns);
        let f = if span > 0.0 { seconds_between(self.time_ns, time_ns) / span } else { 1.0 };
        let mix = |a: f64, b: f64| a + f * (b - a);
        Self {
            time_ns,
            x_m: mix(self.x_m, later.x_m),
            speed_mps: mix(self.speed_mps, later.speed_mps),
            accel_mps2: mix(self.accel_mps2, later.accel_mps2),
        }
    }
}

/// `later - earlier` \[s\]; negative when the order is reversed.
pub fn seconds_between(earlier_ns: u64, later_ns: u64) -> f64 {
    1e-9 * later_ns.wrapping_sub(earlier_ns) as i64 as f64
}

/// Entries of a history.
const LENGTH: usize = 64;
/// Spacing of kept entries \[ns\]: 64 of them reach back 0.64 s, more than twice the longest delay
/// the gain is designed for, and a straight line over 10 ms misses the position by less than
/// 0.05 mm at 4 m/s².
const SPACING_NS: u64 = 10_000_000;

/// The recent past of one truck, thinned to one entry per 10 ms whatever the loop's rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct History {
    #[serde(with = "serde_big_array::BigArray")]
    ring: [Motion; LENGTH],
    /// Where the newest entry is.
    newest: usize,
    count: usize,
}

impl History {
    /// A history without entries.
    pub const fn new() -> Self {
        let none = Motion { time_ns: 0, x_m: 0.0, speed_mps: 0.0, accel_mps2: 0.0 };
        Self { ring: [none; LENGTH], newest: 0, count: 0 }
    }

    /// Notes a motion. One that is not newer than the newest is left out: a repeated message adds
    /// nothing, and time does not run backwards.
    pub fn note(&mut self, motion: Motion) {
        if self.newest().is_some_and(|newest| motion.time_ns <= newest.time_ns) {
            return;
        }
        // The newest entry moves with the truck until it is far enough from the one before.
        let before = self.nth_back(1);
        let keep = before
            .is_none_or(|b| self.ring[self.newest].time_ns.saturating_sub(b.time_ns) >= SPACING_NS);
        if keep && self.count > 0 {
            self.newest = (self.newest + 1) % LENGTH;
        }
        if keep && self.count < LENGTH {
            self.count += 1;
        }
        self.ring[self.newest] = motion;
    }

    /// The newest entry.
    pub fn newest(&self) -> Option<Motion> {
        self.nth_back(0)
    }

    /// The motion at `time_ns`: interpolated inside the history, the nearest end extrapolated by
    /// at most `limit_s` outside it. `None` when empty.
    pub fn at(&self, time_ns: u64, limit_s: f64) -> Option<Motion> {
        let mut later = self.newest()?;
        if time_ns >= later.time_ns {
            return Some(later.extrapolated(time_ns, limit_s));
        }
        for back in 1..self.count {
            let earlier = self.nth_back(back)?;
            if time_ns >= earlier.time_ns {
                return Some(earlier.between(&later, time_ns));
            }
            later = earlier;
        }
        Some(later.extrapolated(time_ns, limit_s))
    }

    fn nth_back(&self, back: usize) -> Option<Motion> {
        (back < self.count).then(|| self.ring[(self.newest + LENGTH - back) % LENGTH])
    }
}

impl Default for History {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn cruising(time_ns: u64) -> Motion {
        Motion { time_ns, x_m: 20.0 * 1e-9 * time_ns as f64, speed_mps: 20.0, accel_mps2: 0.0 }
    }

    #[test]
    fn a_state_is_found_at_any_time_within_the_longest_delay_at_any_rate() {
        for period_ns in [MS / 10, MS, 2 * MS, 10 * MS, 50 * MS] {
            let mut history = History::new();
            let now = 2_000 * MS;
            for k in 0..=now / period_ns {
                history.note(cruising(k * period_ns));
            }
            for back_ms in [0, 1, 3, 17, 99, 150, 250, 500] {
                let time = now - back_ms * MS;
                let found = history.at(time, 0.25).expect("not empty");
                assert!((found.x_m - cruising(time).x_m).abs() < 1e-9, "{period_ns} {back_ms}");
            }
        }
    }

    #[test]
    fn a_repeated_or_older_message_changes_nothing() {
        let mut history = History::new();
        history.note(cruising(20 * MS));
        history.note(cruising(40 * MS));
        let before = history;
        history.note(cruising(40 * MS));
        history.note(cruising(30 * MS));
        assert_eq!(history, before);
    }

    #[test]
    fn extrapolation_stops_at_its_limit() {
        let mut history = History::new();
        history.note(cruising(0));
        let found = history.at(1_000 * MS, 0.25).expect("not empty");
        assert!((found.x_m - 5.0).abs() < 1e-12);
    }
}
