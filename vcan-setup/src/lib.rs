//! The host under a rehearsal: virtual CAN interfaces, real-time privileges, and what the machine
//! itself is worth.
//!
//! - [`can`] makes FD-capable `vcan` interfaces over netlink and says exactly what is missing when
//!   it cannot.
//! - [`check`] reports what of all that is there, and what would make it better.
//! - [`realtime`] asks for SCHED_FIFO, locked memory and CPU affinity, and reports what the kernel
//!   really granted; [`realtime::environment`] describes the machine for the run's metadata.
//! - [`floor`] measures how late the bare machine wakes a thread, before a run or beside one.
//! - [`account`] is what the kernel knows about a thread, [`pauses`] what a sentinel tells others.
//! - [`host`] knows which command mends what on which distribution.
//! - [`kernel`] boots a kernel that has CAN, as an ordinary process, and runs a command in it.
//! - [`clock`] is CLOCK_MONOTONIC with absolute sleeps.
//!
//! The crate knows nothing of trucks, messages or control, and it refuses to touch an interface
//! that is not a `vcan`. Linux only.
//!
//! ```
//! use vcan_setup::realtime::{self, Request};
//!
//! let obtained = realtime::acquire(&Request { priority: Some(80), ..Request::default() });
//! for refusal in &obtained.refused {
//!     eprintln!("running without it: {refusal}");
//! }
//! ```

pub mod account;
pub mod can;
pub mod check;
pub mod clock;
pub mod floor;
pub mod host;
pub mod kernel;
mod link;
pub mod pauses;
pub mod realtime;
mod scheduler;
