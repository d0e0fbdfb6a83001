//! How far a point is from satisfying the optimality conditions.

use nalgebra::SVector;

use super::excess::Excess;
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
    let mut excess = Excess::EMPTY;
    excess.look(qp, &z);
    let (mut pull, mut worst) = (Row::ZERO, excess.relative(qp));
    for (i, &m) in multipliers.iter().enumerate().filter(|&(_, &m)| m != 0.0) {
        pull.add_scaled(m, &qp.normal(i));
        let value = excess.values[i];
        let room = if m > 0.0 { value - qp.lower[i] } else { qp.upper[i] - value };
        worst = larger(worst, m.abs().min(room.abs()));
    }
    larger(worst, stationarity(qp, &qp.slope(&z), &pull))
}

/// The residual of stationarity, for `H z + g` and `A' m`; infinite when something is not a number.
#[inline(always)]
pub fn stationarity(qp: &Qp, slope: &Row, pull: &Row) -> f64 {
    let scale = 1.0 + larger(slope.size(), larger(qp.gradient_row().size(), pull.size()));
    let mut rest = *pull;
    rest.add_scaled(-1.0, slope);
    let stationarity = rest.size() / scale;
    // Sizes pass over NaN; a sum does not.
    let is_number = !(rest.0.iter().sum::<f64>() + stationarity).is_nan();
    if is_number { stationarity } else { f64::INFINITY }
}

/// The larger of two numbers; a candidate that is NaN does not count.
#[inline(always)]
pub fn larger(so_far: f64, candidate: f64) -> f64 {
    if candidate > so_far { candidate } else { so_far }
}
