//! The verdict on deadlines, net of what the machine itself is worth.
//!
//! A tick that ends late on a machine that wakes threads late says nothing about the controller.
//! The share of late ticks is therefore judged beside the share of late wake-ups of a thread that
//! does nothing else, both with their statistical uncertainty. Slots that the program lost by
//! itself, by the evidence of each miss, count against it on any machine.
//!
//! Slots are lost in runs, and one cause that lasts costs many: what counts against the program are
//! therefore the runs, the *lapses*. Each ECU is judged by itself, and all of them together.

use controller_rt::Report;
use hdrhistogram::Histogram;
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
/// Lateness that a sentinel does not note as a pause \[ns\].
const UNSEEN_NS: u64 = vcan_setup::floor::PAUSE_NS_MIN;
/// Lapses that a fail takes; ours.
const LAPSES_MIN: u64 = 3;
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

/// Slots lost, and in how many runs of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Slots lost, of all.
    pub slots: Share,
    /// Runs of lost slots without a good one between.
    pub lapses: u64,
}

impl Losses {
    /// Lower end of the interval of the share lost: slots of one lapse are not independent, so the
    /// interval is that of lapses, times the slots that one costs on average.
    pub fn least(self) -> f64 {
        if self.lapses == 0 {
            return 0.0;
        }
        let lapses = Share { events: self.lapses, trials: self.slots.trials };
        lapses.interval().0 * self.slots.events as f64 / self.lapses as f64
    }

    /// These losses if no pause of the machine can have been taken for them, else none.
    ///
    /// A sentinel with the loop's period sees no pause that falls between two of its wake-ups: up
    /// to a period and what it puts up with, [`UNSEEN_NS`]. Who loses two slots or more at a time
    /// was busy for at least a period and a half, which is longer, unless the period is very short.
    fn beyond_doubt(self, period_ns: u64) -> Self {
        let is_long = self.slots.events >= 2 * self.lapses && period_ns >= 3 * UNSEEN_NS;
        match is_long {
            true => self,
            false => Self { slots: Share { events: 0, ..self.slots }, lapses: 0 },
        }
    }

    fn and(self, other: Self) -> Self {
        let slots = Share {
            events: self.slots.events + other.slots.events,
            trials: self.slots.trials + other.slots.trials,
        };
        Self { slots, lapses: self.lapses + other.lapses }
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
    /// Each ECU by itself.
    #[serde(default)]
    pub ecus: Vec<EcuTiming>,
    /// Losses in the first so many seconds do not count \[s\].
    pub startup_grace_s: f64,
    /// Slots lost in them.
    pub forgiven: u64,
    /// Which CPUs rig and ECUs were kept on.
    pub cpus: String,
}

/// One ECU's share in a verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EcuTiming {
    /// The truck it drives.
    pub truck: u8,
    /// What it alone comes to; with few slots of its own it seldom passes.
    pub verdict: TimingVerdict,
    /// Slots it lost after the startup grace.
    pub lost: u64,
    /// Slots it had.
    pub slots: u64,
    /// In how many runs it lost them.
    pub lapses: u64,
    /// Slots it lost to the program itself.
    pub own: u64,
    /// In how many runs it lost those.
    pub own_lapses: u64,
    /// Lateness from which a wake-up costs this ECU a slot \[µs\].
    pub slack_us: f64,
    /// Share of the sentinel's wake-ups on this ECU's CPU that were later.
    pub floor_share: f64,
}

/// One ECU's losses and the machine beneath it.
struct Account {
    lost: Losses,
    own: Losses,
    /// Of those, what no pause of the machine can have been.
    certain: Losses,
    machine: Share,
}

