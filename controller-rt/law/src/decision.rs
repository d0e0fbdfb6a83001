//! What the law answers at a tick: the command, and how it came about.

use nalgebra::Vector3;

use crate::dmpc::Plan;

/// The law's answer to one [`Observation`](crate::Observation).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// Total longitudinal tyre force F_xT \[N\], positive forward [MCF, Eq. 13].
    pub force_n: f64,
    /// Front-wheel steering angle δ \[rad\], positive to the left [MCF, Eq. 15].
    pub steering_rad: f64,
    /// Acceleration this truck intends, for its V2V broadcast \[m/s²\].
    pub intended_accel_mps2: f64,
    /// The plan to announce to the other trucks, in ticks that made one.
    pub announced: Option<Plan>,
    /// How the command was found.
    pub outcome: Outcome,
    /// The coordination layer's part.
    pub ucl: UclReport,
    /// The motion layer's part.
    pub lml: LmlReport,
}

/// How a command was found. Never an error: every tick has a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outcome {
    /// The QP of this tick was solved to optimality.
    Solved,
    /// Between two solves (`lml_every_ticks` > 1): the last solution's first block is held.
    Held,
    /// The QP needed more iterations than allowed: the previous plan, shifted, is used.
    IterationCap,
    /// The QP had no feasible point or was not finite: the previous plan, shifted, is used.
    #[default]
    Infeasible,
}

/// What the upper-level coordination layer saw and asked for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UclReport {
    /// Error state x_Hi = \[ŝ m, v̂ m/s, â m/s²\] against the leader [MCF, Eq. 2].
    pub x_own: Vector3<f64>,
    /// The predecessor's error state x_H(i-1), zero for truck 1 and when not known.
    pub x_predecessor: Vector3<f64>,
    /// Commanded acceleration u_i after clipping \[m/s²\] [MCF, Eq. 4].
    pub accel_mps2: f64,
    /// Reference speed V_ref handed to the motion layer \[m/s\].
    pub v_ref_mps: f64,
    /// Age of the leader's message \[s\]; NaN when there is none.
    pub leader_age_s: f64,
    /// Age of the predecessor's message \[s\]; NaN when there is none.
    pub predecessor_age_s: f64,
}

/// What the lower-level motion-planning layer did.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LmlReport {
    /// Sum of the obstacles' potentials at the truck's present position [MCF, Eq. 19].
    pub potential: f64,
    /// Adaptive weight Q_ref of the reference speed [MCF, Eq. 22].
    pub q_ref: f64,
    /// Slacks ε of lateral position \[m\], gap \[m\] and lateral acceleration \[m/s²\].
    pub slack: [f64; 3],
    /// The solver's account.
    pub qp: QpReport,
}

/// A QP solver's account of one solve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct QpReport {
    /// Iterations used.
    pub iterations: u32,
    /// Constraints that entered or left the working set.
    pub changes: u32,
    /// Active constraints: bit i for bound i (0..13), then for row i - 13.
    pub working_set: u128,
    /// Largest scaled KKT residual of the returned point, dimensionless.
    pub kkt_residual: f64,
}
