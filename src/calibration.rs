//! From a scenario's `law` table or an ECU's own file to a control law in its slot.

use std::fs;
use std::path::Path;

use bench_sim::Scenario;
use controller_rt::{Controller, LawController};
use law::{Calibration, CoordinationLaw, UclCalibration};
use platoon_dbc::{Profile, Vehicle};

use crate::cli::{LawArgs, SolverKind};
use crate::failure::Failure;

/// Reads the calibration a `law` table gives; keys it leaves out have their published values.
///
/// # Errors
/// Names `source`, the key and what is allowed.
pub fn from_table(source: &str, table: &toml::Table) -> Result<Calibration, Failure> {
    let mut calibration: Calibration =
        table.clone().try_into().map_err(|error: toml::de::Error| {
            let reason = error.message().replace('\n', " ");
            Failure::usage(format!("{source}: law: {reason}"))
        })?;
    let says = |key| table.get("ucl").and_then(|ucl| ucl.get(key)).is_some();
    if says("law") && !says("k1") && !says("k2") {
        let law = calibration.ucl.law;
        coordinate_by(&mut calibration, law);
    }
    match calibration.defect() {
        Some((key, allowed)) => {
            Err(Failure::usage(format!("{source}: law.{key} is impossible: allowed is {allowed}")))
        }
        None => Ok(calibration),
    }
}

/// Has a law coordinate; one that is named after the published gain brings that with it.
pub fn coordinate_by(calibration: &mut Calibration, law: CoordinationLaw) {
    calibration.ucl.law = law;
    if matches!(law, CoordinationLaw::Published | CoordinationLaw::Feedforward) {
        calibration.ucl.k1 = UclCalibration::PUBLISHED_K1;
        calibration.ucl.k2 = UclCalibration::PUBLISHED_K2;
    }
}

/// Reads an ECU's own calibration file; without one the published values hold.
///
/// # Errors
/// When the file cannot be read or makes no sense.
pub fn from_file(path: Option<&Path>) -> Result<Calibration, Failure> {
    let Some(path) = path else {
        return Ok(Calibration::default());
    };
    let source = path.display().to_string();
    let text = fs::read_to_string(path).map_err(|error| {
        Failure::cannot_start(format!("--law {source}: {error}; name a TOML file"))
    })?;
    let table = text.parse().map_err(|error: toml::de::Error| {
        Failure::usage(format!("--law {source}: {}", error.message().replace('\n', " ")))
    })?;
    from_table(&source, &table)
}

/// The calibration with what the options say about it, on buses of a profile.
///
/// # Errors
/// When such buses do not carry what its controller sends.
pub fn asked_for(
    calibration: Calibration,
    options: &LawArgs,
    profile: Profile,
) -> Result<Calibration, Failure> {
    let calibration = options.applied_to(calibration);
    if calibration.structure.announces() && profile == Profile::J1939 {
        return Err(Failure::usage(
            "--controller dmpc-pf and dmpc-plf announce trajectories of 57 bytes, which the \
             profile j1939 does not carry; use --profile fd, or another --controller",
        ));
    }
    Ok(calibration)
}

/// The calibration of one truck's ECU: the common one, and the truck's mass where the scenario says
/// that it is told. Yaw inertia grows with it.
pub fn of_truck(common: &Calibration, scenario: &Scenario, truck: u8) -> Calibration {
    let mut own = *common;
    if let Some(mass_kg) = scenario.told_mass_kg(usize::from(truck)) {
        own.truck.yaw_inertia_kgm2 *= mass_kg / own.truck.mass_kg;
        own.truck.mass_kg = mass_kg;
    }
    own
}

/// The law with this calibration, ready for an ECU.
pub fn controller(calibration: Calibration, solver: SolverKind) -> Box<dyn Controller> {
    match solver {
        SolverKind::ActiveSet => LawController::active_set(calibration),
        SolverKind::Clarabel => LawController::clarabel(calibration),
    }
}

/// What a bus profile must know of the truck, as its ECU believes it to be.
pub fn vehicle(calibration: &Calibration) -> Vehicle {
    Vehicle { mass_kg: calibration.truck.mass_kg, ..Vehicle::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Calibration {
        from_table("test", &text.parse().expect("TOML")).expect("it makes sense")
    }

    #[test]
    fn a_law_named_after_the_published_gain_brings_it_unless_another_is_given() {
        let loop_k1 = Calibration::default().ucl.k1;
        assert_eq!(read("").ucl.k1, loop_k1);
        for law in ["published", "feedforward"] {
            let named = read(&format!("[ucl]\nlaw = \"{law}\""));
            assert_eq!(named.ucl.k1, UclCalibration::PUBLISHED_K1, "{law}");
        }
        assert_eq!(read("[ucl]\nlaw = \"ploeg\"").ucl.k1, loop_k1);
        let own = read("[ucl]\nlaw = \"published\"\nk1 = [1.0, 2.0, 3.0]");
        assert_eq!(own.ucl.k1, [1.0, 2.0, 3.0]);
    }
}
