//! Messages in flight: parts that have arrived and wait for the others.

use super::NO_MEMBER;
use crate::j1939::{
    EcuMisses, EcuProgress, MissionEdges, MissionLane, MissionPlatoon, MissionTarget, NavMotion,
    NavPosition, NavTime, ObstacleBox, ObstacleMotion, ObstaclePosition, V2vMotion, V2vOutHeading,
    V2vOutMotion, V2vOutPosition, V2vOutTime, V2vPosition, V2vTime,
};
use crate::messages::{EcuStatus, Message, Mission, Obstacle, V2vOut, V2vState};
use serde::{Deserialize, Serialize};

/// Messages of one kind that may be in flight: as many as there are slots for obstacles.
const IN_FLIGHT: usize = 8;

/// The parts of one kind of message, by the alive counter they share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Flight<T> {
    slots: [Slot<T>; IN_FLIGHT],
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Slot<T> {
    counter: u8,
    parts: T,
}

/// Parts that make a message.
pub(super) trait Parts: Copy + Default {
    /// The message, once no part is missing.
    fn complete(&self) -> Option<Message>;
}

impl<T: Copy + Default> Flight<T> {
    /// The parts with this counter so far. They displace a message eight counters older.
    pub(super) fn of(&mut self, counter: u8) -> &mut T {
        let slot = &mut self.slots[usize::from(counter) % IN_FLIGHT];
        if slot.counter != counter {
            *slot = Slot { counter, parts: T::default() };
        }
        &mut slot.parts
    }

    /// All parts in flight.
    pub(super) fn all(&mut self) -> impl Iterator<Item = &mut T> {
        self.slots.iter_mut().map(|slot| &mut slot.parts)
    }
}

impl<T: Parts> Flight<T> {
    /// Adds a part; the message when that completes it, which leaves its slot empty.
    pub(super) fn add(&mut self, counter: u8, add: impl FnOnce(&mut T)) -> Option<Message> {
        let parts = self.of(counter);
        add(parts);
        let message = parts.complete()?;
        *parts = T::default();
        Some(message)
    }
}

/// Parts of a navigation solution; VDC2 and CCVS1 make an `EgoState` of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct NavParts {
    pub(super) position: Option<NavPosition>,
    pub(super) motion: Option<NavMotion>,
    pub(super) time: Option<NavTime>,
}

/// Parts of a `V2vState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct V2vParts {
    pub(super) position: Option<V2vPosition>,
    pub(super) motion: Option<V2vMotion>,
    pub(super) time: Option<V2vTime>,
}

impl Parts for V2vParts {
    fn complete(&self) -> Option<Message> {
        let (position, motion, time) = (self.position?, self.motion?, self.time?);
        Some(Message::V2vState(V2vState {
            source_truck: motion.source_truck,
            sequence: time.sequence,
            generation_time_ns: nanoseconds(time.generation_time_s),
            position_x_m: position.position_x_m,
            position_y_m: position.position_y_m,
            speed_mps: motion.speed_mps,
            accel_mps2: motion.accel_mps2,
            intended_accel_mps2: motion.intended_accel_mps2,
        }))
    }
}

/// Parts of a `V2vOut`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct V2vOutParts {
    pub(super) position: Option<V2vOutPosition>,
    pub(super) motion: Option<V2vOutMotion>,
    pub(super) heading: Option<V2vOutHeading>,
    pub(super) time: Option<V2vOutTime>,
}

impl Parts for V2vOutParts {
    fn complete(&self) -> Option<Message> {
        let (position, motion) = (self.position?, self.motion?);
        let (heading, time) = (self.heading?, self.time?);
        Some(Message::V2vOut(V2vOut {
            sequence: time.sequence,
            generation_time_ns: nanoseconds(time.generation_time_s),
            position_x_m: position.position_x_m,
            position_y_m: position.position_y_m,
            heading_rad: heading.heading_rad,
            speed_mps: motion.speed_mps,
            yaw_rate_radps: heading.yaw_rate_radps,
            accel_mps2: motion.accel_mps2,
            intended_accel_mps2: motion.intended_accel_mps2,
        }))
    }
}

/// Parts of an `Obstacle`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct ObstacleParts {
    pub(super) position: Option<ObstaclePosition>,
    pub(super) motion: Option<ObstacleMotion>,
    pub(super) shape: Option<ObstacleBox>,
}

impl Parts for ObstacleParts {
    fn complete(&self) -> Option<Message> {
        let (position, motion, shape) = (self.position?, self.motion?, self.shape?);
        Some(Message::Obstacle(Obstacle {
            page: motion.obstacle_page,
            kind: motion.obstacle_kind,
            member: shape.member.value().unwrap_or(NO_MEMBER),
            measured_time_ns: nanoseconds(shape.measured_time_s),
            position_x_m: position.position_x_m,
            position_y_m: position.position_y_m,
            speed_x_mps: motion.speed_x_mps,
            speed_y_mps: motion.speed_y_mps,
            heading_rad: motion.heading_rad,
            length_m: shape.length_m,
            width_m: shape.width_m,
        }))
    }
}

/// Parts of a `Mission`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct MissionParts {
    pub(super) platoon: Option<MissionPlatoon>,
    pub(super) target: Option<MissionTarget>,
    pub(super) lane: Option<MissionLane>,
    pub(super) edges: Option<MissionEdges>,
}

impl Parts for MissionParts {
    fn complete(&self) -> Option<Message> {
        let (platoon, target) = (self.platoon?, self.target?);
        let (lane, edges) = (self.lane?, self.edges?);
        Some(Message::Mission(Mission {
            truck_index: platoon.truck_index,
            platoon_size: platoon.platoon_size,
            run_state: platoon.run_state,
            spacing_m: target.spacing_m,
            set_speed_mps: target.set_speed_mps,
            desired_y_m: lane.desired_y_m,
            lane_width_m: lane.lane_width_m,
            right_edge_y_m: edges.right_edge_y_m,
            left_edge_y_m: edges.left_edge_y_m,
            loop_period_ns: platoon.loop_period_ns,
        }))
    }
}

/// Parts of an `EcuStatus`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct StatusParts {
    pub(super) progress: Option<EcuProgress>,
    pub(super) misses: Option<EcuMisses>,
}

impl Parts for StatusParts {
    fn complete(&self) -> Option<Message> {
        let (progress, misses) = (self.progress?, self.misses?);
        Some(Message::EcuStatus(EcuStatus {
            ecu_mode: progress.ecu_mode,
            gain_id: progress.gain_id,
            tick_count: progress.tick_count,
            misses: misses.misses,
            skipped: misses.skipped,
        }))
    }
}

/// A time on the bus as the bench counts it.
pub(super) fn nanoseconds(time_s: f64) -> u64 {
    (time_s * super::NS_PER_S).round() as u64
}
