//! Vectors of the QP's size, filled up with a zero to whole vector registers.

use super::VARIABLES;

/// Length of a row: the next even number from the QP's variables on.
pub const WIDTH: usize = VARIABLES.next_multiple_of(2);

/// A vector of the QP's size; what is beyond its variables is zero and stays so.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(16))]
pub struct Row(pub [f64; WIDTH]);

impl Row {
    /// The zero vector.
    pub const ZERO: Self = Self([0.0; WIDTH]);

    /// A row of these entries.
    #[inline(always)]
    pub fn of(entries: &[f64]) -> Self {
        let mut row = Self::ZERO;
        row.0[..VARIABLES].copy_from_slice(&entries[..VARIABLES]);
        row
    }

    /// Inner product, in a fixed order of additions.
    #[inline(always)]
    pub fn dot(&self, other: &Self) -> f64 {
        let mut sums = [0.0; 2];
        for (a, b) in self.0.chunks_exact(2).zip(other.0.chunks_exact(2)) {
            sums[0] += a[0] * b[0];
            sums[1] += a[1] * b[1];
        }
        sums[0] + sums[1]
    }

    /// Adds `scale` times another.
    #[inline(always)]
    pub fn add_scaled(&mut self, scale: f64, other: &Self) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a += scale * b;
        }
    }

    /// `scale` times this.
    #[inline(always)]
    pub fn scaled(&self, scale: f64) -> Self {
        Self(self.0.map(|x| scale * x))
    }

    /// Sum of squares from entry `from` on.
    #[inline(always)]
    pub fn squares_from(&self, from: usize) -> f64 {
        self.0[from..].iter().map(|x| x * x).sum()
    }
}

impl From<Row> for nalgebra::SVector<f64, VARIABLES> {
    fn from(row: Row) -> Self {
        Self::from_column_slice(&row.0[..VARIABLES])
    }
}
