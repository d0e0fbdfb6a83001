//! Messages in parts, both ways: what Proprietary B carries of each.

use super::batch::Batch;
use super::flight::Parts;
use super::{NO_MEMBER, NS_PER_S};
use crate::codec::EncodeError;
use crate::j1939::{
    EcuMisses, EcuProgress, MissionEdges, MissionLane, MissionPlatoon, MissionRoster,
    MissionTarget, NavMotion, NavPosition, NavTime, ObstacleBox, ObstacleMotion, ObstaclePosition,
    V2vMotion, V2vOutHeading, V2vOutMotion, V2vOutPosition, V2vOutTime, V2vPosition, V2vTime,
};
use crate::messages::{EcuStatus, EgoState, Message, Mission, Obstacle, V2vOut, V2vState};
use serde::{Deserialize, Serialize};

/// Parts of a navigation solution; VDC2 and CCVS1 make an `EgoState` of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct NavParts {
    pub(super) position: Option<NavPosition>,
    pub(super) motion: Option<NavMotion>,
    pub(super) time: Option<NavTime>,
}

/// What VDC2 and CCVS1 do not say of an `EgoState`.
pub(super) fn put_navigation(
    state: &EgoState,
    motion_digest: u16,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let position =
        NavPosition { position_x_m: state.position_x_m, position_y_m: state.position_y_m };
    let motion = NavMotion {
        heading_rad: state.heading_rad,
        speed_lateral_mps: state.speed_lateral_mps,
        nav_status: state.nav_status,
        motion_digest,
    };
    let time = NavTime { bench_time_s: seconds(state.bench_time_ns), tick: state.tick };
    batch.push(position.encode(counter)?);
    batch.push(motion.encode(counter)?);
    batch.push(time.encode(counter)?);
    Ok(())
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

/// The parts of a `V2vState`.
pub(super) fn put_v2v_state(
    state: &V2vState,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let position =
        V2vPosition { position_x_m: state.position_x_m, position_y_m: state.position_y_m };
    let motion = V2vMotion {
        speed_mps: state.speed_mps,
        accel_mps2: state.accel_mps2,
        intended_accel_mps2: state.intended_accel_mps2,
        source_truck: state.source_truck,
    };
    let time =
        V2vTime { generation_time_s: seconds(state.generation_time_ns), sequence: state.sequence };
    batch.push(position.encode(counter)?);
    batch.push(motion.encode(counter)?);
    batch.push(time.encode(counter)?);
    Ok(())
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

/// The parts of a `V2vOut`.
pub(super) fn put_v2v_out(
    state: &V2vOut,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let position =
        V2vOutPosition { position_x_m: state.position_x_m, position_y_m: state.position_y_m };
    let motion = V2vOutMotion {
        speed_mps: state.speed_mps,
        accel_mps2: state.accel_mps2,
        intended_accel_mps2: state.intended_accel_mps2,
    };
    let heading =
        V2vOutHeading { heading_rad: state.heading_rad, yaw_rate_radps: state.yaw_rate_radps };
    let time = V2vOutTime {
        generation_time_s: seconds(state.generation_time_ns),
        sequence: state.sequence,
    };
    batch.push(position.encode(counter)?);
    batch.push(motion.encode(counter)?);
    batch.push(heading.encode(counter)?);
    batch.push(time.encode(counter)?);
    Ok(())
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

/// The parts of an `Obstacle`.
pub(super) fn put_obstacle(
    obstacle: &Obstacle,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let position = ObstaclePosition {
        position_x_m: obstacle.position_x_m,
        position_y_m: obstacle.position_y_m,
    };
    let motion = ObstacleMotion {
        speed_x_mps: obstacle.speed_x_mps,
        speed_y_mps: obstacle.speed_y_mps,
        heading_rad: obstacle.heading_rad,
        obstacle_kind: obstacle.kind,
        obstacle_page: obstacle.page,
    };
    let shape = ObstacleBox {
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

/// Parts of a `Mission`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct MissionParts {
    pub(super) platoon: Option<MissionPlatoon>,
    pub(super) target: Option<MissionTarget>,
    pub(super) lane: Option<MissionLane>,
    pub(super) edges: Option<MissionEdges>,
    pub(super) roster: Option<MissionRoster>,
}

impl Parts for MissionParts {
    fn complete(&self) -> Option<Message> {
        let (platoon, target) = (self.platoon?, self.target?);
        let (lane, edges, roster) = (self.lane?, self.edges?, self.roster?);
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
            place: roster.place,
            leader_truck: roster.leader_truck,
            predecessor_truck: roster.predecessor_truck,
            leader_distance_m: roster.leader_distance_m,
        }))
    }
}

/// The parts of a `Mission`.
pub(super) fn put_mission(
    mission: &Mission,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let platoon = MissionPlatoon {
        truck_index: mission.truck_index,
        run_state: mission.run_state,
        platoon_size: mission.platoon_size,
        loop_period_ns: mission.loop_period_ns,
    };
    let target =
        MissionTarget { spacing_m: mission.spacing_m, set_speed_mps: mission.set_speed_mps };
    let lane = MissionLane { desired_y_m: mission.desired_y_m, lane_width_m: mission.lane_width_m };
    let edges = MissionEdges {
        right_edge_y_m: mission.right_edge_y_m,
        left_edge_y_m: mission.left_edge_y_m,
    };
    let roster = MissionRoster {
        place: mission.place,
        leader_truck: mission.leader_truck,
        predecessor_truck: mission.predecessor_truck,
        leader_distance_m: mission.leader_distance_m,
    };
    batch.push(platoon.encode(counter)?);
    batch.push(target.encode(counter)?);
    batch.push(lane.encode(counter)?);
    batch.push(edges.encode(counter)?);
    batch.push(roster.encode(counter)?);
    Ok(())
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

/// The parts of an `EcuStatus`.
pub(super) fn put_ecu_status(
    status: &EcuStatus,
    counter: u8,
    batch: &mut Batch,
) -> Result<(), EncodeError> {
    let progress = EcuProgress {
        ecu_mode: status.ecu_mode,
        gain_id: status.gain_id,
        tick_count: status.tick_count,
    };
    let misses = EcuMisses { misses: status.misses, skipped: status.skipped };
    batch.push(progress.encode(counter)?);
    batch.push(misses.encode(counter)?);
    Ok(())
}

/// A time on the bus as the bench counts it.
pub(super) fn nanoseconds(time_s: f64) -> u64 {
    (time_s * NS_PER_S).round() as u64
}

fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 / NS_PER_S
}
