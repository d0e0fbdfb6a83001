//! The factors that make a step of the active-set method cheap.
//!
//! ```text
//! H = U' U            U upper triangular
//! J' H J = I          J = U^-1 Q, Q orthogonal
//! J' N = [R; 0]       N: the working set's normals, R upper triangular
//! ```
//!
//! [Goldfarb & Idnani, section 4]. A constraint enters by one reflection of J's free columns and
//! leaves by rotations.

use super::row::{Row, WIDTH};
use super::{INPUTS, Qp, SLACKS, VARIABLES};

/// U of H = U' U, with the reciprocals of its diagonal.
#[derive(Debug, Clone, Copy)]
pub struct Cholesky {
    /// Row by row; entries before the diagonal are not meaningful.
    rows: [Row; VARIABLES],
    inverse: [f64; VARIABLES],
}

impl Cholesky {
    /// Factors the Hessian; `None` when it is not positive definite.
    pub fn of(qp: &Qp) -> Option<Self> {
        // Symmetric: a column is a row.
        let columns = qp.hessian.as_slice();
        let mut rows: [Row; VARIABLES] =
            core::array::from_fn(|k| Row::of(&columns[k * VARIABLES..(k + 1) * VARIABLES]));
        let mut inverse = [0.0; VARIABLES];
        for k in 0..VARIABLES {
            let pivot = rows[k].0[k];
            // Written so that NaN is refused too.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            inverse[k] = 1.0 / libm::sqrt(pivot);
            let row = rows[k].scaled(inverse[k]);
            rows[k] = row;
            for (j, below) in rows.iter_mut().enumerate().skip(k + 1) {
                // The slacks are coupled to nothing in the motion layer's problems.
                if row.0[j] != 0.0 {
                    below.add_scaled(-row.0[j], &row);
                }
            }
        }
        Some(Self { rows, inverse })
    }

    /// The minimiser of `z' H z / 2 + g' z` over the inputs, the slacks given.
    pub fn minimise_inputs(&self, qp: &Qp, slacks: &[f64; SLACKS]) -> Row {
        let mut right = Row::ZERO;
        for (right, g) in right.0.iter_mut().zip(qp.gradient.iter().take(INPUTS)) {
            *right = -g;
        }
        let mut z = Row::ZERO;
        for (s, &slack) in slacks.iter().enumerate() {
            z.0[INPUTS + s] = slack;
            if slack != 0.0 {
                for i in 0..INPUTS {
                    right.0[i] -= qp.hessian[(i, INPUTS + s)] * slack;
                }
            }
        }
        for k in 0..INPUTS {
            right.0[k] *= self.inverse[k];
            let value = right.0[k];
            for (j, right) in right.0.iter_mut().enumerate().take(INPUTS).skip(k + 1) {
                *right -= value * self.rows[k].0[j];
            }
        }
        let mut inputs = Row::ZERO;
        for k in (0..INPUTS).rev() {
            inputs.0[k] = (right.0[k] - self.rows[k].dot(&inputs)) * self.inverse[k];
        }
        inputs.add_scaled(1.0, &z);
        inputs
    }

    /// U^-1, column by column.
    fn inverse_columns(&self) -> [Row; VARIABLES] {
        let mut columns = [Row::ZERO; VARIABLES];
        for k in 0..VARIABLES {
            let mut column = Row::ZERO;
            column.0[k] = 1.0;
            for m in 0..k {
                let entry = self.rows[m].0[k];
                if entry != 0.0 {
                    let before = columns[m];
                    column.add_scaled(-entry, &before);
                }
            }
            columns[k] = column.scaled(self.inverse[k]);
        }
        columns
    }
}

/// J and R for a working set of `count` constraints.
#[derive(Debug, Clone, Copy)]
pub struct Factors {
    /// Columns of J.
    j: [Row; VARIABLES],
    /// Columns of R, zero below the diagonal and beyond `count`.
    r: [Row; VARIABLES],
    count: usize,
}

impl Factors {
    /// No constraint active.
    pub fn free(cholesky: &Cholesky) -> Self {
        Self { j: cholesky.inverse_columns(), r: [Row::ZERO; VARIABLES], count: 0 }
    }

