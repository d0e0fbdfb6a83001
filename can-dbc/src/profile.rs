//! What controller and rig say to each other, whatever frames carry it.
//!
//! Both sides speak in [`Message`]s. A [`Profile`] says how a truck's bus carries them: [`Encoder`]
//! turns a message into the frames of the profile and keeps to its rates, [`Decoder`] supervises
//! the frames and puts messages together again. There is one encoder per node and bus, and one
//! decoder for the frames of the other node.
//!
//! ```
//! use platoon_dbc::{Actuation, Decoder, Encoder, Message, Profile, Vehicle};
//!
//! let mut ecu = Encoder::new(Profile::Fd, Vehicle::default());
//! let mut rig = Decoder::new(Profile::Fd, Vehicle::default());
//! let command = Message::Actuation(Actuation { force_n: -1500.0, ..Actuation::default() });
//! let mut heard = None;
//! ecu.encode(&command, 0, &mut |frame| heard = rig.take(frame).expect("undamaged").message)
//!     .expect("in range");
//! assert_eq!(heard, Some(command));
//! ```

mod fd;
mod j1939;

use crate::bus_time::BusTiming;
use crate::catalogue::MessageInfo;
use crate::codec::{DecodeError, EncodeError};
use crate::frame::Frame;
use crate::messages::{MESSAGES, Message};
use serde::{Deserialize, Serialize};

/// How a truck's bus carries the contract.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Profile {
    /// CAN FD, 500 kbit/s and 2 Mbit/s: one frame of `platoon.dbc` per message.
    #[default]
    Fd,
    /// Classic CAN at 500 kbit/s, as on trucks that speak only J1939: the standard parameter groups
    /// at their standard rates and resolutions, and Proprietary B frames for the rest.
    J1939,
}

/// A word that names no profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no such profile; there are fd (CAN FD) and j1939 (classic CAN, at most 100 Hz)")]
pub struct UnknownProfile;

impl Profile {
    /// Every profile.
    pub const ALL: [Self; 2] = [Self::Fd, Self::J1939];

    /// The word for it on the command line and in summaries.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Fd => "fd",
            Self::J1939 => "j1939",
        }
    }

    /// Bit rates of the bus the profile is made for.
    pub const fn timing(self) -> BusTiming {
        match self {
            Self::Fd => BusTiming::fd(500_000, 2_000_000),
            Self::J1939 => BusTiming::classic(500_000),
        }
    }

    /// Every message a bus of this profile carries, by identifier.
    pub fn messages(self) -> &'static [MessageInfo] {
        match self {
            Self::Fd => MESSAGES,
            Self::J1939 => crate::j1939::MESSAGES,
        }
    }

    /// The text of the profile's DBC, to be attached to recordings and handed to other tools.
    pub const fn dbc(self) -> &'static str {
        match self {
            Self::Fd => crate::DBC,
            Self::J1939 => crate::j1939::DBC,
        }
    }

    /// How coarse the commands to this truck are on a bus of the profile.
    pub fn command_grain(self, vehicle: &Vehicle) -> CommandGrain {
        match self {
            Self::Fd => CommandGrain { force_n: 0.1, steering_rad: 1e-6, force_hold_ns: 0 },
            Self::J1939 => j1939::command_grain(vehicle),
        }
    }

    /// Highest rate of the control loop that the profile can carry, Hz.
    pub const fn loop_rate_max_hz(self) -> u32 {
        match self {
            Self::Fd => 10_000,
            Self::J1939 => 100,
        }
    }
}

impl std::fmt::Display for Profile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.word())
    }
}

impl std::str::FromStr for Profile {
    type Err = UnknownProfile;

    fn from_str(word: &str) -> Result<Self, UnknownProfile> {
        Self::ALL.into_iter().find(|profile| profile.word() == word).ok_or(UnknownProfile)
    }
}

/// What a profile must know of the truck to speak of torque and deceleration instead of force.
///
/// Rig and ECU each bring their own: the rig that of the truck as it is, the ECU that of what it
/// believes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Vehicle {
    /// Mass, between braking force and demanded deceleration, kg.
    pub mass_kg: f64,
    /// Force at the driven wheels at 100 % engine torque in the gear of the run, N.
    pub full_torque_force_n: f64,
    /// Steering wheel angle over road wheel angle.
    pub steering_ratio: f64,
}

impl Default for Vehicle {
    /// The paper's truck: 5760 kg (MCF, Table I) and 20 kN at full torque, the most the law asks
    /// for. A steering ratio of 20 is usual for trucks; ours.
    fn default() -> Self {
        Self { mass_kg: 5760.0, full_torque_force_n: 20_000.0, steering_ratio: 20.0 }
    }
}

/// How coarse commands are once they have crossed a bus: what a judge of them must allow for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandGrain {
    /// Resolution of the force, N.
    pub force_n: f64,
    /// Resolution of the steering angle, rad.
    pub steering_rad: f64,
    /// Longest time from one update of the force to the next that the profile's rates impose, ns;
    /// 0 when every command carries it.
    pub force_hold_ns: u64,
}

