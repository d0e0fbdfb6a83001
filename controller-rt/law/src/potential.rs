//! Artificial potential fields of obstacles and road edges, in the convex form the QP needs
//! [MCF, Eqs. 19 and 20].
//!
//! ```text
//! s = |p|,  p = (dX / Xs, dY / Ys)                                              (Eq. 20)
//! non-crossable  U = a ( s^-b - sc^-b + b sc^-(b+1) (s - sc) )   for s < sc     (Eq. 19)
//! crossable      U = a_c exp(-b_c s)                             (Wang et al. 2019)
//! road edge      U = a_R (D_a - d)^2                             for d < D_a
//! ```
//!
//! With `sc` infinite the first is Eq. 19 as printed; the cut at `sc`, smooth in value and slope,
//! is ours: without it a van 40 m behind still pushes the truck 0.3 m out of its lane. Eq. 20's
//! rotation by theta-bar does not change a norm and is left out.
//!
//! The exact Hessian of U(|p|) has one positive eigenvalue, along p, and one negative, across. The
//! nearest positive semidefinite matrix therefore keeps the radial term alone: U is replaced by its
//! second-order model along p, which is convex whatever the distance.

use crate::calibration::LmlCalibration;
use crate::observation::ObstacleKind;

/// Normalised distances below this are taken as this: the potential has a pole at zero.
const DISTANCE_MIN: f64 = 0.25;

/// Safe distances of Eq. 20 around one obstacle, frozen over one QP.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeDistance {
    /// X_s \[m\].
    pub x_m: f64,
    /// Y_s \[m\].
    pub y_m: f64,
}

impl SafeDistance {
    /// Eq. 20 for a truck at `speed_mps` that closes in at the given speeds (negative: moves away).
    ///
    /// The paper writes Y_s with one heading angle for both vehicles; the lateral closing speed
    /// says the same without the ambiguity.
    pub fn new(
        cal: &LmlCalibration,
        speed_mps: f64,
        closing_x_mps: f64,
        closing_y_mps: f64,
    ) -> Self {
        let (closing_x, closing_y) = (closing_x_mps.max(0.0), closing_y_mps.max(0.0));
        let braking = 2.0 * cal.comfort_accel_mps2;
        Self {
            x_m: cal.x_0_m + speed_mps.max(0.0) * cal.time_gap_s + closing_x * closing_x / braking,
            y_m: cal.y_0_m + closing_y * cal.time_gap_s + closing_y * closing_y / braking,
        }
    }
}

/// A potential near one point: value, slope and curvature along one direction, none across.
///
/// `U(p + d) ~ value + slope (n . d) + curvature (n . d)^2 / 2`, with `n = (along_x, along_y)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RadialModel {
    /// U at the point.
    pub value: f64,
    /// Derivative of U by normalised distance.
    pub slope: f64,
    /// Second derivative, not negative.
    pub curvature: f64,
    /// Change of normalised distance per metre along the road.
    pub along_x: f64,
    /// Change of normalised distance per metre across the road.
    pub along_y: f64,
}

impl RadialModel {
    /// The same model of a potential `share` times as strong.
    #[must_use]
    pub fn scaled(self, share: f64) -> Self {
        Self {
            value: share * self.value,
            slope: share * self.slope,
            curvature: share * self.curvature,
            ..self
        }
    }
}

/// A cost to second order in changes of position: `slope . d + d' W d / 2`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PositionCost {
    /// By X and Y.
    pub slope: [f64; 2],
    /// W's entry of X.
    pub xx: f64,
    /// W's entry across.
    pub xy: f64,
    /// W's entry of Y.
    pub yy: f64,
}

impl PositionCost {
    /// Adds another.
    pub fn add(&mut self, other: &Self) {
        self.add_scaled(1.0, other);
    }

    /// Adds `share` times another.
    pub fn add_scaled(&mut self, share: f64, other: &Self) {
        self.slope[0] += share * other.slope[0];
        self.slope[1] += share * other.slope[1];
        self.xx += share * other.xx;
        self.xy += share * other.xy;
        self.yy += share * other.yy;
    }
}

impl From<RadialModel> for PositionCost {
    fn from(model: RadialModel) -> Self {
        let (x, y) = (model.along_x, model.along_y);
        Self {
            slope: [model.slope * x, model.slope * y],
            xx: model.curvature * x * x,
            xy: model.curvature * x * y,
            yy: model.curvature * y * y,
        }
    }
}

/// The obstacles' potentials, what they have in common worked out.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// a and b of Eq. 19.
    a: f64,
    b: f64,
    /// a_c and b_c.
    crossable: (f64, f64),
    /// sc; infinite is Eq. 19 as printed.
    cutoff: f64,
    /// sc^-b and b sc^-(b+1); both vanish for an infinite cut-off.
    tail: (f64, f64),
}

impl Field {
    /// The potentials of a calibration.
    pub fn new(cal: &LmlCalibration) -> Self {
        let (b, cutoff) = (cal.potential_b, cal.cutoff);
        let power = if cutoff.is_finite() { libm::pow(cutoff, -b) } else { 0.0 };
        Self {
            a: cal.potential_a,
            b,
            crossable: (cal.crossable_a, cal.crossable_b),
            cutoff,
            tail: (power, b * power / cutoff),
        }
    }

