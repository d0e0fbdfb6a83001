//! How far every constraint is from holding at a point.

use super::row::{LANES, Row};
use super::{Active, CONSTRAINTS, INPUTS, Qp, ROWS, VARIABLES};

/// The constrained quantities at a point, against their limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excess {
    /// The variables, then A z.
    pub values: [f64; CONSTRAINTS],
    /// By how much each exceeds one of its limits; not positive where both hold, NaN where the
    /// numbers allow no statement.
    pub of: [f64; CONSTRAINTS],
    /// Zero when all limits hold, NaN or positive when not.
    total: f64,
}

impl Excess {
    /// Nothing looked at yet.
    pub const EMPTY: Self =
        Self { values: [0.0; CONSTRAINTS], of: [0.0; CONSTRAINTS], total: f64::NAN };

    /// Looks at all constraints.
    #[inline(always)]
    pub fn look(&mut self, qp: &Qp, z: &Row) {
        self.values[..VARIABLES].copy_from_slice(&z.0[..VARIABLES]);
        let mut totals = [0.0; LANES];
        // The last four overlap with those before, here and below.
        for part in 0..VARIABLES.div_ceil(LANES) {
            self.compare(qp, (part * LANES).min(VARIABLES - LANES), &mut totals);
        }
        let columns = qp.rows.as_slice();
        // They are zero nearly always.
        let are_slacks_used = z.0[INPUTS..VARIABLES].iter().any(|&slack| slack != 0.0);
        for part in 0..ROWS.div_ceil(LANES) {
            let from = (part * LANES).min(ROWS - LANES);
            let mut sums = [0.0; LANES];
            for j in 0..INPUTS {
                for lane in 0..LANES {
                    sums[lane] += columns[j * ROWS + from + lane] * z.0[j];
                }
            }
            if are_slacks_used {
                for j in INPUTS..VARIABLES {
                    for lane in 0..LANES {
                        sums[lane] += columns[j * ROWS + from + lane] * z.0[j];
                    }
                }
            }
            self.values[VARIABLES + from..][..LANES].copy_from_slice(&sums);
            self.compare(qp, VARIABLES + from, &mut totals);
        }
        self.total = (totals[0] + totals[2]) + (totals[1] + totals[3]);
    }

    /// Compares [`LANES`] values with their limits.
    #[inline(always)]
    fn compare(&mut self, qp: &Qp, from: usize, totals: &mut [f64; LANES]) {
        for lane in 0..LANES {
            let value = self.values[from + lane];
            let (low, high) = (qp.lower[from + lane] - value, value - qp.upper[from + lane]);
            // Written so that NaN in either stays.
            let larger = if low <= high { high } else { low };
            let excess = if high.is_nan() { high } else { larger };
            self.of[from + lane] = excess;
            totals[lane] += if excess <= 0.0 { 0.0 } else { excess };
        }
    }

    /// Whether every limit holds but for `tolerance`, by its absolute size.
    #[inline(always)]
    pub fn is_within(&self, tolerance: f64) -> bool {
        // Written so that NaN is not.
        self.total <= tolerance || self.of.iter().all(|&excess| excess <= tolerance)
    }

    /// The limit of constraint i that is exceeded, or nearer.
    #[inline(always)]
    pub fn nearer(&self, qp: &Qp, i: usize) -> Active {
        Active { constraint: i as u8, upper: self.values[i] - qp.upper[i] == self.of[i] }
    }

    /// Largest excess relative to its limit, 0 when there is none.
    #[inline(always)]
    pub fn relative(&self, qp: &Qp) -> f64 {
        let mut worst = 0.0;
        if self.total == 0.0 {
            return worst;
        }
        for (i, &excess) in self.of.iter().enumerate() {
            // What is not worse as it is, is not relative to its limit either.
            if excess > worst {
                let limit = qp.limit(self.nearer(qp, i));
                let relative = excess / (1.0 + limit.abs());
                // An infinite limit gives NaN, which does not count.
                worst = if relative > worst { relative } else { worst };
            }
        }
        worst
    }
}
