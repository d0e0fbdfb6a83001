//! Trucks that differ, one design each: the cost per truck does not depend on their number.
//!
//! Under predecessor-leader following the loop of a platoon is block triangular: it is stable
//! exactly when every truck's own loop is. So each truck gets a gain for its own plant, with a
//! proof for delays of any rate, and no truck needs to know how many there are. With K2 = 0, which
//! is what the optimum of independent disturbances has anyway, no error travels from truck to truck
//! either, and the largest gamma among them bounds every error. Jensen's inequality is enough for
//! that, and fifty times as fast to solve as Wirtinger's. Trucks that share a gain with K2 not 0
//! need [`shared`] and [`certificate::mixed_string_bound`].

use certificate::{
    Corner, DelayBound, Gain, GainFile, Plants, PlatoonProof, VERSION, VehicleProofs,
};

use crate::plant::Platoon;
use crate::{Undesigned, Unsolved, analysis, convex, prove};

/// The rho of the one program per truck: near the best for lags of 0.3 to 0.6 s.
const RHO: f64 = 0.7;

/// Designs and proves a gain for every plant; `progress` hears of every truck.
///
/// # Errors
/// When there is none for one of them.
pub fn design(
    plants: &[Corner],
    longest_s: f64,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<GainFile>, Undesigned> {
    let one = |(i, plant): (usize, &Corner)| {
        progress(i);
        truck(&format!("truck-{}", i + 1), *plant, longest_s)
    };
    plants.iter().enumerate().map(one).collect()
}

/// Designs and proves one truck's gain.
///
/// # Errors
/// When there is none.
pub fn truck(name: &str, plant: Corner, longest_s: f64) -> Result<GainFile, Undesigned> {
    let (platoon, delay) = (Platoon::alike(1, plant), DelayBound::any_rate(longest_s));
    let tangent = convex::at_rho(std::slice::from_ref(&platoon), delay, RHO)?;
    let proof = analysis::jensen(&[platoon.closed(&tangent.k)], delay)?;
    let k1 = [0, 1, 2].map(|state| tangent.k[(0, state)]);
    Ok(GainFile {
        version: VERSION,
        name: name.to_owned(),
        about: "convex bound of Theorem 1, for this truck alone".to_owned(),
        gain: Gain { k1, ..Gain::default() },
        plant: plant.into(),
        delay,
        vehicle: None,
        platoon: vec![PlatoonProof { followers: 1, proof }],
    })
}

/// Proves what one gain, K2 included, does in each of many plants; `progress` hears of every one.
///
/// # Errors
/// When one of the proofs does not exist.
pub fn shared(
    gain: &Gain,
    plants: &[Corner],
    longest_s: f64,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<VehicleProofs>, Unsolved> {
    let one = |(i, plant): (usize, &Corner)| {
        progress(i);
        prove::vehicle(gain, &Plants::from(*plant), longest_s)
    };
    plants.iter().enumerate().map(one).collect()
}

/// What no error of any of these trucks exceeds, per |w|; none when there are no proofs.
#[must_use]
pub fn bound(trucks: &[GainFile]) -> Option<f64> {
    let gammas: Option<Vec<f64>> = trucks.iter().map(GainFile::first_gamma).collect();
    gammas?.into_iter().max_by(f64::total_cmp)
}
