//! The verdict on deadlines, net of what the machine itself is worth.
//!
//! A tick that ends late on a machine that wakes threads late says nothing about the controller.
//! The share of late ticks is therefore judged beside the share of late wake-ups of a thread that
//! does nothing else, both with their statistical uncertainty. Slots that the program lost by
//! itself, by the evidence of each miss, count against it on any machine.

use controller_rt::Report;
use serde::{Deserialize, Serialize};
use traces::MissCause;
use vcan_setup::floor::Floor;

use crate::failure::{EXIT_INCONCLUSIVE, Failure};
use crate::summary::Verdict;

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
    /// The share seen; 0 of nothing.
    pub fn share(self) -> f64 {
        self.events as f64 / self.trials.max(1) as f64
    }

    /// 95 % interval of how much more probable this is than `other`: method 10 of R. G. Newcombe,
    /// Statistics in Medicine 17 (1998) 873-890, from both of Wilson's intervals.
    pub fn interval_above(self, other: Self) -> (f64, f64) {
        let (p, q) = (self.share(), other.share());
        let ((low, high), (other_low, other_high)) = (self.interval(), other.interval());
        let below = (p - low).hypot(other_high - q);
        let above = (high - p).hypot(q - other_low);
        (p - q - below, p - q + above)
    }

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

/// What a verdict on deadlines stands on. Shares are of slots; intervals are of 95 %.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// The verdict.
    pub verdict: TimingVerdict,
    /// Share of slots that may be lost.
    pub allowed_share: f64,
    /// Slots lost, missed or skipped, after the startup grace.
    pub lost: u64,
    /// Slots there were.
    pub slots: u64,
    /// Interval of the share lost.
    pub lost_share: (f64, f64),
    /// Of those lost, the ones for which the evidence names the program itself.
    pub own: u64,
    /// Interval of their share.
    pub own_share: (f64, f64),
    /// Interval of the share of wake-ups of the sentinel that would have lost a slot.
    pub floor_share: (f64, f64),
    /// Interval of the share lost, net of the floor's.
    pub net_share: (f64, f64),
    /// Losses in the first so many seconds do not count \[s\].
    pub startup_grace_s: f64,
    /// Slots lost in them.
    pub forgiven: u64,
    /// Which CPUs rig and ECUs were kept on.
    pub cpus: String,
}

impl Timing {
    /// Judges what ECUs report beside the machine's floor.
    pub fn new(
        ecus: &[Report],
        floor: &Floor,
        period_ns: u64,
        (startup_grace_s, cpus): (f64, String),
    ) -> Self {
        let sum = |of: &dyn Fn(&Report) -> u64| ecus.iter().map(of).sum::<u64>();
        let forgiven = sum(&|ecu| ecu.forgiven);
        let slots = sum(&|ecu| ecu.ticks + ecu.skipped);
        let lost = Share { events: sum(&|ecu| ecu.misses + ecu.skipped) - forgiven, trials: slots };
        // The forgiven ones may have been among them.
        let own = Share { events: sum(&own_losses).saturating_sub(forgiven), trials: slots };
        let machine = late_wakeups(floor, period_ns);
        Self {
            verdict: judge(lost, own, machine),
            allowed_share: LATE_SHARE_MAX,
            lost: lost.events,
            slots,
            lost_share: lost.interval(),
            own: own.events,
            own_share: own.interval(),
            floor_share: machine.interval(),
            net_share: lost.interval_above(machine),
            startup_grace_s,
            forgiven,
            cpus,
        }
    }
}

impl TimingVerdict {
    /// The end of a run in which deadlines count as much as behaviour.
    ///
    /// # Errors
    /// When the machine was too late by itself to tell.
    pub fn strictly(self, behaviour: Verdict) -> Result<Verdict, Failure> {
        match (behaviour, self) {
            (Verdict::Fail, _) | (_, Self::Fail) => Ok(Verdict::Fail),
            (Verdict::Pass, Self::Pass | Self::Virtual) => Ok(Verdict::Pass),
            (Verdict::Pass, Self::Inconclusive) => Err(Failure::with_code(
                EXIT_INCONCLUSIVE,
                "timing inconclusive: this machine is late by itself, or the run too short; free \
                 it of other work, grant real-time priority (platoon vcan check), or run longer",
            )),
        }
    }
}

