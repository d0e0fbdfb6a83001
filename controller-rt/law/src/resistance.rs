//! What slows a truck that coasts: drag and rolling resistance, per unit of mass.

use crate::calibration::TruckBelief;
use crate::lanes::Lanes;

/// Standard gravity \[m/s²\].
pub(crate) const GRAVITY_MPS2: f64 = 9.80665;
/// Speed over which rolling resistance fades through zero at standstill \[m/s\].
pub(crate) const ROLLING_FADE_MPS: f64 = 0.1;

/// Deceleration by drag and rolling as a function of speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    drag_per_m: f64,
    rolling_mps2: f64,
}

impl Resistance {
    /// That of a truck on a level road.
    pub fn new(truck: &TruckBelief) -> Self {
        Self {
            drag_per_m: truck.drag_n_per_mps2 / truck.mass_kg,
            rolling_mps2: truck.rolling_resistance * GRAVITY_MPS2,
        }
    }

    /// The same at road speeds, for who has 1/u already: with x = (fade/u)² at most 1.3e-4 above
    /// 9 m/s, a few terms of 1/sqrt(1 + x) are exact to the last bit and need no root.
    #[inline(always)]
    pub fn mps2_at_road_speed(&self, u: f64, inverse: f64) -> f64 {
        let x = (ROLLING_FADE_MPS * ROLLING_FADE_MPS) * (inverse * inverse);
        let sign = (1.0 - 0.5 * x) + (x * x) * (0.375 - 0.3125 * x);
        self.drag_per_m * (u * u) + self.rolling_mps2 * sign
    }

    /// Derivative of that by speed \[1/s\].
    #[inline(always)]
    pub fn slope_at_road_speed(&self, u: Lanes, inverse: Lanes) -> Lanes {
        let x = (inverse * inverse) * (ROLLING_FADE_MPS * ROLLING_FADE_MPS);
        let sign_u = x * inverse * (x * -1.5 + 1.0);
        u * (2.0 * self.drag_per_m) + sign_u * self.rolling_mps2
    }

    /// Deceleration at speed `u` \[m/s²\], and its derivative by speed \[1/s\].
    pub fn mps2(&self, u: f64) -> (f64, f64) {
        let length = libm::sqrt(u * u + ROLLING_FADE_MPS * ROLLING_FADE_MPS);
        let sign = u / length;
        (
            self.drag_per_m * u * u.abs() + self.rolling_mps2 * sign,
            2.0 * self.drag_per_m * u.abs() + self.rolling_mps2 * (1.0 - sign * sign) / length,
        )
    }
}
