//! The lower-level motion-planning layer: reference speed, obstacles and road in, one QP out
//! [MCF, Eqs. 18-21].
//!
//! ```text
//! minimise over w = (F, delta) of 5 blocks, and slacks eps
//!   sum_k  Q_Y (Y_k - Y_des)^2 + Q_ref (u_k - V_ref)^2 + Q_obs sum_j U_j(X_k, Y_k) + road(Y_k)
//!        + S w_k^2  +  sum_b R (w_b - w_{b-1})^2  +  1/2 eps' H eps + h' eps
//! subject to  bounds and rates of w,
//!   Y_k - epsY <= Ymax_k,  Y_k + epsY >= Ymin_k,  X_k - epsX <= Xmax_k,  |u_k r_k| - epsA <= aymax
//! ```
//!
//! with x_k = x̄_k + G_k (w - w̄) about the trajectory the last plan predicts. The linear slack
//! weights make the penalty exact: slacks stay at zero while the limits can be held.

use crate::bicycle::Bicycle;
use crate::calibration::{Calibration, LmlCalibration};
use crate::dmpc::Course;
use crate::observation::Observation;
use crate::potential::{self, PositionCost};
use crate::prediction::{Gain, Instant, PLANNED, STEP_S, STEPS, WIDTH, block, predict};
use crate::qp::{BLOCKS, INPUTS, Qp, ROWS, SLACKS, VARIABLES};
use crate::single_mpc::Slot;
use crate::surroundings::{PositionLimits, Surroundings};

/// First row of the position limits: three per prediction step.
const POSITION_ROWS: usize = INPUTS;
/// First row of the lateral acceleration limits: two for every other step.
const ACCELERATION_ROWS: usize = POSITION_ROWS + 3 * STEPS;
/// Where the model's state holds ū, r, X and Y.
const SPEED: usize = 0;
const YAW: usize = 2;
const X: usize = 4;
const Y: usize = 5;

/// What one tick asks of the motion layer, beside the observation.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// Reference speed V_ref over the whole horizon \[m/s\].
    pub v_ref_mps: f64,
    /// Its weight Q_ref.
    pub q_ref: f64,
    /// The slot to keep, in the single-structure baseline alone.
    pub slot: Option<Slot>,
    /// The force to follow in place of the reference speed, in distributed MPC alone.
    pub course: Option<Course>,
    /// The plan to linearise about: force \[kN\] and steering \[deg\] of each block.
    pub plan: [[f64; 2]; BLOCKS],
    /// The command in force now, in the same units.
    pub applied: [f64; 2],
    /// Time over which the command may change before the next solve \[s\].
    pub interval_s: f64,
}

/// Builds the QP of one tick in an empty one.
pub fn build(
    cal: &Calibration,
    model: &Bicycle,
    surroundings: &Surroundings,
    seen: &Observation,
    request: &Request,
    qp: &mut Qp,
) {
    let ego = &seen.ego;
    let start =
        [ego.forward_mps, ego.lateral_mps, ego.yaw_radps, ego.heading_rad, ego.x_m, ego.y_m];
    let mut builder = Builder { cal: &cal.lml, request, normal: [[0.0; WIDTH]; INPUTS], qp };
    builder.input_cost();
    builder.slack_cost();
    builder.input_limits();
    builder.rate_limits();
    predict(model, &start, &request.plan, |k, instant| {
        let met = surroundings.meet(&cal.lml, instant.state[X], instant.state[Y], k);
        let mut cost = builder.tracking_cost(instant, seen.mission.desired_y_m);
        builder.slot_cost(k, instant, &mut cost);
        cost.position.add_scaled(cal.lml.q_obs, &met.potential);
        builder.edge_cost(instant, surroundings, &mut cost);
        builder.add(instant, &cost);
        builder.position_limits(k, instant, &met.limits);
        if k % 2 == 0 {
            builder.acceleration_limits(k / 2, instant);
        }
    });
    builder.finish();
}

