//! The contract between the rig and a truck's ECU: messages, protection and the bus they meet on.
//!
//! Controller and rig speak in [`Message`]s ([`EgoState`], [`Actuation`], ...). A [`Profile`] says
//! which frames carry them: `fd` (CAN FD, one protected frame of `platoon.dbc` each) or `j1939`
//! (classic CAN: standard parameter groups and Proprietary B, [`mod@j1939`]). [`Encoder`] and
//! [`Decoder`] turn the one into the other and back.
//!
//! `platoon.dbc` and `j1939.dbc` are the single sources. The build turns each into one struct per
//! frame, an enum over all of them and a table for tools ([`MESSAGES`], [`decode_signals`]). Every
//! FD frame carries an alive counter and a CRC after AUTOSAR E2E Profile 5 ([`e2e`]); J1939 has
//! its own protection ([`Protection`]) and its own codes for a value that is missing
//! ([`Reading`]). Frames travel over one [`Bus`], of which there are three: [`SocketCan`], [`Udp`]
//! (python-can's `udp_multicast` format on loopback) and [`Loopback`] (in memory).
//!
//! This crate knows nobody: no controller, no plant, no recorder. It reads no clock; whoever needs
//! time gets a [`Clock`]. Encoding, decoding, sending and receiving neither allocate nor block.
//!
//! ```
//! use platoon_dbc::{Actuation, ActuationStatus, Bus, Loopback};
//!
//! let (mut ecu, mut rig) = Loopback::pair("loopback0", 16);
//! let command = Actuation {
//!     answers_tick: 7,
//!     force_n: -1500.0,
//!     steering_rad: 0.01,
//!     actuation_status: ActuationStatus::Solved,
//! };
//! ecu.send(&command.encode(0).expect("in range")).expect("room in the queue");
//! let received = rig.receive().expect("the bus is up").expect("a frame waits");
//! assert_eq!(Actuation::decode(&received.frame), Ok((command, 0)));
//! ```

mod bits;
mod bus;
pub mod bus_time;
mod catalogue;
mod checksum;
mod codec;
pub mod e2e;
mod frame;
pub mod j1939;
mod messages;
pub mod probe;
mod profile;
mod protection;
mod reading;
mod time;

pub use bus::{
    Backend, Bus, BusCounts, Emulated, ErrorFrameCounts, Loopback, OpenError, PortLease, Queueing,
    ReceiveError, Received, SendError, SocketCan, Udp, UdpOptions,
};
pub use bus_time::BusTiming;
pub use catalogue::{
    ByteOrder, Codes, MessageInfo, SignalInfo, decode_signals, encode_signals, message_info,
};
pub use codec::{DecodeError, EncodeError};
pub use frame::{Frame, FrameError, FrameFlags};
pub use messages::*;
pub use profile::{
    CommandGrain, Decoder, Encoder, Heard, Profile, Refusal, UnknownProfile, Vehicle,
};
pub use protection::Protection;
pub use reading::Reading;
pub use time::Clock;

/// The text of `platoon.dbc`, to be attached to recordings and handed to other tools.
pub const DBC: &str = include_str!("../platoon.dbc");
