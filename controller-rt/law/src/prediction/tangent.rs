//! How the end of a prediction step answers to its start and its input: the variational equation
//! S' = J S + B by the same Runge-Kutta steps [Hairer, Nørsett & Wanner, *Solving Ordinary
//! Differential Equations I*, I.14], for four prediction steps at once.

use super::rollout::{Group, SUBSTEP_S, Stage};
use crate::bicycle::{Bicycle, Jacobian};
use crate::lanes::Lanes;

/// Columns worked out: to the initial ū, v, r, to force \[1/kN\] and steering \[1/deg\]. Those to
/// φ, X and Y need no integration: turning the start turns the way driven, moving it moves the end.
pub const COLUMNS: usize = 5;

/// Ways and sensitivities of four prediction steps.
#[derive(Debug, Clone, Copy)]
pub struct Tangent {
    /// Way driven along X and Y \[m\].
    pub way: [Lanes; 2],
    /// Column by column: sensitivity of ū, v, r, φ, X, Y.
    pub columns: [[Lanes; 6]; COLUMNS],
}

/// The linear system of one stage.
#[derive(Debug, Clone, Copy)]
struct Linear {
    core: Jacobian,
    cos: Lanes,
    sin: Lanes,
    /// Speed along X and Y \[m/s\].
    speed: [Lanes; 2],
}

impl Tangent {
    /// Integrates along the stages of a rollout.
    pub fn of(model: &Bicycle, group: &Group) -> Self {
        let group = group.each_ref().map(|stages| stages.each_ref().map(|s| Linear::of(model, s)));
        let way = group.iter().fold([Lanes::ZERO; 2], |way, stages| {
            core::array::from_fn(|i| way[i] + weighted(&stages.each_ref().map(|s| s.speed[i])))
        });
        let [force, steering] = model.input_slopes();
        let (zero, one) = (Lanes::ZERO, Lanes::all(1.0));
        let columns = [
            column(&group, [one, zero, zero], [0.0; 3]),
            column(&group, [zero, one, zero], [0.0; 3]),
            column(&group, [zero, zero, one], [0.0; 3]),
            column(&group, [zero; 3], force),
            column(&group, [zero; 3], steering),
        ];
        Self { way, columns }
    }
}

impl Linear {
    #[inline(always)]
    fn of(model: &Bicycle, stage: &Stage) -> Self {
        let [u, v, _] = stage.core;
        let (sin, cos) = stage.heading.sin_cos();
        Self {
            core: model.jacobian(stage.core, &stage.at),
            cos,
            sin,
            speed: [u * cos - v * sin, u * sin + v * cos],
        }
    }

    /// Slope of one column; the slope of X by φ is minus the speed along Y, and vice versa.
    #[inline(always)]
    fn slope(&self, [u, v, r, phi]: [Lanes; 4], drive: [f64; 3]) -> [Lanes; 6] {
        let j = &self.core;
        [
            j.uu * u + j.uv * v + j.ur * r + drive[0],
            j.vu * u + j.vv * v + j.vr * r + drive[1],
            j.ru * u + j.rv * v + j.rr * r + drive[2],
            r,
            self.cos * u - self.sin * v - self.speed[1] * phi,
            self.sin * u + self.cos * v + self.speed[0] * phi,
        ]
    }
}

/// One column of the sensitivity over a prediction step.
#[inline(always)]
fn column(
    group: &[[Linear; 4]; super::rollout::SUBSTEPS],
    start: [Lanes; 3],
    drive: [f64; 3],
) -> [Lanes; 6] {
    let mut now = [start[0], start[1], start[2], Lanes::ZERO, Lanes::ZERO, Lanes::ZERO];
    for stages in group {
        let from = |slope: &[Lanes; 6], reach: f64| -> [Lanes; 4] {
            core::array::from_fn(|i| now[i] + slope[i] * reach)
        };
        let first = stages[0].slope([now[0], now[1], now[2], now[3]], drive);
        let second = stages[1].slope(from(&first, 0.5 * SUBSTEP_S), drive);
        let third = stages[2].slope(from(&second, 0.5 * SUBSTEP_S), drive);
        let fourth = stages[3].slope(from(&third, SUBSTEP_S), drive);
        now = core::array::from_fn(|i| {
            now[i] + weighted(&[first[i], second[i], third[i], fourth[i]])
        });
    }
    now
}

/// What four stages' slopes add up to over a substep.
#[inline(always)]
fn weighted(slopes: &[Lanes; 4]) -> Lanes {
    ((slopes[0] + slopes[3]) + (slopes[1] + slopes[2]) * 2.0) * (SUBSTEP_S / 6.0)
}
