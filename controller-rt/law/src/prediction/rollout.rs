//! The nonlinear model along a plan, by the classical Runge-Kutta method.
//!
//! Speed, lateral speed and yaw rate do not depend on where the truck is or heads, so they go
//! first, one stage after the other; all that must wait for a stage is one division. What can be
//! worked out afterwards, as many steps at once as there are lanes, is left to the tangents.

use super::STEP_S;
use crate::bicycle::{Bicycle, Core};
use crate::lanes::Lanes;

/// Runge-Kutta steps per prediction step.
pub const SUBSTEPS: usize = 2;
/// Length of one \[s\].
pub const SUBSTEP_S: f64 = STEP_S / SUBSTEPS as f64;
/// Stages of one.
const STAGES: usize = 4;

/// One stage of the same substep of neighbouring prediction steps.
#[derive(Debug, Clone, Copy)]
pub struct Stage {
    /// ū \[m/s\], v \[m/s\], r \[rad/s\].
    pub core: [Lanes; 3],
    /// φ \[rad\].
    pub heading: Lanes,
    /// One over the speed that slip angles divide by \[s/m\].
    pub inverse: Lanes,
}

/// Every stage of neighbouring prediction steps, one in each lane.
#[derive(Debug, Clone, Copy)]
pub struct Group(pub [[Stage; STAGES]; SUBSTEPS]);

/// ū, v, r and φ, carried along the plan.
#[derive(Debug, Clone, Copy)]
pub struct Moving {
    /// ū \[m/s\], v \[m/s\], r \[rad/s\].
    pub core: Core,
    /// φ \[rad\].
    pub heading: f64,
}

impl Group {
    /// One in which nothing is noted yet.
    pub const EMPTY: Self = {
        let zero = Lanes::ZERO;
        Self([[Stage { core: [zero; 3], heading: zero, inverse: zero }; STAGES]; SUBSTEPS])
    };

    /// Rolls the model out over one prediction step, noting its stages in one lane.
    #[inline(always)]
    pub fn roll(&mut self, model: &Bicycle, moving: &mut Moving, input: [f64; 2], lane: usize) {
        for stages in &mut self.0 {
            substep(model, moving, input, stages, lane);
        }
    }
}

/// One Runge-Kutta step.
#[inline(always)]
fn substep(
    model: &Bicycle,
    moving: &mut Moving,
    input: [f64; 2],
    stages: &mut [Stage; STAGES],
    lane: usize,
) {
    // How far each stage reaches from the start; the heading's slope is the stage's yaw rate.
    const REACH: [f64; STAGES] = [0.0, 0.5 * SUBSTEP_S, 0.5 * SUBSTEP_S, SUBSTEP_S];
    const SHARE: [f64; STAGES] =
        [SUBSTEP_S / 6.0, SUBSTEP_S / 3.0, SUBSTEP_S / 3.0, SUBSTEP_S / 6.0];
    let Moving { core, heading } = *moving;
    let (mut slope, mut yaw) = ([0.0; 3], 0.0);
    for ((stage, reach), share) in stages.iter_mut().zip(REACH).zip(SHARE) {
        let here: Core = core::array::from_fn(|i| core[i] + reach * slope[i]);
        stage.heading.0[lane] = heading + reach * yaw;
        let at = model.at_speed(here[0]);
        slope = model.slope(here, input, &at);
        yaw = here[2];
        for i in 0..3 {
            stage.core[i].0[lane] = here[i];
            moving.core[i] += share * slope[i];
        }
        moving.heading += share * yaw;
        stage.inverse.0[lane] = at.inverse;
    }
}
