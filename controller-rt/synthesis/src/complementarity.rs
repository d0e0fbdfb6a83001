//! The paper's way to Eq. 8's product: cone complementarity linearisation [MCF, Eq. 12].
//!
//! S stands for P Z⁻¹ P through T = S⁻¹, J = P⁻¹, R = Z⁻¹, which become unknowns of their own:
//!
//! ```text
//! minimise  tr(S T_k + T S_k + P J_k + J P_k + Z R_k + R Z_k)
//! subject to Eq. 8,  [T J; J R] >= 0,  [S I; I T] >= 0,  [P I; I J] >= 0,  [Z I; I R] >= 0
//! ```
//!
//! from identity on. The paper leaves out that Eq. 12 has no gamma, so that it decides whether one
//! is reached, and when to stop: here as soon as the analysis of the gain itself confirms gamma.

use certificate::DelayBound;
use nalgebra::DMatrix;

use crate::analysis;
use crate::lmi::{Affine, Blocks, Program};
use crate::plant::{Platoon, STATES};
use crate::theorem1::Unknowns;
use crate::{Design, Undesigned};

/// Linearisations before a gamma counts as out of reach.
pub const ITERATIONS_MAX: usize = 40;

/// The six matrices that the objective pairs.
#[derive(Debug, Clone)]
struct Pairs {
    s: DMatrix<f64>,
    t: DMatrix<f64>,
    p: DMatrix<f64>,
    j: DMatrix<f64>,
    z: DMatrix<f64>,
    r: DMatrix<f64>,
}

impl Pairs {
    fn identity(n: usize) -> Self {
        let unit = DMatrix::identity(n, n);
        Self {
            s: unit.clone(),
            t: unit.clone(),
            p: unit.clone(),
            j: unit.clone(),
            z: unit.clone(),
            r: unit,
        }
    }
}

/// A gain that reaches `gamma`; `progress` hears of every linearisation.
///
/// # Errors
/// When it is not reached.
pub fn reach(
    platoon: &Platoon,
    delay: DelayBound,
    gamma: f64,
    progress: &mut dyn FnMut(usize),
) -> Result<Design, Undesigned> {
    let mut pairs = Pairs::identity(STATES * platoon.followers());
    for iteration in 1..=ITERATIONS_MAX {
        progress(iteration);
        let (k, next) = linearised(platoon, delay, gamma, &pairs)?;
        let confirmed = analysis::jensen_gamma(&[platoon.closed(&k)], delay);
        if let Ok(confirmed) = confirmed
            && confirmed <= gamma
        {
            return Ok(Design { k, gamma: confirmed, iterations: iteration });
        }
        pairs = next;
    }
    Err(Undesigned::NotReached { gamma, iterations: ITERATIONS_MAX })
}

/// The gain with the least gamma that this way reaches, to within `tolerance`, relative.
///
/// # Errors
/// When not even `worst` is reached.
pub fn least(
    platoon: &Platoon,
    delay: DelayBound,
    worst: f64,
    tolerance: f64,
    progress: &mut dyn FnMut(usize),
) -> Result<Design, Undesigned> {
    let mut best = reach(platoon, delay, worst, progress)?;
    let mut missed = 0.0;
    while best.gamma - missed > tolerance * best.gamma {
        let gamma = 0.5 * (best.gamma + missed);
        match reach(platoon, delay, gamma, progress) {
            Ok(better) => best = better,
            Err(_) => missed = gamma,
        }
    }
    Ok(best)
}

/// One linearised program: the gain, and where to linearise next.
fn linearised(
    platoon: &Platoon,
    delay: DelayBound,
    gamma: f64,
    at: &Pairs,
) -> Result<(DMatrix<f64>, Pairs), Undesigned> {
    let n = STATES * platoon.followers();
    let mut program = Program::new();
    let unknowns = Unknowns::new(&mut program, platoon.followers(), delay.rate);
    let [s, t, j, r] = [(); 4].map(|()| program.symmetric(n));
    let gamma2 = Affine::constant(DMatrix::from_element(1, 1, gamma * gamma));
    let inequality = unknowns.inequality(platoon, delay, &s, &gamma2);
    program.require_negative(&inequality, crate::theorem1::MARGIN);

    let pair = |a: &Affine, b: &Affine, c: &Affine| {
        Blocks::new(&[n, n]).with(0, 0, a.clone()).with(0, 1, b.clone()).with(1, 1, c.clone())
    };
    let unit = Affine::constant(DMatrix::identity(n, n));
    let (p, z) = (&unknowns.p, &unknowns.z);
    for (a, b, c) in [(&t, &j, &r), (&s, &unit, &t), (p, &unit, &j), (z, &unit, &r)] {
        program.require_positive(&pair(a, b, c), 0.0);
    }
    let objective = [(&s, &at.t), (&t, &at.s), (p, &at.j), (&j, &at.p), (z, &at.r), (&r, &at.z)]
        .into_iter()
        .fold(Affine::zeros(1, 1), |sum, (unknown, with)| &sum + &unknown.trace_with(with));
    program.minimise(&objective);

    let solution = program.solve()?;
    let k = unknowns.gain(&solution).ok_or(Undesigned::NoGain)?;
    let value = |unknown: &Affine| solution.value(unknown);
    let next =
        Pairs { s: value(&s), t: value(&t), p: value(p), j: value(&j), z: value(z), r: value(&r) };
    Ok((k, next))
}
