//! How far a point is from satisfying the optimality conditions.

use nalgebra::SVector;

use super::row::Row;
use super::{CONSTRAINTS, Qp, VARIABLES};

/// Largest scaled residual of the Karush-Kuhn-Tucker conditions, dimensionless.
///
/// `multipliers[i]` is positive when constraint i's lower limit holds it, negative for its upper.
///
/// ```text
/// stationarity     |H z + g - A' m|  /  (1 + max(|H z + g|, |g|, |A' m|))
/// feasibility      violation         /  (1 + |limit|)
/// complementarity  min(|m|, distance to the limit that m belongs to)
/// ```
///
/// [Nocedal & Wright, *Numerical Optimization*, 2nd ed., Theorem 12.1.]
pub fn kkt_residual(qp: &Qp, z: &SVector<f64, VARIABLES>, multipliers: &[f64; CONSTRAINTS]) -> f64 {
    let z = Row::of(z.as_slice());
    let held = multipliers.iter().copied().enumerate().filter(|&(_, m)| m != 0.0);
    residual_at(qp, &qp.slope(&z), &qp.values(&z), held)
}

/// The same at a point whose slope `H z + g` and constrained quantities are known already, for the
/// multipliers that are not zero.
pub fn residual_at(
    qp: &Qp,
    slope: &Row,
    values: &[f64; CONSTRAINTS],
    multipliers: impl Iterator<Item = (usize, f64)>,
) -> f64 {
    let mut pull = Row::ZERO;
    let mut worst = feasibility(qp, values);
    for (i, m) in multipliers {
        pull.add_scaled(m, &qp.normal(i));
        let room = if m > 0.0 { values[i] - qp.lower[i] } else { qp.upper[i] - values[i] };
        worst = largest(worst, m.abs().min(room.abs()));
    }
    let size = |row: &Row| row.0.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    let scale = 1.0 + size(slope).max(qp.gradient.amax()).max(size(&pull));
    pull.add_scaled(-1.0, slope);
    let stationarity = size(&pull) / scale;
    // `max` passes over NaN; a sum does not.
    match (pull.0.iter().sum::<f64>() + stationarity).is_nan() {
        true => f64::INFINITY,
        false => largest(worst, stationarity),
    }
}

/// Largest violation relative to its limit, 0 when there is none.
fn feasibility(qp: &Qp, values: &[f64; CONSTRAINTS]) -> f64 {
    let mut worst = 0.0;
    for ((value, lower), upper) in values.iter().zip(&qp.lower).zip(&qp.upper) {
        for (violation, limit) in [(lower - value, lower), (value - upper, upper)] {
            // What is not worse as it is, is not relative to its limit either.
            if violation > worst {
                worst = largest(worst, violation / (1.0 + limit.abs()));
            }
        }
    }
    worst
}

/// The larger of two numbers; limits at infinity give NaN ratios, which do not count.
fn largest(so_far: f64, candidate: f64) -> f64 {
    if candidate > so_far { candidate } else { so_far }
}
