//! Theorem 1's plant: a platoon of followers, each a third-order lag in the leader's frame.
//!
//! ```text
//! x_i' = A_i x_i + B_u u_i + B_w w_i,   A_i = [0 1 0; 0 0 1; 0 0 -1/tau_i]
//! B_u = [0 0 -g_i/tau_i]^T,   B_w = [0 0; 0 0; 1/tau_i 1],   w_i = [a_0, a_0']    [MCF, Eqs. 3, 6]
//! u_i = K1 x_i(t - lambda) + K2 x_(i-1)(t - lambda)                            [MCF, Eq. 4]
//! ```
//!
//! The errors are those of Eq. 2, positive when the truck is behind its slot, so a positive command
//! makes them smaller. The gain g_i of the drive, 1 in the paper, is there because the motion layer
//! below may make more or less of a command than it says.

use certificate::{Corner, Gain};
use nalgebra::DMatrix;

/// States of one vehicle: position, speed and acceleration error.
pub const STATES: usize = 3;

/// Which disturbances the platoon is designed against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Disturbance {
    /// Every follower has its own: the paper's block-diagonal B_w.
    #[default]
    Independent,
    /// All have the leader's one.
    Common,
}

/// The open platoon.
#[derive(Debug, Clone, PartialEq)]
pub struct Platoon {
    /// Lag tau_i and gain g_i of each follower.
    pub plants: Vec<Corner>,
    /// Who disturbs it.
    pub disturbance: Disturbance,
    /// What a command costs a design beside the position errors \[s²\]: z = \[s, weight u\]. A
    /// proof of a gain that is given does not look at it.
    pub command_weight: f64,
}

impl Platoon {
    /// Followers that are all alike.
    #[must_use]
    pub fn alike(followers: usize, plant: Corner) -> Self {
        Self {
            plants: vec![plant; followers],
            disturbance: Disturbance::Independent,
            command_weight: 0.0,
        }
    }

    /// How many follow.
    #[must_use]
    pub fn followers(&self) -> usize {
        self.plants.len()
    }

    /// A of Eq. 6.
    #[must_use]
    pub fn a(&self) -> DMatrix<f64> {
        let n = STATES * self.followers();
        let mut a = DMatrix::zeros(n, n);
        for (i, plant) in self.plants.iter().enumerate() {
            let at = STATES * i;
            a[(at, at + 1)] = 1.0;
            a[(at + 1, at + 2)] = 1.0;
            a[(at + 2, at + 2)] = -1.0 / plant.lag_s;
        }
        a
    }

    /// B_u of Eq. 6.
    #[must_use]
    pub fn b_u(&self) -> DMatrix<f64> {
        let n = self.followers();
        let mut b = DMatrix::zeros(STATES * n, n);
        for (i, plant) in self.plants.iter().enumerate() {
            b[(STATES * i + 2, i)] = -plant.gain / plant.lag_s;
        }
        b
    }

    /// B_w of Eq. 6.
    #[must_use]
    pub fn b_w(&self) -> DMatrix<f64> {
        let n = self.followers();
        let is_common = self.disturbance == Disturbance::Common;
        let mut b = DMatrix::zeros(STATES * n, if is_common { 2 } else { 2 * n });
        for (i, plant) in self.plants.iter().enumerate() {
            let column = if is_common { 0 } else { 2 * i };
            b[(STATES * i + 2, column)] = 1.0 / plant.lag_s;
            b[(STATES * i + 2, column + 1)] = 1.0;
        }
        b
    }

    /// C of Eq. 6: the position errors.
    #[must_use]
    pub fn c(&self) -> DMatrix<f64> {
        let n = self.followers();
        DMatrix::from_fn(n, STATES * n, |i, j| f64::from(u8::from(j == STATES * i)))
    }

    /// K of Eq. 5 under predecessor-leader following: one gain on the diagonal, one beside it.
    #[must_use]
    pub fn k(&self, gain: &Gain) -> DMatrix<f64> {
        let n = self.followers();
        let mut k = DMatrix::zeros(n, STATES * n);
        for i in 0..n {
            for state in 0..STATES {
                k[(i, STATES * i + state)] = gain.k1[state];
                if i > 0 {
                    k[(i, STATES * (i - 1) + state)] = gain.k2[state];
                }
            }
        }
        k
    }

    /// The loop that `k` closes, from w to the position errors.
    #[must_use]
    pub fn closed(&self, k: &DMatrix<f64>) -> Loop {
        Loop { a: self.a(), delayed: self.b_u() * k, input: self.b_w(), output: self.c() }
    }
}

/// A closed loop with one delay: x' = A x + A_d x(t - lambda) + B w, z = C x.
#[derive(Debug, Clone, PartialEq)]
pub struct Loop {
    /// A.
    pub a: DMatrix<f64>,
    /// A_d.
    pub delayed: DMatrix<f64>,
    /// B.
    pub input: DMatrix<f64>,
    /// C.
    pub output: DMatrix<f64>,
}