/// Slots an ECU lost to its own program, by the evidence.
fn own_losses(ecu: &Report) -> u64 {
    let own = [
        MissCause::CanWait,
        MissCause::CanDrain,
        MissCause::Law,
        MissCause::QpIterations,
        MissCause::PageFault,
        MissCause::Recorder,
    ];
    let counts = own
        .iter()
        .flat_map(|cause| [ecu.miss_causes.get(cause.word()), ecu.skip_causes.get(cause.word())]);
    counts.flatten().sum()
}

/// Wake-ups of the bare machine that would have cost a tick half its period.
pub fn late_wakeups(floor: &Floor, period_ns: u64) -> Share {
    let lateness = floor.lateness_ns();
    let punctual = lateness.count_between(0, period_ns / 2);
    Share { events: lateness.len().saturating_sub(punctual), trials: lateness.len() }
}

/// Judges lost slots: all of them, those the program lost by itself, and what the machine loses.
///
/// They cannot both pass and fail: who surely loses few slots cannot surely lose many by itself.
pub fn judge(lost: Share, own: Share, machine: Share) -> TimingVerdict {
    let (least, most) = lost.interval();
    let (least_own, _) = own.interval();
    let (_, late) = machine.interval();
    if most <= LATE_SHARE_MAX {
        TimingVerdict::Pass
    } else if least_own > LATE_SHARE_MAX || least > LATE_SHARE_MAX + MACHINE_FACTOR * late {
        TimingVerdict::Fail
    } else {
        TimingVerdict::Inconclusive
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Share = Share { events: 0, trials: 10_000 };

    fn slots(events: u64, trials: u64) -> Share {
        Share { events, trials }
    }

    #[test]
    fn many_punctual_ticks_pass_and_many_late_ones_fail() {
        let judged = |lost| judge(slots(lost, 400_000), slots(0, 400_000), QUIET);
        assert_eq!(judged(3), TimingVerdict::Pass);
        assert_eq!(judged(8_000), TimingVerdict::Fail);
    }

    #[test]
    fn a_late_machine_or_a_short_run_decides_nothing() {
        let nothing = slots(0, 400_000);
        let late = slots(300, 10_000);
        assert_eq!(judge(slots(8_000, 400_000), nothing, late), TimingVerdict::Inconclusive);
        assert_eq!(judge(slots(0, 100), slots(0, 100), QUIET), TimingVerdict::Inconclusive);
        let none = Share::default();
        assert_eq!(judge(none, none, QUIET), TimingVerdict::Inconclusive);
    }

    #[test]
    fn what_the_program_loses_by_itself_fails_on_any_machine() {
        let late = slots(300, 10_000);
        let judged = |own| judge(slots(120, 4_000), slots(own, 4_000), late);
        assert_eq!(judged(16), TimingVerdict::Fail, "a stall of 3 ms in a thousand ticks");
        assert_eq!(judged(4), TimingVerdict::Inconclusive);
    }

    #[test]
    fn strict_timing_makes_three_ends_of_one() {
        use TimingVerdict::{Fail, Inconclusive, Pass, Virtual};
        let end = |timing: TimingVerdict, behaviour| timing.strictly(behaviour).ok();
        assert_eq!(end(Pass, Verdict::Pass), Some(Verdict::Pass));
        assert_eq!(end(Virtual, Verdict::Pass), Some(Verdict::Pass));
        assert_eq!(end(Fail, Verdict::Pass), Some(Verdict::Fail));
        assert_eq!(end(Inconclusive, Verdict::Fail), Some(Verdict::Fail));
        assert_eq!(end(Inconclusive, Verdict::Pass), None);
    }

    #[test]
    fn newcombes_interval_matches_the_published_example() {
        // 56 of 70 against 48 of 80: 0.2000 (0.0524, 0.3339) [Newcombe 1998, table II, method 10].
        let (low, high) = slots(56, 70).interval_above(slots(48, 80));
        assert!((low - 0.0524).abs() < 1e-4 && (high - 0.3339).abs() < 1e-4, "{low} {high}");
    }

    #[test]
    fn wilsons_interval_matches_the_published_example() {
        // 15 of 148: (0.0624, 0.1605) [R. G. Newcombe, Statistics in Medicine 17 (1998), table I].
        let (low, high) = Share { events: 15, trials: 148 }.interval();
        assert!((low - 0.0624).abs() < 1e-4 && (high - 0.1605).abs() < 1e-4, "{low} {high}");
    }
}
