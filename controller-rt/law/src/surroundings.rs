//! Obstacles and road as one truck meets them: where each obstacle will be, on which side it may be
//! passed, and which limits on position follow. All of this is ours; the paper's potential alone is
//! symmetric, and a truck straight behind a van would never choose a side.

use crate::calibration::{LmlCalibration, TruckBelief};
use crate::history::seconds_between;
use crate::observation::{Mission, OBSTACLES_MAX, Observation, Obstacle, ObstacleKind};
use crate::potential::{self, RadialModel, SafeDistance};

/// An obstacle's lateral motion is believed to fade with this time constant \[s\]: lane changes
/// end.
const LATERAL_FADE_S: f64 = 0.7;
/// A side counts as passable when its passing line is off the road by no more than this \[m\].
const PASSABLE_TOLERANCE_M: f64 = 0.3;
/// Truck within these distances along the road of an obstacle's centre: abreast of it \[m\].
const ABREAST_M: core::ops::Range<f64> = -6.5..9.5;
/// From this lateral distance on a truck is beside an obstacle's path, not in it \[m\].
const BESIDE_M: f64 = 1.2;
/// Lateral distances at which a truck behind an obstacle is steered to its left \[m\].
const CHOOSE_LEFT_M: core::ops::Range<f64> = -2.6..0.15;
/// Beyond the passing distance, the potential of an obstacle beside the truck's own path fades to
/// nothing over this \[m\].
const FADE_M: f64 = 0.5;

/// Limits on the CG's position at one predicted instant; infinite where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionLimits {
    /// Least Y \[m\].
    pub y_min_m: f64,
    /// Largest Y \[m\].
    pub y_max_m: f64,
    /// Largest X \[m\]: stay behind what cannot be passed.
    pub x_max_m: f64,
}

/// What surrounds the truck, as seen at one tick.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings {
    threats: [Option<Threat>; OBSTACLES_MAX],
    y_min_m: f64,
    y_max_m: f64,
}

/// One obstacle with what does not change over the horizon.
#[derive(Debug, Clone, Copy)]
struct Threat {
    obstacle: Obstacle,
    /// Seconds from its measurement to now.
    age_s: f64,
    safe: SafeDistance,
    /// Where the truck would drive if there were no obstacles.
    desired_y_m: f64,
    left_passable: bool,
    right_passable: bool,
    /// The truck is behind it now, not yet abreast.
    truck_behind: bool,
}

impl Surroundings {
    /// Assesses road and obstacles of an observation.
    pub fn new(cal: &LmlCalibration, truck: &TruckBelief, seen: &Observation) -> Self {
        let (y_min_m, y_max_m) = lateral_limits(cal, truck, &seen.mission);
        let mut surroundings = Self { threats: [None; OBSTACLES_MAX], y_min_m, y_max_m };
        for (threat, obstacle) in surroundings.threats.iter_mut().zip(seen.obstacles) {
            *threat = obstacle.map(|obstacle| {
                let age_s = seconds_between(obstacle.time_ns, seen.time_ns).max(0.0);
                Threat::new(cal, seen, obstacle, age_s, (y_min_m, y_max_m))
            });
        }
        surroundings
    }

    /// The obstacles' potentials for a truck at (`x_m`, `y_m`), `ahead_s` from now.
    pub fn potentials<'a>(
        &'a self,
        cal: &'a LmlCalibration,
        x_m: f64,
        y_m: f64,
        ahead_s: f64,
    ) -> impl Iterator<Item = RadialModel> + 'a {
        self.threats.iter().flatten().map(move |threat| threat.potential(cal, x_m, y_m, ahead_s))
    }

    /// Limits on the position of a truck predicted at (`x_m`, `y_m`), `ahead_s` from now.
    pub fn limits(&self, cal: &LmlCalibration, x_m: f64, y_m: f64, ahead_s: f64) -> PositionLimits {
        let mut limits =
            PositionLimits { y_min_m: self.y_min_m, y_max_m: self.y_max_m, x_max_m: f64::INFINITY };
        for threat in self.threats.iter().flatten() {
            threat.tighten(cal, x_m, y_m, ahead_s, &mut limits);
        }
        limits
    }

    /// Distances of `y_m` to the right and left lateral limits \[m\].
    pub fn edge_distances(&self, y_m: f64) -> [f64; 2] {
        [y_m - self.y_min_m, self.y_max_m - y_m]
    }
}

/// Limits of the CG's Y that keep the truck's sides on the road \[m\].
fn lateral_limits(cal: &LmlCalibration, truck: &TruckBelief, mission: &Mission) -> (f64, f64) {
    let inset = truck.half_width_m + cal.edge_margin_m;
    (mission.right_edge_y_m + inset, mission.left_edge_y_m - inset)
}

