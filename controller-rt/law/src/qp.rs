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
mod excess;
mod factors;
mod kkt;
mod row;
mod search;

pub use active_set::ActiveSet;
pub use kkt::kkt_residual;
pub use search::ITERATIONS_MAX;

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
    #[inline(always)]
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

    #[inline(always)]
    fn limit(&self, active: Active) -> f64 {
        let side = if active.upper { &self.upper } else { &self.lower };
        side[usize::from(active.constraint)]
    }

    #[inline(always)]
    fn gradient_row(&self) -> Row {
        Row::of(self.gradient.as_slice())
    }

    /// `H z + g`.
    #[inline(always)]
    fn slope(&self, z: &Row) -> Row {
        let mut slope = self.gradient_row();
        // Symmetric: a column is a row.
        for (column, &z) in self.hessian.as_slice().chunks_exact(VARIABLES).zip(&z.0) {
            slope.add_scaled(z, &Row::of(column));
        }
        slope
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
        Self::NATURAL
    }

    /// [`bits`](Self::bits) of the natural guess.
    const NATURAL_BITS: u128 = ((1 << SLACKS) - 1) << INPUTS;
    const NATURAL: Self = {
        let mut members = [None; VARIABLES];
        let mut slack = 0;
        while slack < SLACKS {
            members[slack] = Some(Active { constraint: (INPUTS + slack) as u8, upper: false });
            slack += 1;
        }
        Self { members }
    };

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
        self.bits() == Self::NATURAL_BITS && self.iter().all(|active| !active.upper)
    }

    /// Whether every slack's bound is in it.
    fn has_slacks(&self) -> bool {
        let natural = Self::natural();
        natural.iter().all(|slack| self.iter().any(|active| active == slack))
    }

    /// The members, in order.
    pub fn iter(&self) -> impl Iterator<Item = Active> {
        self.members.into_iter().flatten()
    }

    /// One bit per active constraint.
    pub fn bits(&self) -> u128 {
        let mut bits = 0;
        for active in self.members.iter().flatten() {
            bits |= 1 << active.constraint;
        }
        bits
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
