//! The verdict on deadlines, net of what the machine itself is worth.
//!
//! A tick that ends late on a machine that wakes threads late says nothing about the controller.
//! The share of late ticks is therefore judged beside the share of late wake-ups of a thread that
//! does nothing else, both with their statistical uncertainty.

use serde::{Deserialize, Serialize};

/// Share of late ticks a run may have and still pass; ours.
pub const LATE_SHARE_MAX: f64 = 1e-3;
/// How many times the machine's own share must be exceeded to count against the controller; ours.
/// Pauses of a machine come in bursts and hit each CPU by itself, so that two threads that do
/// nothing else differ by up to about a factor of two over a run.
const MACHINE_FACTOR: f64 = 2.0;
/// Two-sided 95 % quantile of the normal distribution.
const Z_95: f64 = 1.96;

/// The verdict on deadlines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimingVerdict {
    /// Surely no more late ticks than allowed.
    Pass,
    /// Surely more than allowed, and more than the machine explains.
    Fail,
    /// Too few ticks to tell, or the machine itself is too late.
    Inconclusive,
    /// Virtual time has no deadlines.
    Virtual,
}

/// How often something happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Share {
    /// Times it happened.
    pub events: u64,
    /// Times it could have.
    pub trials: u64,
}

impl Share {
    /// Wilson's 95 % interval of the underlying probability
    /// [E. B. Wilson, J. Am. Stat. Assoc. 22 (1927)].
    pub fn interval(self) -> (f64, f64) {
        if self.trials == 0 {
            return (0.0, 1.0);
        }
        let n = self.trials as f64;
        let p = self.events as f64 / n;
        let z2 = Z_95 * Z_95;
        let centre = p + z2 / (2.0 * n);
        let reach = Z_95 * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z2 / n;
        (((centre - reach) / scale).max(0.0), ((centre + reach) / scale).min(1.0))
    }
}

/// Judges late ticks beside the machine's own late wake-ups.
pub fn judge(ticks: Share, floor: Share) -> TimingVerdict {
    let (least, most) = ticks.interval();
    let (_, machine) = floor.interval();
    if most <= LATE_SHARE_MAX {
        TimingVerdict::Pass
    } else if least > LATE_SHARE_MAX + MACHINE_FACTOR * machine {
        TimingVerdict::Fail
    } else {
        TimingVerdict::Inconclusive
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Share = Share { events: 0, trials: 10_000 };

    #[test]
    fn many_punctual_ticks_pass_and_many_late_ones_fail() {
        assert_eq!(judge(Share { events: 3, trials: 400_000 }, QUIET), TimingVerdict::Pass);
        assert_eq!(judge(Share { events: 8_000, trials: 400_000 }, QUIET), TimingVerdict::Fail);
    }

    #[test]
    fn a_late_machine_or_a_short_run_decides_nothing() {
        let late = Share { events: 300, trials: 10_000 };
        assert_eq!(
            judge(Share { events: 8_000, trials: 400_000 }, late),
            TimingVerdict::Inconclusive
        );
        assert_eq!(judge(Share { events: 0, trials: 100 }, QUIET), TimingVerdict::Inconclusive);
        assert_eq!(judge(Share::default(), QUIET), TimingVerdict::Inconclusive);
    }

    #[test]
    fn wilsons_interval_matches_the_published_example() {
        // 15 of 148: (0.0624, 0.1605) [R. G. Newcombe, Statistics in Medicine 17 (1998), table I].
        let (low, high) = Share { events: 15, trials: 148 }.interval();
        assert!((low - 0.0624).abs() < 1e-4 && (high - 0.1605).abs() < 1e-4, "{low} {high}");
    }
}
