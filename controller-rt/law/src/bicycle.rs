//! The prediction model: what the controller believes about its truck [MCF, Eqs. 13-15].
//!
//! ```text
//! u' = F/m - (c u|u| + f m g)/m + v r            v' = (Fyf + Fyr)/m - u r
//! r' = (lf Fyf - lr Fyr)/Iz                      phi' = r
//! X' = u cos(phi) - v sin(phi)                   Y' = u sin(phi) + v cos(phi)
//! Fyf = Caf (delta - (v + lf r)/ue)              Fyr = -Car (v - lr r)/ue
//! ```
//!
//! Drag and rolling resistance are ours: without them a constant speed error remains. `ue` is the
//! speed, kept away from zero below 9 m/s so that the slip angles stay finite. The plant that
//! drives in `bench-sim` shares nothing with this file.

use crate::calibration::TruckBelief;
use crate::lanes::Lanes;
use crate::resistance::Resistance;

/// Below this speed the slip angles use a guarded speed \[m/s\].
const GUARD_BELOW_MPS: f64 = 9.0;

/// States of the model.
pub const STATES: usize = 6;
/// State \[ū m/s, v m/s, r rad/s, φ rad, X m, Y m\].
pub type State = [f64; STATES];

/// The model with its constants worked out.
///
/// With both slip angles put in, lateral and yaw motion are linear in v, r and delta at a speed:
///
/// ```text
/// v' = (vv v + vr r)/ue + v_steer delta - u r       vv = -(Caf + Car)/m   vr = (lr Car - lf Caf)/m
/// r' = (rv v + rr r)/ue + r_steer delta             rv = (lr Car - lf Caf)/Iz
///                                                   rr = -(lf² Caf + lr² Car)/Iz
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Bicycle {
    /// 1/m in \[m/s² per kN\].
    accel_per_kn: f64,
    resistance: Resistance,
    vv: f64,
    vr: f64,
    rv: f64,
    rr: f64,
    /// Per degree.
    v_steer: f64,
    /// Per degree.
    r_steer: f64,
}

/// The part of the state the rest follows from: \[ū m/s, v m/s, r rad/s\].
pub type Core = [f64; 3];

/// What the speed of an instant makes of tyres and resistances.
#[derive(Debug, Clone, Copy)]
pub struct AtSpeed {
    /// 1/ue \[s/m\].
    pub inverse: f64,
    /// Deceleration by drag and rolling \[m/s²\].
    pub resistance_mps2: f64,
}

/// The Jacobian's entries that are not structural, of an instant per lane.
#[derive(Debug, Clone, Copy)]
pub struct Jacobian {
    pub uu: Lanes,
    pub uv: Lanes,
    pub ur: Lanes,
    pub vu: Lanes,
    pub vv: Lanes,
    pub vr: Lanes,
    pub ru: Lanes,
    pub rv: Lanes,
    pub rr: Lanes,
}

impl Bicycle {
    /// The model of a truck.
    pub fn new(truck: &TruckBelief) -> Self {
        let (m, iz) = (truck.mass_kg, truck.yaw_inertia_kgm2);
        let (front, rear) = (truck.front_stiffness_n_per_rad, truck.rear_stiffness_n_per_rad);
        let (lf, lr) = (truck.cg_to_front_m, truck.cg_to_rear_m);
        Self {
            accel_per_kn: 1e3 / m,
            resistance: Resistance::new(truck),
            vv: -(front + rear) / m,
            vr: (lr * rear - lf * front) / m,
            rv: (lr * rear - lf * front) / iz,
            rr: -(lf * lf * front + lr * lr * rear) / iz,
            v_steer: (front / m).to_radians(),
            r_steer: (front * lf / iz).to_radians(),
        }
    }

    /// Force that holds `speed_mps` on a level road \[kN\].
    pub fn holding_force_kn(&self, speed_mps: f64) -> f64 {
        self.resistance.mps2(speed_mps).0 / self.accel_per_kn
    }

    /// Acceleration a force gives at a speed on a straight road \[m/s²\].
    pub fn acceleration_mps2(&self, force_kn: f64, speed_mps: f64) -> f64 {
        force_kn * self.accel_per_kn - self.resistance.mps2(speed_mps).0
    }

