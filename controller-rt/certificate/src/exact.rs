//! Positive definiteness without rounding.
//!
//! Every `f64` is a rational number, so what a certificate claims is a statement about rational
//! matrices, and Sylvester's criterion decides it: a symmetric matrix is positive definite exactly
//! when all its leading principal minors are positive. Bareiss's elimination (Math. Comp. 22, 1968)
//! finds them one after the other without a fraction, in integers as long as they need to be.

use nalgebra::DMatrix;
use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{One, Signed, Zero};

/// Whether a symmetric matrix is positive definite. An entry off the diagonal counts as written
/// above it.
#[must_use]
pub fn is_positive_definite(matrix: &DMatrix<BigRational>) -> bool {
    let n = matrix.nrows();
    if n != matrix.ncols() {
        return false;
    }
    let mut a = integers(matrix);
    let mut previous = BigInt::one();
    for k in 0..n {
        // The pivot is the leading minor of order k + 1, times a positive number.
        let pivot = a[(k, k)].clone();
        if !pivot.is_positive() {
            return false;
        }
        for i in k + 1..n {
            for j in i..n {
                let kept = &a[(i, j)] * &pivot - &a[(k, i)] * &a[(k, j)];
                a[(i, j)] = kept / &previous;
            }
        }
        previous = pivot;
    }
    true
}

/// The upper triangle times the common denominator, which is positive.
fn integers(matrix: &DMatrix<BigRational>) -> DMatrix<BigInt> {
    let denominator = matrix.iter().fold(BigInt::one(), least_common);
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| {
        if i > j {
            return BigInt::zero();
        }
        let entry = &matrix[(i, j)];
        entry.numer() * (&denominator / entry.denom())
    })
}

fn least_common(all: BigInt, entry: &BigRational) -> BigInt {
    let factor = BigRational::new(entry.denom().clone(), all.clone());
    // denom / all in lowest terms: its numerator is what `all` still lacks.
    all * factor.numer()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rational(matrix: DMatrix<f64>) -> DMatrix<BigRational> {
        matrix.map(|x| BigRational::from_float(x).expect("finite"))
    }

    #[test]
    fn definite_matrices_are_told_from_others() {
        let hilbert = DMatrix::from_fn(8, 8, |i, j| 1.0 / (1 + i + j) as f64);
        assert!(is_positive_definite(&rational(hilbert.clone())));
        assert!(!is_positive_definite(&rational(-hilbert.clone())));
        // The smallest eigenvalue of this one is about 1.1e-10, near rounding for its inverse.
        let shifted = |shift: f64| &hilbert - DMatrix::identity(8, 8) * shift;
        assert!(is_positive_definite(&rational(shifted(1.0e-10))));
        assert!(!is_positive_definite(&rational(shifted(1.2e-10))));
    }

    #[test]
    fn one_unit_in_the_last_place_decides() {
        let near = |corner: f64| DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, corner]);
        assert!(is_positive_definite(&rational(near(1.0 + f64::EPSILON))));
        assert!(!is_positive_definite(&rational(near(1.0))));
        assert!(!is_positive_definite(&rational(near(1.0 - f64::EPSILON))));
    }

    #[test]
    fn an_indefinite_matrix_with_a_positive_diagonal_is_refused() {
        let matrix = DMatrix::from_row_slice(3, 3, &[2.0, 3.0, 0.0, 3.0, 2.0, 0.0, 0.0, 0.0, 1.0]);
        assert!(!is_positive_definite(&rational(matrix)));
    }

    #[test]
    fn oblong_matrices_are_refused() {
        assert!(!is_positive_definite(&rational(DMatrix::identity(2, 3))));
    }
}
