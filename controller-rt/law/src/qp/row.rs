//! Vectors of the QP's size, filled up with zeros to whole vector registers.

use super::VARIABLES;

/// Numbers worked on at once: what the widest registers in use hold.
pub const LANES: usize = 4;
/// Length of a row: the next multiple of [`LANES`] from the QP's variables on.
pub const WIDTH: usize = VARIABLES.next_multiple_of(LANES);

/// A vector of the QP's size; what is beyond its variables is zero and stays so.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
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
        let mut sums: [f64; LANES] = core::array::from_fn(|lane| self.0[lane] * other.0[lane]);
        for from in (LANES..WIDTH).step_by(LANES) {
            for lane in 0..LANES {
                sums[lane] += self.0[from + lane] * other.0[from + lane];
            }
        }
        (sums[0] + sums[2]) + (sums[1] + sums[3])
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

    /// The entries from `from` on, zero before.
    #[inline(always)]
    pub fn beyond(&self, from: usize) -> Self {
        let mut rest = Self::ZERO;
        for i in 0..WIDTH {
            rest.0[i] = if i >= from { self.0[i] } else { 0.0 };
        }
        rest
    }

    /// Largest absolute entry; NaN is passed over.
    #[inline(always)]
    pub fn size(&self) -> f64 {
        let mut sizes = [0.0; LANES];
        for from in (0..WIDTH).step_by(LANES) {
            for lane in 0..LANES {
                let x = self.0[from + lane].abs();
                sizes[lane] = if x > sizes[lane] { x } else { sizes[lane] };
            }
        }
        sizes.into_iter().fold(0.0, f64::max)
    }
}

impl From<Row> for nalgebra::SVector<f64, VARIABLES> {
    #[inline(always)]
    fn from(row: Row) -> Self {
        Self::from_column_slice(&row.0[..VARIABLES])
    }
}
