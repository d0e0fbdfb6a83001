//! What the rig plays of the truck's own standard groups: motion, speed, engine and brakes.
//!
//! Of the actuators it tells what was noted last. Like a sensor, each value stops at the end of its
//! range. What the rig does not tell apart or does not have (single wheels, a crankshaft, a driver)
//! is not available.

use super::ECU_ADDRESS;
use super::force::split_percent;
use crate::j1939::{
    AbsActive, AbsFullyOperational, BrakeSwitch, Ccvs1, Ebc1, Ebc2, Ebc5, EbsBrakeSwitch, Eec1,
    EngineTorqueMode, FoundationBrakeUse, ParkingBrakeSwitch, SteeringWheelSensor, Vdc2,
    XbrActiveControlMode, XbrSystemState,
};
use crate::messages::EgoState;
use crate::profile::Vehicle;
use crate::reading::Reading;
use serde::{Deserialize, Serialize};

const KMPH_PER_MPS: f64 = 3.6;
/// Ends of the ranges of SPN 513, 1807 and 1809.
const TORQUE_MAX_PERCENT: f64 = 125.0;
const WHEEL_MAX_RAD: f64 = 31.374;
const LATERAL_MAX_MPS2: f64 = 15.687;

/// What the actuators do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Actuators {
    /// Force at the wheels, positive forward \[N\].
    pub(super) force_n: f64,
    /// Front wheel angle, positive to the left \[rad\].
    pub(super) steering_rad: f64,
}

impl Actuators {
    fn is_braking(self) -> bool {
        self.force_n < 0.0
    }
}

/// VDC2.
pub(super) fn motion(state: &EgoState, known: Option<Actuators>, vehicle: &Vehicle) -> Vdc2 {
    let wheel_rad = known.map(|actuators| {
        (vehicle.steering_ratio * actuators.steering_rad).clamp(-WHEEL_MAX_RAD, WHEEL_MAX_RAD)
    });
    let centripetal_mps2 = state.speed_forward_mps * state.yaw_rate_radps;
    Vdc2 {
        steering_wheel_angle_rad: wheel_rad.into(),
        steering_wheel_sensor: match wheel_rad {
            Some(_) => SteeringWheelSensor::Absolute,
            None => SteeringWheelSensor::NotAvailable,
        },
        yaw_rate_radps: Reading::Value(state.yaw_rate_radps),
        lateral_acceleration_mps2: Reading::Value(
            centripetal_mps2.clamp(-LATERAL_MAX_MPS2, LATERAL_MAX_MPS2),
        ),
        longitudinal_acceleration_mps2: Reading::Value(state.accel_forward_mps2),
        ..Vdc2::default()
    }
}

/// CCVS1. Wheels do not tell backwards from forwards; a truck here does not roll back.
pub(super) fn vehicle_speed(state: &EgoState) -> Ccvs1 {
    Ccvs1 {
        parking_brake_switch: ParkingBrakeSwitch::NotSet,
        wheel_based_speed_kmph: Reading::Value(speed_kmph(state)),
        brake_switch: BrakeSwitch::Released,
        ..Ccvs1::default()
    }
}

/// EBC2.
pub(super) fn wheel_speeds(state: &EgoState) -> Ebc2 {
    Ebc2 { front_axle_speed_kmph: Reading::Value(speed_kmph(state)), ..Ebc2::default() }
}

/// EEC1.
pub(super) fn engine(known: Option<Actuators>, vehicle: &Vehicle) -> Eec1 {
    let Some(actuators) = known else {
        return Eec1::default();
    };
    let percent = 100.0 * actuators.force_n.max(0.0) / vehicle.full_torque_force_n;
    let (whole, fraction) = split_percent(percent.min(TORQUE_MAX_PERCENT));
    Eec1 {
        engine_torque_mode: EngineTorqueMode::CruiseControl,
        actual_torque_fraction_percent: Reading::Value(fraction),
        actual_torque_percent: Reading::Value(whole),
        engine_controller_address: Reading::Value(ECU_ADDRESS),
        ..Eec1::default()
    }
}

/// EBC1.
pub(super) fn brake_state(known: Option<Actuators>) -> Ebc1 {
    let controller = known.filter(|actuators| actuators.is_braking()).map(|_| ECU_ADDRESS);
    Ebc1 {
        abs_active: AbsActive::Passive,
        ebs_brake_switch: EbsBrakeSwitch::Released,
        abs_fully_operational: AbsFullyOperational::FullyOperational,
        brake_controller_address: controller.into(),
        ..Ebc1::default()
    }
}

/// EBC5.
pub(super) fn brake_requests(known: Option<Actuators>) -> Ebc5 {
    let (foundation_brake_use, xbr_active_control_mode) = match known.map(Actuators::is_braking) {
        None => (FoundationBrakeUse::NotAvailable, XbrActiveControlMode::NotAvailable),
        Some(true) => (FoundationBrakeUse::InUse, XbrActiveControlMode::MaximumMode),
        Some(false) => (FoundationBrakeUse::NotInUse, XbrActiveControlMode::NoBrakeDemand),
    };
    Ebc5 {
        foundation_brake_use,
        xbr_system_state: XbrSystemState::AnyDemandAccepted,
        xbr_active_control_mode,
        ..Ebc5::default()
    }
}

/// What CCVS1 says of the speed, back in SI.
pub(super) fn heard_speed_mps(vehicle: &Ccvs1) -> Option<f64> {
    vehicle.wheel_based_speed_kmph.value().map(|speed_kmph| speed_kmph / KMPH_PER_MPS)
}

fn speed_kmph(state: &EgoState) -> f64 {
    KMPH_PER_MPS * state.speed_forward_mps.max(0.0)
}
