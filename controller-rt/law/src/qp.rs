//! The motion layer's quadratic program, and the solvers' common interface.
//!
//! ```text
//! minimise   1/2 z' H z + g' z
//! subject to lower <= [ z ; A z ] <= upper
//! z = [F0, d0, ..., F4, d4, epsY, epsX, epsA]     kN, degrees, m, m, m/s^2
//! ```
//!
//! `H` is positive definite, so the solution is unique; the slacks make the set non-empty as long
//! as the inputs' bounds and rate limits agree.

mod active_set;
mod factors;
mod kkt;
mod row;

pub use active_set::{ActiveSet, ITERATIONS_MAX};
pub use kkt::kkt_residual;

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::decision::QpReport;
use row::Row;

/// Control blocks N_c [MCF, Table II].
pub const BLOCKS: usize = 5;
/// Inputs per block: force and steering.
pub const INPUTS: usize = 2 * BLOCKS;
/// Slacks: lateral position, gap, lateral acceleration.
pub const SLACKS: usize = 3;
/// Variables of the QP.
pub const VARIABLES: usize = INPUTS + SLACKS;
/// General rows: 10 input changes, 25 x 3 positions, 13 x 2 lateral accelerations.
pub const ROWS: usize = 111;
/// Two-sided constraints: one bound per variable, then the rows.
pub const CONSTRAINTS: usize = VARIABLES + ROWS;

/// One dense convex QP of the motion layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Qp {
    /// Hessian H, symmetric positive definite.
    pub hessian: SMatrix<f64, VARIABLES, VARIABLES>,
    /// Gradient g.
    pub gradient: SVector<f64, VARIABLES>,
    /// General rows A.
    pub rows: SMatrix<f64, ROWS, VARIABLES>,
    /// Lower limits, bounds first; minus infinity where there is none.
    pub lower: [f64; CONSTRAINTS],
    /// Upper limits, bounds first; infinity where there is none.
    pub upper: [f64; CONSTRAINTS],
}

impl Qp {
    /// A QP with zero cost and no limits, to be filled in.
    #[inline(always)]
    pub fn empty() -> Self {
        Self {
            hessian: SMatrix::zeros(),
            gradient: SVector::zeros(),
            rows: SMatrix::zeros(),
            lower: [f64::NEG_INFINITY; CONSTRAINTS],
            upper: [f64::INFINITY; CONSTRAINTS],
        }
    }

    /// The normal of constraint `i`: a unit vector for a bound, a row of A otherwise.
    fn normal(&self, i: usize) -> Row {
        let mut normal = Row::ZERO;
        if i < VARIABLES {
            normal.0[i] = 1.0;
        } else {
            for j in 0..VARIABLES {
                normal.0[j] = self.rows[(i - VARIABLES, j)];
            }
        }
        normal
    }

    fn gradient_row(&self) -> Row {
        Row::of(self.gradient.as_slice())
    }

    /// `H z + g`.
    fn slope(&self, z: &Row) -> Row {
        let mut slope = self.gradient_row();
        // Symmetric: a column is a row.
        for (column, &z) in self.hessian.as_slice().chunks_exact(VARIABLES).zip(&z.0) {
            slope.add_scaled(z, &Row::of(column));
        }
        slope
    }

    /// All constrained quantities at `z`: the variables, then A z.
    fn values(&self, z: &Row) -> [f64; CONSTRAINTS] {
        /// Rows worked on at once.
        const AT_ONCE: usize = 16;
        let mut values = [0.0; CONSTRAINTS];
        values[..VARIABLES].copy_from_slice(&z.0[..VARIABLES]);
        let rows = &mut values[VARIABLES..];
        let columns = self.rows.as_slice();
        let mut from = 0;
        while from < ROWS {
            // The last ones overlap with those before.
            from = from.min(ROWS - AT_ONCE);
            let mut sums = [0.0; AT_ONCE];
            for (column, &z_j) in columns.chunks_exact(ROWS).zip(&z.0) {
                // The slacks are zero nearly always.
                if z_j != 0.0 {
                    for (sum, a) in sums.iter_mut().zip(&column[from..from + AT_ONCE]) {
                        *sum += a * z_j;
                    }
                }
            }
            rows[from..from + AT_ONCE].copy_from_slice(&sums);
            from += AT_ONCE;
        }
        values
    }
}

/// A limit of a constraint that holds with equality.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Active {
    /// Which constraint: bounds first, then rows.
    pub constraint: u8,
    /// Whether its upper limit is meant.
    pub upper: bool,
}

/// The constraints a solver believes active, in the order they entered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WorkingSet {
    members: [Option<Active>; VARIABLES],
}

impl WorkingSet {
    /// The natural guess without history: every slack at zero, no input limited.
    pub fn natural() -> Self {
        let mut set = Self::default();
        for (member, slack) in set.members.iter_mut().zip(INPUTS..VARIABLES) {
            *member = Some(Active { constraint: slack as u8, upper: false });
        }
        set
    }

    /// A set of the given members; those beyond the number of variables are left out.
    pub fn of(active: impl IntoIterator<Item = Active>) -> Self {
        let mut set = Self::default();
        for (member, active) in set.members.iter_mut().zip(active) {
            *member = Some(active);
        }
        set
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.members[0].is_none()
    }

    /// Whether it is the natural guess, in whatever order.
    fn is_natural(&self) -> bool {
        self.bits() == Self::natural().bits() && self.iter().all(|active| !active.upper)
    }

    /// The members, in order.
    pub fn iter(&self) -> impl Iterator<Item = Active> {
        self.members.into_iter().flatten()
    }

    /// One bit per active constraint.
    pub fn bits(&self) -> u128 {
        self.iter().fold(0, |bits, active| bits | 1 << active.constraint)
    }
}

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveStatus {
    /// The solution, to the solver's tolerance.
    Solved,
    /// Stopped at the iteration limit; the point is not feasible.
    IterationCap,
    /// No feasible point, an indefinite Hessian, or data that is not finite.
    Infeasible,
}

/// What a solver returns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// How the solve ended; the point is to be used only when solved.
    pub status: SolveStatus,
    /// The minimiser.
    pub z: SVector<f64, VARIABLES>,
    /// The solver's account.
    pub report: QpReport,
}

/// A method that solves [`Qp`]s.
///
/// `warm` holds the working set of the previous solve on entry and of this one on return; methods
/// without warm start ignore it on entry.
pub trait QpSolver {
    /// Solves one QP. Never panics; what went wrong is in the status.
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution;
}
