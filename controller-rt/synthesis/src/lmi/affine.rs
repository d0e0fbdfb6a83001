//! Matrices whose entries are affine functions of a program's variables.

use std::collections::BTreeMap;
use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::DMatrix;

/// A constant matrix plus one matrix per variable, times that variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Affine {
    pub(super) constant: DMatrix<f64>,
    pub(super) terms: BTreeMap<usize, DMatrix<f64>>,
}

impl Affine {
    /// A known matrix.
    #[must_use]
    pub fn constant(matrix: DMatrix<f64>) -> Self {
        Self { constant: matrix, terms: BTreeMap::new() }
    }

    /// A zero matrix.
    #[must_use]
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self::constant(DMatrix::zeros(rows, columns))
    }

    /// Rows and columns.
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        self.constant.shape()
    }

    fn map(&self, change: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> Self {
        let terms = self.terms.iter().map(|(variable, matrix)| (*variable, change(matrix)));
        Self { constant: change(&self.constant), terms: terms.collect() }
    }

    /// `matrix` times this.
    #[must_use]
    pub fn left(&self, matrix: &DMatrix<f64>) -> Self {
        self.map(|own| matrix * own)
    }

    /// This times `matrix`.
    #[must_use]
    pub fn right(&self, matrix: &DMatrix<f64>) -> Self {
        self.map(|own| own * matrix)
    }

    /// `frame`ᵀ times this times `frame`.
    #[must_use]
    pub fn within(&self, frame: &DMatrix<f64>) -> Self {
        let turned = frame.transpose();
        self.map(|own| &turned * own * frame)
    }

    /// The transpose.
    #[must_use]
    pub fn transpose(&self) -> Self {
        self.map(DMatrix::transpose)
    }

    /// This plus its transpose.
    #[must_use]
    pub fn plus_transpose(&self) -> Self {
        self.map(|own| own + own.transpose())
    }

    /// The trace of `matrix` times this, as a 1 x 1 expression.
    #[must_use]
    pub fn trace_with(&self, matrix: &DMatrix<f64>) -> Self {
        self.map(|own| DMatrix::from_element(1, 1, (matrix * own).trace()))
    }

    /// This 1 x 1 expression times a known matrix.
    #[must_use]
    pub fn times(&self, matrix: &DMatrix<f64>) -> Self {
        self.map(|own| matrix * own[(0, 0)])
    }

    fn combined(&self, other: &Self, sign: f64) -> Self {
        let mut sum = self.clone();
        sum.constant += &other.constant * sign;
        for (variable, matrix) in &other.terms {
            let add = matrix * sign;
            match sum.terms.get_mut(variable) {
                Some(own) => *own += add,
                None => drop(sum.terms.insert(*variable, add)),
            }
        }
        sum
    }
}

impl Add<&Affine> for &Affine {
    type Output = Affine;
    fn add(self, other: &Affine) -> Affine {
        self.combined(other, 1.0)
    }
}

impl Sub<&Affine> for &Affine {
    type Output = Affine;
    fn sub(self, other: &Affine) -> Affine {
        self.combined(other, -1.0)
    }
}

impl Mul<f64> for &Affine {
    type Output = Affine;
    fn mul(self, factor: f64) -> Affine {
        self.map(|own| own * factor)
    }
}

impl Neg for &Affine {
    type Output = Affine;
    fn neg(self) -> Affine {
        self * -1.0
    }
}

/// A symmetric matrix of blocks, of which those on and above the diagonal are given.
#[derive(Debug, Clone)]
pub struct Blocks {
    starts: Vec<usize>,
    pub(super) entries: Vec<(usize, usize, Affine)>,
}

impl Blocks {
    /// A zero matrix with square diagonal blocks of these sizes.
    #[must_use]
    pub fn new(sizes: &[usize]) -> Self {
        let mut starts = vec![0];
        for size in sizes {
            starts.push(starts[starts.len() - 1] + size);
        }
        Self { starts, entries: Vec::new() }
    }

    /// A matrix of one block.
    #[must_use]
    pub fn one(block: Affine) -> Self {
        Self::new(&[block.shape().0]).with(0, 0, block)
    }

    /// The same matrix with something added to the block at (`i`, `j`), `i <= j`.
    ///
    /// # Panics
    /// When the block's shape is not that of its place.
    #[must_use]
    pub fn with(mut self, i: usize, j: usize, block: Affine) -> Self {
        let place = (self.starts[i + 1] - self.starts[i], self.starts[j + 1] - self.starts[j]);
        assert!(i <= j && block.shape() == place, "{:?} at ({i}, {j})", block.shape());
        self.entries.push((self.starts[i], self.starts[j], block));
        self
    }

    /// Rows.
    #[must_use]
    pub fn order(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }
}
