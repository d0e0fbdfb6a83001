//! Trucks that differ, one design each: the cost per truck does not depend on their number.
//!
//! Under predecessor-leader following the loop of a platoon is block triangular: it is stable
//! exactly when every truck's own loop is. So each truck gets a gain for its own lag, with a proof
//! for delays of any rate, and no truck needs to know how many there are. With K2 = 0, which is
//! what the optimum of independent disturbances has anyway, no error travels from truck to truck
//! either, and the largest gamma among them bounds every error.

use certificate::{DelayBound, Gain, Lags, VehicleProofs};

use crate::plant::Platoon;
use crate::{Undesigned, convex, prove};

/// The rho of the one program per truck: near the best for lags of 0.3 to 0.6 s.
const RHO: f64 = 0.7;

/// One truck's design.
#[derive(Debug, Clone, PartialEq)]
pub struct Truck {
    /// Its lag \[s\].
    pub lag_s: f64,
    /// Its gain.
    pub gain: Gain,
    /// What the gain can claim.
    pub proofs: VehicleProofs,
}

/// Designs and proves a gain for every lag; `progress` hears of every truck.
///
/// # Errors
/// When there is none for one of them.
pub fn design(
    lags_s: &[f64],
    longest_s: f64,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<Truck>, Undesigned> {
    let one = |(i, lag_s): (usize, &f64)| {
        progress(i);
        truck(*lag_s, longest_s)
    };
    lags_s.iter().enumerate().map(one).collect()
}

/// Designs and proves one truck's gain.
///
/// # Errors
/// When there is none.
pub fn truck(lag_s: f64, longest_s: f64) -> Result<Truck, Undesigned> {
    let tangent =
        convex::at_rho(&[Platoon::alike(1, lag_s)], DelayBound::any_rate(longest_s), RHO)?;
    let k1 = [0, 1, 2].map(|state| tangent.k[(0, state)]);
    let gain = Gain { k1, ..Gain::default() };
    let proofs = prove::vehicle(&gain, &Lags::only(lag_s), longest_s)?;
    Ok(Truck { lag_s, gain, proofs })
}

/// What no error of any truck exceeds, per |w|.
#[must_use]
pub fn bound(trucks: &[Truck]) -> f64 {
    trucks.iter().map(|truck| truck.proofs.disturbance_to_error.gamma).fold(0.0, f64::max)
}
