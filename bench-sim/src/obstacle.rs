//! Obstacles: things that follow a script and never react.
//!
//! Along the road a constant speed, `x(t) = x_m + speed t`; across the road a constant position or
//! one quintic change from `y_m` to another position over a span of time (zero lateral speed and
//! acceleration at both ends, the usual smooth lane change). An obstacle exists from its
//! `appears_s` on.

use serde::{Deserialize, Serialize};

use crate::rectangle::Rectangle;

/// What kind of thing an obstacle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A vehicle: must not be touched.
    #[default]
    Vehicle,
    /// A pedestrian: must not be touched.
    Pedestrian,
    /// A bump: may be driven over, so it counts for no clearance.
    Bump,
}

/// One obstacle's script, as a scenario file states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// What it is.
    #[serde(default)]
    pub kind: Kind,
    /// Where its constant speed would have put its centre at t = 0, along the road \[m\].
    pub x_m: f64,
    /// Position of its centre across the road \[m\], until a lane change starts.
    pub y_m: f64,
    /// Constant speed along the road \[m/s\].
    pub speed_mps: f64,
    /// When it starts to exist \[s\].
    #[serde(default)]
    pub appears_s: f64,
    /// Length of its box \[m\].
    #[serde(default = "van_length_m")]
    pub length_m: f64,
    /// Width of its box \[m\].
    #[serde(default = "van_width_m")]
    pub width_m: f64,
    /// Its lane change, if it makes one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lane_change: Option<LaneChange>,
}

/// One smooth change of lateral position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneChange {
    /// Where it ends, across the road \[m\].
    pub to_y_m: f64,
    /// When it starts \[s\].
    pub from_s: f64,
    /// When it is done \[s\].
    pub until_s: f64,
}

/// Where an obstacle is and how it moves at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Centre along the road \[m\].
    pub x_m: f64,
    /// Centre across the road \[m\].
    pub y_m: f64,
    /// Velocity along the road \[m/s\].
    pub x_mps: f64,
    /// Velocity across the road \[m/s\].
    pub y_mps: f64,
}

impl Motion {
    /// Direction of motion from the road's direction \[rad\]; 0 at rest.
    pub fn heading_rad(&self) -> f64 {
        if self.x_mps == 0.0 && self.y_mps == 0.0 {
            return 0.0;
        }
        libm::atan2(self.y_mps, self.x_mps)
    }
}

impl Obstacle {
    /// Whether it exists at bench time `time_s`.
    pub fn present(&self, time_s: f64) -> bool {
        time_s >= self.appears_s
    }

    /// Where the script puts it at bench time `time_s`, whether or not it exists yet.
    pub fn motion(&self, time_s: f64) -> Motion {
        let (y_m, y_mps) = match &self.lane_change {
            Some(change) => change.position(self.y_m, time_s),
            None => (self.y_m, 0.0),
        };
        Motion { x_m: self.x_m + self.speed_mps * time_s, y_m, x_mps: self.speed_mps, y_mps }
    }

    /// Its box on the road, given where it is.
    pub fn rectangle(&self, motion: &Motion) -> Rectangle {
        let heading_rad = motion.heading_rad();
        Rectangle::new(motion.x_m, motion.y_m, heading_rad, self.length_m, self.width_m)
    }
}

impl LaneChange {
    /// Lateral position \[m\] and speed \[m/s\]: `y0 + (y1 - y0) (10 p³ - 15 p⁴ + 6 p⁵)`.
    fn position(&self, from_y_m: f64, time_s: f64) -> (f64, f64) {
        let span_s = self.until_s - self.from_s;
        let p = ((time_s - self.from_s) / span_s).clamp(0.0, 1.0);
        let shape = p * p * p * (10.0 + p * (6.0 * p - 15.0));
        let slope = 30.0 * p * p * (1.0 - p) * (1.0 - p);
        let change_m = self.to_y_m - from_y_m;
        (from_y_m + change_m * shape, change_m * slope / span_s)
    }
}

fn van_length_m() -> f64 {
    6.0
}

fn van_width_m() -> f64 {
    2.2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merging_van() -> Obstacle {
        Obstacle {
            kind: Kind::Vehicle,
            x_m: -17.0,
            y_m: -3.75,
            speed_mps: 15.0,
            appears_s: 0.0,
            length_m: 6.0,
            width_m: 2.2,
            lane_change: Some(LaneChange { to_y_m: 0.0, from_s: 0.0, until_s: 4.0 }),
        }
    }

    #[test]
    fn constant_speed_passes_through_its_position_at_time_zero() {
        let van = Obstacle { x_m: -36.0, speed_mps: 17.0, lane_change: None, ..merging_van() };
        assert!((van.motion(49.0).x_m - 797.0).abs() < 1e-9);
    }

    #[test]
    fn a_lane_change_starts_and_ends_smoothly() {
        let van = merging_van();
        assert_eq!(van.motion(-1.0).y_m, -3.75);
        assert_eq!((van.motion(4.0).y_m, van.motion(9.0).y_mps), (0.0, 0.0));
        assert!((van.motion(2.0).y_m + 1.875).abs() < 1e-12);
        for k in 1..400 {
            let t_s = f64::from(k) * 0.01;
            let slope = (van.motion(t_s + 1e-5).y_m - van.motion(t_s - 1e-5).y_m) / 2e-5;
            assert!((slope - van.motion(t_s).y_mps).abs() < 1e-6);
        }
    }

    #[test]
    fn nothing_exists_before_it_appears() {
        let van = Obstacle { appears_s: 40.0, ..merging_van() };
        assert!(!van.present(39.999) && van.present(40.0));
    }
}
