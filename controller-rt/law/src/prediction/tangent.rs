//! How the end of a prediction step answers to its start and its input: the variational equation
//! S' = J S + B by the same Runge-Kutta steps [Hairer, Nørsett & Wanner, *Solving Ordinary
//! Differential Equations I*, I.14], for as many prediction steps at once as there are lanes.

use super::rollout::{Group, SUBSTEP_S, Stage};
use crate::bicycle::{Bicycle, Jacobian};
use crate::lanes::Lanes;
use crate::wide::Work;

/// Columns worked out: to the initial ū, v, r, to force \[1/kN\] and steering \[1/deg\]. Those to
/// φ, X and Y need no integration: turning the start turns the way driven, moving it moves the end.
pub const COLUMNS: usize = 5;

/// How far the second and third stage reach \[s\]; slopes of the core are kept times this.
const HALF_S: f64 = 0.5 * SUBSTEP_S;
/// Weights of the stages in a substep \[s\].
const OUTER_S: f64 = SUBSTEP_S / 6.0;
const INNER_S: f64 = SUBSTEP_S / 3.0;

/// Ways and sensitivities of neighbouring prediction steps.
#[derive(Debug, Clone, Copy)]
pub struct Tangent {
    /// Way driven along X and Y \[m\].
    pub way: [Lanes; 2],
    /// Column by column: sensitivity of ū, v, r, φ, X, Y.
    pub columns: [Column; COLUMNS],
}

/// Sensitivity of ū, v, r, φ, X, Y to one cause.
pub type Column = [Lanes; 6];

/// The linear system of one stage.
#[derive(Debug, Clone, Copy)]
struct Linear {
    /// Slope of the core, over half a substep.
    core: Jacobian,
    /// Cosine, sine and speeds along X and Y, each times the stage's weight.
    cos: Lanes,
    sin: Lanes,
    way: [Lanes; 2],
}

/// Tangents to be worked out along the stages of a rollout.
#[derive(Debug, Clone, Copy)]
pub struct Linearise<'a> {
    /// What rolled.
    pub model: &'a Bicycle,
    /// Its stages.
    pub group: &'a Group,
}

impl Work for Linearise<'_> {
    type Result = Tangent;

    #[inline(always)]
    fn run(self) -> Tangent {
        Tangent::of(self.model, self.group)
    }
}

impl Tangent {
    /// Integrates along the stages of a rollout.
    #[inline(always)]
    fn of(model: &Bicycle, group: &Group) -> Self {
        let [force, steering] = model.input_slopes().map(|drive| drive.map(|x| HALF_S * x));
        let forced = |[u, v, r]: [Lanes; 3]| [u + force[0], v, r];
        let steered = |[u, v, r]: [Lanes; 3]| [u, v + steering[1], r + steering[2]];
        let free = |slope| slope;

        let [first, second] = &group.0;
        let linear = Linear::of_substep(model, first);
        let Linear { core: j, cos, sin, .. } = &linear[0];
        let (zero, one) = (Lanes::ZERO, Lanes::all(1.0));
        let way = way(&linear);
        // What is known of the first stage: each column is still what it began with.
        let start = |core: [Lanes; 3], x, y| [core[0], core[1], core[2], zero, x, y];
        let still = start([zero; 3], zero, zero);
        let by_u = start([one, zero, zero], *cos, *sin);
        let by_v = start([zero, one, zero], -*sin, *cos);
        let by_r = start([zero, zero, one], zero, zero);
        let columns = [
            advance(by_u, [j.uu, j.vu, j.ru], &linear, free),
            advance(by_v, [j.uv, j.vv, j.rv], &linear, free),
            advance(by_r, [j.ur, j.vr, j.rr], &linear, free),
            advance(still, forced([zero; 3]), &linear, forced),
            advance(still, steered([zero; 3]), &linear, steered),
        ];

        let linear = Linear::of_substep(model, second);
        let [by_u, by_v, by_r, by_force, by_steering] = columns;
        let columns = [
            from_first_stage(by_u, &linear, free),
            from_first_stage(by_v, &linear, free),
            from_first_stage(by_r, &linear, free),
            from_first_stage(by_force, &linear, forced),
            from_first_stage(by_steering, &linear, steered),
        ];
        let further = self::way(&linear);
        Self { way: [way[0] + further[0], way[1] + further[1]], columns }
    }
}

