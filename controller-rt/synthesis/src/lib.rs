//! Designs the gain of the coordination layer: Theorem 1, corrected, and what goes beyond it.
//!
//! - [`lmi`]: matrix inequalities as one writes them, solved by Clarabel's semidefinite cones.
//! - [`plant`]: the platoon as Theorem 1 sees it.
//! - [`theorem1`]: its inequality (Eq. 8), for any number of followers.
//! - [`complementarity`]: the paper's way to a gain (Eq. 12), with the stopping test it leaves out.
//! - [`convex`]: a better way, without linearised complementarity.
//! - [`wirtinger`]: a sharper inequality than the paper's, for delays of any rate.
//! - [`fleet`]: trucks that differ, any number of them.
//! - [`tradeoff`]: many designs, and the choice among them by what is wanted.
//! - [`analysis`]: proofs for a gain that is given; [`prove`] writes them into a file.
//!
//! It never runs in an ECU and is never linked into the loop: what it finds is written into a file
//! whose claims the crate `certificate` checks without any of this.

pub mod analysis;
pub mod complementarity;
pub mod convex;
pub mod fleet;
pub mod lmi;
pub mod plant;
pub mod prove;
pub mod theorem1;
pub mod tradeoff;
pub mod wirtinger;

use certificate::Gain;
use nalgebra::DMatrix;

pub use lmi::Unsolved;
pub use plant::{Disturbance, Platoon};

/// A gain that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// K of Eq. 5, a row per follower.
    pub k: DMatrix<f64>,
    /// The gamma that the analysis of this gain proves.
    pub gamma: f64,
    /// Semidefinite programs it took, analyses aside.
    pub iterations: usize,
}

impl Design {
    /// One gain for every follower: K1 of the first, K2 of the second.
    #[must_use]
    pub fn common_gain(&self) -> Gain {
        let three = |row: usize, column: usize| {
            [0, 1, 2].map(|state| self.k.get((row, column + state)).copied().unwrap_or(0.0))
        };
        let k2 = if self.k.nrows() > 1 { three(1, 0) } else { [0.0; 3] };
        Gain { k1: three(0, 0), k2, leader_feedforward: false }
    }
}

/// Why no gain was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Undesigned {
    /// The inequalities have no solution, or the solver found none.
    #[error("{0}; allow a larger gamma, a shorter delay, or a slower one")]
    Unsolved(#[from] Unsolved),
    /// Linearising did not get there.
    #[error("gamma {gamma} was not reached in {iterations} linearisations; allow a larger one")]
    NotReached {
        /// The gamma asked for.
        gamma: f64,
        /// How often it was tried.
        iterations: usize,
    },
    /// The solution has a P that cannot be inverted.
    #[error("the solution has a singular P and so no gain; allow a larger gamma")]
    NoGain,
}
