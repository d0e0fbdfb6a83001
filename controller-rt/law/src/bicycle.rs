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
use crate::resistance::Resistance;

/// Below this speed the slip angles use a guarded speed \[m/s\].
const GUARD_BELOW_MPS: f64 = 9.0;

/// States of the model.
pub const STATES: usize = 6;
/// State \[ū m/s, v m/s, r rad/s, φ rad, X m, Y m\].
pub type State = [f64; STATES];

/// Columns of a sensitivity: to the initial ū, v, r, φ, to force \[1/kN\], to steering \[1/deg\].
/// The columns to the initial X and Y are those of the identity and not stored.
pub const COLUMNS: usize = 6;
/// Sensitivity of a state, row by row.
pub type Sensitivity = [[f64; COLUMNS]; STATES];

/// The model with its constants worked out.
#[derive(Debug, Clone, Copy)]
pub struct Bicycle {
    /// 1/m in \[m/s² per kN\].
    accel_per_kn: f64,
    resistance: Resistance,
    cg_to_front_m: f64,
    cg_to_rear_m: f64,
    front_accel_per_rad: f64,
    rear_accel_per_rad: f64,
    front_yaw_per_rad: f64,
    rear_yaw_per_rad: f64,
}

/// The Jacobian's entries that are not structural.
struct Jacobian {
    uu: f64,
    uv: f64,
    ur: f64,
    vu: f64,
    vv: f64,
    vr: f64,
    ru: f64,
    rv: f64,
    rr: f64,
    cos: f64,
    sin: f64,
    x_phi: f64,
    y_phi: f64,
}

