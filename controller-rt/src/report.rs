//! What an ECU says about its run when it ends: one entry of `ecus` in the JSON summary.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::gallery::Miss;
use crate::inbox::InboxCounts;
use crate::outbox::OutboxCounts;
use crate::overrun::OnOverrun;

/// One ECU's run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Truck this ECU drove, 0 is the leader.
    pub truck: u8,
    /// Ticks per second asked for \[Hz\]; 0 when no mission came.
    pub rate_hz: f64,
    /// Why the run ended.
    pub ending: Ending,
    /// Ticks run.
    pub ticks: u64,
    /// Ticks whose last frame was sent after the end of their period.
    pub misses: u64,
    /// Slots passed over because they could not start within half a period.
    pub skipped: u64,
    /// Records that did not reach the trace file.
    pub dropped_records: u64,
    /// What kept the trace from being written, in the operating system's words.
    pub recording_error: Option<String>,
    /// Real-time privileges obtained; absent in virtual time.
    pub realtime: Option<Realtime>,
    /// Distribution of each phase \[µs\].
    pub phase_us: BTreeMap<String, Percentiles>,
    /// The QP solver's totals.
    pub qp: QpTotals,
    /// Misses by cause, in the words of [`MissCause::word`](traces::MissCause::word).
    pub miss_causes: BTreeMap<String, u64>,
    /// Skipped slots by cause, in the same words.
    pub skip_causes: BTreeMap<String, u64>,
    /// Runs of lost slots after the startup grace, by the cause of the first, in the same words.
    #[serde(default)]
    pub lapses: BTreeMap<String, Lapses>,
    /// The longest after the grace from a slot's due to its last frame \[µs\], or to the wake-up
    /// that lost it.
    #[serde(default)]
    pub slowest_us: f64,
    /// What was done about overruns.
    #[serde(default)]
    pub on_overrun: OnOverrun,
    /// Misses and skipped slots within the startup grace; they are in the totals too.
    #[serde(default)]
    pub forgiven: u64,
    /// Ticks that ran on an older `EgoState` than their own, which came late or not at all.
    #[serde(default)]
    pub stale_ticks: u64,
    /// Commands that came too late and were not sent (`--on-overrun hold`).
    #[serde(default)]
    pub held_ticks: u64,
    /// What the thread of the loop did after the startup grace; none where nobody could tell.
    #[serde(default)]
    pub thread: Option<ThreadCounts>,
    /// The worst misses, worst first.
    #[serde(default)]
    pub worst_misses: Vec<Miss>,
    /// Commands the guard changed, by its reason.
    pub guard: BTreeMap<String, u64>,
    /// How often the guard's emergency layer began to brake.
    #[serde(default)]
    pub emergency_brakings: u32,
    /// Frames received, by what became of them.
    pub received: InboxCounts,
    /// Frames sent.
    pub sent: OutboxCounts,
    /// Frames the kernel dropped before the ECU read them.
    pub receive_overflow: u64,
}

/// Slots lost one after the other, without a good tick between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Lapses {
    /// How often that happened.
    pub times: u64,
    /// Slots lost in all of them.
    pub slots: u64,
}

/// What happened to the thread of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ThreadCounts {
    /// Page faults served without I/O.
    pub minor_faults: u64,
    /// Page faults that read from a disk.
    pub major_faults: u64,
    /// Times the CPU was taken from it.
    pub involuntary_switches: u64,
    /// CPU time used \[ns\].
    pub cpu_ns: u64,
    /// Time spent runnable but without a CPU \[ns\].
    pub run_delay_ns: u64,
    /// Times it asked the heap for memory or gave some back.
    #[serde(default)]
    pub heap_uses: u64,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The mission was declared ended.
    MissionEnded,
    /// Somebody asked to stop.
    Stopped,
    /// The rig fell silent.
    RigSilent,
    /// Too many deadlines were missed (`--on-overrun abort`).
    Overrun,
}

/// Real-time privileges obtained, whatever was asked for. Filled in by who obtained them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Realtime {
    /// Scheduling policy: `fifo`, `other`, ...
    pub policy: String,
    /// Real-time priority, 0 without.
    pub priority: u32,
    /// CPUs the loop may run on.
    pub cpus: Vec<usize>,
    /// Whether the memory is locked.
    pub mlock: bool,
    /// Whether the CPUs are kept out of deep idle states.
    #[serde(default)]
    pub cpu_latency_held: bool,
}

/// Percentiles of one phase \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Percentiles {
    /// Half of all ticks took at most this.
    pub p50: f64,
    /// 90 % did.
    pub p90: f64,
    /// 99 % did.
    pub p99: f64,
    /// 99.9 % did.
    pub p999: f64,
    /// All did.
    pub max: f64,
}

/// The QP solver's totals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct QpTotals {
    /// QPs tried.
    pub solves: u64,
    /// QPs not solved: iteration cap or infeasible.
    pub failures: u64,
    /// Most iterations one QP took.
    pub iterations_max: u32,
}
