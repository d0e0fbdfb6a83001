//! What the rig knows and nobody else does: the noise-free state of the world.
//!
//! Road frame: X along the road, Y to the left, headings counter-clockwise from X (ISO 8855).
//! A truck's position is its centre of gravity (CG), its body axes point forward and left.

use crate::list::List;
use crate::schema::{choices, message};

/// Most trucks a world holds.
pub const TRUCKS_MAX: usize = 16;
/// Most obstacles a world holds.
pub const OBSTACLES_MAX: usize = 8;

choices! {
    /// What kind of thing an obstacle is.
    pub enum ObstacleKind = "platoon.ObstacleKind" {
        /// A vehicle: must not be touched.
        #[default]
        Vehicle = 0,
        /// A pedestrian: must not be touched.
        Pedestrian = 1,
        /// A bump: may be driven over, better not.
        Bump = 2,
    }
}

message! {
    /// The true state of one truck.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct TruckTruth = "platoon.TruckTruth" {
        /// CG along the road \[m\].
        1 x_m: f64,
        /// CG across the road \[m\], positive to the left.
        2 y_m: f64,
        /// Heading \[rad\].
        3 heading_rad: f64,
        /// Speed along the body's forward axis \[m/s\].
        4 forward_mps: f64,
        /// Speed along the body's left axis \[m/s\].
        5 lateral_mps: f64,
        /// Yaw rate \[rad/s\].
        6 yaw_radps: f64,
        /// Acceleration of the CG along the forward axis \[m/s²\].
        7 accel_forward_mps2: f64,
        /// Acceleration of the CG along the left axis \[m/s²\].
        8 accel_lateral_mps2: f64,
        /// Force commanded \[N\], as received.
        9 force_command_n: f64,
        /// Steering angle commanded \[rad\], as received.
        10 steering_command_rad: f64,
        /// Force the drive line delivers \[N\].
        11 force_n: f64,
        /// Steering angle of the front wheels \[rad\].
        12 steering_rad: f64,
        /// Position error to the leader \[m\], as the criteria count it; 0 for the leader.
        13 leader_error_m: f64,
        /// Position error to the truck ahead \[m\], likewise; 0 for the leader.
        14 predecessor_error_m: f64,
        /// Smallest distance between this truck's box and any obstacle's box \[m\].
        15 obstacle_clearance_m: f64,
        /// Transport delay of the V2V link from the leader \[s\]; 0 for the leader.
        16 leader_delay_s: f64,
        /// Transport delay of the V2V link from the truck ahead \[s\]; 0 for the leader.
        17 predecessor_delay_s: f64,
        /// From CG to the front end of the box \[m\].
        18 front_m: f64,
        /// From CG to the rear end of the box \[m\].
        19 rear_m: f64,
        /// Width of the box \[m\].
        20 width_m: f64,
    }
}

message! {
    /// The true state of one obstacle.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct ObstacleTruth = "platoon.ObstacleTruth" {
        /// Number in the scenario, from 1.
        1 number: u8,
        /// What it is.
        2 kind: ObstacleKind,
        /// Whether it is on the road now.
        3 present: bool,
        /// Centre along the road \[m\].
        4 x_m: f64,
        /// Centre across the road \[m\].
        5 y_m: f64,
        /// Velocity along the road \[m/s\].
        6 vx_mps: f64,
        /// Velocity across the road \[m/s\].
        7 vy_mps: f64,
        /// Length of the box along its heading \[m\].
        8 length_m: f64,
        /// Width of the box \[m\].
        9 width_m: f64,
        /// Heading \[rad\].
        10 heading_rad: f64,
    }
}

message! {
    /// The true state of the world at one instant.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct TruthRecord = "platoon.Truth" {
        /// Bench time \[ns\].
        1 time_ns: u64,
        /// The trucks, leader first.
        2 trucks: List<TruckTruth, TRUCKS_MAX>,
        /// The obstacles of the scenario, in its order.
        3 obstacles: List<ObstacleTruth, OBSTACLES_MAX>,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::Message;

    #[test]
    fn a_world_survives_encoding() {
        let mut truth = TruthRecord { time_ns: 5, ..TruthRecord::default() };
        for index in 0..TRUCKS_MAX {
            let truck = TruckTruth { x_m: -20.0 * index as f64, ..TruckTruth::default() };
            truth.trucks.push(truck).expect("room");
        }
        let bump = ObstacleTruth { kind: ObstacleKind::Bump, ..ObstacleTruth::default() };
        truth.obstacles.push(bump).expect("room");
        let mut bytes = Vec::new();
        truth.encode(&mut bytes);
        assert_eq!(TruthRecord::decode(&bytes), Ok(truth));
    }

    #[test]
    fn more_trucks_than_fit_are_refused() {
        let bytes = [2 << 3 | 2, 0].repeat(TRUCKS_MAX + 1);
        assert_eq!(TruthRecord::decode(&bytes), Err(crate::DecodeError::TooLong));
    }
}
