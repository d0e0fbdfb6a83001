//! The ECU: a periodic loop between one truck's CAN bus and the control law.
//!
//! ```text
//! wait -> drain -> observe -> step -> admit -> send -> record
//! ```
//!
//! - [`Pacer`] waits: slots half a period after the rig publishes, absolute deadlines, skips.
//! - `Inbox` drains at most so many frames, checks E2E protection and counts what it refuses.
//! - `Picture` keeps the newest message of each kind with its age and makes the observation.
//! - [`Controller`] is the slot the law fits into.
//! - [`blame`] finds why a deadline was missed, from what a [`Witness`] says; [`Overruns`] is what
//!   is done about it.
//! - [`guard`] admits: its own limits, its own constants, no trust in the law.
//! - `Outbox` sends: command, V2V broadcast, status.
//! - The recording goes into a ring; a thread of the recorder writes it.
//!
//! The same [`Ecu::tick`] runs in real time ([`run`]) and in virtual time. The crate reads no
//! clock, file or environment variable: a [`Clock`](platoon_dbc::Clock) is passed in. It does not
//! acquire real-time privileges either. In the steady state a tick neither allocates nor locks.

mod blame;
mod controller;
mod ecu;
mod gallery;
pub mod guard;
mod inbox;
mod inquest;
mod laps;
mod outbox;
mod overrun;
mod pacer;
mod phase_lock;
mod picture;
mod recording;
mod reference_qp;
mod replica;
mod report;
mod snapshot;
mod statistics;
mod usual;
mod witness;

/// The parts of a tick, for benchmarks; they change without notice.
#[doc(hidden)]
pub mod parts {
    pub use crate::inbox::Inbox;
    pub use crate::picture::Picture;
}

pub use blame::{Evidence, Waiting, Working, blame};
pub use controller::{Around, Controller, LawController, Phase};
pub use ecu::{Config, Ecu, RIG_SILENT_NS, first_mission, run};
pub use gallery::{GALLERY_SIZE, Miss};
pub use inbox::{Drained, InboxCounts};
pub use outbox::OutboxCounts;
pub use overrun::{OnOverrun, Overruns, QUEUE_SLOTS_MAX};
pub use pacer::{Pacer, Slot};
pub use phase_lock::{Arrival, PhaseLock};
pub use recording::{SNAPSHOT_PERIOD_NS, join_snapshot};
pub use reference_qp::Clarabel;
pub use replica::Replica;
pub use report::{Ending, Lapses, Percentiles, QpTotals, Realtime, Report, ThreadCounts};
pub use witness::{Nobody, ThreadTotals, Witness};
