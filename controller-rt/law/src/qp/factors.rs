//! The factors that make a step of the active-set method cheap.
//!
//! ```text
//! H = L D L'                  L unit lower triangular, D diagonal
//! x = D^1/2 L' z              in these coordinates H is the identity
//! D^-1/2 L^-1 N = Q R         N: the working set's normals, Q'Q = I, R upper triangular
//! ```
//!
//! Goldfarb & Idnani (section 4) keep a whole orthogonal basis. The motion layer's working sets
//! are small, so that only what they span is kept: a constraint enters by orthogonalising its
//! normal against them, twice, which is as good to the last digits [Giraud, Langou, Rozloznik & van
//! den Eshof, Numerische Mathematik 101 (2005)], and leaves by rotations.

use core::ops::Range;

use super::row::{LANES, Row, WIDTH};
use super::{INPUTS, Qp, SLACKS, VARIABLES};
use crate::wide;

/// Where a row of the elimination has its entry of the right-hand side.
const RIGHT: usize = VARIABLES;

/// L' and the reciprocals of D, from eliminating H row by row.
#[derive(Debug, Clone, Copy)]
pub struct Elimination {
    /// Row k is row k of L'; entries before its diagonal are not meaningful. At [`RIGHT`] it has
    /// D^-1 L^-1 times the slope in the inputs at `z = [0; slacks]`.
    rows: [Row; VARIABLES],
    inverse: [f64; VARIABLES],
}

impl Elimination {
    /// Nothing eliminated yet. Here as below, what is large is filled in where it is.
    pub const EMPTY: Self = Self { rows: [Row::ZERO; VARIABLES], inverse: [0.0; VARIABLES] };

    /// Eliminates the Hessian; false when it is not positive definite.
    #[inline(always)]
    pub fn fill(&mut self, qp: &Qp, slacks: &[f64; SLACKS]) -> bool {
        // Symmetric: a column is a row.
        let columns = qp.hessian.as_slice();
        for (k, row) in self.rows.iter_mut().enumerate() {
            *row = Row::of(&columns[k * VARIABLES..(k + 1) * VARIABLES]);
            row.0[RIGHT] = qp.gradient[k];
            for (s, &slack) in slacks.iter().enumerate() {
                row.0[RIGHT] += row.0[INPUTS + s] * slack;
            }
        }
        // What is before the diagonal of the rows below is left alone, by whole registers.
        self.eliminate::<0>(0..LANES - 1)
            && self.eliminate::<LANES>(LANES - 1..2 * LANES - 1)
            && self.eliminate::<{ 2 * LANES }>(2 * LANES - 1..3 * LANES - 1)
            && self.eliminate::<{ 3 * LANES }>(3 * LANES - 1..VARIABLES)
    }

    /// Eliminates some variables from the rows below theirs, in columns `FROM` and beyond.
    #[inline(always)]
    fn eliminate<const FROM: usize>(&mut self, variables: Range<usize>) -> bool {
        for k in variables {
            let row = self.rows[k];
            let pivot = row.0[k];
            // Written so that NaN is refused too.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            let inverse = 1.0 / pivot;
            for j in k + 1..VARIABLES {
                // The slacks are coupled to nothing in the motion layer's problems.
                if row.0[j] != 0.0 {
                    let factor = row.0[j] * inverse;
                    for i in FROM..WIDTH {
                        self.rows[j].0[i] -= factor * row.0[i];
                    }
                }
            }
            self.rows[k] = row.scaled(inverse);
            self.inverse[k] = inverse;
        }
        true
    }

    /// The minimiser of `z' H z / 2 + g' z` over the inputs, for the slacks it was made with.
    #[inline(always)]
    pub fn minimise_inputs(&self, slacks: &[f64; SLACKS]) -> Row {
        let mut z = Row::ZERO;
        for k in 0..INPUTS {
            z.0[k] = -self.rows[k].0[RIGHT];
        }
        for k in (1..INPUTS).rev() {
            for i in 0..k {
                z.0[i] -= self.rows[i].0[k] * z.0[k];
            }
        }
        z.0[INPUTS..VARIABLES].copy_from_slice(slacks);
        z
    }

