//! Unknowns, inequalities, objective, and their way into Clarabel and back.
//!
//! Clarabel minimises qᵀx subject to A x + s = b, s in a product of cones. A symmetric matrix of
//! order n enters its cone as the n (n + 1) / 2 entries of its upper triangle, column by column,
//! those off the diagonal times √2, so that the cone's inner product is the trace.

use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;
use std::panic::{AssertUnwindSafe, catch_unwind};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, PSDTriangleConeT, SolverStatus, SupportedConeT,
};
use nalgebra::DMatrix;

use super::affine::{Affine, Blocks};

/// Interior-point iterations allowed; the programs of this crate need 10 to 40.
const ITERATIONS_MAX: u32 = 150;

/// Why a program has no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unsolved {
    /// No numbers satisfy the inequalities.
    #[error("the matrix inequalities have no solution")]
    Infeasible,
    /// The solver got nowhere; near the boundary of feasibility this is its usual end.
    #[error("the solver made no progress on the matrix inequalities")]
    NoProgress,
}

/// A semidefinite program.
#[derive(Debug, Clone, Default)]
pub struct Program {
    variables: usize,
    orders: Vec<usize>,
    /// (row, variable, value) of A.
    entries: Vec<(usize, usize, f64)>,
    limits: Vec<f64>,
    objective: BTreeMap<usize, f64>,
}

/// What a solver found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    values: Vec<f64>,
    /// Interior-point iterations.
    pub iterations: u32,
    /// Whether the solver itself is content; no proof, and its absence no refutation.
    pub is_clean: bool,
}

impl Program {
    /// Without unknowns and inequalities.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Unknowns so far.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.variables
    }

    fn unknown(&mut self) -> usize {
        self.variables += 1;
        self.variables - 1
    }

    /// An unknown matrix.
    pub fn matrix(&mut self, rows: usize, columns: usize) -> Affine {
        let mut unknown = Affine::zeros(rows, columns);
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let mut unit = DMatrix::zeros(rows, columns);
            unit[(i, j)] = 1.0;
            unknown.terms.insert(self.unknown(), unit);
        }
        unknown
    }

    /// An unknown number, as a 1 x 1 matrix.
    pub fn scalar(&mut self) -> Affine {
        self.matrix(1, 1)
    }

    /// An unknown symmetric matrix.
    pub fn symmetric(&mut self, order: usize) -> Affine {
        let mut unknown = Affine::zeros(order, order);
        for (i, j) in (0..order).flat_map(|j| (0..=j).map(move |i| (i, j))) {
            let mut unit = DMatrix::zeros(order, order);
            (unit[(i, j)], unit[(j, i)]) = (1.0, 1.0);
            unknown.terms.insert(self.unknown(), unit);
        }
        unknown
    }

    /// Requires that the matrix minus `margin` times identity is positive semidefinite.
    pub fn require_positive(&mut self, matrix: &Blocks, margin: f64) {
        self.require(matrix, 1.0, margin);
    }

    /// Requires that the matrix plus `margin` times identity is negative semidefinite.
    pub fn require_negative(&mut self, matrix: &Blocks, margin: f64) {
        self.require(matrix, -1.0, margin);
    }

    fn require(&mut self, matrix: &Blocks, sign: f64, margin: f64) {
        let (order, first) = (matrix.order(), self.limits.len());
        self.limits.resize(first + order * (order + 1) / 2, 0.0);
        for (top, left, block) in &matrix.entries {
            // s = b - A x is the matrix itself: A has its terms with the opposite sign.
            for_upper(*top, *left, &block.constant, |row, entry| {
                self.limits[first + row] += sign * entry;
            });
            for (variable, term) in &block.terms {
                for_upper(*top, *left, term, |row, entry| {
                    self.entries.push((first + row, *variable, -sign * entry));
                });
            }
        }
        for i in 0..order {
            self.limits[first + svec_row(i, i)] -= margin;
        }
        self.orders.push(order);
    }

    /// Makes the trace of this expression as small as possible.
    pub fn minimise(&mut self, expression: &Affine) {
        let terms = expression.terms.iter();
        self.objective = terms.map(|(variable, matrix)| (*variable, matrix.trace())).collect();
    }

    /// Solves it.
    ///
    /// # Errors
    /// When there is no solution, or none was found.
    pub fn solve(&self) -> Result<Solution, Unsolved> {
        // Clarabel unwraps inside; nothing of ours is left half changed if it ever panics.
        catch_unwind(AssertUnwindSafe(|| self.solve_unguarded()))
            .unwrap_or(Err(Unsolved::NoProgress))
    }

    fn solve_unguarded(&self) -> Result<Solution, Unsolved> {
        let no_quadratic = CscMatrix::zeros((self.variables, self.variables));
        let mut objective = vec![0.0; self.variables];
        for (variable, factor) in &self.objective {
            objective[*variable] = *factor;
        }
        let rows = self.entries.iter().map(|entry| entry.0).collect();
        let columns = self.entries.iter().map(|entry| entry.1).collect();
        let values = self.entries.iter().map(|entry| entry.2).collect();
        let matrix =
            CscMatrix::new_from_triplets(self.limits.len(), self.variables, rows, columns, values);
        let cones: Vec<SupportedConeT<f64>> =
            self.orders.iter().map(|order| PSDTriangleConeT(*order)).collect();
        let solver = DefaultSolver::new(
            &no_quadratic,
            &objective,
            &matrix,
            &self.limits,
            &cones,
            settings(),
        );
        let mut solver = solver.map_err(|_| Unsolved::NoProgress)?;
        solver.solve();
        let found = &solver.solution;
        match found.status {
            SolverStatus::PrimalInfeasible
            | SolverStatus::AlmostPrimalInfeasible
            | SolverStatus::DualInfeasible
            | SolverStatus::AlmostDualInfeasible => Err(Unsolved::Infeasible),
            _ if found.x.iter().any(|x| !x.is_finite()) => Err(Unsolved::NoProgress),
            status => Ok(Solution {
                values: found.x.clone(),
                iterations: found.iterations,
                is_clean: status == SolverStatus::Solved,
            }),
        }
    }
}

