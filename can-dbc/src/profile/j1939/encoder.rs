//! Messages to frames, in the order of their priority on the bus.

use super::force::{brake_command, split_percent, torque_command};
use super::rate::{Period, Rate};
use super::{BRAKE_COUNTER_MASK, ECU_ADDRESS, KMPH_PER_MPS, NO_MEMBER, NS_PER_S, bytes};
use crate::checksum::{command_digest, motion_digest};
use crate::codec::EncodeError;
use crate::frame::Frame;
use crate::j1939 as frames;
use crate::messages::{
    Actuation, EcuStatus, EgoState, Message, Mission, Obstacle, V2vOut, V2vState,
};
use crate::profile::Vehicle;
use crate::reading::Reading;
use serde::{Deserialize, Serialize};

/// Frames of one message at most: those of `EgoState` with everything the rig plays beside.
const FRAMES_MAX: usize = 9;
/// Frame kinds of `j1939.dbc`.
const KINDS: usize = 28;
const _: () = assert!(frames::MESSAGES.len() == KINDS);

/// Of the controls and the navigation solution, the fastest that the profile sends.
const LOOP: Period = Period::ms(frames::Vdc2::CYCLE_TIME_MS as u64);
const XBR: Period = Period::ms(frames::Xbr::CYCLE_TIME_MS as u64);
const CCVS1: Period = Period::ms(frames::Ccvs1::CYCLE_TIME_MS as u64);
// What tells nothing of a message is spread between, as from nodes with clocks of their own.
const EEC1: Period = Period::ms_after(frames::Eec1::CYCLE_TIME_MS as u64, 10);
const EBC1: Period = Period::ms_after(frames::Ebc1::CYCLE_TIME_MS as u64, 20);
const EBC5: Period = Period::ms_after(frames::Ebc5::CYCLE_TIME_MS as u64, 40);
const EBC2: Period = Period::ms_after(frames::Ebc2::CYCLE_TIME_MS as u64, 60);

/// Largest values that the feedback of the actuators can tell; like a sensor, it stops there.
const TORQUE_MAX_PERCENT: f64 = 125.0;
const WHEEL_MAX_RAD: f64 = 31.374;
const LATERAL_MAX_MPS2: f64 = 15.687;

/// Alive counters, and when which frame is due.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Encoder {
    vehicle: Vehicle,
    /// Next alive counter by place in `j1939::MESSAGES`.
    alive: [u8; KINDS],
    rates: Rates,
    /// The newest brake request as it is on the bus, its counter, and whether it brakes.
    brake: [u8; 8],
    brake_counter: u8,
    is_braking: bool,
    /// Force \[N\] and front wheel angle \[rad\] of the actuators.
    actuators: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Rates {
    state: Rate,
    command: Rate,
    xbr: Rate,
    ccvs1: Rate,
    eec1: Rate,
    ebc1: Rate,
    ebc2: Rate,
    ebc5: Rate,
}

/// The frames of one message.
#[derive(Default)]
struct Batch {
    frames: [Option<Frame>; FRAMES_MAX],
    count: usize,
}

impl Batch {
    fn push(&mut self, frame: Frame) {
        self.frames[self.count] = Some(frame);
        self.count += 1;
    }
}

