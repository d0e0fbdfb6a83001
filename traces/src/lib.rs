//! MCAP traces of a rehearsal: record, read, merge.
//!
//! Each process records what it saw itself into a part file: the rig every frame of every bus
//! and the true world, an ECU the frames each of its ticks consumed, its ticks, and snapshots of
//! the law's memory. A [`Recorder`] takes fixed-size records from the loop without waiting and
//! has a thread write them.
//!
//! This crate knows CAN frames and `platoon.dbc`; it knows neither the law nor the plant, and
//! never reads a clock for what it writes: bench time and wall time arrive in the records.

mod cdr;
mod dropped;
mod fields;
mod frame;
mod input;
mod list;
mod memory;
mod merge;
mod merged;
mod part;
mod reader;
mod record;
mod recorder;
mod ring;
mod scan;
mod scene;
mod schema;
mod signals;
mod sorted;
mod tick;
mod topic;
mod truth;
mod wire;
mod writer;

pub use dropped::DroppedRecord;
pub use frame::FrameRecord;
pub use input::PartReport;
pub use list::List;
pub use memory::{MemoryRecord, SNAPSHOT_BYTES_MAX, Snapshot};
pub use merge::{MergeError, MergeOptions, MergeReport, merge, merge_thinned};
pub use reader::{Channel, Message, ReadError, Reader};
pub use record::Record;
pub use recorder::{Finished, Overflow, Recorder, RecorderError, RecorderOptions};
pub use ring::{Capacity, Counts, Recordable};
pub use scan::{Attachment, Loss};
pub use tick::{GuardReason, MissCause, TickOutcome, TickRecord};
pub use topic::{Source, Topic};
pub use truth::{OBSTACLES_MAX, ObstacleKind, ObstacleTruth, TRUCKS_MAX, TruckTruth, TruthRecord};
pub use wire::DecodeError;
