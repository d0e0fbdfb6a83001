//! Linear matrix inequalities, as one writes them on paper.
//!
//! A [`Program`] hands out unknown matrices as [`Affine`] expressions. These are added, multiplied
//! with known matrices, put into [`Blocks`], and required to be positive or negative definite; a
//! linear function of them is made as small as possible. Clarabel does the work.
//!
//! What comes back is a proposal: interior-point statuses are not proofs, and near the boundary of
//! feasibility they are often pessimistic too. Whoever uses a [`Solution`] evaluates the
//! inequality again with the numbers found.

mod affine;
mod program;

pub use affine::{Affine, Blocks};
pub use program::{Program, Solution, Unsolved};
