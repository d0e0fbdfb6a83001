//! The constant-spacing controller of the California PATH platoons, with leader and predecessor.
//!
//! ```text
//! u_i = (1 - C) a_(i-1) + C a_0 + (2 ξ - C k) ω e' + C k ω (v_0 - v_i) + ω² e,   k = ξ + √(ξ² - 1)
//! ```
//!
//! with e the distance error to the truck ahead. R. Rajamani, *Vehicle Dynamics and Control*, 2nd
//! ed., section 7.4; D. Swaroop and J. K. Hedrick, *String stability of interconnected systems*,
//! IEEE Trans. Automatic Control 41(3), 1996.

use super::Situation;

/// Share C of the leader's motion against the predecessor's, dimensionless.
const LEADER_SHARE: f64 = 0.5;
/// Damping ratio ξ, dimensionless; at 1 the root vanishes and k = ξ.
const DAMPING: f64 = 1.0;
/// Bandwidth ω \[rad/s\]; the book's 0.2 is for spacings of a car, twice that for these trucks.
const BANDWIDTH_RADPS: f64 = 0.4;

/// u_i \[m/s²\].
pub(super) fn accel_mps2(seen: &Situation) -> f64 {
    let error = seen.predecessor_error();
    let accel_ahead_mps2 = seen.leader_accel_mps2 - seen.predecessor.z;
    let (c, k, w) = (LEADER_SHARE, DAMPING, BANDWIDTH_RADPS);
    (1.0 - c) * accel_ahead_mps2
        + c * seen.leader_accel_mps2
        + (2.0 * DAMPING - c * k) * w * error.y
        + c * k * w * seen.own.y
        + w * w * error.x
}