impl Bicycle {
    /// The model of a truck.
    pub fn new(truck: &TruckBelief) -> Self {
        let (m, iz) = (truck.mass_kg, truck.yaw_inertia_kgm2);
        Self {
            accel_per_kn: 1e3 / m,
            resistance: Resistance::new(truck),
            cg_to_front_m: truck.cg_to_front_m,
            cg_to_rear_m: truck.cg_to_rear_m,
            front_accel_per_rad: truck.front_stiffness_n_per_rad / m,
            rear_accel_per_rad: truck.rear_stiffness_n_per_rad / m,
            front_yaw_per_rad: truck.front_stiffness_n_per_rad * truck.cg_to_front_m / iz,
            rear_yaw_per_rad: truck.rear_stiffness_n_per_rad * truck.cg_to_rear_m / iz,
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

    /// State and sensitivity after `step_s`, by one classical Runge-Kutta step of both.
    ///
    /// `input` is \[force kN, steering deg\], held over the step.
    pub fn advance(
        &self,
        state: &State,
        sensitivity: &Sensitivity,
        input: [f64; 2],
        step_s: f64,
    ) -> (State, Sensitivity) {
        // The four stages: how far each reaches from the start, and its share of the sum.
        const REACH: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
        const SHARE: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
        let (mut next, mut next_s) = (*state, *sensitivity);
        let (mut slope, mut slope_s) = ([0.0; STATES], [[0.0; COLUMNS]; STATES]);
        for (reach, share) in REACH.into_iter().zip(SHARE) {
            let (mut at, mut at_s) = (*state, *sensitivity);
            for i in 0..STATES {
                at[i] += reach * step_s * slope[i];
                for c in 0..COLUMNS {
                    at_s[i][c] += reach * step_s * slope_s[i][c];
                }
            }
            let jacobian;
            (slope, jacobian) = self.derivative(&at, input);
            slope_s = self.sensitivity_slope(&jacobian, &at_s);
            for i in 0..STATES {
                next[i] += share * step_s * slope[i];
                for c in 0..COLUMNS {
                    next_s[i][c] += share * step_s * slope_s[i][c];
                }
            }
        }
        (next, next_s)
    }

    /// Eqs. 13 and 14 with their Jacobian.
    fn derivative(&self, state: &State, input: [f64; 2]) -> (State, Jacobian) {
        let [u, v, r, phi, _, _] = *state;
        let (sin, cos) = libm::sincos(phi);
        let (ue, ue_u) = guarded_speed(u);
        let (resistance, resistance_u) = self.resistance.mps2(u);
        let inverse = 1.0 / ue;

        let front_slip = (v + self.cg_to_front_m * r) * inverse - input[1].to_radians();
        let rear_slip = (v - self.cg_to_rear_m * r) * inverse;
        let slope = [
            input[0] * self.accel_per_kn - resistance + v * r,
            -self.front_accel_per_rad * front_slip - self.rear_accel_per_rad * rear_slip - u * r,
            -self.front_yaw_per_rad * front_slip + self.rear_yaw_per_rad * rear_slip,
            r,
            u * cos - v * sin,
            u * sin + v * cos,
        ];

        // d(slip)/du = -(v + l r)/ue * ue'/ue for either axle.
        let front_u = -(v + self.cg_to_front_m * r) * inverse * inverse * ue_u;
        let rear_u = -rear_slip * inverse * ue_u;
        let (cf, cr) = (self.front_accel_per_rad * inverse, self.rear_accel_per_rad * inverse);
        let (yf, yr) = (self.front_yaw_per_rad * inverse, self.rear_yaw_per_rad * inverse);
        let jacobian = Jacobian {
            uu: -resistance_u,
            uv: r,
            ur: v,
            vu: -self.front_accel_per_rad * front_u - self.rear_accel_per_rad * rear_u - r,
            vv: -cf - cr,
            vr: -cf * self.cg_to_front_m + cr * self.cg_to_rear_m - u,
            ru: -self.front_yaw_per_rad * front_u + self.rear_yaw_per_rad * rear_u,
            rv: -yf + yr,
            rr: -yf * self.cg_to_front_m - yr * self.cg_to_rear_m,
            cos,
            sin,
            x_phi: -u * sin - v * cos,
            y_phi: u * cos - v * sin,
        };
        (slope, jacobian)
    }

    /// S' = J S + B [Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, I.14].
    fn sensitivity_slope(&self, j: &Jacobian, s: &Sensitivity) -> Sensitivity {
        let mut slope = [[0.0; COLUMNS]; STATES];
        for c in 0..COLUMNS {
            let (u, v, r, phi) = (s[0][c], s[1][c], s[2][c], s[3][c]);
            slope[0][c] = j.uu * u + j.uv * v + j.ur * r;
            slope[1][c] = j.vu * u + j.vv * v + j.vr * r;
            slope[2][c] = j.ru * u + j.rv * v + j.rr * r;
            slope[3][c] = r;
            slope[4][c] = j.cos * u - j.sin * v + j.x_phi * phi;
            slope[5][c] = j.sin * u + j.cos * v + j.y_phi * phi;
        }
        slope[0][4] += self.accel_per_kn;
        slope[1][5] += self.front_accel_per_rad.to_radians();
        slope[2][5] += self.front_yaw_per_rad.to_radians();
        slope
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

/// The sensitivity at the start: each state to itself, nothing yet to the inputs.
pub const IDENTITY: Sensitivity = {
    let mut s = [[0.0; COLUMNS]; STATES];
    s[0][0] = 1.0;
    s[1][1] = 1.0;
    s[2][2] = 1.0;
    s[3][3] = 1.0;
    s
};

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 0.05;

    fn model() -> Bicycle {
        Bicycle::new(&TruckBelief::default())
    }

    /// Highway, lane change, crawling, standstill, backwards.
    const CASES: [(State, [f64; 2]); 5] = [
        ([20.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.2, 0.0]),
        ([18.0, -0.2, 0.08, 0.05, 300.0, 1.4], [-15.0, 2.5]),
        ([4.0, 0.1, -0.15, -0.3, 10.0, 3.0], [5.0, -8.0]),
        ([0.0, 0.0, 0.0, 0.01, 0.0, 0.0], [0.5, 1.0]),
        ([-0.5, 0.0, 0.01, 0.0, 0.0, 0.0], [-2.0, 0.5]),
    ];

    #[test]
    fn sensitivities_agree_with_central_differences() {
        let model = model();
        for (state, input) in CASES {
            let (_, s) = model.advance(&state, &IDENTITY, input, STEP_S);
            for c in 0..COLUMNS {
                let nudge = 1e-5;
                let moved = |sign: f64| {
                    let (mut state, mut input) = (state, input);
                    match c {
                        0..4 => state[c] += sign * nudge,
                        _ => input[c - 4] += sign * nudge,
                    }
                    model.advance(&state, &IDENTITY, input, STEP_S).0
                };
                let (up, down) = (moved(1.0), moved(-1.0));
                for i in 0..STATES {
                    let difference = (up[i] - down[i]) / (2.0 * nudge);
                    assert!((s[i][c] - difference).abs() < 1e-6, "{state:?}: {i} by {c}");
                }
            }
        }
    }

    #[test]
    fn holding_force_holds_the_speed() {
        let model = model();
        let mut state = [20.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let force = model.holding_force_kn(20.0);
        for _ in 0..200 {
            state = model.advance(&state, &IDENTITY, [force, 0.0], STEP_S).0;
        }
        assert!((state[0] - 20.0).abs() < 1e-9);
        assert!((state[4] - 200.0).abs() < 1e-6);
    }

    #[test]
    fn steady_cornering_has_the_textbook_yaw_rate() {
        // r = u delta / (L + K u^2), K = m (lr/Caf - lf/Car)/L
        // [Rajamani, Vehicle Dynamics and Control, 2nd ed., section 3.1.4].
        let truck = TruckBelief::default();
        let model = model();
        let (u, delta_deg) = (15.0, 0.5_f64);
        let mut state = [u, 0.0, 0.0, 0.0, 0.0, 0.0];
        for _ in 0..400 {
            state = model.advance(&state, &IDENTITY, [0.0, delta_deg], STEP_S).0;
            state[0] = u;
        }
        let length = truck.cg_to_front_m + truck.cg_to_rear_m;
        let understeer = truck.mass_kg / length
            * (truck.cg_to_rear_m / truck.front_stiffness_n_per_rad
                - truck.cg_to_front_m / truck.rear_stiffness_n_per_rad);
        let expected = u * delta_deg.to_radians() / (length + understeer * u * u);
        assert!((state[2] - expected).abs() < 1e-4 * expected, "{} {expected}", state[2]);
    }
}
