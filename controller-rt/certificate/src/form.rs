//! The inequalities of a certificate, evaluated: once in `f64` for its eigenvalues, once in exact
//! rational numbers for the verdict. The formulas are written once, over any such number.

use std::ops::{AddAssign, MulAssign, Neg, SubAssign};

use nalgebra::{DMatrix, Scalar};
use num_rational::BigRational;
use num_traits::Num;

use crate::gain::{Corner, Gain};

/// States of one vehicle.
const STATES: usize = 3;

/// What the formulas compute with.
pub trait Number: Scalar + Num + Neg<Output = Self> + AddAssign + SubAssign + MulAssign {
    /// The number a finite `f64` is; `None` for others.
    fn of(x: f64) -> Option<Self>;
}

impl Number for f64 {
    fn of(x: f64) -> Option<Self> {
        x.is_finite().then_some(x)
    }
}

impl Number for BigRational {
    fn of(x: f64) -> Option<Self> {
        BigRational::from_float(x)
    }
}

/// A matrix of such numbers; `None` unless all are finite.
pub fn matrix<T: Number>(from: &DMatrix<f64>) -> Option<DMatrix<T>> {
    let entries: Option<Vec<T>> = from.iter().map(|x| T::of(*x)).collect();
    entries.map(|entries| DMatrix::from_vec(from.nrows(), from.ncols(), entries))
}

fn zeros<T: Number>(rows: usize, columns: usize) -> DMatrix<T> {
    DMatrix::from_element(rows, columns, T::zero())
}

fn identity<T: Number>(n: usize) -> DMatrix<T> {
    DMatrix::from_fn(n, n, |i, j| if i == j { T::one() } else { T::zero() })
}

/// Selects `size` rows from `first` on, of `n`.
fn place<T: Number>(n: usize, first: usize, size: usize) -> DMatrix<T> {
    DMatrix::from_fn(size, n, |i, j| if j == first + i { T::one() } else { T::zero() })
}

fn stacked<T: Number>(parts: &[DMatrix<T>]) -> DMatrix<T> {
    let rows: usize = parts.iter().map(DMatrix::nrows).sum();
    let mut whole = zeros(rows, parts[0].ncols());
    let mut top = 0;
    for part in parts {
        whole.rows_mut(top, part.nrows()).copy_from(part);
        top += part.nrows();
    }
    whole
}

fn within<T: Number>(middle: &DMatrix<T>, frame: &DMatrix<T>) -> DMatrix<T> {
    frame.transpose() * middle * frame
}

fn plus_transpose<T: Number>(a: DMatrix<T>) -> DMatrix<T> {
    let turned = a.transpose();
    a + turned
}

/// x' = A x + A_d x(t - lambda) + B w, z = C x.
#[derive(Debug, Clone, PartialEq)]
pub struct Loop<T: Number> {
    a: DMatrix<T>,
    delayed: DMatrix<T>,
    input: DMatrix<T>,
    output: DMatrix<T>,
}

impl<T: Number> Loop<T> {
    /// Order of the plant.
    pub fn order(&self) -> usize {
        self.a.nrows()
    }

    /// Followers that are alike under one gain, from their disturbances to their position errors.
    /// The disturbances w_i = [a_0, a_0'] are each follower's own, which includes that they are
    /// equal.
    pub fn platoon(gain: &Gain, plant: Corner, followers: usize) -> Option<Self> {
        let fast = T::one() / T::of(plant.lag_s)?;
        let strong = T::of(plant.gain)? * fast.clone();
        let n = STATES * followers;
        let mut closed = Self {
            a: zeros(n, n),
            delayed: zeros(n, n),
            input: zeros(n, 2 * followers),
            output: zeros(followers, n),
        };
        for i in 0..followers {
            let at = STATES * i;
            closed.a[(at, at + 1)] = T::one();
            closed.a[(at + 1, at + 2)] = T::one();
            closed.a[(at + 2, at + 2)] = -fast.clone();
            closed.input[(at + 2, 2 * i)] = fast.clone();
            closed.input[(at + 2, 2 * i + 1)] = T::one();
            closed.output[(i, at)] = T::one();
            for state in 0..STATES {
                closed.delayed[(at + 2, at + state)] = -(strong.clone() * T::of(gain.k1[state])?);
                if i > 0 {
                    let ahead = at - STATES + state;
                    closed.delayed[(at + 2, ahead)] = -(strong.clone() * T::of(gain.k2[state])?);
                }
            }
        }
        Some(closed)
    }

    /// One vehicle, from and to what a [`Channel`] says.
    pub fn vehicle(gain: &Gain, plant: Corner, channel: Channel) -> Option<Self> {
        let mut closed = Self::platoon(gain, plant, 1)?;
        if channel.is_from_forwarded() {
            let strong = T::of(plant.gain)? / T::of(plant.lag_s)?;
            closed.input = zeros(STATES, 1);
            closed.input[(2, 0)] = -strong;
        }
        if channel.is_to_forwarded() {
            for state in 0..STATES {
                closed.output[(0, state)] = T::of(gain.k2[state])?;
            }
        }
        Some(closed)
    }
}

