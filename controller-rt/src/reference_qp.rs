//! The reference solver: Clarabel, an interior-point method by other authors.
//!
//! It exists to check the law's own solver and to be chosen with `--solver clarabel`. It allocates,
//! takes several times as long, and has no warm start; a loop with deadlines uses the other one.
//!
//! Every QP is set up afresh. Clarabel can update a solver in place, but then keeps the scaling of
//! the first problem: the last bits would depend on what was solved before, and a replay from a
//! snapshot would not repeat them.

use std::panic::{AssertUnwindSafe, catch_unwind};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT,
    ZeroConeT,
};
use law::QpReport;
use law::qp::{
    Active, CONSTRAINTS, Qp, QpSolver, Solution, SolveStatus, VARIABLES, WorkingSet, kkt_residual,
};

/// Tolerance on gap and feasibility, relative and absolute. Solutions agree to about 1e-7.
const TOLERANCE: f64 = 1e-11;
/// A point Clarabel could not improve further is still a solution below this KKT residual.
const RESIDUAL_ACCEPTED: f64 = 1e-7;
/// Iterations allowed; recorded QPs need 10 to 25.
const ITERATIONS_MAX: u32 = 60;
/// Larger data than this is refused: it makes no physical sense, and its squares could overflow.
const MAGNITUDE_MAX: f64 = 1e12;
/// Limits closer than this are one equality: an interior-point method needs an interior.
const EQUALITY_WIDTH: f64 = 1e-12;

/// Solves with Clarabel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Clarabel;

impl QpSolver for Clarabel {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        if !is_sound(qp) {
            return unsolved(SolveStatus::Infeasible, 0);
        }
        // Clarabel unwraps inside; nothing of ours is left half changed if it ever panics.
        catch_unwind(AssertUnwindSafe(|| solve(qp, warm)))
            .unwrap_or_else(|_| unsolved(SolveStatus::Infeasible, 0))
    }
}

/// Finite, of sensible size, with limits in order, and strictly convex.
fn is_sound(qp: &Qp) -> bool {
    let sensible = |x: &f64| x.abs() <= MAGNITUDE_MAX;
    qp.hessian.iter().chain(qp.gradient.iter()).chain(qp.rows.iter()).all(sensible)
        && qp.lower.iter().zip(&qp.upper).all(|(lower, upper)| {
            lower <= upper && *lower <= MAGNITUDE_MAX && *upper >= -MAGNITUDE_MAX
        })
        && qp.hessian.cholesky().is_some()
}

/// One row of Clarabel's `A x + s = b`: side +1 for an upper limit, -1 for a lower one.
#[derive(Debug, Clone, Copy)]
struct Row {
    constraint: usize,
    side: f64,
    limit: f64,
}

fn solve(qp: &Qp, warm: &mut WorkingSet) -> Solution {
    let (rows, equalities) = rows(qp);
    let limits: Vec<f64> = rows.iter().map(|row| row.side * row.limit).collect();
    let cones: [SupportedConeT<f64>; 2] =
        [ZeroConeT(equalities), NonnegativeConeT(rows.len() - equalities)];
    let (hessian, matrix) = (upper_triangle(qp), constraint_matrix(qp, &rows));
    let solver =
        DefaultSolver::new(&hessian, qp.gradient.as_slice(), &matrix, &limits, &cones, settings());
    let Ok(mut solver) = solver else {
        return unsolved(SolveStatus::Infeasible, 0);
    };
    solver.solve();

    let found = &solver.solution;
    let mut multipliers = [0.0; CONSTRAINTS];
    for (row, dual) in rows.iter().zip(&found.z) {
        multipliers[row.constraint] -= row.side * dual;
    }
    let mut z = qp.gradient;
    z.copy_from_slice(&found.x);
    let kkt_residual = kkt_residual(qp, &z, &multipliers);
    let status = status(found.status, kkt_residual);
    if status != SolveStatus::Solved {
        return unsolved(status, found.iterations);
    }
    let products = qp.rows * z;
    let value = |i: usize| {
        if i < VARIABLES { z[i] } else { products[i - VARIABLES] }
    };
    let active = active(qp, value, &multipliers);
    let bits = active.iter().fold(0, |bits, active| bits | 1_u128 << active.constraint);
    *warm = WorkingSet::of(active);
    let report =
        QpReport { iterations: found.iterations, changes: 0, working_set: bits, kkt_residual };
    Solution { status, z, report }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: ITERATIONS_MAX,
        // Presolve would drop rows by their limits' size; ours are chosen already.
        presolve_enable: false,
        // No time limit: a wall clock in a solver makes its answers unrepeatable.
        time_limit: f64::INFINITY,
        tol_gap_abs: TOLERANCE,
        tol_gap_rel: TOLERANCE,
        tol_feas: TOLERANCE,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        ..DefaultSettings::default()
    }
}

