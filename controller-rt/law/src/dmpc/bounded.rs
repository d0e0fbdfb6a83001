//! Convex quadratic programs with bounds only: a projected Newton method.
//!
//! ```text
//! minimise 1/2 z' H z + g' z   subject to   lower <= z <= upper
//! ```
//!
//! D. P. Bertsekas, *Projected Newton methods for optimization problems with simple constraints*,
//! SIAM J. Control Optim. 20(2), 1982. Each iteration holds the variables whose bound the gradient
//! presses against and takes a Newton step in the others, cut back at the bounds. The motion
//! layer's solver is for general rows; here there are none, and the bounds seldom act.

use nalgebra::{SMatrix, SVector};

/// Most iterations of one solve.
pub const ITERATIONS_MAX: u32 = 40;
/// Halvings of a step before it counts as none.
const HALVINGS_MAX: u32 = 30;
/// Share of the decrease that the slope promises with which a step is content [Bertsekas].
const DECREASE: f64 = 0.1;
/// A step shorter than this ends the search: rounding hides what a stiff cost gains beyond.
const STEP_MIN: f64 = 1e-7;

/// A minimiser, and how many iterations it took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<const N: usize> {
    /// The minimiser.
    pub z: SVector<f64, N>,
    /// Iterations used.
    pub iterations: u32,
}

/// Minimises from the point of the box nearest to zero; `None` when H is not positive definite,
/// something is not finite, or the iterations do not suffice.
pub fn minimise<const N: usize>(
    hessian: &SMatrix<f64, N, N>,
    gradient: &SVector<f64, N>,
    lower: &SVector<f64, N>,
    upper: &SVector<f64, N>,
) -> Option<Minimum<N>> {
    // Not `clamp`, which panics when the bounds cross.
    let project = |z: &SVector<f64, N>| z.sup(lower).inf(upper);
    let cost = |z: &SVector<f64, N>| 0.5 * z.dot(&(hessian * z)) + gradient.dot(z);
    let mut z = project(&SVector::zeros());
    for iterations in 1..=ITERATIONS_MAX {
        let slope = hessian * z + gradient;
        let free = SVector::<bool, N>::from_fn(|i, _| {
            !(z[i] <= lower[i] && slope[i] > 0.0 || z[i] >= upper[i] && slope[i] < 0.0)
        });
        let newton = solve_free(hessian, &slope, &free)?;
        if newton.amax().is_nan() {
            return None;
        }
        let now = cost(&z);
        let mut length = 1.0;
        let mut next = project(&(z - newton));
        for _ in 0..HALVINGS_MAX {
            if now - cost(&next) >= DECREASE * slope.dot(&(z - next)) {
                break;
            }
            length *= 0.5;
            next = project(&(z - length * newton));
        }
        let moved = (next - z).amax();
        z = next;
        if moved < STEP_MIN {
            return Some(Minimum { z, iterations });
        }
    }
    None
}

/// H⁻¹ s over the free variables, zero for the others; `None` when H is not positive definite.
fn solve_free<const N: usize>(
    hessian: &SMatrix<f64, N, N>,
    slope: &SVector<f64, N>,
    free: &SVector<bool, N>,
) -> Option<SVector<f64, N>> {
    // A held variable becomes a row of the identity, and its step zero.
    let mut reduced = *hessian;
    let mut step = *slope;
    for i in 0..N {
        if !free[i] {
            reduced.row_mut(i).fill(0.0);
            reduced.column_mut(i).fill(0.0);
            reduced[(i, i)] = 1.0;
            step[i] = 0.0;
        }
    }
    let factor = reduced.cholesky()?;
    factor.solve_mut(&mut step);
    Some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quadratic with condition number about 1e6, as a stiff terminal penalty gives.
    fn stiff() -> (SMatrix<f64, 6, 6>, SVector<f64, 6>) {
        let row = SVector::<f64, 6>::from_fn(|i, _| 1.0 + 0.3 * i as f64);
        let hessian = SMatrix::identity() + 1e6 * row * row.transpose();
        (hessian, SVector::from_fn(|i, _| if i % 2 == 0 { -3e6 } else { 1e6 }))
    }

    #[test]
    fn without_active_bounds_it_is_the_newton_step() {
        let (hessian, gradient) = stiff();
        let wide = SVector::repeat(1e9);
        let found = minimise(&hessian, &gradient, &-wide, &wide).expect("convex");
        let residual = (hessian * found.z + gradient).amax();
        assert!(residual < 1e-2, "{residual:e}");
        assert!(found.iterations <= 8, "{}", found.iterations);
    }

    #[test]
    fn the_minimum_meets_the_conditions_of_optimality() {
        let (hessian, gradient) = stiff();
        let (lower, upper) = (SVector::repeat(-0.5), SVector::from_fn(|i, _| 0.2 * (1 + i) as f64));
        let found = minimise(&hessian, &gradient, &lower, &upper).expect("convex");
        let slope = hessian * found.z + gradient;
        let mut held = 0;
        for i in 0..6 {
            let z = found.z[i];
            assert!((lower[i]..=upper[i]).contains(&z));
            if z == lower[i] || z == upper[i] {
                held += 1;
                assert!(if z == lower[i] { slope[i] > -1.0 } else { slope[i] < 1.0 });
            } else {
                assert!(slope[i].abs() < 1.0, "{i}: {}", slope[i]);
            }
        }
        assert!(held > 0, "this problem is made to press against its bounds");
    }

    #[test]
    fn what_has_no_minimum_is_refused() {
        let indefinite = -SMatrix::<f64, 2, 2>::identity();
        let (zero, one) = (SVector::zeros(), SVector::repeat(1.0));
        assert_eq!(minimise(&indefinite, &zero, &-one, &one), None);
        let broken = SVector::repeat(f64::NAN);
        assert_eq!(minimise(&SMatrix::identity(), &broken, &-one, &one), None);
    }
}
