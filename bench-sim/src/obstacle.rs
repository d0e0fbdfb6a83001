//! Obstacles: things that follow a script and never react.
//!
//! Along the road `x(t) = x_m + speed t`, from then on changed by every [`SpeedChange`]; across the
//! road `y_m`, changed by every [`LaneChange`]. An obstacle exists from its `appears_s` on.
//!
//! Nothing keeps a script from driving into a truck from behind or from the side: clearance counts
//! that as any other touch, so a scenario must not ask it.

mod course;

use serde::{Deserialize, Serialize};

use crate::rectangle::Rectangle;

pub use course::{LaneChange, SpeedChange};

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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// What it is.
    #[serde(default)]
    pub kind: Kind,
    /// Where its first speed would have put its centre at t = 0, along the road \[m\].
    pub x_m: f64,
    /// Position of its centre across the road \[m\], until a lane change starts.
    pub y_m: f64,
    /// Speed along the road \[m/s\], until it changes.
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
    /// Its lane changes: one table, or a list in the order of time.
    #[serde(
        default,
        deserialize_with = "course::one_or_more",
        skip_serializing_if = "Vec::is_empty"
    )]
    pub lane_change: Vec<LaneChange>,
    /// Its changes of speed: one table, or a list in the order of time.
    #[serde(
        default,
        deserialize_with = "course::one_or_more",
        skip_serializing_if = "Vec::is_empty"
    )]
    pub speed_change: Vec<SpeedChange>,
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
        let (along_m, x_mps) = course::along(self.speed_mps, &self.speed_change, time_s);
        let (y_m, y_mps) = course::across(self.y_m, &self.lane_change, time_s);
        Motion { x_m: self.x_m + along_m, y_m, x_mps, y_mps }
    }

    /// Its box on the road, given where it is.
    pub fn rectangle(&self, motion: &Motion) -> Rectangle {
        let heading_rad = motion.heading_rad();
        Rectangle::new(motion.x_m, motion.y_m, heading_rad, self.length_m, self.width_m)
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
            lane_change: vec![LaneChange { to_y_m: 0.0, from_s: 0.0, until_s: 4.0 }],
            speed_change: Vec::new(),
        }
    }

    /// 15 m/s, from 2 s to 4.5 s down to a stop, from 10 s to 14 s up to 8 m/s.
    fn stopping_van() -> Obstacle {
        let stop = SpeedChange { to_speed_mps: 0.0, from_s: 2.0, until_s: 4.5 };
        let start = SpeedChange { to_speed_mps: 8.0, from_s: 10.0, until_s: 14.0 };
        Obstacle { lane_change: Vec::new(), speed_change: vec![stop, start], ..merging_van() }
    }

    /// Asserts that speeds are the slopes of positions.
    #[track_caller]
    fn assert_speeds_are_slopes(van: &Obstacle, until_s: f64) {
        for k in 1..(until_s * 100.0) as u32 {
            // Between the corners of the script.
            let t_s = (f64::from(k) + 0.5) * 0.01;
            let (before, now, after) =
                (van.motion(t_s - 1e-5), van.motion(t_s), van.motion(t_s + 1e-5));
            assert!(((after.x_m - before.x_m) / 2e-5 - now.x_mps).abs() < 1e-5, "{t_s} s");
            assert!(((after.y_m - before.y_m) / 2e-5 - now.y_mps).abs() < 1e-5, "{t_s} s");
        }
    }

    #[test]
    fn constant_speed_passes_through_its_position_at_time_zero() {
        let van = Obstacle { x_m: -36.0, speed_mps: 17.0, ..merging_van() };
        assert!((van.motion(49.0).x_m - 797.0).abs() < 1e-9);
    }

    #[test]
    fn a_lane_change_starts_and_ends_smoothly() {
        let van = merging_van();
        assert_eq!(van.motion(-1.0).y_m, -3.75);
        assert_eq!((van.motion(4.0).y_m, van.motion(9.0).y_mps), (0.0, 0.0));
        assert!((van.motion(2.0).y_m + 1.875).abs() < 1e-12);
        assert_speeds_are_slopes(&van, 5.0);
    }

    #[test]
    fn a_second_lane_change_leaves_from_where_the_first_arrived() {
        let mut van = merging_van();
        van.lane_change.push(LaneChange { to_y_m: 3.75, from_s: 6.0, until_s: 9.0 });
        let y_m = |time_s| van.motion(time_s).y_m;
        assert_eq!((y_m(0.0), y_m(5.0), y_m(7.5), y_m(9.0)), (-3.75, 0.0, 1.875, 3.75));
        assert_speeds_are_slopes(&van, 10.0);
    }

    #[test]
    fn a_van_that_brakes_stands_still_and_starts_again() {
        let van = stopping_van();
        let (brakes, stands, goes) = (van.motion(3.0), van.motion(7.0), van.motion(20.0));
        assert_eq!((brakes.x_mps, stands.x_mps, goes.x_mps), (9.0, 0.0, 8.0));
        assert!((stands.x_m - (-17.0 + 30.0 + 15.0 * 15.0 / 12.0)).abs() < 1e-9);
        assert!((goes.x_m - stands.x_m - (16.0 + 48.0)).abs() < 1e-9);
        assert_speeds_are_slopes(&van, 20.0);
    }

    #[test]
    fn nothing_exists_before_it_appears() {
        let van = Obstacle { appears_s: 40.0, ..merging_van() };
        assert!(!van.present(39.999) && van.present(40.0));
    }
}
