//! What the guard remembers of one object ahead: its last report, and how hard it brakes.
//!
//! Reports carry positions and velocities, no acceleration. An acceleration in the message would be
//! a filter of the sensor's own, with a lag this guard could not know; so the guard differentiates
//! successive speeds itself and smooths the result.

use serde::{Deserialize, Serialize};

/// Time constant of the smoothing \[s\]: two reports. A step of 6 m/s² shows as 4.2 m/s² after
/// three reports; 0.01 m/s of noise on the speeds becomes less than 0.1 m/s².
const SMOOTHING_S: f64 = 0.1;
/// An object that seems to move this much faster or slower than at its last report \[m/s\] is
/// another object: 50 ms of it would take 60 m/s².
const SPEED_JUMP_MPS: f64 = 3.0;
/// Likewise for a place that its last speed does not lead to \[m\].
const PLACE_JUMP_M: f64 = 2.0;

/// One object as the truck's sensors report it. Road frame: X along the road, Y to the left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// When it was measured \[ns\] of bench time.
    pub measured_ns: u64,
    /// Centre along the road \[m\].
    pub x_m: f64,
    /// Centre across the road \[m\].
    pub y_m: f64,
    /// Velocity along the road \[m/s\].
    pub x_mps: f64,
    /// Velocity across the road \[m/s\].
    pub y_mps: f64,
    /// From its centre to its rear or front, along the road \[m\].
    pub half_length_m: f64,
    /// From its centre to its side, across the road \[m\].
    pub half_width_m: f64,
}

/// An object over time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Track {
    /// Its last report.
    pub(super) seen: Object,
    /// How hard it brakes \[m/s²\], smoothed; negative when it speeds up.
    slowing_mps2: f64,
}

impl Track {
    /// An object seen for the first time: nothing is known of its acceleration.
    pub(super) const fn new(seen: Object) -> Self {
        Self { seen, slowing_mps2: 0.0 }
    }

    /// Takes in a report, if it is a new one.
    pub(super) fn note(&mut self, object: &Object) {
        if object.measured_ns <= self.seen.measured_ns {
            return;
        }
        let elapsed_s = (object.measured_ns - self.seen.measured_ns) as f64 * 1e-9;
        if !self.leads_to(object, elapsed_s) {
            *self = Self::new(*object);
            return;
        }
        let now_mps2 = (self.seen.x_mps - object.x_mps) / elapsed_s;
        let share = elapsed_s / (elapsed_s + SMOOTHING_S);
        self.slowing_mps2 += share * (now_mps2 - self.slowing_mps2);
        self.seen = *object;
    }

    /// How hard it brakes \[m/s²\]; 0 while it stands, speeds up or comes nearer backwards.
    pub(super) fn braking_mps2(&self) -> f64 {
        if self.seen.x_mps > 0.0 { self.slowing_mps2.max(0.0) } else { 0.0 }
    }

    /// Whether the object of the last report can have become this one. Pages are given to other
    /// objects.
    fn leads_to(&self, object: &Object, elapsed_s: f64) -> bool {
        let expected_m = |at_m: f64, mps: f64| at_m + mps * elapsed_s;
        (object.x_mps - self.seen.x_mps).abs() <= SPEED_JUMP_MPS
            && (object.x_m - expected_m(self.seen.x_m, self.seen.x_mps)).abs() <= PLACE_JUMP_M
            && (object.y_m - expected_m(self.seen.y_m, self.seen.y_mps)).abs() <= PLACE_JUMP_M
    }
}
