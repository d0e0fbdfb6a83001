//! Theorem 1 [MCF, Eq. 8], corrected.
//!
//! With K = Y P⁻¹ (the paper prints Y P) and S in place of P Z⁻¹ P, for positive P, Q, Z (the paper
//! prints negative ones in Eq. 12):
//!
//! ```text
//! [ A P + P A' + Q/(1-mu) - Z/h    B Y + Z/h    B_w       P A'      P C' ]
//! [ *                              -Q - Z/h     0         (B Y)'    0    ]
//! [ *                              *            -gamma²   B_w'      0    ]  < 0
//! [ *                              *            *         -S/h      0    ]
//! [ *                              *            *         *         -I   ]
//! ```
//!
//! It is sufficient, not necessary as the paper says: Jensen's inequality loses something. Below
//! the rate bound mu, Q helps; with Q = 0 the delay may change at any rate, jump included, and that
//! is how messages that are held until the next one comes behave.
//!
//! Ours: with a weight r of the command, z = [s, r u] has a sixth row and column, r Y' in its
//! second place and -I in its last, and gains that command less come out.

use certificate::{DelayBound, Rate};
use nalgebra::DMatrix;

use crate::lmi::{Affine, Blocks, Program, Solution};
use crate::plant::{Platoon, STATES};

/// Least eigenvalue asked of the unknowns that must be positive, and of the inequality itself.
pub const MARGIN: f64 = 1e-7;

/// The unknowns of Eq. 8.
#[derive(Debug, Clone)]
pub struct Unknowns {
    /// P: block diagonal, so that K has the structure of Y.
    pub p: Affine,
    /// Z.
    pub z: Affine,
    /// Q, where the rate of the delay is bounded.
    pub q: Option<Affine>,
    /// Y: nonzero for a follower itself and for the one ahead of it.
    pub y: Affine,
}

impl Unknowns {
    /// Fresh unknowns of a program, required to be positive.
    pub fn new(program: &mut Program, followers: usize, rate: Rate) -> Self {
        let n = STATES * followers;
        let mut p = Affine::zeros(n, n);
        let mut y = Affine::zeros(followers, n);
        for i in 0..followers {
            let own = place(n, STATES * i, STATES);
            p = &p + &program.symmetric(STATES).within(&own);
            let row = place(followers, i, 1).transpose();
            y = &y + &program.matrix(1, STATES).left(&row).right(&own);
            if i > 0 {
                let ahead = place(n, STATES * (i - 1), STATES);
                y = &y + &program.matrix(1, STATES).left(&row).right(&ahead);
            }
        }
        let z = program.symmetric(n);
        let q = matches!(rate, Rate::Below(_)).then(|| program.symmetric(n));
        for positive in [Some(&p), Some(&z), q.as_ref()].into_iter().flatten() {
            program.require_positive(&Blocks::one(positive.clone()), MARGIN);
        }
        Self { p, z, q, y }
    }

    /// The left side of Eq. 8, with `s` for P Z⁻¹ P and `gamma2` for gamma².
    #[must_use]
    pub fn inequality(
        &self,
        platoon: &Platoon,
        delay: DelayBound,
        s: &Affine,
        gamma2: &Affine,
    ) -> Blocks {
        let (a, b_u, b_w, c) = (platoon.a(), platoon.b_u(), platoon.b_w(), platoon.c());
        let (n, inputs, outputs) = (a.nrows(), b_w.ncols(), c.nrows());
        let per_delay = 1.0 / delay.longest_s;
        let held = &self.z * per_delay;
        let b_y = self.y.left(&b_u);
        let drift = self.p.left(&a);
        let mut first = &drift.plus_transpose() - &held;
        let mut second = -&held;
        if let (Some(q), Rate::Below(mu)) = (&self.q, delay.rate) {
            first = &first + &(q * (1.0 / (1.0 - mu)));
            second = &second - q;
        }
        let unit = |n| DMatrix::identity(n, n);
        let commands = if platoon.command_weight > 0.0 { platoon.followers() } else { 0 };
        let blocks = Blocks::new(&[n, n, inputs, n, outputs, commands])
            .with(0, 0, first)
            .with(0, 1, &b_y + &held)
            .with(0, 2, Affine::constant(b_w.clone()))
            .with(0, 3, drift.transpose())
            .with(0, 4, self.p.right(&c.transpose()))
            .with(1, 1, second)
            .with(1, 3, b_y.transpose())
            .with(2, 2, -&gamma2.times(&unit(inputs)))
            .with(2, 3, Affine::constant(b_w.transpose()))
            .with(3, 3, s * -per_delay)
            .with(4, 4, Affine::constant(-unit(outputs)));
        if commands == 0 {
            return blocks;
        }
        let command = &self.y.transpose() * platoon.command_weight;
        blocks.with(1, 5, command).with(5, 5, Affine::constant(-unit(commands)))
    }

    /// K = Y P⁻¹.
    #[must_use]
    pub fn gain(&self, solution: &Solution) -> Option<DMatrix<f64>> {
        let inverse = solution.value(&self.p).try_inverse()?;
        let k = solution.value(&self.y) * inverse;
        k.iter().all(|x| x.is_finite()).then_some(k)
    }
}

/// Selects `size` rows from `first` on, of `n`: a size x n matrix of zeros and ones.
pub(crate) fn place(n: usize, first: usize, size: usize) -> DMatrix<f64> {
    DMatrix::from_fn(size, n, |i, j| f64::from(u8::from(j == first + i)))
}