impl Encoder {
    pub(crate) fn new(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            alive: [0; KINDS],
            rates: Rates::default(),
            brake: [0; 8],
            brake_counter: 0,
            is_braking: false,
            actuators: None,
        }
    }

    pub(crate) fn note_actuators(&mut self, force_n: f64, steering_rad: f64) {
        self.actuators = Some((force_n, steering_rad));
    }

    pub(crate) fn encode(
        &mut self,
        message: &Message,
        time_ns: u64,
        emit: &mut dyn FnMut(&Frame),
    ) -> Result<(), EncodeError> {
        let mut batch = Batch::default();
        // What cannot be encoded costs neither a counter nor a turn.
        let mut next = *self;
        match message {
            Message::EgoState(state) => next.ego_state(state, time_ns, &mut batch)?,
            Message::Actuation(command) => next.actuation(command, time_ns, &mut batch)?,
            Message::V2vState(state) => next.v2v_state(state, &mut batch)?,
            Message::V2vOut(state) => next.v2v_out(state, &mut batch)?,
            Message::Obstacle(obstacle) => next.obstacle(obstacle, &mut batch)?,
            Message::Mission(mission) => next.mission(mission, &mut batch)?,
            Message::EcuStatus(status) => next.ecu_status(status, &mut batch)?,
        }
        *self = next;
        batch.frames.iter().flatten().for_each(emit);
        Ok(())
    }

    /// The counter for the next frame of a kind.
    fn next_counter(&mut self, index: usize, counter_max: u8) -> u8 {
        let this = self.alive[index];
        self.alive[index] = if this == counter_max { 0 } else { this + 1 };
        this
    }

    fn ego_state(
        &mut self,
        state: &EgoState,
        time_ns: u64,
        batch: &mut Batch,
    ) -> Result<(), EncodeError> {
        if !self.rates.state.is_due(time_ns, LOOP) {
            return Ok(());
        }
        let is_braking = self.actuators.map(|(force_n, _)| force_n < 0.0);
        let speed_kmph = Reading::Value(KMPH_PER_MPS * state.speed_forward_mps.max(0.0));
        if self.rates.eec1.is_due(time_ns, EEC1) {
            batch.push(self.engine().encode()?);
        }
        if self.rates.ebc1.is_due(time_ns, EBC1) {
            batch.push(brake_state(is_braking).encode()?);
        }
        let motion = self.motion(state).encode()?;
        batch.push(motion);
        if self.rates.ebc5.is_due(time_ns, EBC5) {
            batch.push(brake_requests(is_braking).encode()?);
        }
        if self.rates.ebc2.is_due(time_ns, EBC2) {
            let wheels =
                frames::Ebc2 { front_axle_speed_kmph: speed_kmph, ..frames::Ebc2::default() };
            batch.push(wheels.encode()?);
        }
        if self.rates.ccvs1.is_due(time_ns, CCVS1) {
            batch.push(vehicle_speed(speed_kmph).encode()?);
        }
        self.navigation(state, motion_digest(motion.data()), batch)
    }

    /// What the engine does, as far as it is known.
    fn engine(&self) -> frames::Eec1 {
        let Some((force_n, _)) = self.actuators else {
            return frames::Eec1::default();
        };
        let percent = 100.0 * force_n.max(0.0) / self.vehicle.full_torque_force_n;
        let (whole, fraction) = split_percent(percent.min(TORQUE_MAX_PERCENT));
        frames::Eec1 {
            engine_torque_mode: frames::EngineTorqueMode::CruiseControl,
            actual_torque_fraction_percent: Reading::Value(fraction),
            actual_torque_percent: Reading::Value(whole),
            engine_controller_address: Reading::Value(ECU_ADDRESS),
            ..frames::Eec1::default()
        }
    }

    fn motion(&self, state: &EgoState) -> frames::Vdc2 {
        let wheel_rad = self.actuators.map(|(_, steering_rad)| {
            (self.vehicle.steering_ratio * steering_rad).clamp(-WHEEL_MAX_RAD, WHEEL_MAX_RAD)
        });
        let centripetal_mps2 = state.speed_forward_mps * state.yaw_rate_radps;
        let lateral_mps2 = centripetal_mps2.clamp(-LATERAL_MAX_MPS2, LATERAL_MAX_MPS2);
        frames::Vdc2 {
            steering_wheel_angle_rad: wheel_rad.into(),
            steering_wheel_sensor: match wheel_rad {
                Some(_) => frames::SteeringWheelSensor::Absolute,
                None => frames::SteeringWheelSensor::NotAvailable,
            },
            yaw_rate_radps: Reading::Value(state.yaw_rate_radps),
            lateral_acceleration_mps2: Reading::Value(lateral_mps2),
            longitudinal_acceleration_mps2: Reading::Value(state.accel_forward_mps2),
            ..frames::Vdc2::default()
        }
    }

    fn navigation(
        &mut self,
        state: &EgoState,
        motion_digest: u16,
        batch: &mut Batch,
    ) -> Result<(), EncodeError> {
        let counter =
            self.next_counter(frames::NavPosition::INDEX, frames::NavPosition::COUNTER_MAX);
        let position = frames::NavPosition {
            position_x_m: state.position_x_m,
            position_y_m: state.position_y_m,
        };
        let motion = frames::NavMotion {
            heading_rad: state.heading_rad,
            speed_lateral_mps: state.speed_lateral_mps,
            nav_status: state.nav_status,
            motion_digest,
        };
        let time = frames::NavTime { bench_time_s: seconds(state.bench_time_ns), tick: state.tick };
        batch.push(position.encode(counter)?);
        batch.push(motion.encode(counter)?);
        batch.push(time.encode(counter)?);
        Ok(())
    }

    /// Engine and brakes are never asked for force at the same time: when one is to follow the
    /// other, the engine waits until the brakes have been released on the bus.
    fn actuation(
        &mut self,
        command: &Actuation,
        time_ns: u64,
        batch: &mut Batch,
    ) -> Result<(), EncodeError> {
        if !self.rates.command.is_due(time_ns, LOOP) {
            return Ok(());
        }
        if command.force_n.is_nan() {
            return Err(EncodeError::NotANumber("AccelerationDemand"));
        }
        let braking_n = Some(command.force_n).filter(|force_n| *force_n < 0.0);
        let brake = if self.rates.xbr.is_due(time_ns, XBR) {
            let counter = self.next_counter(frames::Xbr::INDEX, frames::Xbr::COUNTER_MAX);
            let frame = brake_command(braking_n, &self.vehicle).encode(counter)?;
            (self.brake, self.brake_counter) = (bytes(&frame), counter);
            self.is_braking = braking_n.is_some();
            Some(frame)
        } else {
            None
        };
        let driving_n = Some(command.force_n).filter(|force_n| *force_n >= 0.0 && !self.is_braking);
        let counter = self.next_counter(frames::Tsc1::INDEX, frames::Tsc1::COUNTER_MAX);
        let torque = torque_command(driving_n, &self.vehicle).encode(counter)?;
        let counter =
            self.next_counter(frames::SteerCommand::INDEX, frames::SteerCommand::COUNTER_MAX);
        let steering = frames::SteerCommand {
            actuation_status: command.actuation_status,
            steering_rad: command.steering_rad,
            answers_tick: command.answers_tick,
            brake_counter: self.brake_counter & BRAKE_COUNTER_MASK,
            command_digest: command_digest(&bytes(&torque), &self.brake),
        };
        let steering = steering.encode(counter)?;
        batch.push(torque);
        brake.into_iter().for_each(|frame| batch.push(frame));
        batch.push(steering);
        Ok(())
    }

    fn v2v_state(&mut self, state: &V2vState, batch: &mut Batch) -> Result<(), EncodeError> {
        let counter =
            self.next_counter(frames::V2vPosition::INDEX, frames::V2vPosition::COUNTER_MAX);
        let position = frames::V2vPosition {
            position_x_m: state.position_x_m,
            position_y_m: state.position_y_m,
        };
        let motion = frames::V2vMotion {
            speed_mps: state.speed_mps,
            accel_mps2: state.accel_mps2,
            intended_accel_mps2: state.intended_accel_mps2,
            source_truck: state.source_truck,
        };
        let time = frames::V2vTime {
            generation_time_s: seconds(state.generation_time_ns),
            sequence: state.sequence,
        };
        batch.push(position.encode(counter)?);
        batch.push(motion.encode(counter)?);
        batch.push(time.encode(counter)?);
        Ok(())
    }

    fn v2v_out(&mut self, state: &V2vOut, batch: &mut Batch) -> Result<(), EncodeError> {
        let counter =
            self.next_counter(frames::V2vOutPosition::INDEX, frames::V2vOutPosition::COUNTER_MAX);
        let position = frames::V2vOutPosition {
            position_x_m: state.position_x_m,
            position_y_m: state.position_y_m,
        };
        let motion = frames::V2vOutMotion {
            speed_mps: state.speed_mps,
            accel_mps2: state.accel_mps2,
            intended_accel_mps2: state.intended_accel_mps2,
        };
        let heading = frames::V2vOutHeading {
            heading_rad: state.heading_rad,
            yaw_rate_radps: state.yaw_rate_radps,
        };
        let time = frames::V2vOutTime {
            generation_time_s: seconds(state.generation_time_ns),
            sequence: state.sequence,
        };
        batch.push(position.encode(counter)?);
        batch.push(motion.encode(counter)?);
        batch.push(heading.encode(counter)?);
        batch.push(time.encode(counter)?);
        Ok(())
    }

    fn obstacle(&mut self, obstacle: &Obstacle, batch: &mut Batch) -> Result<(), EncodeError> {
        let counter = self
            .next_counter(frames::ObstaclePosition::INDEX, frames::ObstaclePosition::COUNTER_MAX);
        let position = frames::ObstaclePosition {
            position_x_m: obstacle.position_x_m,
            position_y_m: obstacle.position_y_m,
        };
        let motion = frames::ObstacleMotion {
            speed_x_mps: obstacle.speed_x_mps,
            speed_y_mps: obstacle.speed_y_mps,
            heading_rad: obstacle.heading_rad,
            obstacle_kind: obstacle.kind,
            obstacle_page: obstacle.page,
        };
        let shape = frames::ObstacleBox {
            measured_time_s: seconds(obstacle.measured_time_ns),
            member: Some(obstacle.member).filter(|member| *member != NO_MEMBER).into(),
            length_m: obstacle.length_m,
            width_m: obstacle.width_m,
        };
        batch.push(position.encode(counter)?);
        batch.push(motion.encode(counter)?);
        batch.push(shape.encode(counter)?);
        Ok(())
    }

    fn mission(&mut self, mission: &Mission, batch: &mut Batch) -> Result<(), EncodeError> {
        let counter =
            self.next_counter(frames::MissionPlatoon::INDEX, frames::MissionPlatoon::COUNTER_MAX);
        let platoon = frames::MissionPlatoon {
            truck_index: mission.truck_index,
            run_state: mission.run_state,
            platoon_size: mission.platoon_size,
            loop_period_ns: mission.loop_period_ns,
        };
        let target = frames::MissionTarget {
            spacing_m: mission.spacing_m,
            set_speed_mps: mission.set_speed_mps,
        };
        let lane = frames::MissionLane {
            desired_y_m: mission.desired_y_m,
            lane_width_m: mission.lane_width_m,
        };
        let edges = frames::MissionEdges {
            right_edge_y_m: mission.right_edge_y_m,
            left_edge_y_m: mission.left_edge_y_m,
        };
        batch.push(platoon.encode(counter)?);
        batch.push(target.encode(counter)?);
        batch.push(lane.encode(counter)?);
        batch.push(edges.encode(counter)?);
        Ok(())
    }

    fn ecu_status(&mut self, status: &EcuStatus, batch: &mut Batch) -> Result<(), EncodeError> {
        let counter =
            self.next_counter(frames::EcuProgress::INDEX, frames::EcuProgress::COUNTER_MAX);
        let progress = frames::EcuProgress {
            ecu_mode: status.ecu_mode,
            gain_id: status.gain_id,
            tick_count: status.tick_count,
        };
        let misses = frames::EcuMisses { misses: status.misses, skipped: status.skipped };
        batch.push(progress.encode(counter)?);
        batch.push(misses.encode(counter)?);
        Ok(())
    }
}

