//! What an ECU says about its run when it ends: one entry of `ecus` in the JSON summary.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::inbox::InboxCounts;
use crate::outbox::OutboxCounts;

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
    /// Misses by the phase that took longest.
    pub miss_causes: BTreeMap<String, u64>,
    /// Skipped slots: `wake` when the loop slept through them, `overrun` when it was still busy.
    pub skip_causes: BTreeMap<String, u64>,
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