fn status(status: SolverStatus, kkt_residual: f64) -> SolveStatus {
    use SolverStatus as Clarabel;
    match status {
        Clarabel::Solved => SolveStatus::Solved,
        Clarabel::AlmostSolved | Clarabel::InsufficientProgress | Clarabel::MaxIterations
            if kkt_residual <= RESIDUAL_ACCEPTED =>
        {
            SolveStatus::Solved
        }
        Clarabel::AlmostSolved
        | Clarabel::InsufficientProgress
        | Clarabel::MaxIterations
        | Clarabel::MaxTime
        | Clarabel::CallbackTerminated
        | Clarabel::Unsolved => SolveStatus::IterationCap,
        Clarabel::PrimalInfeasible
        | Clarabel::DualInfeasible
        | Clarabel::AlmostPrimalInfeasible
        | Clarabel::AlmostDualInfeasible
        | Clarabel::NumericalError => SolveStatus::Infeasible,
    }
}

/// The rows with finite limits, equalities first, and how many of those there are.
fn rows(qp: &Qp) -> (Vec<Row>, usize) {
    let mut rows = Vec::with_capacity(2 * CONSTRAINTS);
    let is_equality = |i: usize| qp.upper[i] - qp.lower[i] <= EQUALITY_WIDTH;
    for constraint in (0..CONSTRAINTS).filter(|&i| is_equality(i)) {
        rows.push(Row { constraint, side: 1.0, limit: qp.upper[constraint] });
    }
    let equalities = rows.len();
    for constraint in (0..CONSTRAINTS).filter(|&i| !is_equality(i)) {
        for (side, limit) in [(1.0, qp.upper[constraint]), (-1.0, qp.lower[constraint])] {
            if limit.abs() <= MAGNITUDE_MAX {
                rows.push(Row { constraint, side, limit });
            }
        }
    }
    (rows, equalities)
}

fn upper_triangle(qp: &Qp) -> CscMatrix<f64> {
    columns(VARIABLES, |i, j| if i <= j { qp.hessian[(i, j)] } else { 0.0 })
}

fn constraint_matrix(qp: &Qp, rows: &[Row]) -> CscMatrix<f64> {
    columns(rows.len(), |i, j| {
        let Row { constraint, side, .. } = rows[i];
        match constraint.checked_sub(VARIABLES) {
            Some(row) => side * qp.rows[(row, j)],
            None if constraint == j => side,
            None => 0.0,
        }
    })
}

/// A matrix with one column per variable, from its entries; zeros are left out.
fn columns(height: usize, entry: impl Fn(usize, usize) -> f64) -> CscMatrix<f64> {
    let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..VARIABLES {
        for (i, value) in (0..height).map(|i| (i, entry(i, j))) {
            if value != 0.0 {
                places.push(i);
                values.push(value);
            }
        }
        starts.push(values.len());
    }
    CscMatrix::new(height, VARIABLES, starts, places, values)
}

/// Constraints whose multiplier outweighs the room left, strongest first.
fn active(qp: &Qp, value: impl Fn(usize) -> f64, multipliers: &[f64; CONSTRAINTS]) -> Vec<Active> {
    let holds = |&i: &usize| {
        let m = multipliers[i];
        let room = if m > 0.0 { value(i) - qp.lower[i] } else { qp.upper[i] - value(i) };
        m != 0.0 && m.abs() > room
    };
    let mut active: Vec<usize> = (0..CONSTRAINTS).filter(holds).collect();
    active.sort_by(|&i, &j| multipliers[j].abs().total_cmp(&multipliers[i].abs()));
    let side = |i: usize| Active { constraint: i as u8, upper: multipliers[i] < 0.0 };
    active.into_iter().map(side).collect()
}

fn unsolved(status: SolveStatus, iterations: u32) -> Solution {
    let report = QpReport { iterations, kkt_residual: f64::INFINITY, ..QpReport::default() };
    Solution { status, z: Qp::empty().gradient, report }
}
