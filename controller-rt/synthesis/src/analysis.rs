//! Proofs for a gain that is given: the matrices of a certificate, and the least gamma they prove.
//!
//! With the gain fixed, Theorem 1 needs no linearisation: it is linear in P, Q, Z and gamma². Every
//! proof is sought twice. The first search finds the least gamma; its matrices lie on the boundary,
//! where rounding decides. The second takes a slightly larger gamma and goes as far inside as it
//! can, so that the proof survives being written down, rounded, and checked exactly.
//!
//! Several loops at once have one proof in common: a plant whose lag lies between two values is a
//! mixture of the two, and both inequalities are convex in that mixture.

use certificate::{DelayBound, Jensen, Rate, Wirtinger};
use nalgebra::DMatrix;

use crate::lmi::{Affine, Blocks, Program, Solution, Unsolved};
use crate::plant::Loop;
use crate::theorem1::{MARGIN, place};

/// By how much the proven gamma exceeds the least one.
const GAMMA_SLACK: f64 = 2e-3;
/// Upper bound on the depth of a proof, so that the deepest one exists.
const DEPTH_MAX: f64 = 1.0;

/// The least gamma that Jensen's inequality proves, and its proof with a little room.
///
/// # Errors
/// When there is no proof.
pub fn jensen(loops: &[Loop], delay: DelayBound) -> Result<Jensen, Unsolved> {
    let gamma = jensen_gamma(loops, delay)?;
    let gamma = rounded_up(gamma * (1.0 + GAMMA_SLACK));
    let mut program = Program::new();
    let unknowns = JensenUnknowns::new(&mut program, loops, delay);
    let gamma2 = Affine::constant(DMatrix::from_element(1, 1, gamma * gamma));
    let solution = deepest(&mut program, |program, depth| {
        unknowns.require(program, loops, delay, &gamma2, depth);
    })?;
    Ok(Jensen {
        gamma,
        p: symmetric(&solution, &unknowns.p),
        z: symmetric(&solution, &unknowns.z),
        q: unknowns.q.as_ref().map(|q| symmetric(&solution, q)),
    })
}

/// The least gamma that Jensen's inequality proves.
///
/// # Errors
/// When there is no proof for any.
pub fn jensen_gamma(loops: &[Loop], delay: DelayBound) -> Result<f64, Unsolved> {
    let mut program = Program::new();
    let unknowns = JensenUnknowns::new(&mut program, loops, delay);
    let gamma2 = program.scalar();
    let margin = Affine::constant(DMatrix::from_element(1, 1, MARGIN));
    unknowns.require(&mut program, loops, delay, &gamma2, &margin);
    program.minimise(&gamma2);
    least_gamma(&program.solve()?, &gamma2)
}

/// The least gamma that Wirtinger's inequality with a reciprocally convex bound proves for delays
/// of any rate, and its proof with a little room.
///
/// # Errors
/// When there is no proof.
pub fn wirtinger(loops: &[Loop], longest_s: f64) -> Result<Wirtinger, Unsolved> {
    let gamma = wirtinger_gamma(loops, longest_s)?;
    let gamma = rounded_up(gamma * (1.0 + GAMMA_SLACK));
    let mut program = Program::new();
    let unknowns = WirtingerUnknowns::new(&mut program, loops);
    let gamma2 = Affine::constant(DMatrix::from_element(1, 1, gamma * gamma));
    let solution = deepest(&mut program, |program, depth| {
        unknowns.require(program, loops, longest_s, &gamma2, depth);
    })?;
    Ok(Wirtinger {
        gamma,
        p: symmetric(&solution, &unknowns.p),
        s: symmetric(&solution, &unknowns.s),
        r: symmetric(&solution, &unknowns.r),
        x: solution.value(&unknowns.x),
    })
}

/// The least gamma that Wirtinger's inequality proves.
///
/// # Errors
/// When there is no proof for any.
pub fn wirtinger_gamma(loops: &[Loop], longest_s: f64) -> Result<f64, Unsolved> {
    let mut program = Program::new();
    let unknowns = WirtingerUnknowns::new(&mut program, loops);
    let gamma2 = program.scalar();
    let margin = Affine::constant(DMatrix::from_element(1, 1, MARGIN));
    unknowns.require(&mut program, loops, longest_s, &gamma2, &margin);
    program.minimise(&gamma2);
    least_gamma(&program.solve()?, &gamma2)
}