    /// The potential of an obstacle at distance (`dx_m`, `dy_m`) = truck - obstacle.
    ///
    /// Exactly on top of the obstacle the truck is pushed backwards.
    pub fn obstacle(
        &self,
        kind: ObstacleKind,
        safe: SafeDistance,
        dx_m: f64,
        dy_m: f64,
    ) -> RadialModel {
        let (px, py) = (dx_m / safe.x_m, dy_m / safe.y_m);
        let distance = libm::sqrt(px * px + py * py);
        let (nx, ny) = if distance > 0.0 { (px / distance, py / distance) } else { (-1.0, 0.0) };
        let s = distance.max(DISTANCE_MIN);
        let (value, slope, curvature) = match kind {
            ObstacleKind::Vehicle | ObstacleKind::Pedestrian => self.non_crossable(s),
            ObstacleKind::Bump => {
                let (a, b) = self.crossable;
                let value = a * libm::exp(-b * s);
                (value, -b * value, b * b * value)
            }
        };
        RadialModel { value, slope, curvature, along_x: nx / safe.x_m, along_y: ny / safe.y_m }
    }

    /// Eq. 19, cut off smoothly at `sc`: value, first and second derivative by s.
    fn non_crossable(&self, s: f64) -> (f64, f64, f64) {
        let (a, b, sc) = (self.a, self.b, self.cutoff);
        if s >= sc {
            return (0.0, 0.0, 0.0);
        }
        let (tail, tail_slope) = match sc.is_finite() {
            true => (self.tail.0 + self.tail.1 * (sc - s), self.tail.1),
            false => (0.0, 0.0),
        };
        // s^-b; half the time of `pow`, for the last two bits.
        let power = libm::exp(-b * libm::log(s));
        let slope = b * power / s;
        (a * (power - tail), -a * (slope - tail_slope), a * (b + 1.0) * slope / s)
    }
}

/// The road-edge potential at distance `d_m` from the limit: value, derivative by `d_m`, curvature.
pub fn road_edge(cal: &LmlCalibration, d_m: f64) -> (f64, f64, f64) {
    let inside = cal.road_distance_m - d_m;
    if inside <= 0.0 {
        return (0.0, 0.0, 0.0);
    }
    (cal.road_a * inside * inside, -2.0 * cal.road_a * inside, 2.0 * cal.road_a)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAFE: SafeDistance = SafeDistance { x_m: 20.0, y_m: 3.0 };

    fn at(cal: &LmlCalibration, kind: ObstacleKind, dx_m: f64, dy_m: f64) -> RadialModel {
        Field::new(cal).obstacle(kind, SAFE, dx_m, dy_m)
    }

    #[test]
    fn slope_and_curvature_agree_with_differences_along_the_radius() {
        let cal = LmlCalibration::default();
        for kind in [ObstacleKind::Vehicle, ObstacleKind::Bump] {
            for (dx, dy) in [(-15.0, 0.5), (-30.0, -3.0), (8.0, 2.5), (-6.0, 0.0)] {
                let model = at(&cal, kind, dx, dy);
                let s = libm::hypot(dx / SAFE.x_m, dy / SAFE.y_m);
                let h = 1e-5;
                let u = |f: f64| at(&cal, kind, dx * f / s, dy * f / s).value;
                let slope = (u(s + h) - u(s - h)) / (2.0 * h);
                let curvature = (u(s + h) - 2.0 * u(s) + u(s - h)) / (h * h);
                assert!((model.slope - slope).abs() < 1e-4 * model.slope.abs().max(1.0));
                let scale = model.curvature.abs().max(1.0);
                assert!((model.curvature - curvature).abs() < 1e-2 * scale, "{curvature}");
            }
        }
    }

    #[test]
    fn the_radial_direction_is_the_gradient_of_the_normalised_distance() {
        let cal = LmlCalibration::default();
        let (dx, dy, h) = (-12.0, 1.5, 1e-6);
        let model = at(&cal, ObstacleKind::Vehicle, dx, dy);
        let s = |dx: f64, dy: f64| libm::hypot(dx / SAFE.x_m, dy / SAFE.y_m);
        assert!((model.along_x - (s(dx + h, dy) - s(dx - h, dy)) / (2.0 * h)).abs() < 1e-6);
        assert!((model.along_y - (s(dx, dy + h) - s(dx, dy - h)) / (2.0 * h)).abs() < 1e-6);
    }

    #[test]
    fn the_cut_off_is_smooth_and_infinity_gives_the_printed_equation() {
        let cut = LmlCalibration::default();
        let (value, slope, _) = Field::new(&cut).non_crossable(cut.cutoff - 1e-9);
        assert!(value.abs() < 1e-6 && slope.abs() < 1e-4);
        let printed = LmlCalibration { cutoff: f64::INFINITY, ..cut };
        let (value, slope, curvature) = Field::new(&printed).non_crossable(2.0);
        assert!((value - 1e4 * libm::pow(2.0, -1.23)).abs() < 1e-9);
        assert!((slope + 1.23 * value / 2.0).abs() < 1e-9);
        assert!((curvature - 1.23 * 2.23 * value / 4.0).abs() < 1e-9);
    }

    #[test]
    fn on_top_of_an_obstacle_everything_is_finite_and_pushes_back() {
        let cal = LmlCalibration::default();
        let model = at(&cal, ObstacleKind::Vehicle, 0.0, 0.0);
        assert!(model.value.is_finite() && model.curvature > 0.0);
        assert!(model.slope < 0.0 && model.along_x < 0.0 && model.along_y == 0.0);
    }
}
