//! What the law is told at a tick: everything it knows about the world, stamped.
//!
//! Frames: the road frame has X along the road, Y to the left, heading counter-clockwise from X
//! (ISO 8855). Body axes are forward and left of the truck's centre of gravity (CG).

use crate::dmpc::Plan;
use crate::history::Motion;

/// Most obstacles a picture holds; `platoon.dbc` has as many pages.
pub const OBSTACLES_MAX: usize = 8;

/// Everything the law sees at one tick.
///
/// Times are bench time: nanoseconds since the run's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The instant this tick stands for \[ns\], a point of the loop's grid.
    pub time_ns: u64,
    /// This truck's navigation solution.
    pub ego: Ego,
    /// What the global planner asks for.
    pub mission: Mission,
    /// Newest message of the platoon's leader; `None` when none came or it counts as lost.
    pub leader: Option<V2v>,
    /// Newest message of the truck ahead; `None` when none came or it counts as lost.
    pub predecessor: Option<V2v>,
    /// What the others announced of their future.
    pub plans: Plans,
    /// Obstacles the sensors report now, by page; lost ones are `None`.
    pub obstacles: [Option<Obstacle>; OBSTACLES_MAX],
}

/// A fused navigation solution of the truck's CG.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ego {
    /// When the solution was valid \[ns\].
    pub time_ns: u64,
    /// CG position along the road X \[m\].
    pub x_m: f64,
    /// CG position across the road Y \[m\], positive to the left.
    pub y_m: f64,
    /// Heading φ \[rad\] from the road's direction, counter-clockwise.
    pub heading_rad: f64,
    /// Longitudinal speed ū in body axes \[m/s\].
    pub forward_mps: f64,
    /// Lateral speed v in body axes \[m/s\].
    pub lateral_mps: f64,
    /// Yaw rate r \[rad/s\].
    pub yaw_radps: f64,
    /// Acceleration along the truck \[m/s²\].
    pub accel_mps2: f64,
}

/// The global planner's knowledge: place in the platoon, speeds, lanes, road.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mission {
    /// This truck's place in its platoon, 0 is the leader.
    pub truck: u8,
    /// Trucks in the platoon, the leader included.
    pub trucks: u8,
    /// Which truck leads, by its number in the run; it may change.
    pub leader: u8,
    /// Which truck this one follows, likewise.
    pub predecessor: u8,
    /// Desired distance D from this truck's CG to that of the one it follows \[m\].
    pub spacing_m: f64,
    /// Desired distance to the leader's CG \[m\]: i D while every truck keeps the same distance D.
    pub leader_distance_m: f64,
    /// Speed the leader is to hold \[m/s\].
    pub set_speed_mps: f64,
    /// Desired lateral position Y_des \[m\].
    pub desired_y_m: f64,
    /// Lane width \[m\].
    pub lane_width_m: f64,
    /// Y of the road's right edge \[m\].
    pub right_edge_y_m: f64,
    /// Y of the road's left edge \[m\].
    pub left_edge_y_m: f64,
}

/// One truck's broadcast, as received.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct V2v {
    /// Bench time at which the sender measured this \[ns\].
    pub generated_ns: u64,
    /// CG position along the road \[m\].
    pub x_m: f64,
    /// CG position across the road \[m\].
    pub y_m: f64,
    /// Speed along the sending truck \[m/s\].
    pub speed_mps: f64,
    /// Acceleration \[m/s²\].
    pub accel_mps2: f64,
    /// Acceleration the sender intends \[m/s²\].
    pub intended_accel_mps2: f64,
}

/// Announced plans, as received; only distributed MPC announces and hears them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plans {
    /// The leader's newest; `None` when none came or it counts as lost.
    pub leader: Option<Plan>,
    /// That of the truck ahead.
    pub predecessor: Option<Plan>,
}

/// What kind of thing an obstacle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObstacleKind {
    /// A vehicle: must not be touched.
    #[default]
    Vehicle,
    /// A pedestrian: must not be touched.
    Pedestrian,
    /// A bump: may be driven over, better not.
    Bump,
}

/// One obstacle as the sensors report it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Obstacle {
    /// What it is.
    pub kind: ObstacleKind,
    /// When it was measured \[ns\].
    pub time_ns: u64,
    /// Centre position along the road \[m\].
    pub x_m: f64,
    /// Centre position across the road \[m\].
    pub y_m: f64,
    /// Velocity along the road \[m/s\].
    pub vx_mps: f64,
    /// Velocity across the road \[m/s\].
    pub vy_mps: f64,
    /// Box length along the road \[m\].
    pub length_m: f64,
    /// Box width across the road \[m\].
    pub width_m: f64,
}

impl Ego {
    /// Speed along the road, Ẋ of Eq. 14's global coordinates \[m/s\].
    pub fn road_speed_mps(&self) -> f64 {
        let (sin, cos) = libm::sincos(self.heading_rad);
        self.forward_mps * cos - self.lateral_mps * sin
    }

    /// Speed across the road, Ẏ \[m/s\], positive to the left.
    pub fn cross_speed_mps(&self) -> f64 {
        let (sin, cos) = libm::sincos(self.heading_rad);
        self.forward_mps * sin + self.lateral_mps * cos
    }
}

impl V2v {
    /// The part of the message the coordination layer reads.
    pub(crate) fn motion(&self) -> Motion {
        Motion {
            time_ns: self.generated_ns,
            x_m: self.x_m,
            speed_mps: self.speed_mps,
            accel_mps2: self.accel_mps2,
        }
    }
}