impl Timing {
    /// Judges what ECUs report beside the machine's floor.
    pub fn new(
        ecus: &[Report],
        floor: &Floor,
        period_ns: u64,
        (startup_grace_s, cpus): (f64, String),
    ) -> Self {
        let grace_slots = (1e9 * startup_grace_s) as u64 / period_ns.max(1);
        let account = |ecu: &Report| Account::new(ecu, floor, period_ns, grace_slots);
        let accounts: Vec<Account> = ecus.iter().map(account).collect();
        let sum = |of: &dyn Fn(&Account) -> Losses| {
            accounts.iter().map(of).fold(Losses::default(), Losses::and)
        };
        let (lost, own) = (sum(&|account| account.lost), sum(&|account| account.own));
        let certain = sum(&|account| account.certain);
        let machines = accounts.iter().map(|account| account.machine);
        let machine = machines
            .max_by(|a, b| a.share().total_cmp(&b.share()))
            .unwrap_or_else(|| late_wakeups(floor, &[], period_ns / 2));
        let each = |(ecu, account): (&Report, &Account)| EcuTiming {
            truck: ecu.truck,
            verdict: judge(account.lost, account.certain, account.machine),
            lost: account.lost.slots.events,
            slots: account.lost.slots.trials,
            lapses: account.lost.lapses,
            own: account.own.slots.events,
            own_lapses: account.own.lapses,
            slack_us: slack_ns(ecu, period_ns) as f64 / 1e3,
            floor_share: account.machine.share(),
        };
        let ecu_timings: Vec<EcuTiming> = ecus.iter().zip(&accounts).map(each).collect();
        let fails = ecu_timings.iter().any(|ecu| ecu.verdict == TimingVerdict::Fail);
        Self {
            verdict: if fails { TimingVerdict::Fail } else { judge(lost, certain, machine) },
            allowed_share: LATE_SHARE_MAX,
            lost: lost.slots.events,
            slots: lost.slots.trials,
            lost_share: lost.slots.interval(),
            own: own.slots.events,
            own_share: own.slots.interval(),
            floor_share: machine.interval(),
            net_share: lost.slots.interval_above(machine),
            ecus: ecu_timings,
            startup_grace_s,
            forgiven: ecus.iter().map(|ecu| ecu.forgiven).sum(),
            cpus,
        }
    }
}

impl Account {
    fn new(ecu: &Report, floor: &Floor, period_ns: u64, grace_slots: u64) -> Self {
        let trials = (ecu.ticks + ecu.skipped).saturating_sub(grace_slots);
        let losses = |counts: &dyn Fn(&str) -> bool| {
            let lapses = ecu.lapses.iter().filter(|(cause, _)| counts(cause));
            let none = Losses { slots: Share { events: 0, trials }, lapses: 0 };
            lapses.fold(none, |mut sum, (_, lapses)| {
                sum.slots.events += lapses.slots;
                sum.lapses += lapses.times;
                sum
            })
        };
        let cpus = ecu.realtime.as_ref().map_or(&[][..], |realtime| &realtime.cpus);
        let own = losses(&|cause| OWN.iter().any(|own| own.word() == cause));
        Self {
            lost: losses(&|_| true),
            own,
            certain: own.beyond_doubt(period_ns),
            machine: late_wakeups(floor, cpus, slack_ns(ecu, period_ns)),
        }
    }
}

