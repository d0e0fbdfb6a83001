//! Where a truck expects to be: the trajectory that Zheng's trucks tell each other.

use serde::{Deserialize, Serialize};

use super::{STEP_S, STEPS};
use crate::history::seconds_between;

/// Points of a plan: now, and the end of every step.
pub const POINTS: usize = STEPS + 1;

/// Positions and speeds of one truck along the road, [`STEP_S`] apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Bench time of the first point \[ns\].
    pub start_ns: u64,
    /// Positions of the CG along the road \[m\].
    pub x_m: [f64; POINTS],
    /// Speeds \[m/s\].
    pub speed_mps: [f64; POINTS],
}

impl Plan {
    /// The plan of a truck that keeps its speed.
    pub fn steady(start_ns: u64, x_m: f64, speed_mps: f64) -> Self {
        Self {
            start_ns,
            x_m: core::array::from_fn(|k| x_m + speed_mps * STEP_S * k as f64),
            speed_mps: [speed_mps; POINTS],
        }
    }

    /// The plan whose speed is linear between the given ones.
    ///
    /// That is what travels on the bus: the positions follow by the trapezoidal rule, whose error
    /// over a plan is `STEP_S² / 12` times the change of acceleration, 2 mm for 2 m/s².
    pub fn from_speeds(start_ns: u64, x_m: f64, speed_mps: &[f64; POINTS]) -> Self {
        let mut positions = [x_m; POINTS];
        for k in 1..POINTS {
            positions[k] = positions[k - 1] + 0.5 * STEP_S * (speed_mps[k - 1] + speed_mps[k]);
        }
        Self { start_ns, x_m: positions, speed_mps: *speed_mps }
    }

    /// Position \[m\] and speed \[m/s\] at an instant.
    ///
    /// Between points the position is the cubic with the points' positions and speeds. Before the
    /// first and after the last point the speed is constant: a plan ends in steady driving, so its
    /// continuation is the assumed trajectory of \[Zheng\], however old the plan is.
    pub fn at(&self, time_ns: u64) -> (f64, f64) {
        let steps = seconds_between(self.start_ns, time_ns) / STEP_S;
        if steps <= 0.0 {
            return (self.x_m[0] + self.speed_mps[0] * steps * STEP_S, self.speed_mps[0]);
        }
        let past_end = steps - STEPS as f64;
        if past_end >= 0.0 {
            let (x_m, speed_mps) = (self.x_m[STEPS], self.speed_mps[STEPS]);
            return (x_m + speed_mps * past_end * STEP_S, speed_mps);
        }
        let k = (steps as usize).min(STEPS - 1);
        let s = steps - k as f64;
        let (x, v) = (&self.x_m[k..k + 2], &self.speed_mps[k..k + 2]);
        let (from, to) = (v[0] * STEP_S, v[1] * STEP_S);
        // The cubic Hermite polynomial, written about its first point.
        let gap = x[1] - x[0];
        let square = 3.0 * gap - 2.0 * from - to;
        let cube = from + to - 2.0 * gap;
        (x[0] + s * (from + s * (square + s * cube)), v[0] + s * (v[1] - v[0]))
    }

    /// The plan as it is assumed from `time_ns` on: shifted by its age.
    pub fn shifted_to(&self, time_ns: u64) -> Self {
        let mut shifted = Self { start_ns: time_ns, ..*self };
        for k in 0..POINTS {
            let point = self.at(time_ns + k as u64 * super::STEP_NS);
            (shifted.x_m[k], shifted.speed_mps[k]) = point;
        }
        shifted
    }

    /// The same motion, `distance_m` further back.
    pub fn behind(&self, distance_m: f64) -> Self {
        Self { x_m: self.x_m.map(|x_m| x_m - distance_m), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dmpc::STEP_NS;

    fn accelerating() -> Plan {
        let speed_mps = core::array::from_fn(|k| 20.0 + 0.1 * k.min(15) as f64);
        Plan::from_speeds(3 * STEP_NS, 100.0, &speed_mps)
    }

    #[test]
    fn a_plan_shifted_by_a_step_has_its_own_later_points_and_ends_at_constant_speed() {
        let plan = accelerating();
        let shifted = plan.shifted_to(4 * STEP_NS);
        for k in 0..STEPS {
            assert!((shifted.x_m[k] - plan.x_m[k + 1]).abs() < 1e-9, "{k}");
            assert!((shifted.speed_mps[k] - plan.speed_mps[k + 1]).abs() < 1e-9, "{k}");
        }
        let last = plan.x_m[STEPS] + STEP_S * plan.speed_mps[STEPS];
        assert!((shifted.x_m[STEPS] - last).abs() < 1e-9);
    }

    #[test]
    fn between_points_speed_is_linear_and_position_its_integral() {
        let plan = accelerating();
        for ms in 0..2_000 {
            let at = |ms: u64| plan.at(3 * STEP_NS + ms * 1_000_000);
            let ((x0, v0), (x1, v1)) = (at(ms), at(ms + 1));
            assert!((x1 - x0 - 0.5e-3 * (v0 + v1)).abs() < 1e-9, "{ms}");
        }
    }

    #[test]
    fn a_plan_of_any_age_continues_at_its_last_speed() {
        let plan = accelerating();
        let (x_m, speed_mps) = plan.at((3 + 20 + 100) * STEP_NS);
        assert!((x_m - plan.x_m[STEPS] - 10.0 * speed_mps).abs() < 1e-9);
        assert_eq!(speed_mps, 21.5);
        let (before_m, _) = plan.at(0);
        assert!((before_m - (100.0 - 0.3 * 20.0)).abs() < 1e-9);
    }
}
