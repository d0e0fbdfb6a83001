//! Margins in closed form, and by a sweep over frequency: no matrix inequality anywhere.
//!
//! One vehicle's loop with a delay lambda is, with K(s) = k1 + k2 s + k3 s²,
//!
//! ```text
//! 1 + L(s) e^(-lambda s) = 0,    L(s) = K(s) / (s² (tau s + 1))
//! ```
//!
//! A platoon under predecessor-leader following is a chain of such loops: K2 only couples them, so
//! they are stable together exactly when each is.

use nalgebra::{Complex, ComplexField};

use crate::gain::{Gain, Plants};

/// Frequencies of a sweep \[rad/s\]: three decades about the loop's own on both sides.
const SWEEP: (f64, f64, usize) = (1e-3, 1e3, 4_000);
/// Halvings of an interval that holds a root: enough for every bit.
const HALVINGS: usize = 200;

/// K1(jw).
pub(crate) fn k1(gain: &Gain, w_radps: f64) -> Complex<f64> {
    quadratic(&gain.k1, w_radps)
}

/// K2(jw).
pub(crate) fn k2(gain: &Gain, w_radps: f64) -> Complex<f64> {
    quadratic(&gain.k2, w_radps)
}

fn quadratic([position, speed, accel]: &[f64; 3], w: f64) -> Complex<f64> {
    Complex::new(position - accel * w * w, speed * w)
}

/// tau (jw)³ + (jw)².
pub(crate) fn open(lag_s: f64, w: f64) -> Complex<f64> {
    Complex::new(-w * w, -lag_s * w * w * w)
}

/// The frequencies of a sweep \[rad/s\], evenly spaced in their logarithm.
pub(crate) fn sweep() -> impl Iterator<Item = f64> {
    let (from, to, count) = SWEEP;
    let step = (to / from).ln() / (count - 1) as f64;
    (0..count).map(move |i| from * (step * i as f64).exp())
}

/// Whether the loop without delay is stable, by Routh's criterion.
#[must_use]
pub fn is_stable_without_delay(gain: &Gain, lag_s: f64) -> bool {
    let [position, speed, accel] = gain.k1;
    let all_positive = [lag_s, 1.0 + accel, speed, position].iter().all(|x| *x > 0.0);
    all_positive && (1.0 + accel) * speed > lag_s * position
}

/// The longest constant delay up to which the loop is stable for every shorter one \[s\].
///
/// |L(jw)| = 1 is a cubic in w²; at each of its positive roots the phase says how much delay turns
/// L to -1. Without any crossing, or unstable without delay, it is 0.
#[must_use]
pub fn delay_margin_s(gain: &Gain, lag_s: f64) -> f64 {
    if !is_stable_without_delay(gain, lag_s) {
        return 0.0;
    }
    crossovers(gain, lag_s)
        .into_iter()
        .map(|w| {
            let phase = k1(gain, w).argument() - (lag_s * w).atan();
            phase.rem_euclid(core::f64::consts::TAU) / w
        })
        .fold(f64::INFINITY, f64::min)
}

/// Frequencies at which |L| = 1 \[rad/s\].
fn crossovers(gain: &Gain, lag_s: f64) -> Vec<f64> {
    let [position, speed, accel] = gain.k1;
    let (c3, c2) = (lag_s * lag_s, 1.0 - accel * accel);
    let (c1, c0) = (2.0 * position * accel - speed * speed, -position * position);
    let value = |x: f64| ((c3 * x + c2) * x + c1) * x + c0;
    // Between the turning points of the cubic it is monotone.
    let root = (c2 * c2 - 3.0 * c3 * c1).max(0.0).sqrt();
    let turns = [(-c2 - root) / (3.0 * c3), (-c2 + root) / (3.0 * c3)];
    let end = 1.0 + [c2, c1, c0].iter().map(|c| c.abs() / c3).fold(0.0, f64::max);
    let mut ends = vec![0.0];
    ends.extend(turns.into_iter().filter(|x| *x > 0.0 && *x < end));
    ends.push(end);
    ends.windows(2)
        .filter(|pair| (value(pair[0]) < 0.0) != (value(pair[1]) < 0.0))
        .map(|pair| root_between(value, pair[0], pair[1]).sqrt())
        .collect()
}

/// The root of a function between two places where its signs differ.
fn root_between(value: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let is_negative = value(low) < 0.0;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if (value(middle) < 0.0) == is_negative { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The longest delay for which the small-gain theorem promises stability at any rate of change
/// \[s\]: x(t) - x(t - lambda) is an integral of x' over lambda, a block of gain h, around which
/// the loop has the gain sup |jw L / (1 + L)|.
#[must_use]
pub fn any_rate_small_gain_s(gain: &Gain, lag_s: f64) -> f64 {
    if !is_stable_without_delay(gain, lag_s) {
        return 0.0;
    }
    let around = |w: f64| w * (k1(gain, w) / (open(lag_s, w) + k1(gain, w))).modulus();
    // Above every sweep the loop behaves like k3 / tau.
    let limit = gain.k1[2] / lag_s;
    1.0 / sweep().map(around).fold(limit, f64::max)
}

/// Largest gains over frequency at one constant delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peaks {
    /// From w = \[a_0, a_0'\] to a vehicle's position error when nothing is forwarded to it.
    pub error: f64,
    /// |T|: from the error of the truck ahead to what it adds to this one's.
    pub forwarded: f64,
    /// |1 + T|: by how much a truck's gap closes when the one ahead falls back by itself.
    pub gap: f64,
}

/// The peaks at this delay.
#[must_use]
pub fn peaks(gain: &Gain, lag_s: f64, delay_s: f64) -> Peaks {
    let both = (1.0 + lag_s * lag_s).sqrt();
    let at = |w: f64| {
        let late = Complex::new((w * delay_s).cos(), -(w * delay_s).sin());
        let d = open(lag_s, w) + k1(gain, w) * late;
        let t = k2(gain, w) * late / d;
        Peaks {
            error: both / d.modulus(),
            forwarded: t.modulus(),
            gap: (t + Complex::new(1.0, 0.0)).modulus(),
        }
    };
    sweep().map(at).fold(Peaks { error: 0.0, forwarded: 0.0, gap: 0.0 }, |most, now| Peaks {
        error: most.error.max(now.error),
        forwarded: most.forwarded.max(now.forwarded),
        gap: most.gap.max(now.gap),
    })
}

/// The smallest of a margin over the corners of the plants, each given as the gain in series with
/// it and its lag.
#[must_use]
pub fn least_over(plants: &Plants, gain: &Gain, margin: impl Fn(&Gain, f64) -> f64) -> f64 {
    let of = |corner: crate::Corner| margin(&gain.through(corner.gain), corner.lag_s);
    plants.corners().into_iter().map(of).fold(f64::INFINITY, f64::min)
}
