//! Frames to messages: supervision, and parts until they are whole.

use super::feedback::heard_speed_mps;
use super::flight::Flight;
use super::force::commanded_n;
use super::parts::{
    MissionParts, NavParts, ObstacleParts, StatusParts, V2vOutParts, V2vParts, nanoseconds,
};
use super::speed::SpeedEstimate;
use super::{BRAKE_COUNTER_MASK, bytes};
use crate::checksum::{command_digest, motion_digest};
use crate::e2e::{Continuity, Supervisor};
use crate::frame::Frame;
use crate::j1939::{Ccvs1, MESSAGES, Message as Part, SteerCommand, Tsc1, Vdc2, Xbr};
use crate::messages::{Actuation, EgoState, Message};
use crate::profile::{Heard, Refusal, Vehicle};
use serde::{Deserialize, Serialize};

/// Frame kinds of `j1939.dbc`.
const KINDS: usize = 29;
const _: () = assert!(MESSAGES.len() == KINDS);

/// Supervisors, and messages in flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Decoder {
    vehicle: Vehicle,
    /// By place in `j1939::MESSAGES`.
    supervisors: [Supervisor; KINDS],
    navigation: Flight<NavParts>,
    /// The newest VDC2 and its digest.
    motion: Option<(Vdc2, u16)>,
    speed: SpeedEstimate,
    command: CommandParts,
    v2v: Flight<V2vParts>,
    v2v_out: Flight<V2vOutParts>,
    obstacles: Flight<ObstacleParts>,
    mission: Flight<MissionParts>,
    status: Flight<StatusParts>,
}

/// Parts of an `Actuation`: the newest of each, and the steering until it has found the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct CommandParts {
    torque: Option<(Tsc1, u8, [u8; 8])>,
    brake: Option<(Xbr, u8, [u8; 8])>,
    steering: Option<(SteerCommand, u8)>,
}

