//! Where the poles are: of the loop with a constant delay, and of its sampled version.

use nalgebra::{Complex, ComplexField, DMatrix, Matrix3, RowVector3, Schur, Vector3};

use crate::gain::Gain;

/// Chebyshev points over the delay interval; the rightmost root is then right to 1e-9 for the
/// delays here.
const POINTS: usize = 30;
/// Steps of the eigenvalue search before it counts as failed.
const SEARCH_MAX: usize = 100_000;

/// A and B of one vehicle: x' = A x + B u.
pub(crate) fn vehicle(lag_s: f64) -> (Matrix3<f64>, Vector3<f64>) {
    let a = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0 / lag_s);
    (a, Vector3::new(0.0, 0.0, -1.0 / lag_s))
}

/// The rightmost root of one vehicle's loop with a constant delay \[1/s\]; `None` when the search
/// fails.
///
/// The generator of the delayed state over [-h, 0] is collocated at Chebyshev points (Breda, Maset
/// and Vermiglio, SIAM J. Sci. Comput. 27, 2005). A whole platoon would have the same roots several
/// times over, which no eigenvalue search likes, so it is looked at truck by truck.
#[must_use]
pub fn rightmost_root(gain: &Gain, lag_s: f64, delay_s: f64) -> Option<Complex<f64>> {
    let (a, b) = vehicle(lag_s);
    let fed_back = b * RowVector3::from(gain.k1);
    if delay_s == 0.0 {
        let whole = a + fed_back;
        return rightmost(DMatrix::from_fn(3, 3, |i, j| whole[(i, j)]));
    }
    let n = POINTS + 1;
    let derivative = chebyshev_derivative();
    let mut generator = DMatrix::zeros(3 * n, 3 * n);
    for (row, column) in (1..n).flat_map(|row| (0..n).map(move |column| (row, column))) {
        for state in 0..3 {
            generator[(3 * row + state, 3 * column + state)] =
                derivative[(row, column)] * 2.0 / delay_s;
        }
    }
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        generator[(i, j)] = a[(i, j)];
        generator[(i, 3 * POINTS + j)] = fed_back[(i, j)];
    }
    rightmost(generator)
}

/// Differentiation of a polynomial given at the points cos(pi j / N) (Trefethen, Spectral Methods
/// in MATLAB, 2000).
fn chebyshev_derivative() -> DMatrix<f64> {
    let n = POINTS;
    let x = |i: usize| (core::f64::consts::PI * i as f64 / n as f64).cos();
    let weight = |i: usize| {
        let end = if i == 0 || i == n { 2.0 } else { 1.0 };
        if i.is_multiple_of(2) { end } else { -end }
    };
    let mut d = DMatrix::from_fn(n + 1, n + 1, |i, j| {
        if i == j { 0.0 } else { weight(i) / weight(j) / (x(i) - x(j)) }
    });
    for i in 0..=n {
        d[(i, i)] = -d.row(i).sum();
    }
    d
}

fn eigenvalues(matrix: DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    let schur = Schur::try_new(matrix, f64::EPSILON, SEARCH_MAX)?;
    Some(schur.complex_eigenvalues().iter().copied().collect())
}

fn rightmost(matrix: DMatrix<f64>) -> Option<Complex<f64>> {
    eigenvalues(matrix)?.into_iter().max_by(|a, b| a.re.total_cmp(&b.re))
}

/// Spectral radius of one vehicle's loop when its errors are sampled every `period_s`, act
/// `latency_s` later, and are held until the next take effect; below 1 it is stable. `None` when
/// the search fails.
///
/// Exact: between samples the plant is linear with a constant input, which changes once.
#[must_use]
pub fn sampled_radius(gain: &Gain, lag_s: f64, period_s: f64, latency_s: f64) -> Option<f64> {
    let whole = (latency_s / period_s + 1e-9).floor();
    let late_s = (latency_s - whole * period_s).max(0.0);
    let older = whole as usize;
    // The state is x and the commands computed one, two, ... samples ago.
    let order = 3 + older + 1;
    let (step, _) = held(lag_s, period_s);
    let (rest, new) = held(lag_s, period_s - late_s);
    let (_, old) = held(lag_s, late_s);
    let old = rest * old;
    let k1 = RowVector3::from(gain.k1);
    let mut next = DMatrix::zeros(order, order);
    let direct = if older == 0 { new * k1 } else { Matrix3::zeros() };
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        next[(i, j)] = step[(i, j)] + direct[(i, j)];
    }
    for i in 0..3 {
        if older > 0 {
            next[(i, 3 + older - 1)] += new[i];
        }
        next[(i, 3 + older)] += old[i];
        next[(3, i)] = k1[i];
    }
    for i in 1..=older {
        next[(3 + i, 3 + i - 1)] = 1.0;
    }
    let largest = eigenvalues(next)?.into_iter().map(|z| z.modulus()).fold(0.0, f64::max);
    Some(largest)
}

/// What the plant does in `time_s` by itself, and under a constant unit command: the lag answers
/// with an exponential, position and speed integrate it.
fn held(lag_s: f64, time_s: f64) -> (Matrix3<f64>, Vector3<f64>) {
    let left = (-time_s / lag_s).exp();
    let speed = lag_s * (1.0 - left);
    let position = lag_s * (time_s - speed);
    let free = Matrix3::new(1.0, time_s, position, 0.0, 1.0, speed, 0.0, 0.0, left);
    let forced = Vector3::new(position - 0.5 * time_s * time_s, speed - time_s, left - 1.0);
    (free, forced)
}