/// How late an ECU may wake and still send in time, with the work of its median tick \[ns\]; at
/// most half a period, after which the slot is passed over.
fn slack_ns(ecu: &Report, period_ns: u64) -> u64 {
    let median_us =
        |phase: &str| ecu.phase_us.get(phase).map_or(0.0, |percentiles| percentiles.p50);
    let work_ns = (1e3 * (median_us("total") - median_us("wake")).max(0.0)) as u64;
    period_ns.saturating_sub(work_ns).min(period_ns / 2)
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

/// Causes that are the program's own doing.
const OWN: [MissCause; 6] = [
    MissCause::CanWait,
    MissCause::CanDrain,
    MissCause::Law,
    MissCause::QpIterations,
    MissCause::PageFault,
    MissCause::Recorder,
];

/// Wake-ups of the bare machine later than this \[ns\], on the worst of these CPUs; of all together
/// when none of them was watched.
pub fn late_wakeups(floor: &Floor, cpus: &[usize], slack_ns: u64) -> Share {
    let late = |lateness: &Histogram<u64>| {
        let punctual = lateness.count_between(0, slack_ns);
        Share { events: lateness.len().saturating_sub(punctual), trials: lateness.len() }
    };
    let watched = floor.cpus.iter().filter(|watched| cpus.contains(&watched.cpu));
    watched
        .map(|watched| late(&watched.lateness_ns))
        .max_by(|a, b| a.share().total_cmp(&b.share()))
        .unwrap_or_else(|| late(&floor.lateness_ns()))
}

/// Judges lost slots: all of them, those the program surely lost by itself, and the machine's.
///
/// They cannot both pass and fail: who surely loses few slots cannot surely lose many by itself.
/// One accident, however long, is no fail either: it takes [`LAPSES_MIN`] of them. On a machine
/// that surely loses more than is allowed by itself, only what the program surely did counts.
pub fn judge(lost: Losses, own: Losses, machine: Share) -> TimingVerdict {
    let (_, most) = lost.slots.interval();
    let (machine_least, machine_most) = machine.interval();
    let surely_more =
        |losses: Losses, than: f64| losses.lapses >= LAPSES_MIN && losses.least() > than;
    let is_punctual = machine_least <= LATE_SHARE_MAX;
    let beyond_machine = LATE_SHARE_MAX + MACHINE_FACTOR * machine_most;
    if most <= LATE_SHARE_MAX {
        TimingVerdict::Pass
    } else if surely_more(own, LATE_SHARE_MAX) || (is_punctual && surely_more(lost, beyond_machine))
    {
        TimingVerdict::Fail
    } else {
        TimingVerdict::Inconclusive
    }
}

#[cfg(test)]
mod tests {
    use vcan_setup::floor::CpuFloor;
    use vcan_setup::realtime::Policy;

    use super::*;

    const QUIET: Share = Share { events: 0, trials: 10_000 };

    fn slots(events: u64, trials: u64) -> Share {
        Share { events, trials }
    }

    /// Slots lost in runs of four.
    fn in_fours(events: u64, trials: u64) -> Losses {
        Losses { slots: slots(events, trials), lapses: events.div_ceil(4) }
    }

    #[test]
    fn many_punctual_ticks_pass_and_many_late_ones_fail() {
        let judged = |lost| judge(in_fours(lost, 400_000), in_fours(0, 400_000), QUIET);
        assert_eq!(judged(3), TimingVerdict::Pass);
        assert_eq!(judged(8_000), TimingVerdict::Fail);
    }

    #[test]
    fn a_late_machine_or_a_short_run_decides_nothing() {
        let nothing = in_fours(0, 400_000);
        let late = slots(300, 10_000);
        assert_eq!(judge(in_fours(8_000, 400_000), nothing, late), TimingVerdict::Inconclusive);
        assert_eq!(judge(in_fours(0, 100), in_fours(0, 100), QUIET), TimingVerdict::Inconclusive);
        let none = Losses::default();
        assert_eq!(judge(none, none, Share::default()), TimingVerdict::Inconclusive);
    }

    #[test]
    fn what_the_program_loses_by_itself_fails_on_any_machine() {
        let late = slots(300, 10_000);
        let judged = |own| judge(in_fours(120, 4_000), in_fours(own, 4_000), late);
        assert_eq!(judged(16), TimingVerdict::Fail, "a stall of 3 ms in a thousand ticks");
        assert_eq!(judged(4), TimingVerdict::Inconclusive);
    }

    #[test]
    fn one_long_accident_fails_nobody() {
        let accident = |lapses| Losses { slots: slots(170, 16_000), lapses };
        assert_eq!(judge(accident(1), accident(1), QUIET), TimingVerdict::Inconclusive);
        assert_eq!(judge(accident(2), accident(2), QUIET), TimingVerdict::Inconclusive);
        assert_eq!(judge(accident(8), accident(8), QUIET), TimingVerdict::Fail);
    }

    /// What an ECU reports that lost these slots.
    fn report(truck: u8, ticks: u64, lapses: &[(&str, u64, u64)]) -> Report {
        let lapses = lapses.iter().map(|&(cause, times, slots)| {
            (cause.to_owned(), controller_rt::Lapses { times, slots })
        });
        let mut report: Report = serde_json::from_value(serde_json::json!({
            "truck": truck, "rate_hz": 1000.0, "ending": "mission_ended", "ticks": ticks,
            "misses": 0, "skipped": 0, "dropped_records": 0, "recording_error": null,
            "realtime": null, "phase_us": {}, "miss_causes": {}, "skip_causes": {}, "guard": {},
            "qp": { "solves": 0, "failures": 0, "iterations_max": 0 },
            "received": controller_rt::InboxCounts::default(),
            "sent": controller_rt::OutboxCounts::default(), "receive_overflow": 0,
        }))
        .expect("a report");
        report.lapses = lapses.collect();
        report
    }

    fn judged(ecus: &[Report]) -> Timing {
        Timing::new(ecus, &Floor { cpus: Vec::new() }, 1_000_000, (0.0, "auto".into()))
    }

    #[test]
    fn a_stall_on_one_of_four_ecus_fails_although_together_they_lose_little() {
        let mut ecus: Vec<Report> = (0..4).map(|truck| report(truck, 8_000, &[])).collect();
        assert_eq!(judged(&ecus).verdict, TimingVerdict::Pass);
        ecus[1] = report(1, 8_000, &[("law", 8, 24)]);
        let timing = judged(&ecus);
        assert_eq!(timing.verdict, TimingVerdict::Fail);
        assert!(timing.lost_share.0 < LATE_SHARE_MAX, "all together: {timing:?}");
        let verdicts: Vec<_> = timing.ecus.iter().map(|ecu| ecu.verdict).collect();
        use TimingVerdict::{Fail, Pass};
        assert_eq!(verdicts, [Pass, Fail, Pass, Pass]);
    }

    #[test]
    fn what_an_unseen_pause_could_have_been_is_not_held_against_the_program() {
        let single = [report(0, 8_000, &[("law", 40, 40)])];
        let late = CpuFloor {
            cpu: 0,
            policy: Policy::Fifo,
            priority: 81,
            refused: Vec::new(),
            lateness_ns: [vec![10_000; 9_900], vec![900_000; 100]].concat().into_iter().fold(
                Histogram::new(3).expect("three digits"),
                |mut lateness, ns| {
                    lateness += ns;
                    lateness
                },
            ),
            slept_through: 0,
        };
        let floor = Floor { cpus: vec![late] };
        let verdict = |ecus: &[Report], period_ns| {
            Timing::new(ecus, &floor, period_ns, (0.0, "auto".into())).verdict
        };
        assert_eq!(verdict(&single, 1_000_000), TimingVerdict::Inconclusive);
        let in_fours = [report(0, 8_000, &[("law", 10, 40)])];
        assert_eq!(verdict(&in_fours, 1_000_000), TimingVerdict::Fail);
        assert_eq!(verdict(&in_fours, 100_000), TimingVerdict::Inconclusive, "10 kHz");
    }

    #[test]
    fn short_runs_of_many_ecus_pass_together() {
        let ecus: Vec<Report> = (0..4).map(|truck| report(truck, 1_000, &[])).collect();
        let timing = judged(&ecus);
        assert_eq!(timing.verdict, TimingVerdict::Pass);
        assert_eq!(timing.ecus[0].verdict, TimingVerdict::Inconclusive, "1000 slots tell little");
    }

    #[test]
    fn pauses_of_the_machine_on_one_ecus_cpu_fail_it_only_beyond_what_the_sentinel_saw() {
        let ecu = report(0, 8_000, &[("host_pause", 20, 80)]);
        let quiet = judged(std::slice::from_ref(&ecu));
        assert_eq!(quiet.verdict, TimingVerdict::Inconclusive, "without a sentinel nobody knows");
        assert_eq!((quiet.own, quiet.lost), (0, 80));
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