/// Turns messages into frames. Holds alive counters and the rates of the profile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Encoder(Encoding);

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "it is plain data that is never moved about")]
enum Encoding {
    Fd(fd::Encoder),
    J1939(j1939::Encoder),
}

impl Encoder {
    /// An encoder that has sent nothing.
    pub fn new(profile: Profile, vehicle: Vehicle) -> Self {
        Self(match profile {
            Profile::Fd => Encoding::Fd(fd::Encoder::default()),
            Profile::J1939 => Encoding::J1939(j1939::Encoder::new(vehicle)),
        })
    }

    /// Hands the frames of a message to `emit`, in sending order; none where the profile's rate
    /// says that none is due.
    ///
    /// `time_ns` is what the profile's rates are kept by: nanoseconds of one clock per kind of
    /// message. Alive counters advance with every frame emitted, whether or not the bus takes it.
    ///
    /// # Errors
    /// A value is not a number or does not fit its signal; then nothing is emitted.
    pub fn encode(
        &mut self,
        message: &Message,
        time_ns: u64,
        emit: &mut dyn FnMut(&Frame),
    ) -> Result<(), EncodeError> {
        match &mut self.0 {
            Encoding::Fd(encoder) => encoder.encode(message, emit),
            Encoding::J1939(encoder) => encoder.encode(message, time_ns, emit),
        }
    }

    /// Notes what the actuators do, which some profiles publish beside `EgoState`.
    ///
    /// `force_n` is the longitudinal force at the wheels, positive forward, `steering_rad` the
    /// angle of the front wheels, positive to the left. Until called, both are unknown.
    pub fn note_actuators(&mut self, force_n: f64, steering_rad: f64) {
        match &mut self.0 {
            Encoding::Fd(_) => {}
            Encoding::J1939(encoder) => encoder.note_actuators(force_n, steering_rad),
        }
    }
}

/// Turns frames into messages, and supervises counters and checksums.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decoder(Decoding);

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "it is plain data that is never moved about")]
enum Decoding {
    Fd(fd::Decoder),
    J1939(j1939::Decoder),
}

impl Decoder {
    /// A decoder that has heard nothing.
    pub fn new(profile: Profile, vehicle: Vehicle) -> Self {
        Self(match profile {
            Profile::Fd => Decoding::Fd(fd::Decoder::default()),
            Profile::J1939 => Decoding::J1939(j1939::Decoder::new(vehicle)),
        })
    }

    /// Judges a frame and takes it in.
    ///
    /// # Errors
    /// [`Refusal`] when the frame must have no effect.
    pub fn take(&mut self, frame: &Frame) -> Result<Heard, Refusal> {
        match &mut self.0 {
            Decoding::Fd(decoder) => decoder.take(frame),
            Decoding::J1939(decoder) => decoder.take(frame),
        }
    }
}

/// What a frame of the profile brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard {
    /// The message it completes; `None` when it is a part of one, or tells nothing of the contract.
    pub message: Option<Message>,
    /// Frames missing before this one, by its counter.
    pub lost: u32,
}

/// Why a frame had no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Its identifier is not in the profile.
    UnknownId,
    /// Its length, flags or a value are not as the profile says.
    Malformed,
    /// Its checksum is wrong.
    Crc,
    /// It repeats the counter of the frame before it.
    Repeated,
}

impl From<DecodeError> for Refusal {
    fn from(error: DecodeError) -> Self {
        match error {
            DecodeError::UnknownId => Self::UnknownId,
            DecodeError::Crc => Self::Crc,
            DecodeError::WrongFlags | DecodeError::WrongLength | DecodeError::OutOfRange(_) => {
                Self::Malformed
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::EgoState;

    #[test]
    fn a_profile_is_found_by_its_word() {
        for profile in Profile::ALL {
            assert_eq!(profile.to_string().parse(), Ok(profile));
        }
        assert_eq!("can".parse::<Profile>(), Err(UnknownProfile));
    }

    #[test]
    fn encoder_and_decoder_continue_from_their_bytes() {
        for profile in Profile::ALL {
            let mut encoder = Encoder::new(profile, Vehicle::default());
            let mut decoder = Decoder::new(profile, Vehicle::default());
            let step = |encoder: &mut Encoder, decoder: &mut Decoder, tick: u32| {
                let state = Message::EgoState(EgoState { tick, ..EgoState::default() });
                let mut heard = Vec::new();
                let time_ns = u64::from(tick) * 10_000_000;
                let mut hear = |frame: &Frame| heard.push((*frame, decoder.take(frame)));
                encoder.encode(&state, time_ns, &mut hear).expect("in range");
                heard
            };
            for tick in 0..25 {
                step(&mut encoder, &mut decoder, tick);
            }
            let bytes = postcard::to_allocvec(&(encoder, decoder)).expect("serialises");
            let (mut other, mut twin) = postcard::from_bytes(&bytes).expect("its own bytes");
            for tick in 25..50 {
                let expected = step(&mut encoder, &mut decoder, tick);
                assert_eq!(step(&mut other, &mut twin, tick), expected, "{profile} {tick}");
            }
        }
    }
}