    /// Slope of the core under \[force kN, steering deg\], Eq. 13.
    #[inline(always)]
    pub fn slope(&self, [u, v, r]: Core, input: [f64; 2], at: &AtSpeed) -> Core {
        [
            input[0] * self.accel_per_kn - at.resistance_mps2 + v * r,
            (self.vv * v + self.vr * r) * at.inverse + input[1] * self.v_steer - u * r,
            (self.rv * v + self.rr * r) * at.inverse + input[1] * self.r_steer,
        ]
    }

    /// What a speed makes of tyres and resistances.
    #[inline(always)]
    pub fn at_speed(&self, u: f64) -> AtSpeed {
        if u >= GUARD_BELOW_MPS { self.at_road_speed(u) } else { self.at_low_speed(u) }
    }

    /// Above the guarded range one division is all that has to be waited for.
    #[inline(always)]
    fn at_road_speed(&self, u: f64) -> AtSpeed {
        let inverse = 1.0 / u;
        AtSpeed { inverse, resistance_mps2: self.resistance.mps2_at_road_speed(u, inverse) }
    }

    #[cold]
    fn at_low_speed(&self, u: f64) -> AtSpeed {
        AtSpeed { inverse: 1.0 / guarded_speed(u).0, resistance_mps2: self.resistance.mps2(u).0 }
    }

    /// The core's Jacobian where 1/ue is known, times `reach_s`: what the slopes change over that
    /// time, by a change of the core.
    #[inline(always)]
    pub fn jacobian(&self, [u, v, r]: [Lanes; 3], inverse: Lanes, reach_s: f64) -> Jacobian {
        let (inverse_u, resistance_u) = match u.0.iter().all(|&u| u >= GUARD_BELOW_MPS) {
            true => (inverse, self.resistance.slope_at_road_speed(u, inverse)),
            false => self.slopes_at_low_speed(u, inverse),
        };
        // d(1/ue)/du = -(1/ue) (ue'/ue).
        let fade = -(inverse * inverse_u);
        let of_tyre = |stiffness: f64| reach_s * stiffness;
        Jacobian {
            uu: resistance_u * -reach_s,
            uv: r * reach_s,
            ur: v * reach_s,
            vu: (v * of_tyre(self.vv) + r * of_tyre(self.vr)) * fade - r * reach_s,
            vv: inverse * of_tyre(self.vv),
            vr: inverse * of_tyre(self.vr) - u * reach_s,
            ru: (v * of_tyre(self.rv) + r * of_tyre(self.rr)) * fade,
            rv: inverse * of_tyre(self.rv),
            rr: inverse * of_tyre(self.rr),
        }
    }

    /// The derivative of 1/ue by speed, over -1/ue \[s/m\], and that of the resistances \[1/s\].
    #[cold]
    fn slopes_at_low_speed(&self, u: Lanes, inverse: Lanes) -> (Lanes, Lanes) {
        let mut slopes = (inverse, Lanes::ZERO);
        for (lane, &u) in u.0.iter().enumerate() {
            slopes.0.0[lane] *= guarded_speed(u).1;
            slopes.1.0[lane] = self.resistance.mps2(u).1;
        }
        slopes
    }

    /// Slope of the core per unit of force \[kN\] and of steering \[deg\].
    pub fn input_slopes(&self) -> [Core; 2] {
        [[self.accel_per_kn, 0.0, 0.0], [0.0, self.v_steer, self.r_steer]]
    }
}

/// The speed slip angles divide by, and its derivative: the speed itself above 9 m/s, never below
/// about 3 m/s.
fn guarded_speed(u: f64) -> (f64, f64) {
    if u >= GUARD_BELOW_MPS {
        return (u, 1.0);
    }
    let fade = libm::exp(-u * u / 9.0);
    let ue = libm::sqrt(u * u + 9.0 * fade);
    (ue, u * (1.0 - fade) / ue)
}

#[cfg(test)]
#[path = "bicycle/tests.rs"]
pub(crate) mod tests;
