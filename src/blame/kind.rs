//! The kinds of fault, and what the inquest ought to say to each.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use traces::MissCause;

/// Fastest loop of an ECU whose deadline a bounded drain can miss at all; see [`Kind::rate_hz`].
const FLOOD_RATE_HZ: u32 = 4_000;
/// Ticks between two strikes, at least.
const SPACING: u64 = 25;

/// What is done to the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Nothing: whatever is lost, the machine lost.
    Undisturbed,
    /// A more urgent thread takes the loop's CPU before it is due.
    RunQueueHog,
    /// A more urgent thread takes the loop's CPU while it computes.
    PreemptingHog,
    /// Sentinel, rig and ECU are stopped together, as a hypervisor stops a machine (SIGSTOP).
    HostPause,
    /// The rig sends `EgoState` after the tick that is to use it.
    LateFrame,
    /// Another node floods the bus.
    FrameFlood,
    /// The bus blocks whoever sends.
    BlockedBus,
    /// The law computes for longer.
    LongLaw,
    /// The QP's solver iterates more.
    QpInflation,
    /// The law touches memory that is not there yet.
    PageFault,
    /// The recorder's thread gets no CPU, and the loop waits for it.
    RecorderStall,
}

/// What came of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// A lost slot with this cause.
    Lost(MissCause),
    /// No slot was lost, but a tick ran on an older state than its own.
    Stale,
    /// Nothing that shows.
    Nothing,
}

impl Kind {
    /// The right answers to it; empty when nothing is done.
    pub const fn right(self) -> &'static [Answer] {
        match self {
            Self::Undisturbed => &[],
            Self::RunQueueHog => &[Answer::Lost(MissCause::RunQueue)],
            Self::PreemptingHog => &[Answer::Lost(MissCause::Preempted)],
            Self::HostPause => &[Answer::Lost(MissCause::HostPause)],
            Self::LateFrame => &[Answer::Stale],
            Self::FrameFlood => &[Answer::Lost(MissCause::CanDrain)],
            Self::BlockedBus => &[Answer::Lost(MissCause::CanWait)],
            Self::LongLaw => &[Answer::Lost(MissCause::Law)],
            Self::QpInflation => &[Answer::Lost(MissCause::QpIterations)],
            Self::PageFault => &[Answer::Lost(MissCause::PageFault)],
            Self::RecorderStall => &[Answer::Lost(MissCause::Recorder)],
        }
    }

    /// Rate of its loop \[Hz\]. A drain is bounded, so that a flood costs no deadline of a loop of
    /// 1 kHz; it is shown where it does.
    pub const fn rate_hz(self, asked_hz: u32) -> u32 {
        match self {
            Self::FrameFlood => FLOOD_RATE_HZ,
            _ => asked_hz,
        }
    }

    /// Ticks from one strike to the next, at least.
    pub const fn spacing(self) -> u64 {
        match self {
            Self::FrameFlood | Self::RecorderStall => 3 * SPACING,
            _ => SPACING,
        }
    }
}

impl Answer {
    /// Every answer, in the order of the matrix' columns.
    pub const ALL: [Self; 12] = [
        Self::Lost(MissCause::RunQueue),
        Self::Lost(MissCause::Preempted),
        Self::Lost(MissCause::HostPause),
        Self::Stale,
        Self::Lost(MissCause::CanDrain),
        Self::Lost(MissCause::CanWait),
        Self::Lost(MissCause::Law),
        Self::Lost(MissCause::QpIterations),
        Self::Lost(MissCause::PageFault),
        Self::Lost(MissCause::Recorder),
        Self::Lost(MissCause::Unattributed),
        Self::Nothing,
    ];

    /// The head of its column in the matrix.
    pub const fn head(self) -> &'static str {
        match self {
            Self::Lost(MissCause::RunQueue) => "queue",
            Self::Lost(MissCause::Preempted) => "preem",
            Self::Lost(MissCause::HostPause) => "pause",
            Self::Stale => "stale",
            Self::Lost(MissCause::CanDrain) => "drain",
            Self::Lost(MissCause::CanWait) => "wait",
            Self::Lost(MissCause::Law) => "law",
            Self::Lost(MissCause::QpIterations) => "qp",
            Self::Lost(MissCause::PageFault) => "fault",
            Self::Lost(MissCause::Recorder) => "rec",
            Self::Lost(MissCause::Unattributed | MissCause::None) => "?",
            Self::Nothing => "none",
        }
    }

    /// The word of reports.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Lost(cause) => cause.word(),
            Self::Stale => "stale",
            Self::Nothing => "nothing",
        }
    }
}
