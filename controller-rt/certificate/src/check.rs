//! Whether a proof holds: its eigenvalues in `f64`, for the eye, and exactly, for the verdict.

use nalgebra::DMatrix;
use num_rational::BigRational;

use crate::exact;
use crate::form::{
    Channel, JensenMatrices, Loop, Number, WirtingerMatrices, coupled, jensen_form, matrix,
    wirtinger_form,
};
use crate::gain::{DelayBound, Gain, Plants, Rate};
use crate::proof::{Jensen, Wirtinger};

/// What a proof is about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Subject {
    /// The gain.
    pub gain: Gain,
    /// The plants it has to cope with.
    pub plants: Plants,
    /// One vehicle's channel, or so many followers at once.
    pub part: Part,
}

/// A part of a platoon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A chain of this many followers that are alike.
    Platoon(usize),
    /// One channel of one vehicle.
    Vehicle(Channel),
}

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checked {
    /// Largest eigenvalue of the forms that must be negative, in `f64`.
    pub form_max: f64,
    /// Smallest eigenvalue of the matrices that must be positive, in `f64`.
    pub positive_min: f64,
    /// Whether all of that is so in exact arithmetic.
    pub is_exact: bool,
}

impl Checked {
    /// The verdict: exact, and the eigenvalues agree.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.is_exact && self.form_max < 0.0 && self.positive_min > 0.0
    }

    /// For numbers that no check is possible with.
    const REFUSED: Self =
        Self { form_max: f64::INFINITY, positive_min: f64::NEG_INFINITY, is_exact: false };
}

impl Subject {
    /// The loops at the corners of the plants. Every form is convex in (1/tau, g/tau): where it is
    /// negative at the corners it is negative between them.
    fn loops<T: Number>(&self) -> Option<Vec<Loop<T>>> {
        let one = |corner| match self.part {
            Part::Platoon(followers) => Loop::platoon(&self.gain, corner, followers),
            Part::Vehicle(channel) => Loop::vehicle(&self.gain, corner, channel),
        };
        self.plants.corners().into_iter().map(one).collect()
    }

    fn order(&self) -> usize {
        match self.part {
            Part::Platoon(followers) => 3 * followers,
            Part::Vehicle(_) => 3,
        }
    }

    fn is_sound(&self) -> bool {
        self.plants.is_sound() && self.order() > 0
    }
}

/// Checks a proof by Jensen's inequality.
#[must_use]
pub fn jensen(subject: &Subject, delay: DelayBound, proof: &Jensen) -> Checked {
    let n = subject.order();
    let square = |m: &DMatrix<f64>| m.shape() == (n, n) && *m == m.transpose();
    let q_fits = match (delay.rate, &proof.q) {
        (_, None) => true,
        (Rate::Below(mu), Some(q)) => (0.0..1.0).contains(&mu) && square(q),
        (Rate::Any, Some(_)) => false,
    };
    let is_sound = subject.is_sound() && delay.longest_s > 0.0 && proof.gamma > 0.0;
    if !(is_sound && square(&proof.p) && square(&proof.z) && q_fits) {
        return Checked::REFUSED;
    }
    let rounded = jensen_matrices::<f64>(subject, delay, proof);
    checked(rounded, || jensen_matrices(subject, delay, proof))
}

/// Checks a proof by Wirtinger's inequality.
#[must_use]
pub fn wirtinger(subject: &Subject, longest_s: f64, proof: &Wirtinger) -> Checked {
    let n = subject.order();
    let square = |m: &DMatrix<f64>, order| m.shape() == (order, order) && *m == m.transpose();
    let is_sound = subject.is_sound() && longest_s > 0.0 && proof.gamma > 0.0;
    let has_x = proof.x.shape() == (2 * n, 2 * n);
    let has_others = square(&proof.p, 2 * n) && square(&proof.s, n) && square(&proof.r, n);
    if !(is_sound && has_x && has_others) {
        return Checked::REFUSED;
    }
    let rounded = wirtinger_matrices::<f64>(subject, longest_s, proof);
    checked(rounded, || wirtinger_matrices(subject, longest_s, proof))
}

/// What must be negative, and what must be positive.
struct Claims<T: Number> {
    negative: Vec<DMatrix<T>>,
    positive: Vec<DMatrix<T>>,
}

fn jensen_matrices<T: Number>(
    subject: &Subject,
    delay: DelayBound,
    proof: &Jensen,
) -> Option<Claims<T>> {
    let q = match (&proof.q, delay.rate) {
        (Some(q), Rate::Below(mu)) => Some((matrix(q)?, T::one() / (T::one() - T::of(mu)?))),
        _ => None,
    };
    let longest = T::of(delay.longest_s)?;
    let (p, z) = (matrix(&proof.p)?, matrix(&proof.z)?);
    let matrices = JensenMatrices { gamma: T::of(proof.gamma)?, p, z, q };
    let loops = subject.loops::<T>()?;
    let negative = loops.iter().map(|closed| jensen_form(closed, &longest, &matrices)).collect();
    let q = matrices.q.map(|(q, _)| q);
    Some(Claims { negative, positive: [matrices.p, matrices.z].into_iter().chain(q).collect() })
}

fn wirtinger_matrices<T: Number>(
    subject: &Subject,
    longest_s: f64,
    proof: &Wirtinger,
) -> Option<Claims<T>> {
    let matrices = WirtingerMatrices {
        gamma: T::of(proof.gamma)?,
        p: matrix(&proof.p)?,
        s: matrix(&proof.s)?,
        r: matrix(&proof.r)?,
        x: matrix(&proof.x)?,
    };
    let longest = T::of(longest_s)?;
    let mut negative = Vec::new();
    for closed in subject.loops::<T>()? {
        for delay in [T::zero(), longest.clone()] {
            negative.push(wirtinger_form(&closed, &longest, &delay, &matrices));
        }
    }
    let coupled = coupled(&matrices);
    Some(Claims { negative, positive: vec![matrices.p, matrices.s, matrices.r, coupled] })
}

/// Exact arithmetic is slow where it has to say no in the end; the eigenvalues say it at once.
fn checked(
    rounded: Option<Claims<f64>>,
    exact: impl FnOnce() -> Option<Claims<BigRational>>,
) -> Checked {
    let Some(rounded) = rounded else {
        return Checked::REFUSED;
    };
    let eigenvalues = |m: &DMatrix<f64>| {
        let finite = m.iter().all(|x| x.is_finite());
        finite.then(|| m.clone().symmetric_eigenvalues())
    };
    let largest = |m| eigenvalues(m).map_or(f64::INFINITY, |values| values.max());
    let smallest = |m| eigenvalues(m).map_or(f64::NEG_INFINITY, |values| values.min());
    let form_max = rounded.negative.iter().map(largest).fold(f64::NEG_INFINITY, f64::max);
    let positive_min = rounded.positive.iter().map(smallest).fold(f64::INFINITY, f64::min);
    let is_plausible = form_max < 0.0 && positive_min > 0.0;
    let is_exact = is_plausible && exact().is_some_and(|claims| claims.hold());
    Checked { form_max, positive_min, is_exact }
}

impl Claims<BigRational> {
    fn hold(self) -> bool {
        self.positive.iter().all(exact::is_positive_definite)
            && self.negative.into_iter().all(|form| exact::is_positive_definite(&-form))
    }
}
