//! The paper's coordination law: an H-infinity feedback gain, found offline [MCF, Eq. 4].
//!
//! ```text
//! u_i = K1 x_Hi + K2 x_H(i-1)
//! ```

use nalgebra::RowVector3;

use super::Situation;
use crate::calibration::UclCalibration;

/// u_i \[m/s²\].
pub(super) fn accel_mps2(cal: &UclCalibration, seen: &Situation) -> f64 {
    let (k1, k2) = (RowVector3::from(cal.k1), RowVector3::from(cal.k2));
    (k1 * seen.own + k2 * seen.predecessor).x
}
