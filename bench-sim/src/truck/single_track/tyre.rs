//! One axle's tyres: a saturating lateral force inside a friction ellipse.
//!
//! ```text
//! |Fx| <= 0.98 µ Fz                      (ABS and traction control keep the wheel turning)
//! Fy_max = sqrt((µ Fz)² - Fx²)           (friction ellipse with equal half-axes)
//! Fy = Fy_max tanh(C α / Fy_max)         (slope C at small slip, Fy_max at large)
//! ```
//!
//! The ellipse is the usual combined-slip approximation (Pacejka, *Tire and Vehicle Dynamics*,
//! 3rd ed., section 4.1); the hyperbolic tangent is the simplest curve with the right slope at
//! zero and the right limit. It is not the linear tyre the controller believes in.

/// Share of the friction that longitudinal force may take, so that some side force always remains.
const LONGITUDINAL_SHARE_MAX: f64 = 0.98;

/// Below this wheel speed the slip angle is taken over this speed instead \[m/s\]: a standing wheel
/// then resists sideways motion like a damper and never divides by zero.
const SLIP_SPEED_MIN_MPS: f64 = 1.0;

/// The tyres of one axle at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axle {
    /// Cornering stiffness C at small slip \[N/rad\].
    pub(super) stiffness_n_per_rad: f64,
    /// Friction coefficient µ.
    pub(super) friction: f64,
    /// Vertical load Fz \[N\].
    pub(super) load_n: f64,
}

/// Force of an axle in its wheel's frame: x along the wheel plane, y to the wheel's left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WheelForce {
    /// Along the wheel \[N\].
    pub(super) along_n: f64,
    /// Across the wheel \[N\].
    pub(super) across_n: f64,
}

impl Axle {
    /// The axle's force for a demanded longitudinal force and the velocity of its contact point
    /// in the wheel's frame \[m/s\].
    pub(super) fn force(&self, demanded_n: f64, along_mps: f64, across_mps: f64) -> WheelForce {
        let grip_n = (self.friction * self.load_n).max(1.0);
        let along_max_n = LONGITUDINAL_SHARE_MAX * grip_n;
        let along_n = demanded_n.clamp(-along_max_n, along_max_n);
        let across_max_n = (grip_n * grip_n - along_n * along_n).sqrt();
        let slip_rad = -libm::atan(across_mps / along_mps.max(SLIP_SPEED_MIN_MPS));
        let across_n =
            across_max_n * libm::tanh(self.stiffness_n_per_rad * slip_rad / across_max_n);
        WheelForce { along_n, across_n }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXLE: Axle = Axle { stiffness_n_per_rad: 260_000.0, friction: 0.85, load_n: 40_000.0 };

    #[test]
    fn force_stays_inside_the_friction_circle() {
        let grip_n = AXLE.friction * AXLE.load_n;
        for demanded_n in [-1e6, -30e3, -1e3, 0.0, 5e3, 33.9e3, 1e6] {
            for across_mps in [-30.0, -3.0, -0.1, 0.0, 0.1, 3.0, 30.0] {
                for along_mps in [0.0, 0.3, 2.0, 25.0] {
                    let force = AXLE.force(demanded_n, along_mps, across_mps);
                    let total_n = libm::hypot(force.along_n, force.across_n);
                    assert!(total_n <= grip_n * (1.0 + 1e-12), "{total_n} above {grip_n}");
                }
            }
        }
    }

    #[test]
    fn small_slip_has_the_stiffness_as_slope() {
        let slip_rad = 1e-4;
        let force = AXLE.force(0.0, 20.0, -20.0 * libm::tan(slip_rad));
        assert!((force.across_n / slip_rad / AXLE.stiffness_n_per_rad - 1.0).abs() < 1e-5);
    }

    #[test]
    fn braking_takes_side_force_away() {
        let rolling = AXLE.force(0.0, 20.0, -4.0).across_n;
        let braking = AXLE.force(-33e3, 20.0, -4.0).across_n;
        assert!(braking < 0.35 * rolling && braking > 0.0, "{braking} of {rolling}");
    }
}
