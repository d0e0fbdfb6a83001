//! The real-time QP solver: a dense dual active-set method.
//!
//! D. Goldfarb and A. Idnani, *A numerically stable dual method for solving strictly convex
//! quadratic programs*, Mathematical Programming 27 (1983), with three additions: two-sided
//! limits, a start from any guessed working set, and one step of refinement at the end.
//!
//! The method keeps a point that is optimal for the constraints in its working set and adds the
//! most violated one until none is left. The dual objective grows with every full step, so no
//! working set comes back, degenerate or not. Work per iteration is bounded, nothing is allocated,
//! ties are broken by index: equal problems give equal bits.

use nalgebra::{SMatrix, SVector};

use super::{
    Active, CONSTRAINTS, Qp, QpSolver, Solution, SolveStatus, VARIABLES, WorkingSet, kkt_residual,
};
use crate::decision::QpReport;

/// Most iterations of one solve. The recorded problems of the paper's hardest scenario need 13 at
/// the most from a cold start; at this limit the caller falls back to its previous plan.
pub const ITERATIONS_MAX: u32 = 100;

/// A violation below this, relative to the limit, counts as rounding.
const VIOLATION_MIN: f64 = 1e-10;
/// A normal whose part outside the working set's span is relatively smaller depends on the set.
const INDEPENDENCE_MIN: f64 = 1e-9;

type Vector = SVector<f64, VARIABLES>;

/// The dense dual active-set method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ActiveSet;

impl QpSolver for ActiveSet {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        let guess = if warm.iter().next().is_some() { *warm } else { WorkingSet::natural() };
        let Some(mut search) = Search::start(qp) else {
            return Solution {
                status: SolveStatus::Infeasible,
                z: Vector::zeros(),
                report: QpReport { kkt_residual: f64::INFINITY, ..QpReport::default() },
            };
        };
        search.adopt(&guess);
        let status = search.run();
        search.refine();
        *warm = search.working_set();
        search.solution(status)
    }
}

/// One search: a point optimal for its working set, with the factors that make a step cheap.
///
/// With N the matrix of the working set's normals, `J' H J = I` and `J' N = [R; 0]`, R upper
/// triangular [Goldfarb & Idnani, section 4].
struct Search<'a> {
    qp: &'a Qp,
    /// Columns of J.
    j: [Vector; VARIABLES],
    /// R, upper triangular in its leading `count` rows and columns.
    r: SMatrix<f64, VARIABLES, VARIABLES>,
    /// The working set; only the first `count` are meaningful.
    members: [Active; VARIABLES],
    count: usize,
    /// Multipliers of the working set, one more for the constraint being added.
    multipliers: [f64; VARIABLES + 1],
    z: Vector,
    iterations: u32,
    changes: u32,
}

impl<'a> Search<'a> {
    /// Factors H = L L' and sets J = L'^-1; `None` when H is not positive definite.
    fn start(qp: &'a Qp) -> Option<Self> {
        let l = cholesky(&qp.hessian)?;
        let mut j = [Vector::zeros(); VARIABLES];
        for (k, column) in j.iter_mut().enumerate() {
            // Column k of L'^-1 solves L' x = e_k by back substitution; entries below k are zero.
            column[k] = 1.0 / l[(k, k)];
            for i in (0..k).rev() {
                let sum: f64 = (i + 1..=k).map(|m| l[(m, i)] * column[m]).sum();
                column[i] = -sum / l[(i, i)];
            }
        }
        Some(Self {
            qp,
            j,
            r: SMatrix::zeros(),
            members: [Active { constraint: 0, upper: false }; VARIABLES],
            count: 0,
            multipliers: [0.0; VARIABLES + 1],
            z: Vector::zeros(),
            iterations: 0,
            changes: 0,
        })
    }

    /// Takes over a guessed working set, without those members that depend on earlier ones, have
    /// no limit, or would have to pull the wrong way.
    fn adopt(&mut self, guess: &WorkingSet) {
        for active in guess.iter() {
            if usize::from(active.constraint) < CONSTRAINTS && self.limit(active).is_finite() {
                let mut d = self.project(&self.normal(active));
                if self.outside(&d) > INDEPENDENCE_MIN {
                    self.push(active, &mut d);
                }
            }
        }
        self.settle();
        while let Some(worst) = self.most_negative_multiplier() {
            self.drop_member(worst);
            self.settle();
        }
        self.changes = 0;
    }

    /// Adds violated constraints until there is none.
    fn run(&mut self) -> SolveStatus {
        while let Some((active, violation)) = self.most_violated() {
            if !violation.is_finite() {
                return SolveStatus::Infeasible;
            }
            if let Err(status) = self.satisfy(active) {
                return status;
            }
        }
        if self.z.iter().all(|x| x.is_finite()) {
            SolveStatus::Solved
        } else {
            SolveStatus::Infeasible
        }
    }

