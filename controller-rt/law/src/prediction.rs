//! The future the motion layer plans on: the nonlinear model rolled out along the last plan, and
//! how each predicted state answers to each planned input [MCF, Eq. 16].
//!
//! Linearising about the predicted trajectory, not about the present state, is what makes one QP
//! per tick enough (the real-time iteration of Diehl, Bock & Schlöder, SIAM J. Control Optim.
//! 43(5), 2005).

mod rollout;
mod tangent;

use crate::bicycle::{Bicycle, STATES, State};
use crate::lanes::LANES;
use crate::qp::{BLOCKS, INPUTS};
use crate::wide::widest;
use rollout::{Group, Moving};
use tangent::{Linearise, Tangent};

/// Prediction steps N_p [MCF, Table II].
pub const STEPS: usize = 25;
/// Length T of a prediction step \[s\]; ours. A horizon below 2.5 s gets stuck behind obstacles.
pub const STEP_S: f64 = 0.1;
/// Width of a row of gains: the inputs, the part of the state that the plan makes, one to spare.
pub const WIDTH: usize = INPUTS + 2;
/// Where a row holds the part that the plan makes.
pub const PLANNED: usize = INPUTS;

/// The control block whose input acts from step `k` to `k + 1`; the last one is held.
pub const fn block(k: usize) -> usize {
    if k < BLOCKS { k } else { BLOCKS - 1 }
}

/// How one state answers to every planned input (kN and degrees in turn), and at [`PLANNED`] the
/// sum of that over the plan: G w̄.
pub type Gain = [f64; WIDTH];

/// One predicted instant: the state, and its sensitivity to every planned input.
#[derive(Debug, Clone, Copy)]
pub struct Instant {
    /// Predicted state x̄_k.
    pub state: State,
    /// One row per state.
    pub gain: [Gain; STATES],
}

/// Predicts the states at steps 1 to N_p under `plan`, and hands over one after the other.
///
/// Rollout, tangents and gains take turns, a few steps at a time: what one leaves the next finds
/// in the fastest memory.
pub fn predict(
    model: &Bicycle,
    start: &State,
    plan: &[[f64; 2]; BLOCKS],
    mut hand_over: impl FnMut(usize, &Instant),
) {
    let mut moving = Moving { core: [start[0], start[1], start[2]], heading: start[3] };
    let mut instant = Instant { state: *start, gain: [[0.0; WIDTH]; STATES] };
    let mut group = Group::EMPTY;
    let mut ends = [moving; LANES];
    for first in (0..STEPS).step_by(LANES) {
        // Where the steps end before the lanes do, the others keep what they had; nobody asks.
        let steps = LANES.min(STEPS - first);
        for lane in 0..steps {
            group.roll(model, &mut moving, plan[block(first + lane)], lane);
            ends[lane] = moving;
        }
        let tangent = widest(Linearise { model, group: &group });
        for lane in 0..steps {
            let k = first + lane;
            instant.advance(&tangent, lane, &ends[lane], block(k), &plan[block(k)]);
            hand_over(k, &instant);
        }
    }
}

impl Instant {
    /// G_{k+1} = A_k G_k + B_k E_k; the columns of inputs not used yet stay zero.
    #[inline(always)]
    fn advance(
        &mut self,
        tangent: &Tangent,
        lane: usize,
        end: &Moving,
        block: usize,
        input: &[f64; 2],
    ) {
        let a = |row: usize, column: usize| tangent.columns[column][row].0[lane];
        let way = [tangent.way[0].0[lane], tangent.way[1].0[lane]];
        let [u, v, r, phi, x, y] = self.gain;
        let of_core = |row: usize| {
            let (by_u, by_v, by_r) = (a(row, 0), a(row, 1), a(row, 2));
            let mut gain = u;
            for j in 0..WIDTH {
                gain[j] = by_u * u[j] + by_v * v[j] + by_r * r[j];
            }
            gain
        };
        // A turn of the start by dφ moves the end by dφ times the way, turned to the left.
        let turned = |row: usize, by_phi: f64, kept: &Gain| {
            let mut gain = of_core(row);
            for j in 0..WIDTH {
                gain[j] += by_phi * phi[j] + kept[j];
            }
            gain
        };
        let mut of_phi = of_core(3);
        for j in 0..WIDTH {
            of_phi[j] += phi[j];
        }
        let (of_x, of_y) = (turned(4, -way[1], &x), turned(5, way[0], &y));
        self.gain = [of_core(0), of_core(1), of_core(2), of_phi, of_x, of_y];
        for (row, gain) in self.gain.iter_mut().enumerate() {
            let (force, steering) = (a(row, 3), a(row, 4));
            gain[2 * block] += force;
            gain[2 * block + 1] += steering;
            gain[PLANNED] += force * input[0] + steering * input[1];
        }
        let [_, _, _, _, x_m, y_m] = self.state;
        let [u, v, r] = end.core;
        self.state = [u, v, r, end.heading, x_m + way[0], y_m + way[1]];
    }
}

#[cfg(test)]
#[path = "prediction/tests.rs"]
mod tests;
