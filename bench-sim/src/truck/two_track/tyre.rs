//! One tyre: magic formula with load dependence, combined slip and relaxation lengths.
//!
//! ```text
//! Ky = λ p1 Fz0 sin(2 atan(Fz / (p2 Fz0)))       Kx = pk Fz
//! D  = µ (1 + pd (Fz/Fz0 - 1)) Fz
//! ρx = Kx κ / D,  ρy = Ky tan α / D,  ρ = |(ρx, ρy)|
//! P(ρ) = sin(C atan(ρ/C - E (ρ/C - atan(ρ/C))))
//! (Fx, Fy) = D P(ρ) (ρx, ρy) / ρ
//! σ = s0 + K / c                                 (relaxation length of either direction)
//! ```
//!
//! Pacejka, *Tire and Vehicle Dynamics*, 3rd ed.: the formula and Ky(Fz) are of section 4.3, the
//! combination by normalised slip is the similarity method of section 4.2, the relaxation length
//! as slip stiffness over carcass stiffness is of chapter 7. At small slip the slopes are exactly
//! Kx and Ky; the resultant never exceeds D. Camber, ply steer and conicity are left out. A locked
//! wheel's force points along (Kx κ, Ky tan α), not exactly against the sliding: anti-lock brakes
//! keep the wheels from there.

/// Calibration of one tyre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TyreParameters {
    /// Rated load Fz0 \[N\].
    pub rated_load_n: f64,
    /// Largest cornering stiffness over rated load, p1 \[1/rad\].
    pub cornering_peak_per_rad: f64,
    /// Load at which cornering stiffness is largest, over rated load, p2.
    pub cornering_peak_load: f64,
    /// Factor on the cornering stiffness λ (Pacejka's λ_Kyα).
    pub cornering_scale: f64,
    /// Longitudinal slip stiffness over load pk.
    pub slip_stiffness: f64,
    /// Change of friction with load over rated load pd.
    pub friction_load_slope: f64,
    /// Shape factor C.
    pub shape: f64,
    /// Curvature factor E.
    pub curvature: f64,
    /// Longitudinal carcass stiffness \[N/m\].
    pub carcass_x_n_per_m: f64,
    /// Lateral carcass stiffness \[N/m\].
    pub carcass_y_n_per_m: f64,
    /// Relaxation length of an unloaded tyre s0 \[m\], about half the contact length.
    pub relaxation_min_m: f64,
}

/// Friction never falls below this share of its value at the rated load, however overloaded.
const FRICTION_SHARE_MIN: f64 = 0.5;

/// A load below this counts as this \[N\], so that a lifted wheel divides nothing by zero.
const LOAD_MIN_N: f64 = 1.0;

/// What a load makes of a tyre: stiffnesses, peak and relaxation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loaded {
    /// Longitudinal slip stiffness \[N\].
    pub(super) slip_stiffness_n: f64,
    /// Cornering stiffness \[N/rad\].
    pub(super) cornering_n_per_rad: f64,
    /// Largest force D \[N\].
    pub(super) peak_n: f64,
    /// Relaxation length of longitudinal slip \[m\].
    pub(super) relaxation_x_m: f64,
    /// Relaxation length of lateral slip \[m\].
    pub(super) relaxation_y_m: f64,
    shape: f64,
    curvature: f64,
}

impl TyreParameters {
    /// The tyre under a vertical load, on a road of a friction coefficient.
    pub(super) fn under(&self, load_n: f64, friction: f64) -> Loaded {
        let load_n = load_n.max(LOAD_MIN_N);
        let friction_share = 1.0 + self.friction_load_slope * (load_n / self.rated_load_n - 1.0);
        let slip_stiffness_n = self.slip_stiffness * load_n;
        let cornering_n_per_rad = self.cornering_n_per_rad(load_n);
        Loaded {
            slip_stiffness_n,
            cornering_n_per_rad,
            peak_n: friction * friction_share.max(FRICTION_SHARE_MIN) * load_n,
            relaxation_x_m: self.relaxation_min_m + slip_stiffness_n / self.carcass_x_n_per_m,
            relaxation_y_m: self.relaxation_min_m + cornering_n_per_rad / self.carcass_y_n_per_m,
            shape: self.shape,
            curvature: self.curvature,
        }
    }