    /// Steps until `active` holds, dropping members whose multipliers reach zero on the way
    /// [Goldfarb & Idnani, algorithm 1, step 2].
    fn satisfy(&mut self, active: Active) -> Result<(), SolveStatus> {
        let normal = self.normal(active);
        self.multipliers[self.count] = 0.0;
        loop {
            self.iterations += 1;
            if self.iterations > ITERATIONS_MAX {
                return Err(SolveStatus::IterationCap);
            }
            let mut d = self.project(&normal);
            let independent = self.outside(&d) > INDEPENDENCE_MIN;
            let pull = self.back_substitute(&d);

            // Largest step that keeps every multiplier non-negative, and who stops it.
            let blocking = (0..self.count)
                .filter(|&i| pull[i] > 0.0)
                .map(|i| (self.multipliers[i] / pull[i], i))
                .fold(None, |best: Option<(f64, usize)>, x| match best {
                    Some(b) if b.0 <= x.0 => Some(b),
                    _ => Some(x),
                });
            // Step that makes the constraint hold with equality.
            let full = if independent {
                let curvature: f64 = d.iter().skip(self.count).map(|x| x * x).sum();
                self.shortfall(active) / curvature
            } else {
                f64::INFINITY
            };

            let step = blocking.map_or(full, |(t, _)| full.min(t));
            if !step.is_finite() {
                return Err(SolveStatus::Infeasible);
            }
            if independent {
                for k in self.count..VARIABLES {
                    self.z += self.j[k] * (step * d[k]);
                }
            }
            for i in 0..self.count {
                self.multipliers[i] -= step * pull[i];
            }
            self.multipliers[self.count] += step;
            match blocking {
                Some((t, i)) if t < full => self.drop_member(i),
                _ => {
                    self.push(active, &mut d);
                    return Ok(());
                }
            }
        }
    }

    /// Computes point and multipliers afresh from the factors:
    /// `z = J y`, `y1 = R'^-1 b`, `y2 = -J2' g`, `R m = y1 + J1' g`.
    fn settle(&mut self) {
        let gradient = self.project(&self.qp.gradient);
        let mut y = -gradient;
        for i in 0..self.count {
            let sum: f64 = (0..i).map(|k| self.r[(k, i)] * y[k]).sum();
            y[i] = (self.bound(self.members[i]) - sum) / self.r[(i, i)];
        }
        self.z = Vector::zeros();
        for k in 0..VARIABLES {
            self.z += self.j[k] * y[k];
        }
        self.multipliers = self.back_substitute(&(y + gradient));
    }

    /// One step of iterative refinement: the same solve for the residuals of point and multipliers.
    fn refine(&mut self) {
        let mut residual = self.qp.hessian * self.z + self.qp.gradient;
        for i in 0..self.count {
            residual -= self.normal(self.members[i]) * self.multipliers[i];
        }
        let residual = self.project(&residual);
        let mut y = -residual;
        for i in 0..self.count {
            let sum: f64 = (0..i).map(|k| self.r[(k, i)] * y[k]).sum();
            y[i] = (self.shortfall(self.members[i]) - sum) / self.r[(i, i)];
        }
        for k in 0..VARIABLES {
            self.z += self.j[k] * y[k];
        }
        let correction = self.back_substitute(&(y + residual));
        for i in 0..self.count {
            self.multipliers[i] += correction[i];
        }
    }

    /// The constraint violated most, relative to its limit, and by how much.
    fn most_violated(&self) -> Option<(Active, f64)> {
        let values = self.qp.values(&self.z);
        let mut worst = None;
        let mut largest = VIOLATION_MIN;
        for (i, &value) in values.iter().enumerate() {
            for (violation, limit, upper) in [
                (self.qp.lower[i] - value, self.qp.lower[i], false),
                (value - self.qp.upper[i], self.qp.upper[i], true),
            ] {
                // Not `>`: a NaN anywhere must end the search, not pass as satisfied.
                if violation <= largest {
                    continue;
                }
                let relative = violation / (1.0 + limit.abs());
                if relative <= largest {
                    continue;
                }
                largest = relative;
                worst = Some((Active { constraint: i as u8, upper }, relative));
                if !relative.is_finite() {
                    return worst;
                }
            }
        }
        worst
    }

    /// Adds a constraint whose projected normal is `d`: rotations turn `d` into a column of R.
    fn push(&mut self, active: Active, d: &mut Vector) {
        for k in (self.count + 1..VARIABLES).rev() {
            let (c, s, length) = rotation(d[k - 1], d[k]);
            d[k - 1] = length;
            d[k] = 0.0;
            self.rotate_columns(k - 1, c, s);
        }
        for i in 0..=self.count {
            self.r[(i, self.count)] = d[i];
        }
        self.members[self.count] = active;
        self.count += 1;
        self.changes += 1;
    }

