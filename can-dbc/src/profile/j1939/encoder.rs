//! Messages to frames, in the order of their priority on the bus.

use super::batch::Batch;
use super::feedback::{self, Actuators};
use super::force::{brake_command, torque_command};
use super::rate::{Period, Rate};
use super::{BRAKE_COUNTER_MASK, bytes, parts};
use crate::checksum::{command_digest, motion_digest};
use crate::codec::EncodeError;
use crate::frame::Frame;
use crate::j1939 as frames;
use crate::messages::{Actuation, EgoState, Message};
use crate::profile::Vehicle;
use serde::{Deserialize, Serialize};

/// Frame kinds of `j1939.dbc`.
const KINDS: usize = 29;
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
    actuators: Option<Actuators>,
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
        self.actuators = Some(Actuators { force_n, steering_rad });
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
            Message::V2vState(state) => {
                parts::put_v2v_state(state, next.part(frames::V2vPosition::INDEX), &mut batch)?;
            }
            Message::V2vOut(state) => {
                parts::put_v2v_out(state, next.part(frames::V2vOutPosition::INDEX), &mut batch)?;
            }
            Message::Obstacle(obstacle) => {
                let counter = next.part(frames::ObstaclePosition::INDEX);
                parts::put_obstacle(obstacle, counter, &mut batch)?;
            }
            Message::Mission(mission) => {
                parts::put_mission(mission, next.part(frames::MissionPlatoon::INDEX), &mut batch)?;
            }
            Message::EcuStatus(status) => {
                parts::put_ecu_status(status, next.part(frames::EcuProgress::INDEX), &mut batch)?;
            }
            // 57 bytes ten times a second, on frames of eight: left to CAN FD.
            Message::V2vTrajectory(_) | Message::V2vTrajectoryOut(_) => {
                return Err(EncodeError::NotInProfile("j1939"));
            }
        }
        *self = next;
        batch.iter().for_each(emit);
        Ok(())
    }

    /// The counter for the next parts on Proprietary B, remembered by the first of them.
    fn part(&mut self, index: usize) -> u8 {
        self.next_counter(index, u8::MAX)
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
        let (known, vehicle) = (self.actuators, &self.vehicle);
        if self.rates.eec1.is_due(time_ns, EEC1) {
            batch.push(feedback::engine(known, vehicle).encode()?);
        }
        if self.rates.ebc1.is_due(time_ns, EBC1) {
            batch.push(feedback::brake_state(known).encode()?);
        }
        let motion = feedback::motion(state, known, vehicle).encode()?;
        batch.push(motion);
        if self.rates.ebc5.is_due(time_ns, EBC5) {
            batch.push(feedback::brake_requests(known).encode()?);
        }
        if self.rates.ebc2.is_due(time_ns, EBC2) {
            batch.push(feedback::wheel_speeds(state).encode()?);
        }
        if self.rates.ccvs1.is_due(time_ns, CCVS1) {
            batch.push(feedback::vehicle_speed(state).encode()?);
        }
        let counter = self.part(frames::NavPosition::INDEX);
        parts::put_navigation(state, motion_digest(motion.data()), counter, batch)
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
}