    /// Squared lengths `n' H^-1 n` of some normals, of which only the inputs' part counts.
    #[inline(always)]
    pub fn lengths(&self, normals: &[Row; LANES]) -> [f64; LANES] {
        let mut parts = [[0.0; LANES]; INPUTS];
        for (k, part) in parts.iter_mut().enumerate() {
            *part = core::array::from_fn(|lane| normals[lane].0[k]);
        }
        let mut lengths = [0.0; LANES];
        for k in 0..INPUTS {
            let part = parts[k];
            for lane in 0..LANES {
                lengths[lane] += self.inverse[k] * (part[lane] * part[lane]);
            }
            for j in k + 1..INPUTS {
                for lane in 0..LANES {
                    parts[j][lane] -= self.rows[k].0[j] * part[lane];
                }
            }
        }
        lengths
    }
}

/// Q and R for a working set of `count` constraints.
#[derive(Debug, Clone, Copy)]
pub struct Factors {
    /// L' beyond its diagonal, row by row.
    upper: [Row; VARIABLES],
    /// D^-1/2.
    roots: Row,
    /// Minimiser without any constraint, in x.
    free_minimum: Row,
    /// Columns of Q.
    q: [Row; VARIABLES],
    /// Columns of R, zero below the diagonal and beyond `count`.
    r: [Row; VARIABLES],
    /// Reciprocals of R's diagonal.
    inverse: Row,
    /// `Q' free_minimum`.
    along: Row,
    count: usize,
}

/// A normal, seen from the working set.
#[derive(Debug, Clone, Copy)]
pub struct Direction {
    /// Q' n.
    held: Row,
    /// What of it is orthogonal to Q, in x.
    free: Row,
    /// Its squared length, and that of the latter.
    square: f64,
    free_square: f64,
}

impl Direction {
    /// How much a unit step along it changes the constrained quantity.
    #[inline(always)]
    pub fn gain(&self) -> f64 {
        self.free_square
    }

    /// Whether the normal does not depend on the working set's, but for this share of its length.
    #[inline(always)]
    pub fn is_independent(&self, share: f64) -> bool {
        self.free_square > share * share * self.square
    }
}

impl Factors {
    /// Nothing known yet.
    pub const EMPTY: Self = Self {
        upper: [Row::ZERO; VARIABLES],
        roots: Row::ZERO,
        free_minimum: Row::ZERO,
        q: [Row::ZERO; VARIABLES],
        r: [Row::ZERO; VARIABLES],
        inverse: Row::ZERO,
        along: Row::ZERO,
        count: 0,
    };

    /// Starts without any constraint.
    #[inline(always)]
    pub fn start(&mut self, elimination: &Elimination, gradient: &Row) {
        for k in 0..VARIABLES {
            self.upper[k] = elimination.rows[k].beyond(k + 1);
            self.upper[k].0[RIGHT] = 0.0;
            self.roots.0[k] = wide::sqrt(elimination.inverse[k]);
        }
        self.free_minimum = self.transformed(&gradient.scaled(-1.0));
    }

    /// Holds the slacks' bounds, last slack first, when nothing is held yet.
    ///
    /// The slacks come last in H, so that the transformed normal of one has nothing before it: Q's
    /// columns are unit vectors.
    #[inline(always)]
    pub fn hold_slacks(&mut self) {
        for member in 0..SLACKS {
            let slack = VARIABLES - 1 - member;
            let mut normal = [0.0; VARIABLES];
            normal[slack] = 1.0;
            for k in slack..VARIABLES {
                for j in k + 1..VARIABLES {
                    normal[j] -= self.upper[k].0[j] * normal[k];
                }
                self.r[member].0[VARIABLES - 1 - k] = normal[k] * self.roots.0[k];
            }
            self.q[member].0[slack] = 1.0;
            self.inverse.0[member] = 1.0 / self.r[member].0[member];
            self.along.0[member] = self.free_minimum.0[slack];
        }
        self.count = SLACKS;
    }

    /// `D^-1/2 L^-1 n`.
    #[inline(always)]
    fn transformed(&self, normal: &Row) -> Row {
        let mut rest = *normal;
        for k in 0..VARIABLES - 1 {
            rest.add_scaled(-rest.0[k], &self.upper[k]);
        }
        for i in 0..WIDTH {
            rest.0[i] *= self.roots.0[i];
        }
        rest
    }