impl Solution {
    /// The value of an expression of the program.
    #[must_use]
    pub fn value(&self, expression: &Affine) -> DMatrix<f64> {
        expression.terms.iter().fold(expression.constant.clone(), |sum, (variable, matrix)| {
            sum + matrix * self.values[*variable]
        })
    }

    /// The value of a 1 x 1 expression.
    #[must_use]
    pub fn number(&self, expression: &Affine) -> f64 {
        self.value(expression)[(0, 0)]
    }
}

/// Row of entry (`i`, `j`), `i <= j`, among those of the upper triangle column by column.
const fn svec_row(i: usize, j: usize) -> usize {
    j * (j + 1) / 2 + i
}

/// Calls with row and scaled value for the entries of a block that are above the diagonal or on it.
fn for_upper(top: usize, left: usize, block: &DMatrix<f64>, mut call: impl FnMut(usize, f64)) {
    for (j, column) in block.column_iter().enumerate() {
        for (i, entry) in column.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
            let (row, column) = (top + i, left + j);
            if row <= column {
                let scale = if row == column { 1.0 } else { SQRT_2 };
                call(svec_row(row, column), scale * entry);
            }
        }
    }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: ITERATIONS_MAX,
        // No time limit: a wall clock in a solver makes its answers unrepeatable.
        time_limit: f64::INFINITY,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        ..DefaultSettings::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest t with t I - M positive semidefinite is M's largest eigenvalue.
    #[test]
    fn the_largest_eigenvalue_is_found() {
        let m = DMatrix::from_fn(5, 5, |i, j| 1.0 / (1 + i + j) as f64);
        let mut program = Program::new();
        let t = program.scalar();
        let gap = &t.times(&DMatrix::identity(5, 5)) - &Affine::constant(m.clone());
        program.require_positive(&Blocks::one(gap), 0.0);
        program.minimise(&t);
        let solution = program.solve().expect("feasible");
        let largest = m.symmetric_eigenvalues().max();
        assert!((solution.number(&t) - largest).abs() < 1e-7, "{}", solution.number(&t));
    }

    /// Lyapunov's inequality for a stable matrix has a solution, for an unstable one none.
    #[test]
    fn lyapunov_tells_stable_from_unstable() {
        let lyapunov = |a: DMatrix<f64>| {
            let mut program = Program::new();
            let p = program.symmetric(2);
            program.require_positive(&Blocks::one(p.clone()), 1.0);
            program.require_negative(&Blocks::one(p.right(&a).plus_transpose()), 1.0);
            program.minimise(&p);
            program.solve().map(|solution| (solution.value(&p), a))
        };
        let (p, a) = lyapunov(DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -2.0, -1.0]))
            .expect("a damped oscillator is stable");
        let decay = &p * &a + (&p * &a).transpose();
        assert!(decay.symmetric_eigenvalues().max() < -0.99);
        assert!(p.symmetric_eigenvalues().min() > 0.99);
        let unstable = lyapunov(DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -2.0, 0.1]));
        assert_eq!(unstable.map(drop), Err(Unsolved::Infeasible));
    }

    /// Blocks off the diagonal count once, whichever side of √2 they are on: the Schur complement
    /// of [t, bᵀ; b, A] is t - bᵀ A⁻¹ b.
    #[test]
    fn a_schur_complement_has_its_value() {
        let a = DMatrix::from_row_slice(3, 3, &[2.0, 0.5, 0.0, 0.5, 3.0, 0.1, 0.0, 0.1, 1.0]);
        let b = DMatrix::from_row_slice(1, 3, &[1.0, -2.0, 0.5]);
        let mut program = Program::new();
        let t = program.scalar();
        let matrix = Blocks::new(&[1, 3])
            .with(0, 0, t.clone())
            .with(0, 1, Affine::constant(b.clone()))
            .with(1, 1, Affine::constant(a.clone()));
        program.require_positive(&matrix, 0.0);
        program.minimise(&t);
        let found = program.solve().expect("feasible").number(&t);
        let wanted = (&b * a.try_inverse().expect("positive") * b.transpose())[(0, 0)];
        assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
    }
}
