//! Designs for delays of any rate by Wirtinger's inequality: less is lost than with Jensen's.
//!
//! The analysis multiplies the gain with several unknowns. Here x' stays a variable of its own,
//! tied to the rest by the plant's equation with multipliers (x + epsilon x')ᵀ X⁻¹ (Fridman's
//! descriptor method). In the coordinates X⁻¹ x every product of unknowns with K becomes Y = K X,
//! and for a fixed epsilon the inequality is linear:
//!
//! ```text
//! xi = [x, x', x(t - lambda), x(t - h), mean near, mean far, w, z]
//! He{G1ᵀ P G0} + S terms + h² R on x' - Γᵀ [diag(R, 3R) X12; *] Γ - gamma² w'w - z'z
//!   + He{(e1 + epsilon e2)ᵀ (A X e1 + B Y e3 + B_w e7 - X e2)} + He{e8ᵀ C X e1} < 0
//! ```
//!
//! at lambda = 0 and lambda = h, which decide for all between. K = Y X⁻¹.

use nalgebra::DMatrix;

use crate::analysis::{self, stacked};
use crate::lmi::{Affine, Blocks, Program, Unsolved};
use crate::plant::{Platoon, STATES};
use crate::theorem1::{MARGIN, place};
use crate::{Design, Undesigned};

/// Where the search over epsilon looks \[s\].
pub const EPSILON_GRID: [f64; 6] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.5];

/// Blocks of xi that are states: x, x', x(t - lambda), x(t - h) and two means.
const STATE_BLOCKS: usize = 6;

/// The gain of one truck with the least gamma over the grid, whose analysis is the last word.
///
/// # Errors
/// When there is none.
pub fn search(corners: &[Platoon], longest_s: f64) -> Result<Design, Undesigned> {
    let designs = EPSILON_GRID.iter().filter_map(|epsilon_s| {
        let k = at_epsilon(corners, longest_s, *epsilon_s).ok()?;
        let loops: Vec<_> = corners.iter().map(|platoon| platoon.closed(&k)).collect();
        let gamma = analysis::wirtinger_gamma(&loops, longest_s).ok()?;
        Some(Design { k, gamma, iterations: EPSILON_GRID.len() })
    });
    designs.min_by(|a, b| a.gamma.total_cmp(&b.gamma)).ok_or(Unsolved::Infeasible.into())
}

/// The gain for one epsilon.
///
/// # Errors
/// When there is none.
pub fn at_epsilon(
    corners: &[Platoon],
    longest_s: f64,
    epsilon_s: f64,
) -> Result<DMatrix<f64>, Undesigned> {
    let followers = corners[0].followers();
    let n = STATES * followers;
    let mut program = Program::new();
    let unknowns = Unknowns {
        p: program.symmetric(2 * n),
        s: program.symmetric(n),
        r: program.symmetric(n),
        cross: program.matrix(2 * n, 2 * n),
        x: program.matrix(n, n),
        y: program.matrix(followers, n),
    };
    let gamma2 = program.scalar();
    for positive in [&unknowns.p, &unknowns.s, &unknowns.r, &unknowns.coupled()] {
        program.require_positive(&Blocks::one(positive.clone()), MARGIN);
    }
    for platoon in corners {
        for delay_s in [0.0, longest_s] {
            let form = unknowns.form(platoon, [longest_s, delay_s, epsilon_s], &gamma2);
            program.require_negative(&Blocks::one(form), MARGIN);
        }
    }
    program.minimise(&gamma2);
    let solution = program.solve()?;
    let inverse = solution.value(&unknowns.x).try_inverse().ok_or(Undesigned::NoGain)?;
    let k = solution.value(&unknowns.y) * inverse;
    if k.iter().all(|x| x.is_finite()) { Ok(k) } else { Err(Undesigned::NoGain) }
}

struct Unknowns {
    p: Affine,
    s: Affine,
    r: Affine,
    cross: Affine,
    x: Affine,
    y: Affine,
}

impl Unknowns {
    /// [diag(R, 3R) X12; X12' diag(R, 3R)].
    fn coupled(&self) -> Affine {
        let n = self.r.shape().0;
        let at = |block: usize| place(4 * n, block * n, n);
        let once = &self.r.within(&at(0)) + &self.r.within(&at(2));
        let thrice = &(&self.r.within(&at(1)) + &self.r.within(&at(3))) * 3.0;
        let (above, below) = (place(4 * n, 0, 2 * n), place(4 * n, 2 * n, 2 * n));
        let cross = self.cross.left(&above.transpose()).right(&below).plus_transpose();
        &(&once + &thrice) + &cross
    }

    /// The whole inequality at one length of the delay; `times` are the longest delay, this one and
    /// epsilon \[s\].
    fn form(&self, platoon: &Platoon, times_s: [f64; 3], gamma2: &Affine) -> Affine {
        let [longest_s, delay_s, epsilon_s] = times_s;
        let (a, b_u, b_w, c) = (platoon.a(), platoon.b_u(), platoon.b_w(), platoon.c());
        let (n, inputs, outputs) = (a.nrows(), b_w.ncols(), c.nrows());
        let all = STATE_BLOCKS * n + inputs + outputs;
        let [now, rate, late, last, near, far] =
            [0, 1, 2, 3, 4, 5].map(|block| place(all, block * n, n));
        let disturbance = place(all, STATE_BLOCKS * n, inputs);
        let seen = place(all, STATE_BLOCKS * n + inputs, outputs);

        let zeta = stacked(&[&now, &(&near * delay_s + &far * (longest_s - delay_s))]);
        let zeta_rate = stacked(&[&rate, &(&now - &last)]);
        let energy = self.p.left(&zeta.transpose()).right(&zeta_rate).plus_transpose();
        let stored = &self.s.within(&now) - &self.s.within(&last);
        let spent = &self.r.within(&rate) * (longest_s * longest_s);
        let ends = stacked(&[
            &(&now - &late),
            &(&now + &late - &near * 2.0),
            &(&late - &last),
            &(&late + &last - &far * 2.0),
        ]);
        let regained = self.coupled().within(&ends);

        let drift = &self.x.left(&a).right(&now) - &self.x.right(&rate);
        let control = self.y.left(&b_u).right(&late);
        let pushed = Affine::constant(b_w * &disturbance);
        let equation = &(&drift + &control) + &pushed;
        let multiplier = &now + &rate * epsilon_s;
        let plant = equation.left(&multiplier.transpose()).plus_transpose();

        let output = self.x.left(&c).right(&now).left(&seen.transpose()).plus_transpose();
        let supply = &gamma2.times(&(disturbance.transpose() * &disturbance))
            + &Affine::constant(seen.transpose() * &seen);
        let functional = &(&(&energy + &stored) + &spent) - &regained;
        &(&(&functional + &plant) + &output) - &supply
    }
}
