//! The verdict on deadlines, net of what the machine itself is worth.
//!
//! A slot that the machine provably took - it stood still, by the sentinel's word or the kernel's -
//! says nothing about the program: no other could have served it either. A run passes by the slots
//! that remain, as long as the machine took few. What fails a run is the program's own doing by the
//! evidence of each miss, or losses beyond all that the sentinel saw. All of it is judged with its
//! statistical uncertainty.
//!
//! Slots are lost in runs, and one cause that lasts costs many: what counts against the program are
//! therefore the runs, the *lapses*. Each ECU is judged by itself, and all of them together.

mod share;

use controller_rt::Report;
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use traces::MissCause;
use vcan_setup::floor::{Floor, FloorOptions};

use crate::failure::{EXIT_INCONCLUSIVE, Failure};
use crate::summary::Verdict;
pub use share::{Losses, Share};

/// Share of late ticks a run may have and still pass; ours.
pub const LATE_SHARE_MAX: f64 = 1e-3;
/// Share of slots lost without a witness against the program that fails it all the same; ours. What
/// else runs on a machine changes from run to run, and a loop waits for it unseen by the sentinel.
const UNEXPLAINED_SHARE_MIN: f64 = 1e-2;
/// How many times the machine's own share must be exceeded to count against the controller; ours.
/// Pauses of a machine come in bursts and hit each CPU by itself, so that two threads that do
/// nothing else differ by up to about a factor of two over a run.
const MACHINE_FACTOR: f64 = 2.0;
/// Share of slots that the machine may take before it decides nothing; ours.
const DENIED_SHARE_MAX: f64 = 2e-2;
/// Lapses that a fail takes; ours.
const LAPSES_MIN: u64 = 3;

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
    /// Of those lost, the ones that a pause of the machine took.
    #[serde(default)]
    pub denied: u64,
    /// Of those lost, the ones for which the evidence names the program itself.
    pub own: u64,
    /// Interval of their share.
    pub own_share: (f64, f64),
    /// Interval of the share of wake-ups of the sentinel that would have lost a slot.
    pub floor_share: (f64, f64),
    /// Interval of the share lost of the slots that the machine did not take.
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
    /// Slots that a pause of the machine took from it.
    #[serde(default)]
    pub denied: u64,
    /// Slots it lost to the program itself.
    pub own: u64,
    /// In how many runs it lost those.
    pub own_lapses: u64,
    /// Lateness from which a wake-up costs this ECU a slot \[µs\].
    pub slack_us: f64,
    /// Share of the sentinel's wake-ups on this ECU's CPU that were later.
    pub floor_share: f64,
}

/// What counts for and against ECUs, and the machine beneath them.
#[derive(Debug, Clone, Copy, Default)]
struct Account {
    lost: Losses,
    /// What the machine took.
    denied: Losses,
    /// What the program did.
    own: Losses,
    /// Of that, what no pause of the machine can have been.
    certain: Losses,
    /// Wake-ups of the sentinel that would have lost a slot, on the worst CPU.
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
        let nobody =
            || Account { machine: late_wakeups(floor, &[], period_ns / 2), ..Account::default() };
        let all = accounts.iter().copied().reduce(Account::and).unwrap_or_else(nobody);
        let each = |(ecu, account): (&Report, &Account)| EcuTiming {
            truck: ecu.truck,
            verdict: account.verdict(),
            lost: account.lost.slots.events,
            slots: account.lost.slots.trials,
            lapses: account.lost.lapses,
            denied: account.denied.slots.events,
            own: account.own.slots.events,
            own_lapses: account.own.lapses,
            slack_us: slack_ns(ecu, period_ns) as f64 / 1e3,
            floor_share: account.machine.share(),
        };
        let ecu_timings: Vec<EcuTiming> = ecus.iter().zip(&accounts).map(each).collect();
        let fails = ecu_timings.iter().any(|ecu| ecu.verdict == TimingVerdict::Fail);
        Self {
            verdict: if fails { TimingVerdict::Fail } else { all.verdict() },
            allowed_share: LATE_SHARE_MAX,
            lost: all.lost.slots.events,
            slots: all.lost.slots.trials,
            lost_share: all.lost.slots.interval(),
            denied: all.denied.slots.events,
            own: all.own.slots.events,
            own_share: all.own.slots.interval(),
            floor_share: all.machine.interval(),
            net_share: all.net().slots.interval(),
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
        let sentinel = FloorOptions::beside(period_ns, Vec::new(), 0);
        Self {
            lost: losses(&|_| true),
            denied: losses(&|cause| cause == MissCause::HostPause.word()),
            own,
            certain: own.beyond_doubt(period_ns, sentinel.unseen_ns()),
            machine: late_wakeups(floor, cpus, slack_ns(ecu, period_ns)),
        }
    }

    /// What was lost of the slots that the machine did not take.
    fn net(&self) -> Losses {
        let Self { lost, denied, .. } = self;
        let slots = Share {
            events: lost.slots.events - denied.slots.events,
            trials: lost.slots.trials.saturating_sub(denied.slots.events),
        };
        Losses { slots, lapses: lost.lapses - denied.lapses }
    }

    /// Both, on the worse of their CPUs.
    fn and(self, other: Self) -> Self {
        let machines = [self.machine, other.machine];
        Self {
            lost: self.lost.and(other.lost),
            denied: self.denied.and(other.denied),
            own: self.own.and(other.own),
            certain: self.certain.and(other.certain),
            machine: if machines[0].share() > machines[1].share() {
                self.machine
            } else {
                other.machine
            },
        }
    }

    /// Pass or fail where that is sure.
    ///
    /// Nobody can both pass and fail: who surely loses few slots cannot surely lose many.
    /// One accident, however long, is no fail either: it takes [`LAPSES_MIN`] of them. On a machine
    /// that surely loses more than is allowed by itself, only what the program surely did counts.
    fn verdict(&self) -> TimingVerdict {
        let net = self.net();
        let (_, most) = net.slots.interval();
        let (_, denied_most) = self.denied.slots.interval();
        let (machine_least, machine_most) = self.machine.interval();
        let surely_more =
            |losses: Losses, than: f64| losses.lapses >= LAPSES_MIN && losses.least() > than;
        let is_punctual = machine_least <= LATE_SHARE_MAX;
        let beyond_machine = UNEXPLAINED_SHARE_MIN + MACHINE_FACTOR * machine_most;
        if most <= LATE_SHARE_MAX && denied_most <= DENIED_SHARE_MAX {
            TimingVerdict::Pass
        } else if surely_more(self.certain, LATE_SHARE_MAX)
            || (is_punctual && surely_more(net, beyond_machine))
        {
            TimingVerdict::Fail
        } else {
            TimingVerdict::Inconclusive
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

#[cfg(test)]
mod tests;