impl Threat {
    fn new(
        cal: &LmlCalibration,
        seen: &Observation,
        obstacle: Obstacle,
        age_s: f64,
        (y_min_m, y_max_m): (f64, f64),
    ) -> Self {
        let ego = &seen.ego;
        let mut threat = Self {
            obstacle,
            age_s,
            safe: SafeDistance { x_m: cal.x_0_m, y_m: cal.y_0_m },
            desired_y_m: seen.mission.desired_y_m,
            left_passable: obstacle.y_m + cal.passing_distance_m <= y_max_m + PASSABLE_TOLERANCE_M,
            right_passable: obstacle.y_m - cal.passing_distance_m >= y_min_m - PASSABLE_TOLERANCE_M,
            truck_behind: false,
        };
        let (x, y) = threat.position(0.0);
        let (dx, dy) = (ego.x_m - x, ego.y_m - y);
        threat.truck_behind = dx < ABREAST_M.start;
        let dy = threat.side(dx, dy);
        // Closing speeds count towards the obstacle: positive when the distance shrinks.
        let relative_x = ego.road_speed_mps() - obstacle.vx_mps;
        let relative_y = ego.cross_speed_mps() - obstacle.vy_mps;
        let closing_x = if dx < 0.0 { relative_x } else { -relative_x };
        let closing_y = if dy < 0.0 { relative_y } else { -relative_y };
        threat.safe = SafeDistance::new(cal, ego.forward_mps, closing_x, closing_y);
        threat
    }

    /// Where the obstacle will be `ahead_s` from now: constant speed along the road, lateral motion
    /// that fades.
    fn position(&self, ahead_s: f64) -> (f64, f64) {
        let t = self.age_s + ahead_s;
        let drift_s = LATERAL_FADE_S * (1.0 - libm::exp(-t / LATERAL_FADE_S));
        (
            self.obstacle.x_m + self.obstacle.vx_mps * t,
            self.obstacle.y_m + self.obstacle.vy_mps * drift_s,
        )
    }

    /// The lateral distance at which the potential is evaluated: the true one, unless the truck is
    /// behind and must be told a side.
    fn side(&self, dx_m: f64, dy_m: f64) -> f64 {
        if dx_m >= 0.0 || self.obstacle.kind == ObstacleKind::Bump {
            dy_m
        } else if self.left_passable && CHOOSE_LEFT_M.contains(&dy_m) {
            // Always to the left, as traffic rules have it.
            CHOOSE_LEFT_M.end
        } else if !self.left_passable && dy_m > -BESIDE_M {
            // Follow: a push to the left would end off the road.
            0.0
        } else {
            dy_m
        }
    }

    fn potential(&self, cal: &LmlCalibration, x_m: f64, y_m: f64, ahead_s: f64) -> RadialModel {
        let (x, y) = self.position(ahead_s);
        let (dx, dy) = (x_m - x, y_m - y);
        let model = potential::obstacle(cal, self.obstacle.kind, self.safe, dx, self.side(dx, dy));
        model.scaled(self.presence(cal, self.desired_y_m - y, dy))
    }

    /// Share of the potential that is felt at lateral distance `dy_m` when the truck's own path is
    /// at `path_m` from the obstacle.
    ///
    /// The potential alone pushes a truck that is back in its lane half a metre off its centre for
    /// as long as a slow obstacle is abreast in the other lane. An obstacle that neither the truck
    /// nor its path comes nearer than the passing distance is no concern of theirs.
    ///
    /// The share is a weight and frozen over the QP, like Eq. 20's distances. Differentiated with
    /// the potential it would be a cliff: measured, it throws trucks that come back from the other
    /// lane (steering peak up by 40 %).
    fn presence(&self, cal: &LmlCalibration, path_m: f64, dy_m: f64) -> f64 {
        let same_side = path_m * dy_m > 0.0;
        if !same_side || path_m.abs() < cal.passing_distance_m {
            return 1.0;
        }
        let near = 1.0 - (dy_m.abs() - cal.passing_distance_m) / FADE_M;
        let near = near.clamp(0.0, 1.0);
        near * near * (3.0 - 2.0 * near)
    }

    /// Keep-out rows beside the obstacle, gap row behind it.
    fn tighten(
        &self,
        cal: &LmlCalibration,
        x_m: f64,
        y_m: f64,
        ahead_s: f64,
        limits: &mut PositionLimits,
    ) {
        if self.obstacle.kind == ObstacleKind::Bump {
            return;
        }
        let (x, y) = self.position(ahead_s);
        let (dx, dy) = (x_m - x, y_m - y);
        let passing_left = dy >= BESIDE_M && self.left_passable;
        let passing_right = dy <= -BESIDE_M && self.right_passable;
        if passing_left || passing_right {
            if ABREAST_M.contains(&dx) {
                if passing_left {
                    limits.y_min_m = limits.y_min_m.max(y + cal.passing_distance_m);
                } else {
                    limits.y_max_m = limits.y_max_m.min(y - cal.passing_distance_m);
                }
            }
        } else if self.truck_behind && dy.abs() < cal.passing_distance_m {
            limits.x_max_m = limits.x_max_m.min(x - cal.gap_m);
        }
    }
}

#[cfg(test)]
#[path = "surroundings/tests.rs"]
mod tests;
