//! The adaptive weight of the reference speed [MCF, Eq. 22].
//!
//! ```text
//! Q_ref = Q0 ( 1/sigma_0 + sum_j 1/(sigma_j + U_j / unit) )
//! ```
//!
//! `unit` = 1 is the equation as printed. With the printed density a = 10000 it is a no-op: a
//! potential of even 4 needs a normalised distance above 500, so every near obstacle's term is
//! nil (Q_ref moves by 0.24 % over a whole run). In units of 1000 the weight does what the text
//! says: it falls while an obstacle is near.

use crate::calibration::LmlCalibration;

/// Q_ref for the potentials of the obstacles seen now.
pub fn reference_weight(cal: &LmlCalibration, potentials: impl Iterator<Item = f64>) -> f64 {
    let near: f64 = potentials.map(|u| 1.0 / (cal.sigma_j + u / cal.potential_unit)).sum();
    cal.q_0 * (1.0 / cal.sigma_0 + near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_obstacles_the_weight_is_half_of_q0() {
        assert_eq!(reference_weight(&LmlCalibration::default(), [].into_iter()), 187.5);
    }

    #[test]
    fn a_nearer_obstacle_lowers_the_weight_in_our_units_but_not_as_printed() {
        let ours = LmlCalibration::default();
        let printed = LmlCalibration { potential_unit: 1.0, ..ours };
        let spread = |cal: &LmlCalibration| {
            let (far, near) = (2_000.0, 20_000.0);
            1.0 - reference_weight(cal, [near].into_iter())
                / reference_weight(cal, [far].into_iter())
        };
        assert!(spread(&ours) > 0.1, "{}", spread(&ours));
        assert!(spread(&printed) < 0.01, "{}", spread(&printed));
    }
}