    /// Cornering stiffness under a load \[N/rad\]; sin(2 atan x) = 2x / (1 + x²).
    pub(super) fn cornering_n_per_rad(&self, load_n: f64) -> f64 {
        let x = load_n / (self.cornering_peak_load * self.rated_load_n);
        let peak_n_per_rad = self.cornering_scale * self.cornering_peak_per_rad * self.rated_load_n;
        peak_n_per_rad * 2.0 * x / (1.0 + x * x)
    }
}

impl Loaded {
    /// Force along and across the wheel \[N\] at a longitudinal slip κ (positive when driving) and
    /// the tangent of a slip angle (positive when it pushes to the left).
    pub(super) fn force_n(&self, slip: f64, tan_slip: f64) -> (f64, f64) {
        let along = self.slip_stiffness_n * slip / self.peak_n;
        let across = self.cornering_n_per_rad * tan_slip / self.peak_n;
        let length = (along * along + across * across).sqrt();
        let x = length / self.shape;
        if x < 1e-6 {
            return (self.peak_n * along, self.peak_n * across);
        }
        let curved = x - self.curvature * (x - libm::atan(x));
        let scale_n = self.peak_n * libm::sin(self.shape * libm::atan(curved)) / length;
        (scale_n * along, scale_n * across)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truck::two_track::TwoTrackParameters;

    fn tyre() -> TyreParameters {
        TwoTrackParameters::default().tyre
    }

    #[test]
    fn force_stays_inside_the_friction_circle() {
        for (load_n, friction) in [(0.0, 0.85), (3_000.0, 0.2), (22_000.0, 0.85), (90_000.0, 0.5)] {
            let loaded = tyre().under(load_n, friction);
            for slip in [-1.0, -0.2, -0.01, 0.0, 0.05, 0.4, 1.5] {
                for tan_slip in [-2.0, -0.3, -0.01, 0.0, 0.1, 1.0] {
                    let (along_n, across_n) = loaded.force_n(slip, tan_slip);
                    assert!(libm::hypot(along_n, across_n) <= loaded.peak_n * (1.0 + 1e-12));
                    assert!(along_n * slip >= 0.0 && across_n * tan_slip >= 0.0);
                }
            }
        }
    }

    #[test]
    fn small_slip_has_the_stiffnesses_as_slopes() {
        let loaded = tyre().under(20_000.0, 0.85);
        let (along_n, across_n) = loaded.force_n(1e-5, 2e-5);
        assert!((along_n / 1e-5 / loaded.slip_stiffness_n - 1.0).abs() < 1e-6);
        assert!((across_n / 2e-5 / loaded.cornering_n_per_rad - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_peak_is_reached_and_sliding_is_weaker() {
        // Dry road: a truck tyre peaks at 10 to 25 % slip and slides with 0.7 to 0.9 of the peak
        // (Wong, Theory of Ground Vehicles, section 1.3; Gillespie, section 10.2).
        let loaded = tyre().under(22_000.0, 0.85);
        let force_n = |permille: u32| loaded.force_n(f64::from(permille) * 1e-3, 0.0).0;
        let best = (1..1000).max_by(|a, b| force_n(*a).total_cmp(&force_n(*b))).expect("some");
        assert!((100..250).contains(&best), "peak at {best} permille");
        assert!((force_n(best) / loaded.peak_n - 1.0).abs() < 1e-4);
        let sliding = force_n(1000) / loaded.peak_n;
        assert!((0.7..0.9).contains(&sliding), "sliding {sliding} of the peak");
    }

    #[test]
    fn braking_takes_side_force_away() {
        let loaded = tyre().under(22_000.0, 0.85);
        let rolling_n = loaded.force_n(0.0, 0.1).1;
        let braking_n = loaded.force_n(-0.15, 0.1).1;
        assert!(braking_n > 0.0 && braking_n < 0.6 * rolling_n, "{braking_n} of {rolling_n}");
    }

    #[test]
    fn cornering_stiffness_grows_less_than_load() {
        let (half, full) = (tyre().cornering_n_per_rad(1.5e4), tyre().cornering_n_per_rad(3e4));
        assert!(full > half && full < 2.0 * half);
    }

    #[test]
    fn opposite_slip_gives_the_opposite_force() {
        let loaded = tyre().under(15_000.0, 0.6);
        let (along_n, across_n) = loaded.force_n(0.07, -0.12);
        assert_eq!(loaded.force_n(-0.07, 0.12), (-along_n, -across_n));
    }
}