fn least_gamma(solution: &Solution, gamma2: &Affine) -> Result<f64, Unsolved> {
    let gamma2 = solution.number(gamma2);
    if gamma2 > 0.0 { Ok(gamma2.sqrt()) } else { Err(Unsolved::NoProgress) }
}

/// Solves for the proof that is farthest from the boundary.
fn deepest(
    program: &mut Program,
    require: impl Fn(&mut Program, &Affine),
) -> Result<Solution, Unsolved> {
    let depth = program.scalar();
    require(program, &depth);
    let room = &Affine::constant(DMatrix::from_element(1, 1, DEPTH_MAX)) - &depth;
    program.require_positive(&Blocks::one(room), 0.0);
    program.minimise(&-&depth);
    let solution = program.solve()?;
    if solution.number(&depth) > 0.0 { Ok(solution) } else { Err(Unsolved::Infeasible) }
}

/// Four digits are enough for a gamma, and rounding up keeps it proven.
fn rounded_up(gamma: f64) -> f64 {
    (gamma * 1e4).ceil() / 1e4
}

/// A value that is symmetric to the last bit.
fn symmetric(solution: &Solution, expression: &Affine) -> DMatrix<f64> {
    let value = solution.value(expression);
    DMatrix::from_fn(value.nrows(), value.ncols(), |i, j| value[(i.min(j), i.max(j))])
}

/// Requires that a matrix exceeds `depth` times identity.
fn require_above(program: &mut Program, matrix: &Affine, depth: &Affine) {
    let n = matrix.shape().0;
    let gap = matrix - &depth.times(&DMatrix::identity(n, n));
    program.require_positive(&Blocks::one(gap), 0.0);
}

/// P, Z and, where it helps, Q.
struct JensenUnknowns {
    p: Affine,
    z: Affine,
    q: Option<Affine>,
}

impl JensenUnknowns {
    fn new(program: &mut Program, loops: &[Loop], delay: DelayBound) -> Self {
        let n = loops[0].a.nrows();
        let (p, z) = (program.symmetric(n), program.symmetric(n));
        let q = matches!(delay.rate, Rate::Below(_)).then(|| program.symmetric(n));
        Self { p, z, q }
    }

    fn require(
        &self,
        program: &mut Program,
        loops: &[Loop],
        delay: DelayBound,
        gamma2: &Affine,
        depth: &Affine,
    ) {
        for matrix in [Some(&self.p), Some(&self.z), self.q.as_ref()].into_iter().flatten() {
            require_above(program, matrix, depth);
        }
        for closed in loops {
            let sizes = [closed.a.nrows(), closed.a.nrows(), closed.input.ncols()];
            let mut inequality = self.inequality(closed, delay, gamma2);
            for (block, size) in sizes.into_iter().enumerate() {
                let room = depth.times(&DMatrix::identity(size, size));
                inequality = inequality.with(block, block, room);
            }
            program.require_negative(&inequality, 0.0);
        }
    }

    /// V' + z'z - gamma² w'w as a form in (x(t), x(t - lambda), w), after Jensen's inequality.
    fn inequality(&self, closed: &Loop, delay: DelayBound, gamma2: &Affine) -> Blocks {
        let Loop { a, delayed, input, output } = closed;
        let h = delay.longest_s;
        let held = &self.z * (1.0 / h);
        // h x''Z x' with x' = [A A_d B] (x, x_lambda, w).
        let rate = |left: &DMatrix<f64>, right: &DMatrix<f64>| {
            &self.z.left(&left.transpose()).right(right) * h
        };
        let energy = Affine::constant(output.transpose() * output);
        let mut first = &(&self.p.right(a).plus_transpose() - &held) + &energy;
        let mut second = -&held;
        if let (Some(q), Rate::Below(mu)) = (&self.q, delay.rate) {
            first = &first + &(q * (1.0 / (1.0 - mu)));
            second = &second - q;
        }
        let inputs = input.ncols();
        Blocks::new(&[a.nrows(), a.nrows(), inputs])
            .with(0, 0, &first + &rate(a, a))
            .with(0, 1, &(&self.p.right(delayed) + &held) + &rate(a, delayed))
            .with(0, 2, &self.p.right(input) + &rate(a, input))
            .with(1, 1, &second + &rate(delayed, delayed))
            .with(1, 2, rate(delayed, input))
            .with(2, 2, &rate(input, input) - &gamma2.times(&DMatrix::identity(inputs, inputs)))
    }
}

