//! The paper's gain, and the leader's acceleration fed forward.
//!
//! ```text
//! u_i = K1 x_Hi + K2 x_H(i-1) + a_0
//! ```
//!
//! The leader's acceleration is the disturbance of Theorem 1's plant, and V2V tells it. Adding it
//! changes no eigenvalue, so the gain's certificate of stability holds as it is; ours.

use super::{Situation, h_infinity};
use crate::calibration::UclCalibration;

/// u_i \[m/s²\].
pub(super) fn accel_mps2(cal: &UclCalibration, seen: &Situation) -> f64 {
    h_infinity::accel_mps2(cal, seen) + seen.leader_accel_mps2
}