/// What leads from where to where in one vehicle: the disturbance w or the signal v = K2 x_(i-1)
/// that the truck ahead forwards, to the position error or to what is forwarded in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// From w to the position error.
    DisturbanceToError,
    /// From w to K2 x.
    DisturbanceToForwarded,
    /// From v to the position error.
    ForwardedToError,
    /// From v to K2 x.
    ForwardedToForwarded,
}

impl Channel {
    const fn is_from_forwarded(self) -> bool {
        matches!(self, Self::ForwardedToError | Self::ForwardedToForwarded)
    }

    const fn is_to_forwarded(self) -> bool {
        matches!(self, Self::DisturbanceToForwarded | Self::ForwardedToForwarded)
    }
}

/// Matrices of a Jensen proof.
#[derive(Debug, Clone)]
pub struct JensenMatrices<T: Number> {
    pub gamma: T,
    pub p: DMatrix<T>,
    pub z: DMatrix<T>,
    /// Q and 1 / (1 - mu).
    pub q: Option<(DMatrix<T>, T)>,
}

/// V' + z'z - gamma² w'w as a form in (x(t), x(t - lambda), w), bounded with Jensen's inequality:
/// the upper left 3 x 3 blocks of the paper's Phi_1 after its Schur complements are undone.
pub fn jensen_form<T: Number>(
    closed: &Loop<T>,
    longest: &T,
    proof: &JensenMatrices<T>,
) -> DMatrix<T> {
    let (n, inputs) = (closed.order(), closed.input.ncols());
    let all = 2 * n + inputs;
    let [now, late] = [0, n].map(|first| place(all, first, n));
    let disturbance: DMatrix<T> = place(all, 2 * n, inputs);
    let rate = &closed.a * &now + &closed.delayed * &late + &closed.input * &disturbance;
    let seen = &closed.output * &now;
    let gamma2 = proof.gamma.clone() * proof.gamma.clone();

    let energy = plus_transpose(now.transpose() * &proof.p * &rate);
    let spent = within(&proof.z, &rate) * longest.clone();
    let regained = within(&proof.z, &(&now - &late)) * (T::one() / longest.clone());
    let supply = seen.transpose() * &seen - within(&identity(inputs), &disturbance) * gamma2;
    let form = energy + spent - regained + supply;
    match &proof.q {
        Some((q, grown)) => form + within(q, &now) * grown.clone() - within(q, &late),
        None => form,
    }
}

/// Matrices of a Wirtinger proof.
#[derive(Debug, Clone)]
pub struct WirtingerMatrices<T: Number> {
    pub gamma: T,
    pub p: DMatrix<T>,
    pub s: DMatrix<T>,
    pub r: DMatrix<T>,
    pub x: DMatrix<T>,
}

/// [diag(R, 3R) X; X' diag(R, 3R)].
pub fn coupled<T: Number>(proof: &WirtingerMatrices<T>) -> DMatrix<T> {
    let n = proof.r.nrows();
    let three = T::one() + T::one() + T::one();
    let mut whole = zeros(4 * n, 4 * n);
    for (block, factor) in [(0, T::one()), (1, three.clone()), (2, T::one()), (3, three)] {
        whole.view_mut((block * n, block * n), (n, n)).copy_from(&(&proof.r * factor));
    }
    whole.view_mut((0, 2 * n), (2 * n, 2 * n)).copy_from(&proof.x);
    whole.view_mut((2 * n, 0), (2 * n, 2 * n)).copy_from(&proof.x.transpose());
    whole
}

/// V' + z'z - gamma² w'w as a form in (x, x(t - lambda), x(t - h), mean of x over [t - lambda, t],
/// mean over [t - h, t - lambda], w), at one length of the delay, bounded with Wirtinger's
/// inequality. It is affine in that length, so the two ends decide.
pub fn wirtinger_form<T: Number>(
    closed: &Loop<T>,
    longest: &T,
    delay: &T,
    proof: &WirtingerMatrices<T>,
) -> DMatrix<T> {
    let (n, inputs) = (closed.order(), closed.input.ncols());
    let all = 5 * n + inputs;
    let [now, late, last, near, far] = [0, 1, 2, 3, 4].map(|i| place::<T>(all, i * n, n));
    let disturbance: DMatrix<T> = place(all, 5 * n, inputs);
    let two = T::one() + T::one();
    let rate = &closed.a * &now + &closed.delayed * &late + &closed.input * &disturbance;
    let whole = &near * delay.clone() + &far * (longest.clone() - delay.clone());
    let zeta = stacked(&[now.clone(), whole]);
    let zeta_rate = stacked(&[rate.clone(), &now - &last]);
    let ends = stacked(&[
        &now - &late,
        &now + &late - &near * two.clone(),
        &late - &last,
        &late + &last - &far * two,
    ]);
    let seen = &closed.output * &now;
    let gamma2 = proof.gamma.clone() * proof.gamma.clone();

    let energy = plus_transpose(zeta.transpose() * &proof.p * &zeta_rate);
    let stored = within(&proof.s, &now) - within(&proof.s, &last);
    let spent = within(&proof.r, &rate) * (longest.clone() * longest.clone());
    let regained = within(&coupled(proof), &ends);
    let supply = seen.transpose() * &seen - within(&identity(inputs), &disturbance) * gamma2;
    energy + stored + spent - regained + supply
}
