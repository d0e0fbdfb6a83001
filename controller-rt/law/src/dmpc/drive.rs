//! The longitudinal model a DMPC truck predicts with \[Zheng\].
//!
//! ```text
//! x' = v      v' = a - r(v)      a' = (u - a)/tau      a = eta T/(m R),  u = eta T_des/(m R)
//! ```
//!
//! Torques appear as the acceleration they give, so that trucks and cars have numbers of one size;
//! `r` is drag and rolling resistance per mass.

use serde::{Deserialize, Serialize};

use super::STEP_S;
use crate::calibration::TruckBelief;
use crate::resistance::Resistance;

/// State \[x m, v m/s, a m/s²\].
pub type State = [f64; 3];

/// How the model is advanced by a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Discretisation {
    /// Input held, resistance constant over the step, the rest exact: for trucks that are no model.
    #[default]
    Hold,
    /// Forward Euler, as in the paper's simulations.
    Euler,
}

/// A vehicle on a level road, its constants worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    resistance: Resistance,
    /// Effect of v' and of a on x, and of a on v and itself, over a step.
    x_by_slope: f64,
    x_by_a: f64,
    v_by_a: f64,
    a_by_a: f64,
    /// Effect of u on x, v and a over a step.
    by_input: [f64; 3],
}

/// One step's result with its derivatives by the state it started from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advanced {
    /// State at the step's end.
    pub state: State,
    /// Row i, column j: change of state i per change of state j at the step's start.
    pub by_state: [[f64; 3]; 3],
}

impl Drive {
    /// The model of a vehicle whose drive line answers with a lag of `lag_s`.
    pub fn new(vehicle: &TruckBelief, lag_s: f64, discretisation: Discretisation) -> Self {
        let resistance = Resistance::new(vehicle);
        let t = STEP_S;
        match discretisation {
            Discretisation::Euler => Self {
                resistance,
                x_by_slope: 0.0,
                x_by_a: 0.0,
                v_by_a: t,
                a_by_a: 1.0 - t / lag_s,
                by_input: [0.0, 0.0, t / lag_s],
            },
            Discretisation::Hold => {
                let decay = libm::exp(-t / lag_s);
                let v_by_a = lag_s * (1.0 - decay);
                let x_by_a = lag_s * (t - v_by_a);
                Self {
                    resistance,
                    x_by_slope: 0.5 * t * t,
                    x_by_a,
                    v_by_a,
                    a_by_a: decay,
                    by_input: [0.5 * t * t - x_by_a, t - v_by_a, 1.0 - decay],
                }
            }
        }
    }

    /// The state a step later, and how it depends on where the step began.
    pub fn advance(&self, [x, v, a]: &State, u: f64) -> Advanced {
        let (r, r_v) = self.resistance.mps2(*v);
        let [x_u, v_u, a_u] = self.by_input;
        Advanced {
            state: [
                x + STEP_S * v + self.x_by_a * a + x_u * u - self.x_by_slope * r,
                v + self.v_by_a * a + v_u * u - STEP_S * r,
                self.a_by_a * a + a_u * u,
            ],
            by_state: [
                [1.0, STEP_S - self.x_by_slope * r_v, self.x_by_a],
                [0.0, 1.0 - STEP_S * r_v, self.v_by_a],
                [0.0, 0.0, self.a_by_a],
            ],
        }
    }

    /// Effect of the input on the state at the step's end.
    pub fn by_input(&self) -> [f64; 3] {
        self.by_input
    }

    /// The input that keeps a speed, h(v) of \[Zheng\] \[m/s²\], and its derivative by speed.
    pub fn holding(&self, speed_mps: f64) -> (f64, f64) {
        self.resistance.mps2(speed_mps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAG_S: f64 = 0.5;

    #[test]
    fn a_held_step_agrees_with_many_small_euler_steps() {
        let vehicle = TruckBelief::default();
        let drive = Drive::new(&vehicle, LAG_S, Discretisation::Hold);
        let resistance = Resistance::new(&vehicle);
        let (mut fine, u) = ([5.0, 20.0, 0.3], 2.0);
        let coarse = drive.advance(&fine, u).state;
        for _ in 0..100_000 {
            let [x, v, a] = fine;
            let dt = STEP_S / 1e5;
            fine = [x + dt * v, v + dt * (a - resistance.mps2(v).0), a + dt / LAG_S * (u - a)];
        }
        for (coarse, fine) in coarse.iter().zip(fine) {
            assert!((coarse - fine).abs() < 1e-4, "{coarse} {fine}");
        }
    }

    #[test]
    fn the_holding_input_holds_either_way() {
        for way in [Discretisation::Hold, Discretisation::Euler] {
            let drive = Drive::new(&TruckBelief::default(), LAG_S, way);
            let u = drive.holding(22.0).0;
            let next = drive.advance(&[0.0, 22.0, u], u).state;
            assert!((next[0] - 2.2).abs() < 1e-12 && (next[1] - 22.0).abs() < 1e-12);
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for way in [Discretisation::Hold, Discretisation::Euler] {
            let drive = Drive::new(&TruckBelief::default(), LAG_S, way);
            let (state, u, nudge) = ([3.0, 18.0, -0.4], 1.0, 1e-5);
            let at = drive.advance(&state, u);
            for j in 0..3 {
                let mut moved = state;
                moved[j] += nudge;
                let up = drive.advance(&moved, u).state;
                for i in 0..3 {
                    let difference = (up[i] - at.state[i]) / nudge;
                    assert!((difference - at.by_state[i][j]).abs() < 1e-6, "{i} {j}");
                }
            }
            let pushed = drive.advance(&state, u + nudge).state;
            for i in 0..3 {
                let difference = (pushed[i] - at.state[i]) / nudge;
                assert!((difference - drive.by_input()[i]).abs() < 1e-6, "{i}");
            }
        }
    }
}