/// State of the brake system; `None` while nobody knows whether it brakes.
fn brake_state(is_braking: Option<bool>) -> frames::Ebc1 {
    frames::Ebc1 {
        abs_active: frames::AbsActive::Passive,
        ebs_brake_switch: frames::EbsBrakeSwitch::Released,
        abs_fully_operational: frames::AbsFullyOperational::FullyOperational,
        brake_controller_address: is_braking.filter(|brakes| *brakes).map(|_| ECU_ADDRESS).into(),
        ..frames::Ebc1::default()
    }
}

/// What the brakes do with requests; `None` while nobody knows.
fn brake_requests(is_braking: Option<bool>) -> frames::Ebc5 {
    use frames::{FoundationBrakeUse, XbrActiveControlMode};
    let (foundation_brake_use, xbr_active_control_mode) = match is_braking {
        None => (FoundationBrakeUse::NotAvailable, XbrActiveControlMode::NotAvailable),
        Some(true) => (FoundationBrakeUse::InUse, XbrActiveControlMode::MaximumMode),
        Some(false) => (FoundationBrakeUse::NotInUse, XbrActiveControlMode::NoBrakeDemand),
    };
    frames::Ebc5 {
        foundation_brake_use,
        xbr_system_state: frames::XbrSystemState::AnyDemandAccepted,
        xbr_active_control_mode,
        ..frames::Ebc5::default()
    }
}

fn vehicle_speed(speed_kmph: Reading<f64>) -> frames::Ccvs1 {
    frames::Ccvs1 {
        parking_brake_switch: frames::ParkingBrakeSwitch::NotSet,
        wheel_based_speed_kmph: speed_kmph,
        brake_switch: frames::BrakeSwitch::Released,
        ..frames::Ccvs1::default()
    }
}

fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 / NS_PER_S
}