    /// The point of these coordinates x: `L'^-1 D^-1/2 x`.
    #[inline(always)]
    fn point(&self, x: &Row) -> Row {
        let mut z = Row::ZERO;
        for i in 0..WIDTH {
            z.0[i] = x.0[i] * self.roots.0[i];
        }
        for k in (0..VARIABLES - 1).rev() {
            z.0[k] -= self.upper[k].dot(&z);
        }
        z
    }

    /// Looks at a normal.
    #[inline(always)]
    pub fn direction(&self, normal: &Row) -> Direction {
        let transformed = self.transformed(normal);
        let (mut held, mut free) = (Row::ZERO, transformed);
        for _ in 0..2 {
            let before = free;
            for i in 0..self.count {
                let part = self.q[i].dot(&before);
                held.0[i] += part;
                free.add_scaled(-part, &self.q[i]);
            }
        }
        let (square, free_square) = (transformed.dot(&transformed), free.dot(&free));
        Direction { held, free, square, free_square }
    }

    /// Where the point goes in a unit step along a direction that is independent.
    #[inline(always)]
    pub fn step(&self, direction: &Direction) -> Row {
        self.point(&direction.free)
    }

    /// How the working set's multipliers fall in the same step.
    #[inline(always)]
    pub fn pull(&self, direction: &Direction) -> Row {
        self.back_substitute(&direction.held)
    }

    /// The point that is optimal while the working set's constraints hold at their bounds, and
    /// their multipliers.
    #[inline(always)]
    pub fn optimum(&self, bound: impl Fn(usize) -> f64) -> (Row, Row) {
        let (mut x, mut y, mut lift) = (self.free_minimum, Row::ZERO, Row::ZERO);
        for i in 0..self.count {
            y.0[i] = (bound(i) - self.r[i].dot(&y)) * self.inverse.0[i];
            lift.0[i] = y.0[i] - self.along.0[i];
            x.add_scaled(lift.0[i], &self.q[i]);
        }
        (self.point(&x), self.back_substitute(&lift))
    }

    /// `R^-1` applied to the leading part of `right`; zero beyond the working set.
    #[inline(always)]
    fn back_substitute(&self, right: &Row) -> Row {
        let (mut rest, mut x) = (*right, Row::ZERO);
        for i in (0..self.count).rev() {
            x.0[i] = rest.0[i] * self.inverse.0[i];
            rest.add_scaled(-x.0[i], &self.r[i]);
        }
        x
    }

    /// Adds a constraint by its direction, which has to be independent.
    #[inline(always)]
    pub fn push(&mut self, direction: &Direction) {
        let at = self.count;
        let length = wide::sqrt(direction.free_square);
        self.inverse.0[at] = 1.0 / length;
        self.q[at] = direction.free.scaled(self.inverse.0[at]);
        self.r[at] = direction.held;
        self.r[at].0[at] = length;
        self.along.0[at] = self.q[at].dot(&self.free_minimum);
        self.count += 1;
    }

    /// Removes member `at`, closing the gap in R with rotations.
    #[inline(always)]
    pub fn remove(&mut self, at: usize) {
        let last = self.count - 1;
        self.r.copy_within(at + 1..self.count, at);
        self.count = last;
        for k in at..last {
            let (c, s) = rotation(self.r[k].0[k], self.r[k].0[k + 1]);
            for column in &mut self.r[k..last] {
                let (a, b) = (column.0[k], column.0[k + 1]);
                column.0[k] = c * a + s * b;
                column.0[k + 1] = c * b - s * a;
            }
            self.r[k].0[k + 1] = 0.0;
            self.inverse.0[k] = 1.0 / self.r[k].0[k];
            let (a, b) = (self.q[k], self.q[k + 1]);
            for i in 0..WIDTH {
                self.q[k].0[i] = c * a.0[i] + s * b.0[i];
                self.q[k + 1].0[i] = c * b.0[i] - s * a.0[i];
            }
            let (a, b) = (self.along.0[k], self.along.0[k + 1]);
            self.along.0[k] = c * a + s * b;
            self.along.0[k + 1] = c * b - s * a;
        }
    }
}

/// Cosine and sine that turn (a, b) into (length, 0).
#[inline(always)]
fn rotation(a: f64, b: f64) -> (f64, f64) {
    if b == 0.0 {
        return (1.0, 0.0);
    }
    let inverse = 1.0 / wide::sqrt(a * a + b * b);
    (a * inverse, b * inverse)
}