    /// Removes member `at`, closing the gap in R with rotations.
    fn drop_member(&mut self, at: usize) {
        let last = self.count - 1;
        for column in at..last {
            self.members[column] = self.members[column + 1];
            self.multipliers[column] = self.multipliers[column + 1];
            for i in 0..=column + 1 {
                self.r[(i, column)] = self.r[(i, column + 1)];
            }
        }
        // The multiplier of the constraint being added sits behind the working set's.
        self.multipliers[last] = self.multipliers[last + 1];
        self.count = last;
        self.changes += 1;
        for k in at..last {
            let (c, s, length) = rotation(self.r[(k, k)], self.r[(k + 1, k)]);
            self.r[(k, k)] = length;
            self.r[(k + 1, k)] = 0.0;
            for column in k + 1..last {
                let (a, b) = (self.r[(k, column)], self.r[(k + 1, column)]);
                self.r[(k, column)] = c * a + s * b;
                self.r[(k + 1, column)] = c * b - s * a;
            }
            self.rotate_columns(k, c, s);
        }
    }

    fn rotate_columns(&mut self, k: usize, c: f64, s: f64) {
        let (a, b) = (self.j[k], self.j[k + 1]);
        self.j[k] = a * c + b * s;
        self.j[k + 1] = b * c - a * s;
    }

    /// `J' x`.
    fn project(&self, x: &Vector) -> Vector {
        let mut d = Vector::zeros();
        for k in 0..VARIABLES {
            d[k] = self.j[k].dot(x);
        }
        d
    }

    /// Relative length of a projected normal outside the working set's span.
    fn outside(&self, d: &Vector) -> f64 {
        let whole = d.norm();
        let rest: f64 = d.iter().skip(self.count).map(|x| x * x).sum();
        if whole > 0.0 { libm::sqrt(rest) / whole } else { 0.0 }
    }

    /// `R^-1` applied to the leading part of `d`; zero beyond the working set.
    fn back_substitute(&self, d: &Vector) -> [f64; VARIABLES + 1] {
        let mut x = [0.0; VARIABLES + 1];
        for i in (0..self.count).rev() {
            let sum: f64 = (i + 1..self.count).map(|k| self.r[(i, k)] * x[k]).sum();
            x[i] = (d[i] - sum) / self.r[(i, i)];
        }
        x
    }

    fn most_negative_multiplier(&self) -> Option<usize> {
        (0..self.count)
            .filter(|&i| self.multipliers[i] < 0.0)
            .min_by(|&a, &b| self.multipliers[a].total_cmp(&self.multipliers[b]))
    }

    /// The normal, turned so that the constraint reads `normal' z >= bound`.
    fn normal(&self, active: Active) -> Vector {
        let normal = self.qp.normal(active.constraint.into());
        if active.upper { -normal } else { normal }
    }

    fn limit(&self, active: Active) -> f64 {
        let side = if active.upper { &self.qp.upper } else { &self.qp.lower };
        side[usize::from(active.constraint)]
    }

    /// The bound in `normal' z >= bound`.
    fn bound(&self, active: Active) -> f64 {
        if active.upper { -self.limit(active) } else { self.limit(active) }
    }

    /// How much the constraint is short of holding.
    fn shortfall(&self, active: Active) -> f64 {
        self.bound(active) - self.normal(active).dot(&self.z)
    }

    fn working_set(&self) -> WorkingSet {
        WorkingSet::of(self.members[..self.count].iter().copied())
    }

    fn solution(&self, status: SolveStatus) -> Solution {
        let mut multipliers = [0.0; CONSTRAINTS];
        for i in 0..self.count {
            let sign = if self.members[i].upper { -1.0 } else { 1.0 };
            multipliers[usize::from(self.members[i].constraint)] = sign * self.multipliers[i];
        }
        Solution {
            status,
            z: self.z,
            report: QpReport {
                iterations: self.iterations,
                changes: self.changes,
                working_set: self.working_set().bits(),
                kkt_residual: kkt_residual(self.qp, &self.z, &multipliers),
            },
        }
    }
}

/// L with H = L L', L lower triangular; `None` when H is not positive definite.
fn cholesky(h: &SMatrix<f64, VARIABLES, VARIABLES>) -> Option<SMatrix<f64, VARIABLES, VARIABLES>> {
    let mut l = SMatrix::<f64, VARIABLES, VARIABLES>::zeros();
    for k in 0..VARIABLES {
        let mut pivot = h[(k, k)];
        for m in 0..k {
            pivot -= l[(k, m)] * l[(k, m)];
        }
        // Written so that NaN is refused too.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let root = libm::sqrt(pivot);
        l[(k, k)] = root;
        for i in k + 1..VARIABLES {
            let mut sum = h[(i, k)];
            for m in 0..k {
                sum -= l[(i, m)] * l[(k, m)];
            }
            l[(i, k)] = sum / root;
        }
    }
    Some(l)
}

/// Cosine and sine that turn (a, b) into (length, 0), and that length.
fn rotation(a: f64, b: f64) -> (f64, f64, f64) {
    if b == 0.0 {
        return (1.0, 0.0, a);
    }
    let length = libm::hypot(a, b);
    (a / length, b / length, length)
}