impl Decoder {
    pub(crate) fn new(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            supervisors: [Supervisor::new(); KINDS],
            navigation: Flight::default(),
            motion: None,
            speed: SpeedEstimate::default(),
            command: CommandParts::default(),
            v2v: Flight::default(),
            v2v_out: Flight::default(),
            obstacles: Flight::default(),
            mission: Flight::default(),
            status: Flight::default(),
        }
    }

    pub(crate) fn take(&mut self, frame: &Frame) -> Result<Heard, Refusal> {
        let (part, counter) = Part::decode(frame)?;
        let lost = match counter {
            Some(counter) => self.supervise(part.index(), counter)?,
            None => 0,
        };
        Ok(Heard { message: self.place(part, counter.unwrap_or(0), frame), lost })
    }

    /// Frames of this kind missing before this counter.
    fn supervise(&mut self, index: usize, counter: u8) -> Result<u32, Refusal> {
        let signal = MESSAGES[index].counter.map(|signal| &MESSAGES[index].signals[signal]);
        let counter_max = signal.map_or(u8::MAX, |signal| signal.raw_max as u8);
        match self.supervisors[index].see_up_to(counter, counter_max) {
            Continuity::Repeated => Err(Refusal::Repeated),
            Continuity::Lost(missing) => Ok(u32::from(missing)),
            Continuity::First | Continuity::Ok => Ok(0),
        }
    }

    /// Puts a part where it belongs; the message that it completes.
    fn place(&mut self, part: Part, counter: u8, frame: &Frame) -> Option<Message> {
        match part {
            Part::Vdc2(part) => self.hear_motion(part, motion_digest(frame.data())),
            Part::Ccvs1(part) => self.hear_speed(&part),
            Part::NavPosition(part) => self.navigate(counter, |n| n.position = Some(part)),
            Part::NavMotion(part) => self.navigate(counter, |n| n.motion = Some(part)),
            Part::NavTime(part) => self.navigate(counter, |n| n.time = Some(part)),

            Part::Tsc1(part) => self.command(|c| c.torque = Some((part, counter, bytes(frame)))),
            Part::Xbr(part) => self.command(|c| c.brake = Some((part, counter, bytes(frame)))),
            Part::SteerCommand(part) => self.command(|c| c.steering = Some((part, counter))),

            Part::V2vPosition(part) => self.v2v.add(counter, |v| v.position = Some(part)),
            Part::V2vMotion(part) => self.v2v.add(counter, |v| v.motion = Some(part)),
            Part::V2vTime(part) => self.v2v.add(counter, |v| v.time = Some(part)),

            Part::V2vOutPosition(part) => self.v2v_out.add(counter, |v| v.position = Some(part)),
            Part::V2vOutMotion(part) => self.v2v_out.add(counter, |v| v.motion = Some(part)),
            Part::V2vOutHeading(part) => self.v2v_out.add(counter, |v| v.heading = Some(part)),
            Part::V2vOutTime(part) => self.v2v_out.add(counter, |v| v.time = Some(part)),

            Part::ObstaclePosition(part) => {
                self.obstacles.add(counter, |o| o.position = Some(part))
            }
            Part::ObstacleMotion(part) => self.obstacles.add(counter, |o| o.motion = Some(part)),
            Part::ObstacleBox(part) => self.obstacles.add(counter, |o| o.shape = Some(part)),

            Part::MissionPlatoon(part) => self.mission.add(counter, |m| m.platoon = Some(part)),
            Part::MissionTarget(part) => self.mission.add(counter, |m| m.target = Some(part)),
            Part::MissionLane(part) => self.mission.add(counter, |m| m.lane = Some(part)),
            Part::MissionEdges(part) => self.mission.add(counter, |m| m.edges = Some(part)),
            Part::MissionRoster(part) => self.mission.add(counter, |m| m.roster = Some(part)),

            Part::EcuProgress(part) => self.status.add(counter, |s| s.progress = Some(part)),
            Part::EcuMisses(part) => self.status.add(counter, |s| s.misses = Some(part)),

            Part::Eec1(_) | Part::Ebc1(_) | Part::Ebc2(_) | Part::Ebc5(_) => None,
        }
    }

    /// A speed of CCVS1 belongs to the navigation solution completed next.
    fn hear_speed(&mut self, vehicle: &Ccvs1) -> Option<Message> {
        if let Some(speed_mps) = heard_speed_mps(vehicle) {
            self.speed.hear(speed_mps);
        }
        None
    }

    /// A VDC2 may be what a navigation solution has been waiting for.
    fn hear_motion(&mut self, motion: Vdc2, digest: u16) -> Option<Message> {
        self.motion = Some((motion, digest));
        let (known, speed) = (self.motion, &mut self.speed);
        self.navigation.all().find_map(|parts| state(parts, known, speed))
    }

    fn navigate(&mut self, counter: u8, add: impl FnOnce(&mut NavParts)) -> Option<Message> {
        let parts = self.navigation.of(counter);
        add(parts);
        state(parts, self.motion, &mut self.speed)
    }

    /// Adds a part of a command; the command when all three of one are there.
    fn command(&mut self, add: impl FnOnce(&mut CommandParts)) -> Option<Message> {
        let parts = &mut self.command;
        add(parts);
        let (torque, torque_counter, torque_data) = parts.torque?;
        let (brake, brake_counter, brake_data) = parts.brake?;
        let (steering, counter) = parts.steering?;
        let belongs = counter & Tsc1::COUNTER_MAX == torque_counter
            && steering.brake_counter == brake_counter & BRAKE_COUNTER_MASK
            && steering.command_digest == command_digest(&torque_data, &brake_data);
        if !belongs {
            return None;
        }
        parts.steering = None;
        Some(Message::Actuation(Actuation {
            answers_tick: steering.answers_tick,
            force_n: commanded_n(&torque, &brake, &self.vehicle)?,
            steering_rad: steering.steering_rad,
            actuation_status: steering.actuation_status,
        }))
    }
}

/// The navigation solution, once all its parts are there and the VDC2 is the one of its instant.
fn state(
    parts: &mut NavParts,
    known: Option<(Vdc2, u16)>,
    speed: &mut SpeedEstimate,
) -> Option<Message> {
    let (position, motion, time) = (parts.position?, parts.motion?, parts.time?);
    let (sensed, _) = known.filter(|(_, digest)| *digest == motion.motion_digest)?;
    *parts = NavParts::default();
    let yaw_rate_radps = sensed.yaw_rate_radps.value()?;
    let accel_forward_mps2 = sensed.longitudinal_acceleration_mps2.value()?;
    let bench_time_ns = nanoseconds(time.bench_time_s);
    // The forward speed of a body that turns changes by u' = a + v r.
    let rate_mps2 = accel_forward_mps2 + motion.speed_lateral_mps * yaw_rate_radps;
    Some(Message::EgoState(EgoState {
        tick: time.tick,
        bench_time_ns,
        position_x_m: position.position_x_m,
        position_y_m: position.position_y_m,
        heading_rad: motion.heading_rad,
        speed_forward_mps: speed.at(bench_time_ns, rate_mps2)?,
        speed_lateral_mps: motion.speed_lateral_mps,
        yaw_rate_radps,
        accel_forward_mps2,
        nav_status: motion.nav_status,
    }))
}
