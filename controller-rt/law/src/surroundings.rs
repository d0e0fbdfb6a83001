//! Obstacles and road as one truck meets them: where each obstacle will be, on which side it may be
//! passed, and which limits on position follow. All of this is ours; the paper's potential alone is
//! symmetric, and a truck straight behind a van would never choose a side.

use crate::calibration::{LmlCalibration, TruckBelief};
use crate::history::seconds_between;
use crate::observation::{Mission, OBSTACLES_MAX, Observation, Obstacle, ObstacleKind};
use crate::potential::{Field, PositionCost, RadialModel, SafeDistance};
use crate::prediction::{STEP_S, STEPS};

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

/// What the obstacles mean to a truck at one predicted place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meeting {
    /// Sum of their potentials.
    pub potential: PositionCost,
    /// What they and the road leave.
    pub limits: PositionLimits,
}

/// Where an obstacle is at some instant, and from there to the truck.
#[derive(Debug, Clone, Copy)]
struct Place {
    x_m: f64,
    y_m: f64,
    dx_m: f64,
    dy_m: f64,
}

/// A time ahead of now, and what is left of a lateral motion after it.
#[derive(Debug, Clone, Copy)]
struct Ahead {
    time_s: f64,
    fade: f64,
}

impl Ahead {
    const NOW: Self = Self { time_s: 0.0, fade: 1.0 };

    /// The prediction's steps.
    const STEPS: [Self; STEPS] = {
        // exp(-STEP_S / LATERAL_FADE_S)
        const FADE: f64 = 0.866_877_899_750_181_6;
        let mut steps = [Self::NOW; STEPS];
        let (mut k, mut fade) = (0, 1.0);
        while k < STEPS {
            fade *= FADE;
            steps[k] = Self { time_s: (k + 1) as f64 * STEP_S, fade };
            k += 1;
        }
        steps
    };
}

/// What surrounds the truck, as seen at one tick.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings {
    field: Field,
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
    /// What is left of its lateral motion after that.
    fade: f64,
    /// Whether it is believed to move on.
    predicted: bool,
    /// Whether the truck is told on which side to pass.
    has_side_rule: bool,
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
        let (field, threats) = (Field::new(cal), [None; OBSTACLES_MAX]);
        let mut surroundings = Self { field, threats, y_min_m, y_max_m };
        for (threat, obstacle) in surroundings.threats.iter_mut().zip(seen.obstacles) {
            *threat = obstacle.map(|obstacle| {
                let age_s = seconds_between(obstacle.time_ns, seen.time_ns).max(0.0);
                Threat::new(cal, seen, obstacle, age_s, (y_min_m, y_max_m))
            });
        }
        surroundings
    }

    /// The obstacles' potentials for a truck that is at (`x_m`, `y_m`) now.
    pub fn potentials_now<'a>(
        &'a self,
        cal: &'a LmlCalibration,
        x_m: f64,
        y_m: f64,
    ) -> impl Iterator<Item = RadialModel> + 'a {
        let there = move |threat: &Threat| threat.place(x_m, y_m, Ahead::NOW);
        let threats = self.threats.iter().flatten();
        threats.map(move |threat| threat.potential(cal, &self.field, &there(threat)))
    }

    /// What a truck predicted at (`x_m`, `y_m`) at the end of step `k` meets there.
    pub fn meet(&self, cal: &LmlCalibration, x_m: f64, y_m: f64, k: usize) -> Meeting {
        self.meet_at(cal, x_m, y_m, Ahead::STEPS[k])
    }

    fn meet_at(&self, cal: &LmlCalibration, x_m: f64, y_m: f64, ahead: Ahead) -> Meeting {
        let limits =
            PositionLimits { y_min_m: self.y_min_m, y_max_m: self.y_max_m, x_max_m: f64::INFINITY };
        let mut met = Meeting { potential: PositionCost::default(), limits };
        for threat in self.threats.iter().flatten() {
            let place = threat.place(x_m, y_m, ahead);
            met.potential.add(&threat.potential(cal, &self.field, &place).into());
            threat.tighten(cal, &place, &mut met.limits);
        }
        met
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
            fade: libm::exp(-age_s / LATERAL_FADE_S),
            predicted: cal.obstacles_predicted,
            has_side_rule: cal.passing_side_rule,
            safe: SafeDistance { x_m: cal.x_0_m, y_m: cal.y_0_m },
            desired_y_m: seen.mission.desired_y_m,
            left_passable: obstacle.y_m + cal.passing_distance_m <= y_max_m + PASSABLE_TOLERANCE_M,
            right_passable: obstacle.y_m - cal.passing_distance_m >= y_min_m - PASSABLE_TOLERANCE_M,
            truck_behind: false,
        };
        let Place { dx_m: dx, dy_m: dy, .. } = threat.place(ego.x_m, ego.y_m, Ahead::NOW);
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

    /// Where the obstacle will be, against a truck at (`x_m`, `y_m`): it keeps its speed along the
    /// road, its lateral motion fades.
    fn place(&self, x_m: f64, y_m: f64, ahead: Ahead) -> Place {
        let (time_s, fade) = match self.predicted {
            true => (self.age_s + ahead.time_s, self.fade * ahead.fade),
            false => (self.age_s, self.fade),
        };
        let drift_s = LATERAL_FADE_S * (1.0 - fade);
        let x = self.obstacle.x_m + self.obstacle.vx_mps * time_s;
        let y = self.obstacle.y_m + self.obstacle.vy_mps * drift_s;
        Place { x_m: x, y_m: y, dx_m: x_m - x, dy_m: y_m - y }
    }

    /// The lateral distance at which the potential is evaluated: the true one, unless the truck is
    /// behind and must be told a side.
    fn side(&self, dx_m: f64, dy_m: f64) -> f64 {
        let has_no_side = !self.has_side_rule || self.obstacle.kind == ObstacleKind::Bump;
        if dx_m >= 0.0 || has_no_side {
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

    fn potential(&self, cal: &LmlCalibration, field: &Field, place: &Place) -> RadialModel {
        let Place { dx_m, dy_m, y_m, .. } = *place;
        let side_m = self.side(dx_m, dy_m);
        let model = field.obstacle(self.obstacle.kind, self.safe, dx_m, side_m);
        model.scaled(self.presence(cal, self.desired_y_m - y_m, dy_m))
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
    fn tighten(&self, cal: &LmlCalibration, place: &Place, limits: &mut PositionLimits) {
        let Place { x_m: x, y_m: y, dx_m: dx, dy_m: dy } = *place;
        if self.obstacle.kind == ObstacleKind::Bump {
            return;
        }
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