/// P, S, R and X of Wirtinger's functional.
struct WirtingerUnknowns {
    p: Affine,
    s: Affine,
    r: Affine,
    x: Affine,
}

impl WirtingerUnknowns {
    fn new(program: &mut Program, loops: &[Loop]) -> Self {
        let n = loops[0].a.nrows();
        Self {
            p: program.symmetric(2 * n),
            s: program.symmetric(n),
            r: program.symmetric(n),
            x: program.matrix(2 * n, 2 * n),
        }
    }

    fn require(
        &self,
        program: &mut Program,
        loops: &[Loop],
        longest_s: f64,
        gamma2: &Affine,
        depth: &Affine,
    ) {
        for matrix in [&self.p, &self.s, &self.r, &self.coupled()] {
            require_above(program, matrix, depth);
        }
        for closed in loops {
            for delay_s in [0.0, longest_s] {
                let form = self.form(closed, longest_s, delay_s, gamma2);
                require_above(program, &-&form, depth);
            }
        }
    }

    /// [diag(R, 3R) X; X' diag(R, 3R)], the reciprocally convex bound's matrix.
    fn coupled(&self) -> Affine {
        let n = self.r.shape().0;
        let at = |block: usize| place(4 * n, block * n, n);
        let once = &self.r.within(&at(0)) + &self.r.within(&at(2));
        let thrice = &(&self.r.within(&at(1)) + &self.r.within(&at(3))) * 3.0;
        let (above, below) = (place(4 * n, 0, 2 * n), place(4 * n, 2 * n, 2 * n));
        let cross = self.x.left(&above.transpose()).right(&below).plus_transpose();
        &(&once + &thrice) + &cross
    }

    /// V' + z'z - gamma² w'w as a form in (x, x_lambda, x_h, mean of x over [t - lambda, t], mean
    /// over [t - h, t - lambda], w), at one length of the delay.
    fn form(&self, closed: &Loop, longest_s: f64, delay_s: f64, gamma2: &Affine) -> Affine {
        let Loop { a, delayed, input, output } = closed;
        let (n, inputs) = (a.nrows(), input.ncols());
        let all = 5 * n + inputs;
        let [now, late, last, near, far] = [0, 1, 2, 3, 4].map(|i| place(all, i * n, n));
        let disturbance = place(all, 5 * n, inputs);
        let rate = a * &now + delayed * &late + input * &disturbance;
        // zeta = [x; integral of x over the whole delay interval] and its rate.
        let zeta = stacked(&[&now, &(&near * delay_s + &far * (longest_s - delay_s))]);
        let zeta_rate = stacked(&[&rate, &(&now - &last)]);
        let energy = self.p.left(&zeta.transpose()).right(&zeta_rate).plus_transpose();
        let stored = &self.s.within(&now) - &self.s.within(&last);
        let spent = &self.r.within(&rate) * (longest_s * longest_s);
        let gamma = stacked(&[
            &(&now - &late),
            &(&now + &late - &near * 2.0),
            &(&late - &last),
            &(&late + &last - &far * 2.0),
        ]);
        let regained = self.coupled().within(&gamma);
        let seen = output * &now;
        let supply = &Affine::constant(seen.transpose() * seen)
            - &gamma2.times(&(disturbance.transpose() * &disturbance));
        &(&(&(&energy + &stored) + &spent) - &regained) + &supply
    }
}

/// Matrices on top of each other.
pub(crate) fn stacked(parts: &[&DMatrix<f64>]) -> DMatrix<f64> {
    let rows: usize = parts.iter().map(|part| part.nrows()).sum();
    let mut whole = DMatrix::zeros(rows, parts[0].ncols());
    let mut top = 0;
    for part in parts {
        whole.rows_mut(top, part.nrows()).copy_from(*part);
        top += part.nrows();
    }
    whole
}
