//! The optimal control problem of one vehicle and one instant, after \[Zheng\].
//!
//! ```text
//! minimise over u_0 .. u_19
//!   sum_k  |y_k - y_des,k|²_Q + |u_k - h(v_k)|²_R + |y_k - y_own,k|²_F + |y_k - y_nb,k|²_G
//! subject to  the model,  u_min <= u_k <= u_max,
//!   x_20 and v_20 = those asked for,  a_20 = h(v_20)
//! ```
//!
//! with y = (position, speed). The model is nonlinear in its drag alone, so the problem is
//! linearised once about the last plan's inputs (the real-time iteration of Diehl, Bock & Schlöder,
//! SIAM J. Control Optim. 43(5), 2005); on the paper's platoon converged solutions change no
//! spacing error by more than 0.1 mm. The equality at the end is a quadratic penalty, stiff enough
//! to hold within a millimetre where it can be met, so that there is a command where it cannot.

use nalgebra::{SMatrix, SVector};

use super::bounded::{self, Minimum};
use super::drive::{Drive, State};
use super::plan::{POINTS, Plan};
use super::{DmpcCalibration, STEPS};

/// Weight of a terminal error against that of an input of 1 m/s² \[1/m², s²/m², s⁴/m²\].
const TERMINAL_WEIGHT: f64 = 1e6;

type Vector = SVector<f64, STEPS>;

/// Weights per unit of squared input acceleration: \[position 1/s⁴, speed 1/s²\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Q: against the leader.
    pub leader: [f64; 2],
    /// F: against the vehicle's own last plan.
    pub own: [f64; 2],
    /// G: against the neighbour's.
    pub neighbour: [f64; 2],
}

impl Weights {
    /// The calibration's, which weigh torques, for a vehicle of `mass_kg`.
    pub fn new(cal: &DmpcCalibration, mass_kg: f64) -> Self {
        let torque_per_accel = mass_kg * cal.wheel_radius_m / cal.efficiency;
        let unit = cal.input_weight * torque_per_accel * torque_per_accel;
        let scaled = |weight: [f64; 2]| weight.map(|w| w / unit);
        Self {
            leader: scaled(cal.leader_weight),
            own: scaled(cal.own_weight),
            neighbour: scaled(cal.neighbour_weight),
        }
    }
}

/// What the end of the horizon has to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terminal {
    /// Position \[m\]; `None` when only the speed matters.
    pub x_m: Option<f64>,
    /// Speed \[m/s\], from then on steady.
    pub speed_mps: f64,
}

/// One problem.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The vehicle.
    pub drive: &'a Drive,
    /// Least and largest input \[m/s²\].
    pub input_limits_mps2: [f64; 2],
    /// Q, F and G.
    pub weights: &'a Weights,
    /// Where the vehicle is, and when \[ns\].
    pub start: State,
    /// See `start`.
    pub start_ns: u64,
    /// Inputs to linearise about \[m/s²\].
    pub inputs: [f64; STEPS],
    /// The slot behind the leader, when the leader is heard.
    pub leader: Option<Plan>,
    /// The vehicle's own last plan, shifted.
    pub own: Plan,
    /// The slot behind the neighbour, when there is one.
    pub neighbour: Option<Plan>,
    /// The horizon's end.
    pub terminal: Terminal,
}

/// A solved problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solved {
    /// The inputs \[m/s²\].
    pub inputs: [f64; STEPS],
    /// Where they lead, by the nonlinear model.
    pub plan: Plan,
    /// State at the end.
    pub end: State,
    /// Iterations of the solver.
    pub iterations: u32,
}

/// A predicted state, and its derivatives by every input.
#[derive(Debug, Clone, Copy)]
struct Instant {
    state: State,
    gain: [Vector; 3],
}

impl Problem<'_> {
    /// Solves it; `None` when the numbers allow no solution.
    pub fn solve(&self) -> Option<Solved> {
        let instants = self.predict();
        let mut cost = Quadratic { hessian: SMatrix::zeros(), gradient: Vector::zeros() };
        let weights = self.weights;
        let trackings = [
            (self.leader.as_ref(), weights.leader),
            (Some(&self.own), weights.own),
            (self.neighbour.as_ref(), weights.neighbour),
        ];
        for (k, instant) in instants[..STEPS].iter().enumerate() {
            for (plan, weight) in trackings {
                let Some(plan) = plan else { continue };
                let wanted = [plan.x_m[k], plan.speed_mps[k]];
                for i in 0..2 {
                    cost.add(&instant.gain[i], weight[i], instant.state[i] - wanted[i]);
                }
            }
            let (hold, hold_v) = self.drive.holding(instant.state[1]);
            let mut row = instant.gain[1] * -hold_v;
            row[k] += 1.0;
            cost.add(&row, 1.0, self.inputs[k] - hold);
        }
        self.terminal_cost(&instants[STEPS], &mut cost);
        let now = Vector::from(self.inputs);
        let [least, most] = self.input_limits_mps2.map(Vector::repeat);
        let Minimum { z, iterations } =
            bounded::minimise(&cost.hessian, &cost.gradient, &(least - now), &(most - now))?;
        Some(self.rolled_out((now + z).into(), iterations))
    }

    /// The plan that given inputs make.
    pub fn rolled_out(&self, inputs: [f64; STEPS], iterations: u32) -> Solved {
        let mut plan = Plan {
            start_ns: self.start_ns,
            x_m: [self.start[0]; POINTS],
            speed_mps: [self.start[1]; POINTS],
        };
        let mut end = self.start;
        for (k, &u) in inputs.iter().enumerate() {
            end = self.drive.advance(&end, u).state;
            (plan.x_m[k + 1], plan.speed_mps[k + 1]) = (end[0], end[1]);
        }
        Solved { inputs, plan, end, iterations }
    }

    fn predict(&self) -> [Instant; POINTS] {
        let mut last = Instant { state: self.start, gain: [Vector::zeros(); 3] };
        let mut instants = [last; POINTS];
        for (k, &u) in self.inputs.iter().enumerate() {
            let step = self.drive.advance(&last.state, u);
            let mut gain = [Vector::zeros(); 3];
            for (row, by_state) in gain.iter_mut().zip(&step.by_state) {
                for (by, of_state) in by_state.iter().zip(&last.gain) {
                    *row += of_state * *by;
                }
            }
            for (row, by_input) in gain.iter_mut().zip(self.drive.by_input()) {
                row[k] += by_input;
            }
            last = Instant { state: step.state, gain };
            instants[k + 1] = last;
        }
        instants
    }

    fn terminal_cost(&self, end: &Instant, cost: &mut Quadratic) {
        let Terminal { x_m, speed_mps } = self.terminal;
        if let Some(x_m) = x_m {
            cost.add(&end.gain[0], TERMINAL_WEIGHT, end.state[0] - x_m);
        }
        cost.add(&end.gain[1], TERMINAL_WEIGHT, end.state[1] - speed_mps);
        let steady = self.drive.holding(speed_mps).0;
        cost.add(&end.gain[2], TERMINAL_WEIGHT, end.state[2] - steady);
    }
}

/// 1/2 z' H z + g' z under construction.
struct Quadratic {
    hessian: SMatrix<f64, STEPS, STEPS>,
    gradient: Vector,
}

impl Quadratic {
    /// Adds `weight/2 (error + row' z)²`.
    fn add(&mut self, row: &Vector, weight: f64, error: f64) {
        self.hessian.ger(weight, row, row, 1.0);
        self.gradient.axpy(weight * error, row, 1.0);
    }
}
