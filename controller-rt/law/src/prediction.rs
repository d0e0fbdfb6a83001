//! The future the motion layer plans on: the nonlinear model rolled out along the last plan, and
//! how each predicted state answers to each planned input [MCF, Eq. 16].
//!
//! Linearising about the predicted trajectory, not about the present state, is what makes one QP
//! per tick enough (the real-time iteration of Diehl, Bock & Schlöder, SIAM J. Control Optim.
//! 43(5), 2005).

use crate::bicycle::{Bicycle, COLUMNS, IDENTITY, STATES, State};
use crate::qp::{BLOCKS, INPUTS};

/// Prediction steps N_p [MCF, Table II].
pub const STEPS: usize = 25;
/// Length T of a prediction step \[s\]; ours. A horizon below 2.5 s gets stuck behind obstacles.
pub const STEP_S: f64 = 0.1;
/// Runge-Kutta steps per prediction step.
const SUBSTEPS: usize = 2;

/// The control block whose input acts from step `k` to `k + 1`; the last one is held.
pub const fn block(k: usize) -> usize {
    if k < BLOCKS { k } else { BLOCKS - 1 }
}

/// One predicted instant: the state, and its sensitivity to every planned input.
#[derive(Debug, Clone, Copy)]
pub struct Instant {
    /// Predicted state x̄_k.
    pub state: State,
    /// Row i, column j: change of state i per unit of input j (kN and degrees in turn).
    pub gain: [[f64; INPUTS]; STATES],
}

/// Predicts the states at steps 1 to N_p under `plan`.
pub fn predict(model: &Bicycle, start: &State, plan: &[[f64; 2]; BLOCKS]) -> [Instant; STEPS] {
    let mut instants = [Instant { state: *start, gain: [[0.0; INPUTS]; STATES] }; STEPS];
    let mut last = instants[0];
    for (k, instant) in instants.iter_mut().enumerate() {
        let input = plan[block(k)];
        let (mut state, mut local) = (last.state, IDENTITY);
        for _ in 0..SUBSTEPS {
            (state, local) = model.advance(&state, &local, input, STEP_S / SUBSTEPS as f64);
        }
        // G_{k+1} = A_k G_k + B_k E_k; the columns of inputs not used yet stay zero, and those of
        // A_k to X and Y are the identity's.
        let mut gain = [[0.0; INPUTS]; STATES];
        let used = 2 * (block(k) + 1);
        for i in 0..STATES {
            for j in 0..used {
                let mut sum = if i >= 4 { last.gain[i][j] } else { 0.0 };
                for m in 0..4 {
                    sum += local[i][m] * last.gain[m][j];
                }
                gain[i][j] = sum;
            }
            gain[i][used - 2] += local[i][COLUMNS - 2];
            gain[i][used - 1] += local[i][COLUMNS - 1];
        }
        last = Instant { state, gain };
        *instant = last;
    }
    instants
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::TruckBelief;

    #[test]
    fn gains_agree_with_central_differences_of_the_rollout() {
        let model = Bicycle::new(&TruckBelief::default());
        let start = [18.0, 0.05, 0.02, 0.01, 5.0, 1.0];
        let plan = [[2.0, 1.0], [5.0, 1.5], [-3.0, 0.5], [-8.0, -1.0], [0.0, -0.2]];
        let instants = predict(&model, &start, &plan);
        for j in 0..INPUTS {
            let nudge = 1e-4;
            let moved = |sign: f64| {
                let mut plan = plan;
                plan[j / 2][j % 2] += sign * nudge;
                predict(&model, &start, &plan)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for k in 0..STEPS {
                for i in 0..STATES {
                    let difference = (up[k].state[i] - down[k].state[i]) / (2.0 * nudge);
                    let error = (instants[k].gain[i][j] - difference).abs();
                    assert!(error < 1e-6, "step {k}, state {i}, input {j}: {error:e}");
                }
            }
        }
    }
}