    /// The slacks' lower bounds active, last slack first.
    ///
    /// The slacks come last in H, so the columns of U^-1 to the inputs have nothing of them and
    /// are free, and those to the slacks, last first, are J's others: nothing needs turning.
    pub fn with_slacks_held(cholesky: &Cholesky) -> Self {
        let columns = cholesky.inverse_columns();
        let mut factors = Self { j: columns, r: [Row::ZERO; VARIABLES], count: SLACKS };
        for i in 0..SLACKS {
            factors.j[i] = columns[VARIABLES - 1 - i];
        }
        factors.j[SLACKS..].copy_from_slice(&columns[..INPUTS]);
        for member in 0..SLACKS {
            for i in 0..=member {
                factors.r[member].0[i] = factors.j[i].0[VARIABLES - 1 - member];
            }
        }
        factors
    }

    /// `J' x`.
    pub fn project(&self, x: &Row) -> Row {
        let mut d = Row::ZERO;
        for (d, column) in d.0.iter_mut().zip(&self.j) {
            *d = column.dot(x);
        }
        d
    }

    /// `J y`.
    pub fn combine(&self, y: &Row) -> Row {
        let mut z = Row::ZERO;
        for (column, &y) in self.j.iter().zip(&y.0) {
            z.add_scaled(y, column);
        }
        z
    }

    /// J's free columns times the same entries of `y`.
    pub fn combine_free(&self, y: &Row) -> Row {
        let mut z = Row::ZERO;
        for (column, &y) in self.j.iter().zip(&y.0).skip(self.count) {
            z.add_scaled(y, column);
        }
        z
    }

    /// `R^-1` applied to the leading part of `d`; zero beyond the working set.
    pub fn back_substitute(&self, d: &Row) -> Row {
        let (mut rest, mut x) = (*d, Row::ZERO);
        for i in (0..self.count).rev() {
            x.0[i] = rest.0[i] / self.r[i].0[i];
            rest.add_scaled(-x.0[i], &self.r[i]);
        }
        x
    }

    /// `R'^-1` applied to what `right` gives for each member; zero beyond the working set.
    pub fn forward_substitute(&self, right: impl Fn(usize) -> f64) -> Row {
        let mut y = Row::ZERO;
        for i in 0..self.count {
            y.0[i] = (right(i) - self.r[i].dot(&y)) / self.r[i].0[i];
        }
        y
    }

    /// Adds a constraint whose projected normal is `d`.
    pub fn push(&mut self, d: &Row) {
        let at = self.count;
        let (first, rest) = (d.0[at], d.squares_from(at + 1));
        let mut pivot = first;
        if rest > 0.0 {
            // Reflect d's free part onto its first entry, away from it so that nothing cancels.
            let length = libm::sqrt(first * first + rest);
            pivot = if first > 0.0 { -length } else { length };
            let mut mirror = *d;
            mirror.0[..at].fill(0.0);
            mirror.0[at] = first - pivot;
            let along = self.combine_free(&mirror);
            let scale = 1.0 / (length * (length + first.abs()));
            for (column, &entry) in self.j.iter_mut().zip(&mirror.0).skip(at) {
                column.add_scaled(-scale * entry, &along);
            }
        }
        self.r[at] = Row::ZERO;
        self.r[at].0[..at].copy_from_slice(&d.0[..at]);
        self.r[at].0[at] = pivot;
        self.count += 1;
    }

    /// Removes member `at`, closing the gap in R with rotations.
    pub fn remove(&mut self, at: usize) {
        let last = self.count - 1;
        self.r.copy_within(at + 1..self.count, at);
        self.r[last] = Row::ZERO;
        self.count = last;
        for k in at..last {
            let (c, s) = rotation(self.r[k].0[k], self.r[k].0[k + 1]);
            for column in &mut self.r[k..last] {
                let (a, b) = (column.0[k], column.0[k + 1]);
                column.0[k] = c * a + s * b;
                column.0[k + 1] = c * b - s * a;
            }
            self.r[k].0[k + 1] = 0.0;
            let (a, b) = (self.j[k], self.j[k + 1]);
            for i in 0..WIDTH {
                self.j[k].0[i] = c * a.0[i] + s * b.0[i];
                self.j[k + 1].0[i] = c * b.0[i] - s * a.0[i];
            }
        }
    }
}

/// Cosine and sine that turn (a, b) into (length, 0).
fn rotation(a: f64, b: f64) -> (f64, f64) {
    if b == 0.0 {
        return (1.0, 0.0);
    }
    let inverse = 1.0 / libm::sqrt(a * a + b * b);
    (a * inverse, b * inverse)
}
