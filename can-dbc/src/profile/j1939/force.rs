//! Force at the wheels as trucks speak of it: engine torque in percent, and braking deceleration.

use crate::j1939::{OverrideControlMode, Tsc1, Xbr, XbrControlMode};
use crate::profile::Vehicle;
use crate::reading::Reading;

/// Steps of the torque in a percent: SPN 518 counts percents, SPN 4191 eighths of one.
pub(super) const STEPS_PER_PERCENT: f64 = 8.0;

/// A torque in whole percents and the rest, which is never negative.
pub(super) fn split_percent(torque_percent: f64) -> (f64, f64) {
    let steps = (torque_percent * STEPS_PER_PERCENT).round_ties_even();
    let whole = (steps / STEPS_PER_PERCENT).floor();
    (whole, steps / STEPS_PER_PERCENT - whole)
}

/// The torque command for a driving force; `None` requests nothing.
pub(super) fn torque_command(force_n: Option<f64>, vehicle: &Vehicle) -> Tsc1 {
    let Some(force_n) = force_n else {
        return Tsc1::default();
    };
    let (whole, fraction) = split_percent(100.0 * force_n / vehicle.full_torque_force_n);
    Tsc1 {
        override_control_mode: OverrideControlMode::TorqueControl,
        override_control_mode_priority: crate::j1939::OverrideControlModePriority::MediumPriority,
        requested_torque_percent: Reading::Value(whole),
        requested_torque_fraction_percent: Reading::Value(fraction),
        ..Tsc1::default()
    }
}

/// The brake command for a braking force; `None` requests nothing.
pub(super) fn brake_command(force_n: Option<f64>, vehicle: &Vehicle) -> Xbr {
    let Some(force_n) = force_n else {
        return Xbr::default();
    };
    Xbr {
        acceleration_demand_mps2: Reading::Value(force_n / vehicle.mass_kg),
        xbr_control_mode: XbrControlMode::MaximumMode,
        xbr_priority: crate::j1939::XbrPriority::MediumPriority,
        ..Xbr::default()
    }
}

/// The force both commands ask for together \[N\]; `None` when one is none of ours.
pub(super) fn commanded_n(torque: &Tsc1, brake: &Xbr, vehicle: &Vehicle) -> Option<f64> {
    let engine_n = match torque.override_control_mode {
        OverrideControlMode::OverrideDisabled => 0.0,
        OverrideControlMode::TorqueControl => {
            let whole = torque.requested_torque_percent.value()?;
            let percent = whole + torque.requested_torque_fraction_percent.value()?;
            percent / 100.0 * vehicle.full_torque_force_n
        }
        OverrideControlMode::SpeedControl | OverrideControlMode::SpeedTorqueLimitControl => {
            return None;
        }
    };
    let brake_n = match brake.xbr_control_mode {
        XbrControlMode::OverrideDisabled => 0.0,
        XbrControlMode::AdditionMode | XbrControlMode::MaximumMode => {
            brake.acceleration_demand_mps2.value()? * vehicle.mass_kg
        }
        XbrControlMode::NotDefined => return None,
    };
    Some(engine_n + brake_n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percent_is_split_into_a_whole_and_eighths_that_add() {
        for (percent, parts) in [
            (0.0, (0.0, 0.0)),
            (12.3, (12.0, 0.25)),
            (-0.1, (-1.0, 0.875)),
            (99.95, (100.0, 0.0)),
            (-125.0, (-125.0, 0.0)),
        ] {
            assert_eq!(split_percent(percent), parts, "{percent}");
        }
    }

    #[test]
    fn a_force_comes_back_within_half_a_step_of_its_command() {
        let vehicle = Vehicle::default();
        for step in -5_000..=3_100 {
            let force_n = f64::from(step) * 7.77;
            let (torque, brake) = match force_n < 0.0 {
                true => (None, Some(force_n)),
                false => (Some(force_n), None),
            };
            let (torque, _) =
                Tsc1::decode(&torque_command(torque, &vehicle).encode(0).expect("in range"))
                    .expect("sound");
            let (brake, _) =
                Xbr::decode(&brake_command(brake, &vehicle).encode(0).expect("in range"))
                    .expect("sound");
            let heard_n = commanded_n(&torque, &brake, &vehicle).expect("ours");
            let half_n = if force_n < 0.0 { 0.5 * 5760.0 / 2048.0 } else { 0.5 * 200.0 / 8.0 };
            assert!((heard_n - force_n).abs() <= half_n + 1e-6, "{force_n}: {heard_n}");
        }
    }

    #[test]
    fn a_command_of_another_kind_or_without_its_value_is_no_force() {
        let vehicle = Vehicle::default();
        let (idle, brake) = (torque_command(None, &vehicle), brake_command(None, &vehicle));
        assert_eq!(commanded_n(&idle, &brake, &vehicle), Some(0.0));
        let speed = Tsc1 { override_control_mode: OverrideControlMode::SpeedControl, ..idle };
        assert_eq!(commanded_n(&speed, &brake, &vehicle), None);
        let blank = Tsc1 { override_control_mode: OverrideControlMode::TorqueControl, ..idle };
        assert_eq!(commanded_n(&blank, &brake, &vehicle), None);
        let blank = Xbr { xbr_control_mode: XbrControlMode::MaximumMode, ..brake };
        assert_eq!(commanded_n(&idle, &blank, &vehicle), None);
    }
}
