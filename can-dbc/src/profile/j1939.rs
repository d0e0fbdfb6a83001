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
//! | `Mission` | `MissionPlatoon`, `MissionTarget`, `MissionLane`, `MissionEdges` |
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

pub(crate) use decoder::Decoder;
pub(crate) use encoder::Encoder;

/// Source address of the controller.
const ECU_ADDRESS: u8 = 0x2A;
const NS_PER_S: f64 = 1e9;
/// `Obstacle::member` of what is no platoon truck.
const NO_MEMBER: u8 = 255;
/// What `SteerCommand` tells of the counter of XBR.
const BRAKE_COUNTER_MASK: u8 = 3;

/// The data of a frame of the profile, all of which have eight bytes.
fn bytes(frame: &crate::Frame) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..frame.data().len()].copy_from_slice(frame.data());
    bytes
}
