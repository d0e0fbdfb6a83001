//! How far a point is from satisfying the optimality conditions.

use nalgebra::SVector;

use super::{CONSTRAINTS, Qp, VARIABLES};

/// Largest scaled residual of the Karush-Kuhn-Tucker conditions, dimensionless.
///
/// `multipliers[i]` is positive when constraint i's lower limit holds it, negative for its upper.
///
/// ```text
/// stationarity     |H z + g - A' m|  /  (1 + max(|H z|, |g|, |A' m|))
/// feasibility      violation         /  (1 + |limit|)
/// complementarity  min(|m|, distance to the limit that m belongs to)
/// ```
///
/// [Nocedal & Wright, *Numerical Optimization*, 2nd ed., Theorem 12.1.]
pub fn kkt_residual(qp: &Qp, z: &SVector<f64, VARIABLES>, multipliers: &[f64; CONSTRAINTS]) -> f64 {
    let values = qp.values(z);
    let mut pull = SVector::<f64, VARIABLES>::zeros();
    let mut worst = 0.0_f64;
    for i in 0..CONSTRAINTS {
        let (value, lower, upper, m) = (values[i], qp.lower[i], qp.upper[i], multipliers[i]);
        worst = largest(worst, (lower - value) / (1.0 + lower.abs()));
        worst = largest(worst, (value - upper) / (1.0 + upper.abs()));
        if m != 0.0 {
            pull += qp.normal(i) * m;
            let room = if m > 0.0 { value - lower } else { upper - value };
            worst = largest(worst, m.abs().min(room.abs()));
        }
    }
    let curve = qp.hessian * z;
    let scale = 1.0 + curve.amax().max(qp.gradient.amax()).max(pull.amax());
    let stationarity = (curve + qp.gradient - pull).amax() / scale;
    if stationarity.is_nan() { f64::INFINITY } else { largest(worst, stationarity) }
}

/// The larger of two numbers; limits at infinity give NaN ratios, which do not count.
fn largest(so_far: f64, candidate: f64) -> f64 {
    if candidate > so_far { candidate } else { so_far }
}
