//! A known command in place of a coordination law: the input of `platoon identify`.
//!
//! In a loop that is closed, command and acceleration drive each other, and their ratio says
//! nothing about the truck. A command that depends on time alone opens that loop and leaves the
//! rest, reference speed, motion layer and truck, as it is.

use super::Situation;
use crate::calibration::UclCalibration;

/// u_i \[m/s²\].
pub(super) fn accel_mps2(cal: &UclCalibration, seen: &Situation) -> f64 {
    cal.excitation.accel_mps2(seen.time_s)
}
