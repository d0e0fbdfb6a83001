//! The paper's control law for one truck of a platoon, as a pure function of what the truck sees.
//!
//! Two layers [MCF, Fig. 2]: the upper-level coordination layer (`ucl`) turns delayed V2V states
//! into a reference speed with an H-infinity gain; the lower-level motion-planning layer (`lml`)
//! turns that speed, the obstacles and the road into force and steering with one convex QP.
//! [`Law::step`] is the paper's Algorithm 1 for one vehicle and one instant.
//!
//! Two baselines take the place of the first layer or of both: one MPC that tracks its slot
//! (`single_mpc`), and distributed MPC ([`dmpc`]).
//!
//! The crate refuses to know about CAN, clocks, files, threads and heap: time arrives in the
//! [`Observation`], everything that changes lives in [`Memory`], and the same inputs give the same
//! bits on every machine.
//!
//! \[MCF\]: H. Wang, L.-M. Peng et al., *A Holistic Robust Motion Control Framework for Autonomous
//! Platooning*. Equation numbers are the printed ones.
#![no_std]

mod bicycle;
mod calibration;
mod decision;
pub mod dmpc;
mod history;
mod lanes;
mod law;
mod lml;
mod memory;
mod observation;
mod potential;
mod prediction;
pub mod qp;
mod resistance;
mod single_mpc;
mod surroundings;
mod ucl;
mod weight;
mod wide;

/// The parts of a step, for benchmarks and pictures; they change without notice.
#[doc(hidden)]
pub mod parts {
    pub use crate::bicycle::Bicycle;
    pub use crate::potential::SafeDistance;
    use crate::prediction::predict;
    use crate::qp::BLOCKS;

    /// Rolls the model out and linearises it at every instant; a sum of gains, so that there is a
    /// result.
    pub fn linearise(model: &Bicycle, start: &[f64; 6], plan: &[[f64; 2]; BLOCKS]) -> f64 {
        let mut sum = 0.0;
        predict(model, start, plan, |_, instant| sum += instant.gain[5][0]);
        sum
    }
}

pub use calibration::{
    Calibration, CoordinationLaw, DelayReading, Excitation, LmlCalibration, SingleMpcCalibration,
    Structure, TruckBelief, UclCalibration,
};
pub use decision::{Decision, LmlReport, Outcome, QpReport, UclReport};
pub use law::{Law, Phase};
pub use memory::Memory;
pub use observation::{
    Ego, Mission, OBSTACLES_MAX, Observation, Obstacle, ObstacleKind, Plans, V2v,
};
