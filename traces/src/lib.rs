//! MCAP traces of a rehearsal: record, read, merge.
//!
//! Each process records what it saw itself into a part file: the rig every frame of every bus
//! and the true world, an ECU the frames each of its ticks consumed, its ticks, and snapshots of
//! the law's memory. A [`Recorder`] takes fixed-size records from the loop without waiting and
//! has a thread write them. [`merge`] makes one `run.mcap` of the parts, also of those that
//! killed processes left, and adds what follows from them. [`Reader`] reads both.
//!
//! | topic | encoding | by | holds |
//! |---|---|---|---|
//! | `/can/bus<i>/frames` | ros2msg, cdr | rig | every frame on bus i, [`FrameRecord`] |
//! | `/ecu<i>/rx` | ros2msg, cdr | ECU i | the frames it consumed, in order, [`FrameRecord`] |
//! | `/ecu<i>/tick` | protobuf | ECU i | [`TickRecord`] |
//! | `/ecu<i>/memory` | protobuf | ECU i | [`MemoryRecord`] |
//! | `/world/truth` | protobuf | rig | [`TruthRecord`] |
//! | `/rig/dropped`, `/ecu<i>/dropped` | protobuf | each | gaps, [`DroppedRecord`] |
//! | `/bus<i>/<Message>` | protobuf | merge | signals of `platoon.dbc`; units in channel metadata |
//! | `/scene`, `/scene/road`, `/scene/field` | protobuf | merge | `foxglove.SceneUpdate` |
//! | `/tf` | protobuf | merge | `foxglove.FrameTransform` of the frame `platoon`, at 20 Hz |
//!
//! Log and publish time are the wall clock at the run's start plus bench time; the kernel's receive
//! stamp of a frame, where there is one, is its `header.stamp`. Metadata `platoon.merged` tells the
//! log time of bench time 0, `platoon.parts` what became of each part.
//!
//! This crate knows CAN frames and `platoon.dbc`. It refuses to know the law or the plant, and
//! reads no clock for what it writes: bench time and wall time arrive in the records. Only when
//! a chunk ends is decided by a clock, so that a killed process loses about 100 ms.
//!
//! ```
//! use traces::{MergeOptions, Reader, Record, Recorder, RecorderOptions, Source, TickRecord};
//!
//! # let folder = std::env::temp_dir().join(format!("traces-doc-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! let (part, run) = (folder.join("doc.part.mcap"), folder.join("doc.mcap"));
//! let mut recorder = Recorder::start(&part, RecorderOptions::new(Source::Ecu(0)))?;
//! recorder.push(TickRecord { time_ns: 1_000_000, tick: 1, ..TickRecord::default() });
//! assert_eq!(recorder.finish().written, 1);
//!
//! traces::merge(&[part], &run, &MergeOptions::default())?;
//! let first = Reader::open(&run)?.next().expect("one message");
//! assert_eq!(first.channel.topic, "/ecu0/tick");
//! assert!(matches!(first.record()?, Record::Tick(tick) if tick.tick == 1));
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cdr;
mod derived;
mod dropped;
mod fields;
mod focus;
mod foxglove;
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
mod scenery;
mod schema;
mod signals;
mod sorted;
mod tick;
mod topic;
mod truth;
mod wire;
mod writer;

pub use derived::{Derivation, Derived};
pub use dropped::DroppedRecord;
pub use focus::Focus;
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
pub use scenery::{Reach, Scenery};
pub use tick::{GuardReason, MissCause, TickOutcome, TickRecord};
pub use topic::{Offer, Source, Topic};
pub use truth::{OBSTACLES_MAX, ObstacleKind, ObstacleTruth, TRUCKS_MAX, TruckTruth, TruthRecord};
pub use wire::DecodeError;