impl Linear {
    #[inline(always)]
    fn of_substep(model: &Bicycle, stages: &[Stage; 4]) -> [Self; 4] {
        let [first, second, third, fourth] = stages;
        [
            Self::of(model, first, OUTER_S),
            Self::of(model, second, INNER_S),
            Self::of(model, third, INNER_S),
            Self::of(model, fourth, OUTER_S),
        ]
    }

    #[inline(always)]
    fn of(model: &Bicycle, stage: &Stage, weight_s: f64) -> Self {
        let [u, v, _] = stage.core;
        let (sin, cos) = stage.heading.sin_cos();
        let (sin, cos) = (sin * weight_s, cos * weight_s);
        Self {
            core: model.jacobian(stage.core, stage.inverse, HALF_S),
            cos,
            sin,
            way: [u * cos - v * sin, u * sin + v * cos],
        }
    }

    /// Slope of the core, times half a substep.
    #[inline(always)]
    fn slope(&self, [u, v, r]: [Lanes; 3]) -> [Lanes; 3] {
        let j = &self.core;
        [
            j.uu * u + j.uv * v + j.ur * r,
            j.vu * u + j.vv * v + j.vr * r,
            j.ru * u + j.rv * v + j.rr * r,
        ]
    }

    /// What the stage adds to X and Y; the slope of X by φ is minus the speed along Y, and vice
    /// versa.
    #[inline(always)]
    fn position(&self, [u, v, _]: [Lanes; 3], phi: Lanes) -> [Lanes; 2] {
        [
            self.cos * u - self.sin * v - self.way[1] * phi,
            self.sin * u + self.cos * v + self.way[0] * phi,
        ]
    }
}

/// Way driven over a substep.
#[inline(always)]
fn way([first, second, third, fourth]: &[Linear; 4]) -> [Lanes; 2] {
    let sum = |i: usize| (first.way[i] + fourth.way[i]) + (second.way[i] + third.way[i]);
    [sum(0), sum(1)]
}

/// One column over a substep.
#[inline(always)]
fn from_first_stage(
    mut now: Column,
    linear: &[Linear; 4],
    drive: impl Fn([Lanes; 3]) -> [Lanes; 3],
) -> Column {
    let core = [now[0], now[1], now[2]];
    let position = linear[0].position(core, now[3]);
    now[4] += position[0];
    now[5] += position[1];
    advance(now, drive(linear[0].slope(core)), linear, drive)
}

/// One column over a substep whose first stage is done: its slope is `first`, and what it adds to
/// X and Y is in `now`.
#[inline(always)]
fn advance(
    now: Column,
    first: [Lanes; 3],
    linear: &[Linear; 4],
    drive: impl Fn([Lanes; 3]) -> [Lanes; 3],
) -> Column {
    let [u, v, r, phi, x, y] = now;
    // Half a slope leads to the second and third stage, a whole one to the fourth.
    let second = [u + first[0], v + first[1], r + first[2]];
    let twice = drive(linear[1].slope(second));
    let by_second = linear[1].position(second, phi + r * HALF_S);
    let third = [u + twice[0], v + twice[1], r + twice[2]];
    let whole = drive(linear[2].slope(third));
    let by_third = linear[2].position(third, phi + second[2] * HALF_S);
    let fourth = [u + whole[0] * 2.0, v + whole[1] * 2.0, r + whole[2] * 2.0];
    let last = drive(linear[3].slope(fourth));
    let by_fourth = linear[3].position(fourth, phi + third[2] * SUBSTEP_S);
    let sum = |i: usize| ((first[i] + last[i]) + (twice[i] + whole[i]) * 2.0) * (1.0 / 3.0);
    let turned = ((r + fourth[2]) + (second[2] + third[2]) * 2.0) * OUTER_S;
    [
        u + sum(0),
        v + sum(1),
        r + sum(2),
        phi + turned,
        x + by_second[0] + by_third[0] + by_fourth[0],
        y + by_second[1] + by_third[1] + by_fourth[1],
    ]
}
