//! Better than the paper: Eq. 8's product bounded from a tangent, which is convex at once.
//!
//! For every rho > 0 and every G,
//!
//! ```text
//! -P Z⁻¹ P <= rho² Z - 2 rho P,     -P Z⁻¹ P <= G'Z G - P G - G'P
//! ```
//!
//! because the differences are squares, (P - rho Z) Z⁻¹ (P - rho Z) and (P - G'Z) Z⁻¹ (P - Z G).
//! The first turns Eq. 8 into one semidefinite program per rho, gamma² its objective, and rho is a
//! number to search over. The second, with G = Z⁻¹ P of the solution before, touches the product
//! there, so every refinement can only improve.

use certificate::DelayBound;
use nalgebra::DMatrix;

use crate::analysis;
use crate::lmi::{Affine, Blocks, Program, Unsolved};
use crate::plant::{Platoon, STATES};
use crate::theorem1::{MARGIN, Unknowns};
use crate::{Design, Undesigned};

/// Where the search over rho looks.
pub const RHO_GRID: [f64; 8] = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5];
/// Least eigenvalue of Z: its smallest one would otherwise run to 0, and G away with it.
const Z_LEAST: f64 = 1e-2;
/// Refinements end when gamma falls by less than this, relative.
const IMPROVEMENT_LEAST: f64 = 2e-3;
/// Refinements at most.
const REFINEMENTS_MAX: usize = 15;

/// One solution of the bounded inequality.
#[derive(Debug, Clone)]
pub struct Tangent {
    /// The gamma that the bounded inequality itself proves, before the gain is analysed afresh.
    pub gamma: f64,
    /// The gain.
    pub k: DMatrix<f64>,
    p: DMatrix<f64>,
    z: DMatrix<f64>,
}

/// The best gain for one rho, the same for every platoon of `corners`: one unknown plant between
/// them.
///
/// # Errors
/// When there is none.
pub fn at_rho(corners: &[Platoon], delay: DelayBound, rho: f64) -> Result<Tangent, Undesigned> {
    solve(corners, delay, |unknowns| &(&unknowns.p * (2.0 * rho)) - &(&unknowns.z * (rho * rho)))
}

/// The best gain over the grid of rho.
///
/// # Errors
/// When there is none for any.
pub fn search(corners: &[Platoon], delay: DelayBound) -> Result<Tangent, Undesigned> {
    let found = RHO_GRID.iter().filter_map(|rho| at_rho(corners, delay, *rho).ok());
    found.min_by(|a, b| a.gamma.total_cmp(&b.gamma)).ok_or(Unsolved::Infeasible.into())
}

/// Refines until it no longer pays; `progress` hears of every step with its gamma.
///
/// # Errors
/// When there is no gain to start from, or none whose analysis confirms it.
pub fn refined(
    corners: &[Platoon],
    delay: DelayBound,
    progress: &mut dyn FnMut(usize, f64),
) -> Result<Design, Undesigned> {
    let mut best = search(corners, delay)?;
    let mut steps = 0;
    while steps < REFINEMENTS_MAX {
        let Some(inverse) = best.z.clone().try_inverse() else { break };
        let g = inverse * &best.p;
        let next = solve(corners, delay, |unknowns| {
            let twice = unknowns.p.right(&g).plus_transpose();
            &twice - &unknowns.z.within(&g)
        });
        let Ok(next) = next else { break };
        steps += 1;
        progress(steps, next.gamma);
        let is_enough = next.gamma > best.gamma * (1.0 - IMPROVEMENT_LEAST);
        if next.gamma < best.gamma {
            best = next;
        }
        if is_enough {
            break;
        }
    }
    confirmed(corners, delay, best.k, steps)
}

/// The design with the gamma that its own analysis proves.
///
/// # Errors
/// When it proves none.
pub fn confirmed(
    corners: &[Platoon],
    delay: DelayBound,
    k: DMatrix<f64>,
    iterations: usize,
) -> Result<Design, Undesigned> {
    let loops: Vec<_> = corners.iter().map(|platoon| platoon.closed(&k)).collect();
    let gamma = analysis::jensen_gamma(&loops, delay)?;
    Ok(Design { k, gamma, iterations })
}

/// Eq. 8 with a bound in place of its product, gamma² as the objective.
fn solve(
    corners: &[Platoon],
    delay: DelayBound,
    product: impl Fn(&Unknowns) -> Affine,
) -> Result<Tangent, Undesigned> {
    let followers = corners[0].followers();
    let mut program = Program::new();
    let unknowns = Unknowns::new(&mut program, followers, delay.rate);
    let gamma2 = program.scalar();
    let s = product(&unknowns);
    for platoon in corners {
        let inequality = unknowns.inequality(platoon, delay, &s, &gamma2);
        program.require_negative(&inequality, MARGIN);
    }
    let n = STATES * followers;
    let floor = DMatrix::identity(n, n) * Z_LEAST;
    program.require_positive(&Blocks::one(&unknowns.z - &Affine::constant(floor)), 0.0);
    program.minimise(&gamma2);
    let solution = program.solve()?;
    let gamma2 = solution.number(&gamma2);
    let k = unknowns.gain(&solution).filter(|_| gamma2 > 0.0).ok_or(Undesigned::NoGain)?;
    let (p, z) = (solution.value(&unknowns.p), solution.value(&unknowns.z));
    Ok(Tangent { gamma: gamma2.sqrt(), k, p, z })
}
