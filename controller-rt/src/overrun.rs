//! What the loop does about a tick that comes too late.

use core::fmt;
use core::str::FromStr;

use serde::{Deserialize, Serialize};

/// Most slots that wait in the queue of [`OnOverrun::Queue`]; older ones are passed over.
pub const QUEUE_SLOTS_MAX: u32 = 16;

/// Overrun policies. The first and the last are those of A. Cervin, *Analysis of overrun strategies
/// in periodic control tasks*, IFAC 2005.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OnOverrun {
    /// The late command is sent; slots that cannot start within half a period are passed over.
    #[default]
    Skip,
    /// As `Skip`, but a command that was computed after its deadline is not sent: the truck gets
    /// the one before again.
    Hold,
    /// As `Skip`, but the run ends once more slots were lost than are allowed.
    Abort,
    /// No slot is passed over: late ones follow each other without a pause, up to
    /// [`QUEUE_SLOTS_MAX`] of them.
    Queue,
}

impl OnOverrun {
    /// Every policy.
    pub const ALL: [Self; 4] = [Self::Skip, Self::Hold, Self::Abort, Self::Queue];

    /// The word users type for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Skip => "skip",
            Self::Hold => "hold",
            Self::Abort => "abort",
            Self::Queue => "queue",
        }
    }
}

impl fmt::Display for OnOverrun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for OnOverrun {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|policy| policy.word() == text);
        known.ok_or_else(|| format!("no policy {text:?}; give skip, hold, abort or queue"))
    }
}

/// A policy with its limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Overruns {
    /// What to do.
    pub policy: OnOverrun,
    /// Bench time from the start of the run in which lost slots do not count \[ns\].
    pub grace_ns: u64,
    /// Slots that may be lost after that before [`OnOverrun::Abort`] ends the run.
    pub allowed: u64,
}

impl Overruns {
    /// Whether a loss at this bench time is forgiven.
    #[must_use]
    pub const fn forgives(&self, time_ns: u64) -> bool {
        time_ns < self.grace_ns
    }

    /// Whether the run must end after so many losses that were not forgiven.
    #[must_use]
    pub fn is_too_much(&self, lost: u64) -> bool {
        self.policy == OnOverrun::Abort && lost > self.allowed
    }
}
