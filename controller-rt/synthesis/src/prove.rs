//! From a gain to a file with all its proofs.

use certificate::{
    Corner, CouplingProofs, DelayBound, Gain, GainFile, Plants, PlatoonProof, VERSION,
    VehicleProofs, Wirtinger,
};
use nalgebra::DMatrix;

use crate::analysis;
use crate::lmi::Unsolved;
use crate::plant::{Loop, Platoon};

/// What a file is to be about.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// Name of the gain.
    pub name: String,
    /// Where it comes from.
    pub about: String,
    /// The gain.
    pub gain: Gain,
    /// The plants it is for.
    pub plants: Plants,
    /// The delays it is for.
    pub delay: DelayBound,
    /// Platoons to prove at once go up to so many followers.
    pub followers: usize,
}

/// The file with every proof that exists: for one truck, which is enough for any number of trucks,
/// and for whole platoons.
///
/// # Errors
/// When there is neither.
pub fn prove(claim: &Claim, progress: &mut dyn FnMut(&str)) -> Result<GainFile, Unsolved> {
    progress("one truck");
    let vehicle = vehicle(&claim.gain, &claim.plants, claim.delay.longest_s);
    let mut platoon = Vec::new();
    for followers in 1..=claim.followers {
        progress(&format!("{followers} followers"));
        let corner = |plant| {
            let open = Platoon::alike(followers, plant);
            open.closed(&open.k(&claim.gain))
        };
        let loops: Vec<Loop> = claim.plants.corners().into_iter().map(corner).collect();
        match analysis::jensen(&loops, claim.delay) {
            Ok(proof) => platoon.push(PlatoonProof { followers, proof }),
            // More followers are never easier to prove.
            Err(_) => break,
        }
    }
    if let Err(why) = vehicle
        && platoon.is_empty()
    {
        return Err(why);
    }
    Ok(GainFile {
        version: VERSION,
        name: claim.name.clone(),
        about: claim.about.clone(),
        gain: claim.gain,
        plant: claim.plants,
        delay: claim.delay,
        vehicle: vehicle.ok(),
        platoon,
    })
}

/// The proofs for one truck.
///
/// # Errors
/// When one of them does not exist.
pub fn vehicle(gain: &Gain, plants: &Plants, longest_s: f64) -> Result<VehicleProofs, Unsolved> {
    let channel = |is_from_forwarded, is_to_forwarded| -> Result<Wirtinger, Unsolved> {
        let corner = |plant| vehicle_loop(gain, plant, is_from_forwarded, is_to_forwarded);
        let loops: Vec<Loop> = plants.corners().into_iter().map(corner).collect();
        analysis::wirtinger(&loops, longest_s)
    };
    let disturbance_to_error = channel(false, false)?;
    let coupling = gain.is_coupled().then(|| {
        Ok(CouplingProofs {
            disturbance_to_forwarded: channel(false, true)?,
            forwarded_to_error: channel(true, false)?,
            forwarded_to_forwarded: channel(true, true)?,
        })
    });
    Ok(VehicleProofs { disturbance_to_error, coupling: coupling.transpose()? })
}

/// One truck's loop, from its disturbance or from the signal v that enters beside its command, to
/// its position error or to K2 x.
fn vehicle_loop(
    gain: &Gain,
    plant: Corner,
    is_from_forwarded: bool,
    is_to_forwarded: bool,
) -> Loop {
    let open = Platoon::alike(1, plant);
    let mut closed = open.closed(&open.k(gain));
    if is_from_forwarded {
        closed.input = open.b_u();
    }
    if is_to_forwarded {
        closed.output = DMatrix::from_row_slice(1, 3, &gain.k2);
    }
    closed
}
