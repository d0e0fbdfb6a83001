//! The nonlinear model along a plan, by the classical Runge-Kutta method.
//!
//! Speed, lateral speed and yaw rate do not depend on where the truck is or heads, so they go
//! first, one stage after the other; all that must wait for a stage is one division. What can be
//! worked out afterwards, four steps at a time, is left to the tangents.

use super::{STEP_S, STEPS, block};
use crate::bicycle::{AtSpeedLanes, Bicycle, Core, State};
use crate::lanes::{LANES, Lanes};
use crate::qp::BLOCKS;

/// Runge-Kutta steps per prediction step.
pub const SUBSTEPS: usize = 2;
/// Length of one \[s\].
pub const SUBSTEP_S: f64 = STEP_S / SUBSTEPS as f64;
/// Stages of one.
const STAGES: usize = 4;
/// Prediction steps, four by four; the last group is filled up with zeros.
pub const GROUPS: usize = STEPS.div_ceil(LANES);

/// One stage of the same substep of four prediction steps.
#[derive(Debug, Clone, Copy)]
pub struct Stage {
    /// ū \[m/s\], v \[m/s\], r \[rad/s\].
    pub core: [Lanes; 3],
    /// φ \[rad\].
    pub heading: Lanes,
    /// What the speed makes of tyres and resistances.
    pub at: AtSpeedLanes,
}

/// Every stage of four prediction steps.
pub type Group = [[Stage; STAGES]; SUBSTEPS];

/// A rollout, as its tangents need it.
#[derive(Debug, Clone, Copy)]
pub struct Rollout {
    pub groups: [Group; GROUPS],
    /// ū, v, r and φ at the end of every step.
    pub ends: [[f64; 4]; STEPS],
}

impl Stage {
    const ZERO: Self = Self {
        core: [Lanes::ZERO; 3],
        heading: Lanes::ZERO,
        at: AtSpeedLanes {
            inverse: Lanes::ZERO,
            inverse_u: Lanes::ZERO,
            resistance_u: Lanes::ZERO,
        },
    };
}

/// Rolls the model out from `start` under `plan`.
pub fn rollout(model: &Bicycle, start: &State, plan: &[[f64; 2]; BLOCKS]) -> Rollout {
    let mut out =
        Rollout { groups: [[[Stage::ZERO; STAGES]; SUBSTEPS]; GROUPS], ends: [[0.0; 4]; STEPS] };
    let mut core: Core = [start[0], start[1], start[2]];
    let mut heading = start[3];
    for (k, end) in out.ends.iter_mut().enumerate() {
        let (group, lane) = (&mut out.groups[k / LANES], k % LANES);
        for stages in group {
            (core, heading) = substep(model, core, heading, plan[block(k)], stages, lane);
        }
        *end = [core[0], core[1], core[2], heading];
    }
    out
}

/// One Runge-Kutta step, its stages noted in one lane.
#[inline(always)]
fn substep(
    model: &Bicycle,
    core: Core,
    heading: f64,
    input: [f64; 2],
    stages: &mut [Stage; STAGES],
    lane: usize,
) -> (Core, f64) {
    // How far each stage reaches from the start; the heading's slope is the stage's yaw rate.
    const REACH: [f64; STAGES] = [0.0, 0.5 * SUBSTEP_S, 0.5 * SUBSTEP_S, SUBSTEP_S];
    const SHARE: [f64; STAGES] =
        [SUBSTEP_S / 6.0, SUBSTEP_S / 3.0, SUBSTEP_S / 3.0, SUBSTEP_S / 6.0];
    let (mut next, mut next_heading) = (core, heading);
    let (mut slope, mut yaw) = ([0.0; 3], 0.0);
    for ((stage, reach), share) in stages.iter_mut().zip(REACH).zip(SHARE) {
        let here: Core = core::array::from_fn(|i| core[i] + reach * slope[i]);
        stage.heading.0[lane] = heading + reach * yaw;
        let at = model.at_speed(here[0]);
        slope = model.slope(here, input, &at);
        yaw = here[2];
        for i in 0..3 {
            stage.core[i].0[lane] = here[i];
            next[i] += share * slope[i];
        }
        next_heading += share * yaw;
        stage.at.inverse.0[lane] = at.inverse;
        stage.at.inverse_u.0[lane] = at.inverse_u;
        stage.at.resistance_u.0[lane] = at.resistance_u;
    }
    (next, next_heading)
}
