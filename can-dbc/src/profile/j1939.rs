//! The profile `j1939`: what standard parameter groups carry comes from them alone, at their usual
//! rates and standard resolutions; the rest travels on Proprietary B.
//!
//! | message | frames |
//! |---|---|
//! | `EgoState` | VDC2, CCVS1 (speed, 100 ms), `NavPosition`, `NavMotion`, `NavTime` |
//! | `Actuation` | TSC1 (driving force), XBR (braking force, 20 ms), `SteerCommand` |
//! | `V2vState` | `V2vPosition`, `V2vMotion`, `V2vTime` |
//! | `V2vOut` | `V2vOutPosition`, `V2vOutMotion`, `V2vOutHeading`, `V2vOutTime` |
//! | `Obstacle` | `ObstaclePosition`, `ObstacleMotion`, `ObstacleBox` |
//! | `Mission` | `MissionPlatoon`, `-Target`, `-Lane`, `-Edges`, `-Roster` |
//! | `EcuStatus` | `EcuProgress`, `EcuMisses` |
//!
//! Beside `EgoState` the rig also plays EEC1, EBC1, EBC2 and EBC5, which tell nothing of a message.
//!
//! A message is delivered when its last missing part arrives, in whatever order arbitration let
//! the parts through. Parts on Proprietary B share an alive counter. VDC2 has none, so `NavMotion`
//! carries a digest of the very VDC2 it belongs to; `SteerCommand` names its TSC1 and XBR by their
//! counters, and its digest of both finds the bit errors that the checksum of TSC1 misses.
//!
//! The forward speed is that of CCVS1 at its instant, and between its frames the integral of the
//! acceleration of VDC2 from there: see [`speed`].

mod batch;
mod decoder;
mod encoder;
mod feedback;
mod flight;
mod force;
mod parts;
mod rate;
mod speed;
#[cfg(test)]
mod tests;

use super::{CommandGrain, Vehicle};
use crate::j1939::Xbr;

pub(crate) use decoder::Decoder;
pub(crate) use encoder::Encoder;

/// Source address of the controller.
const ECU_ADDRESS: u8 = 0x2A;
/// Resolution of XBR's demand, SPN 2920 \[m/s²\].
const DEMAND_STEP_MPS2: f64 = 1.0 / 2048.0;
/// Resolution of the angle in `SteerCommand` \[rad\].
const STEERING_STEP_RAD: f64 = 1e-5;
const NS_PER_S: f64 = 1e9;
/// `Obstacle::member` of what is no platoon truck.
const NO_MEMBER: u8 = 255;
/// What `SteerCommand` tells of the counter of XBR.
const BRAKE_COUNTER_MASK: u8 = 3;

/// How coarse commands are: steps of the torque or of the deceleration, whichever is coarser, and
/// of `SteerCommand`; and XBR comes less often than the others.
pub(crate) fn command_grain(vehicle: &Vehicle) -> CommandGrain {
    let torque_n = vehicle.full_torque_force_n / 100.0 / force::STEPS_PER_PERCENT;
    CommandGrain {
        force_n: torque_n.max(vehicle.mass_kg * DEMAND_STEP_MPS2),
        steering_rad: STEERING_STEP_RAD,
        force_hold_ns: u64::from(Xbr::CYCLE_TIME_MS) * 1_000_000,
    }
}

/// The data of a frame of the profile, all of which have eight bytes.
fn bytes(frame: &crate::Frame) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..frame.data().len()].copy_from_slice(frame.data());
    bytes
}
