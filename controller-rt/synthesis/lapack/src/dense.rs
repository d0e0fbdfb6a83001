//! What the routines compute, without pointers.
//!
//! Sizes are those of a control design, a few dozen rows, so clarity wins over blocking. Only the
//! triangle that a routine is told to use is read or written.

use nalgebra::{
    DMatrix, DMatrixView, DMatrixViewMut, DVector, Dyn, LU, RealField, SVD, SymmetricEigen,
};

/// A column-major matrix inside somebody else's memory.
pub type View<'a, T> = DMatrixView<'a, T, Dyn, Dyn>;
/// The same, to be written.
pub type ViewMut<'a, T> = DMatrixViewMut<'a, T, Dyn, Dyn>;

/// Iterations of an eigenvalue or singular value search before it counts as failed; a matrix of
/// order n needs about 2 n.
const SEARCH_MAX: usize = 10_000;

/// `f32` or `f64`.
pub trait Real: RealField + Copy {}
impl Real for f32 {}
impl Real for f64 {}

/// Which entries of a square matrix count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All.
    Whole,
    /// Those on and above the diagonal.
    Upper,
    /// Those on and below it.
    Lower,
}

impl Part {
    fn has(self, row: usize, column: usize) -> bool {
        match self {
            Self::Whole => true,
            Self::Upper => row <= column,
            Self::Lower => row >= column,
        }
    }
}

/// Why a decomposition has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failed {
    /// The leading minor of this order, counted from 1, is not positive or is singular.
    Minor(usize),
    /// The numbers are not finite, or the search found no end.
    Search,
}

/// `C <- product + beta C` on a part of C; with `beta` 0, C is not read.
pub fn blend<T: Real>(product: &DMatrix<T>, beta: T, c: &mut ViewMut<'_, T>, part: Part) {
    for j in 0..c.ncols() {
        for i in (0..c.nrows()).filter(|&i| part.has(i, j)) {
            let old = if beta.is_zero() { T::zero() } else { beta * c[(i, j)] };
            c[(i, j)] = old + product[(i, j)];
        }
    }
}

/// The symmetric matrix of which only one part is kept.
pub fn symmetric<T: Real>(a: &View<'_, T>, part: Part) -> DMatrix<T> {
    let entry = |i: usize, j: usize| if part.has(i, j) { a[(i, j)] } else { a[(j, i)] };
    DMatrix::from_fn(a.nrows(), a.ncols(), entry)
}

/// Cholesky's factor in place: L below, with A = L Lᵀ, or U above, with A = Uᵀ U.
///
/// # Errors
/// The order of the first minor that is not positive.
pub fn factor_cholesky<T: Real>(a: &mut ViewMut<'_, T>, part: Part) -> Result<(), Failed> {
    let full = symmetric(&a.as_view(), part);
    let minor = |k: usize| full.view((0, 0), (k, k)).into_owned().cholesky();
    let Some(found) = minor(full.nrows()) else {
        let order = (1..=full.nrows()).find(|&k| minor(k).is_none());
        return Err(Failed::Minor(order.unwrap_or(full.nrows())));
    };
    let l = found.l();
    if l.iter().any(|x| !x.is_finite()) {
        return Err(Failed::Minor(1));
    }
    blend(&if part == Part::Upper { l.transpose() } else { l }, T::zero(), a, part);
    Ok(())
}

/// Solves A X = B with Cholesky's factor of A.
pub fn solve_cholesky<T: Real>(factor: &View<'_, T>, part: Part, b: &mut ViewMut<'_, T>) {
    let l = if part == Part::Upper { factor.transpose() } else { factor.into_owned() };
    // A factor with a zero on its diagonal solves nothing; B then stays as it came.
    let _ = l.solve_lower_triangular_mut(b) && l.tr_solve_lower_triangular_mut(b);
}

/// Solves A X = B by elimination with row exchanges; A becomes its factors, and the row that each
/// row was exchanged with comes back, counted from 0.
///
/// # Errors
/// The order of the first zero pivot.
pub fn solve_lu<T: Real>(
    a: &mut ViewMut<'_, T>,
    b: &mut ViewMut<'_, T>,
) -> Result<Vec<usize>, Failed> {
    let n = a.nrows();
    let found = LU::new(a.clone_owned());
    let mut order = DVector::from_fn(n, |i, _| i);
    found.p().permute_rows(&mut order);
    blend(&found.lu_internal().clone_owned(), T::zero(), a, Part::Whole);
    let exchanges = exchanges(order.as_slice());
    if let Some(zero) = (0..n).find(|&i| a[(i, i)].is_zero() || !a[(i, i)].is_finite()) {
        return Err(Failed::Minor(zero + 1));
    }
    found.solve_mut(b);
    Ok(exchanges)
}

/// The sequence of exchanges, each with a later row, that puts rows into `order`.
fn exchanges(order: &[usize]) -> Vec<usize> {
    let mut current: Vec<usize> = (0..order.len()).collect();
    let mut exchanges = Vec::with_capacity(order.len());
    for (i, wanted) in order.iter().enumerate() {
        let j = current.iter().position(|row| row == wanted).unwrap_or(i);
        current.swap(i, j);
        exchanges.push(j);
    }
    exchanges
}

/// A thin singular value decomposition A = U diag(s) Vᵀ, s falling.
#[derive(Debug, Clone)]
pub struct Singular<T> {
    /// Left vectors, a column each.
    pub u: DMatrix<T>,
    /// Singular values.
    pub s: DVector<T>,
    /// Right vectors, a row each.
    pub vt: DMatrix<T>,
}

/// Decomposes A.
///
/// # Errors
/// When A is not finite.
pub fn singular<T: Real>(a: &View<'_, T>) -> Result<Singular<T>, Failed> {
    if a.iter().any(|x| !x.is_finite()) {
        return Err(Failed::Search);
    }
    if a.is_empty() {
        let (m, n) = a.shape();
        let (u, vt) = (DMatrix::zeros(m, 0), DMatrix::zeros(0, n));
        return Ok(Singular { u, s: DVector::zeros(0), vt });
    }
    let found = SVD::try_new(a.into_owned(), true, true, T::default_epsilon(), SEARCH_MAX);
    let found = found.ok_or(Failed::Search)?;
    match (found.u, found.v_t) {
        (Some(u), Some(vt)) => Ok(Singular { u, s: found.singular_values, vt }),
        _ => Err(Failed::Search),
    }
}

/// Eigenvalues, rising, and their vectors, a column each.
///
/// # Errors
/// When A is not finite.
pub fn eigen<T: Real>(a: &View<'_, T>, part: Part) -> Result<(DVector<T>, DMatrix<T>), Failed> {
    let full = symmetric(a, part);
    if full.iter().any(|x| !x.is_finite()) {
        return Err(Failed::Search);
    }
    if full.is_empty() {
        return Ok((DVector::zeros(0), full));
    }
    let found = SymmetricEigen::try_new(full, T::default_epsilon(), SEARCH_MAX);
    let found = found.ok_or(Failed::Search)?;
    let n = found.eigenvalues.len();
    let mut order: Vec<usize> = (0..n).collect();
    let value = |i: usize| found.eigenvalues[i];
    order.sort_by(|&i, &j| value(i).partial_cmp(&value(j)).unwrap_or(core::cmp::Ordering::Equal));
    let values = DVector::from_fn(n, |k, _| value(order[k]));
    Ok((values, DMatrix::from_fn(n, n, |i, k| found.eigenvectors[(i, order[k])])))
}