/// The QP under construction; the Hessian's upper triangle only, until it is finished.
struct Builder<'a> {
    cal: &'a LmlCalibration,
    request: &'a Request,
    /// What the instants add: row i holds the Hessian from column i on, and the gradient's entry
    /// at [`PLANNED`]. Entries before column i, rounded down to even, are not kept.
    normal: [Gain; INPUTS],
    qp: &'a mut Qp,
}

/// What one instant costs, to second order in the changes of its speed and position.
#[derive(Debug, Clone, Copy, Default)]
struct InstantCost {
    /// Slope and curvature by speed.
    speed: (f64, f64),
    position: PositionCost,
}

impl Builder<'_> {
    /// S w² at every step, R (w_b - w_{b-1})² between blocks.
    ///
    /// The first block is compared with the command in force, and that change is weighted by the
    /// share of a prediction step until the next solve. With the whole R at every tick the command
    /// would cover the same fraction of its way per tick however short the tick: a lag that depends
    /// on the loop's rate. At one solve per prediction step this is Eq. 21 as printed.
    ///
    /// With a force to follow, both weigh the difference from it, and it replaces S: where nothing
    /// is in the way the force is then exactly the one asked for.
    fn input_cost(&mut self) {
        let share = (self.request.interval_s / STEP_S).clamp(0.0, 1.0);
        for (i, (&s, &r)) in self.cal.s.iter().zip(&self.cal.r).enumerate() {
            let course = self.request.course.filter(|_| i == 0);
            let s = course.map_or(s, |course| course.weight * self.request.q_ref);
            let wanted = course.map_or([0.0; BLOCKS], |course| course.force_kn);
            let mut before = course.map_or(0.0, |course| course.before_kn);
            for b in 0..BLOCKS {
                let r = if b == 0 { share * r } else { r };
                let steps = if b + 1 < BLOCKS { 1 } else { STEPS + 1 - BLOCKS };
                let at = 2 * b + i;
                let weight = 2.0 * s * steps as f64;
                let change = wanted[b] - before;
                before = wanted[b];
                self.qp.hessian[(at, at)] += weight + 2.0 * r;
                self.qp.gradient[at] -= weight * wanted[b] + 2.0 * r * change;
                if b == 0 {
                    self.qp.gradient[at] -= 2.0 * r * self.request.applied[i];
                } else {
                    self.qp.gradient[at - 2] += 2.0 * r * change;
                    self.qp.hessian[(at - 2, at - 2)] += 2.0 * r;
                    self.qp.hessian[(at - 2, at)] -= 2.0 * r;
                }
            }
        }
    }

    fn slack_cost(&mut self) {
        for i in 0..SLACKS {
            self.qp.hessian[(INPUTS + i, INPUTS + i)] = self.cal.slack_quadratic[i];
            self.qp.gradient[INPUTS + i] = self.cal.slack_linear[i];
            self.qp.lower[INPUTS + i] = 0.0;
        }
    }

    /// Q_Y and Q_ref terms of one predicted instant.
    fn tracking_cost(&self, instant: &Instant, desired_y_m: f64) -> InstantCost {
        let (by_y, by_speed) = (2.0 * self.cal.q_y, 2.0 * self.request.q_ref);
        let mut cost = InstantCost::default();
        cost.position.slope[1] = by_y * (instant.state[Y] - desired_y_m);
        cost.position.yy = by_y;
        if self.request.course.is_none() {
            cost.speed = (by_speed * (instant.state[SPEED] - self.request.v_ref_mps), by_speed);
        }
        cost
    }

    /// Q_X term of one predicted instant.
    fn slot_cost(&self, k: usize, instant: &Instant, cost: &mut InstantCost) {
        if let Some(slot) = self.request.slot {
            let error = instant.state[X] - (slot.x_m + slot.speed_mps * ahead_s(k));
            cost.position.slope[0] += 2.0 * slot.weight * error;
            cost.position.xx += 2.0 * slot.weight;
        }
    }

    /// Potentials of the road's edges at one predicted instant.
    fn edge_cost(&self, instant: &Instant, surroundings: &Surroundings, cost: &mut InstantCost) {
        let distances = surroundings.edge_distances(instant.state[Y]);
        for (distance, sign) in distances.into_iter().zip([1.0, -1.0]) {
            let (_, slope, curvature) = potential::road_edge(self.cal, distance);
            cost.position.slope[1] += sign * slope;
            cost.position.yy += curvature;
        }
    }

    /// Adds the cost of one instant: with q = G (w - w̄), `slope' q + q' W q / 2`.
    ///
    /// Its gradient in w is `G' (slope - W G w̄)`, its Hessian `G' W G`: with G w̄ beside G, one
    /// sum of outer products gives both.
    fn add(&mut self, instant: &Instant, cost: &InstantCost) {
        let (x, y, u) = (&instant.gain[X], &instant.gain[Y], &instant.gain[SPEED]);
        let at = &cost.position;
        let by_u = weighed(|j| cost.speed.1 * u[j], cost.speed.0);
        let by_y = weighed(|j| at.xy * x[j] + at.yy * y[j], at.slope[1]);
        // Without an obstacle near, the way along the road costs nothing.
        if at.xx == 0.0 && at.xy == 0.0 && at.slope[0] == 0.0 {
            self.add_products([(u, &by_u), (y, &by_y)]);
        } else {
            let by_x = weighed(|j| at.xx * x[j] + at.xy * y[j], at.slope[0]);
            self.add_products([(u, &by_u), (y, &by_y), (x, &by_x)]);
        }
    }

    /// Adds outer products, pairs of rows from their diagonal on.
    fn add_products<const N: usize>(&mut self, products: [(&Gain, &Gain); N]) {
        self.add_rows::<0, N>(&products);
        self.add_rows::<2, N>(&products);
        self.add_rows::<4, N>(&products);
        self.add_rows::<6, N>(&products);
        self.add_rows::<8, N>(&products);
    }

    #[inline(always)]
    fn add_rows<const ROW: usize, const N: usize>(&mut self, products: &[(&Gain, &Gain); N]) {
        for i in [ROW, ROW + 1] {
            for j in ROW..WIDTH {
                for (left, right) in products {
                    self.normal[i][j] += left[i] * right[j];
                }
            }
        }
    }

    /// Actuator ranges [MCF, Eq. 18].
    fn input_limits(&mut self) {
        let steering_deg = self.cal.steering_max_rad.to_degrees();
        for b in 0..BLOCKS {
            self.qp.lower[2 * b] = self.cal.force_min_kn;
            self.qp.upper[2 * b] = self.cal.force_max_kn;
            self.qp.lower[2 * b + 1] = -steering_deg;
            self.qp.upper[2 * b + 1] = steering_deg;
        }
    }

    /// Actuator rates: between blocks over a prediction step, to the first block over the interval
    /// until the next solve.
    fn rate_limits(&mut self) {
        let rates = [self.cal.force_rate_kn_per_s, self.cal.steering_rate_radps.to_degrees()];
        for b in 0..BLOCKS {
            for (i, rate) in rates.into_iter().enumerate() {
                let at = 2 * b + i;
                let (centre, reach) = if b == 0 {
                    (self.request.applied[i], rate * self.request.interval_s)
                } else {
                    self.qp.rows[(at, at - 2)] = -1.0;
                    (0.0, rate * STEP_S)
                };
                self.qp.rows[(at, at)] = 1.0;
                self.limit_row(at, centre - reach, centre + reach);
            }
        }
    }

    /// Lateral limits and the gap to what cannot be passed, each softened by its slack.
    fn position_limits(&mut self, k: usize, instant: &Instant, limits: &PositionLimits) {
        let (x, y) = (&instant.gain[X], &instant.gain[Y]);
        let row = POSITION_ROWS + 3 * k;
        for j in 0..INPUTS {
            self.qp.rows.as_mut_slice()[j * ROWS + row..][..3].copy_from_slice(&[y[j], y[j], x[j]]);
        }
        self.qp.rows[(row, INPUTS)] = -1.0;
        self.qp.rows[(row + 1, INPUTS)] = 1.0;
        self.qp.rows[(row + 2, INPUTS + 1)] = -1.0;
        // The part of a position that does not depend on the inputs.
        let y_m = instant.state[Y] - y[PLANNED];
        let x_m = instant.state[X] - x[PLANNED];
        self.limit_row(row, f64::NEG_INFINITY, limits.y_max_m - y_m);
        self.limit_row(row + 1, limits.y_min_m - y_m, f64::INFINITY);
        self.limit_row(row + 2, f64::NEG_INFINITY, limits.x_max_m - x_m);
    }

    /// |u r| <= aymax, linearised, softened by its slack.
    fn acceleration_limits(&mut self, pair: usize, instant: &Instant) {
        let (u, r) = (instant.state[SPEED], instant.state[YAW]);
        let (by_u, by_r) = (&instant.gain[SPEED], &instant.gain[YAW]);
        let mut gain = [0.0; WIDTH];
        for j in 0..WIDTH {
            gain[j] = u * by_r[j] + r * by_u[j];
        }
        let row = ACCELERATION_ROWS + 2 * pair;
        for j in 0..INPUTS {
            self.qp.rows.as_mut_slice()[j * ROWS + row..][..2].fill(gain[j]);
        }
        self.qp.rows[(row, INPUTS + 2)] = -1.0;
        self.qp.rows[(row + 1, INPUTS + 2)] = 1.0;
        let (limit, offset) = (self.cal.lateral_accel_max_mps2, u * r - gain[PLANNED]);
        self.limit_row(row, f64::NEG_INFINITY, limit - offset);
        self.limit_row(row + 1, -limit - offset, f64::INFINITY);
    }

    fn limit_row(&mut self, row: usize, lower: f64, upper: f64) {
        self.qp.lower[VARIABLES + row] = lower;
        self.qp.upper[VARIABLES + row] = upper;
    }

    /// Adds what the instants gave and completes the Hessian's lower triangle.
    fn finish(self) {
        for (i, row) in self.normal.iter().enumerate() {
            for j in i..INPUTS {
                self.qp.hessian[(i, j)] += row[j];
                self.qp.hessian[(j, i)] = self.qp.hessian[(i, j)];
            }
            self.qp.gradient[i] += row[PLANNED];
        }
    }
}

/// One row of W G, and at [`PLANNED`] of `slope - W G w̄`.
#[inline(always)]
fn weighed(entry: impl Fn(usize) -> f64, slope: f64) -> Gain {
    let mut row = [0.0; WIDTH];
    for j in 0..WIDTH {
        row[j] = entry(j);
    }
    row[PLANNED] = slope - row[PLANNED];
    row
}

/// Time of prediction step `k`, counted from zero, after now \[s\].
fn ahead_s(k: usize) -> f64 {
    (k + 1) as f64 * STEP_S
}

/// The plan `elapsed_s` later: blended towards its shift by one block, by the share of a prediction
/// step that has passed. Shifting by a whole block at every tick would run the plan at the loop's
/// rate instead of time's.
pub fn shifted(plan: &[[f64; 2]; BLOCKS], elapsed_s: f64) -> [[f64; 2]; BLOCKS] {
    let share = (elapsed_s / STEP_S).clamp(0.0, 1.0);
    core::array::from_fn(|b| {
        let next = plan[block(b + 1)];
        core::array::from_fn(|i| plan[b][i] + share * (next[i] - plan[b][i]))
    })
}

#[cfg(test)]
#[path = "lml/tests.rs"]
mod tests;
