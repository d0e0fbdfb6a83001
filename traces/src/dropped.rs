//! The gap markers a recorder leaves where records did not fit its ring.

use crate::schema::message;

message! {
    /// Records that are missing here because the ring was full, with the totals so far.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct DroppedRecord = "platoon.Dropped" {
        /// Bench time of the first record kept after the gap, or of the last record \[ns\].
        1 time_ns: u64,
        /// Records missing in this gap.
        2 count: u64,
        /// Frames missing since the start.
        3 frames: u64,
        /// Ticks missing since the start.
        4 ticks: u64,
        /// World states missing since the start.
        5 truths: u64,
        /// Memory snapshots missing since the start.
        6 memories: u64,
    }
}
