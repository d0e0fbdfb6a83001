//! What the rig publishes, and when.
//!
//! Within one publication the order is mission, V2V, obstacles, navigation: the frame that starts
//! an ECU's tick comes last, so everything of the same instant is already there.

use platoon_dbc::{Message, Mission, V2vOut, V2vState, V2vTrajectory, V2vTrajectoryOut};
use traces::{ObstacleKind, ObstacleTruth, TruckTruth, TruthRecord};

use super::Rig;
use crate::metrics::errors;
use crate::obstacle::Kind;
use crate::sensor::Surroundings;
use crate::truck::{FRONT_OVERHANG_M, REAR_OVERHANG_M, Truck, WIDTH_M};

/// Time between reports of the obstacles \[ns\].
const OBSTACLE_PERIOD_NS: u64 = 50_000_000;
/// Time between missions \[ns\].
const MISSION_PERIOD_NS: u64 = 1_000_000_000;
/// The same while a number in them moves \[ns\].
const MOVING_MISSION_PERIOD_NS: u64 = 20_000_000;
/// Time between trajectories of a scripted leader \[ns\], and between the points of one \[s\].
const PLAN_PERIOD_NS: u64 = V2vTrajectory::CYCLE_TIME_MS as u64 * 1_000_000;
const PLAN_STEP_S: f64 = 0.1;
/// Time between records of the truth \[ns\].
pub(super) const TRUTH_PERIOD_NS: u64 = 10_000_000;

/// What the radio of truck `source` sends on, of what its ECU handed it.
pub(super) fn relayed(source: usize, heard: &V2vOut) -> V2vState {
    V2vState {
        source_truck: source as u8,
        sequence: heard.sequence,
        generation_time_ns: heard.generation_time_ns,
        position_x_m: heard.position_x_m,
        position_y_m: heard.position_y_m,
        speed_mps: heard.speed_mps,
        accel_mps2: heard.accel_mps2,
        intended_accel_mps2: heard.intended_accel_mps2,
    }
}

/// The same of an announced trajectory.
pub(super) fn relayed_plan(source: usize, heard: &V2vTrajectoryOut) -> V2vTrajectory {
    V2vTrajectory {
        source_truck: source as u8,
        sequence: heard.sequence,
        generation_time_ns: heard.generation_time_ns,
        position_x_m: heard.position_x_m,
        speed_mps: heard.speed_mps,
    }
}

/// What a truck that follows a script would hand its radio.
fn scripted_broadcast(truck: &Truck, now_ns: u64, sequence: u16) -> V2vOut {
    let (state, accel_mps2) = (truck.state(), truck.acceleration().forward_mps2);
    V2vOut {
        sequence,
        generation_time_ns: now_ns,
        position_x_m: state.x_m,
        position_y_m: state.y_m,
        heading_rad: state.heading_rad,
        speed_mps: state.forward_mps,
        yaw_rate_radps: state.yaw_radps,
        accel_mps2,
        intended_accel_mps2: accel_mps2,
    }
}

impl Rig {
    /// Sends everything that is due now; of several missed states only the latest.
    pub(super) fn publish(&mut self) {
        let now_ns = self.time_ns();
        self.tap.time_ns = now_ns;
        if now_ns >= self.due.mission_ns {
            self.publish_mission();
        }
        self.broadcast_scripted_leader();
        self.announce_scripted_leader();
        let (nodes, tap) = (&mut self.nodes, &mut self.tap);
        self.channel.deliver(now_ns, |to, message| {
            nodes[to].send(&Message::V2vState(*message), tap);
        });
        self.plans.deliver(now_ns, |to, message| {
            nodes[to].send(&Message::V2vTrajectory(*message), tap);
        });
        if now_ns >= self.due.obstacles_ns {
            self.publish_obstacles();
            self.due.obstacles_ns = next_ns(now_ns, OBSTACLE_PERIOD_NS);
        }
        self.publish_navigation();
    }

    /// The radio of a leader that has no ECU: what its script does, every period.
    fn broadcast_scripted_leader(&mut self) {
        let now_ns = self.time_ns();
        if self.scenario.leader.is_none() || now_ns < self.due.leader_ns {
            return;
        }
        let period_ns = (self.scenario.v2v.period_s * 1e9) as u64;
        let sequence = (now_ns / period_ns.max(1)) as u16;
        let said = scripted_broadcast(&self.trucks[0], now_ns, sequence);
        self.channel.broadcast(0, now_ns, now_ns, relayed(0, &said));
        self.due.leader_ns = next_ns(now_ns, period_ns.max(1));
    }

    /// The same leader's trajectory, once any truck has announced one: platoons that announce
    /// nothing hear nothing.
    fn announce_scripted_leader(&mut self) {
        let now_ns = self.time_ns();
        if now_ns < self.due.leader_plan_ns || !self.plans.has_carried() {
            return;
        }
        let Some(speed_mps) = self.trucks[0].scripted_speeds(PLAN_STEP_S) else { return };
        let message = V2vTrajectory {
            source_truck: 0,
            sequence: (now_ns / PLAN_PERIOD_NS) as u16,
            generation_time_ns: now_ns,
            position_x_m: self.trucks[0].state().x_m,
            speed_mps,
        };
        self.plans.broadcast(0, now_ns, now_ns, message);
        self.due.leader_plan_ns = next_ns(now_ns, PLAN_PERIOD_NS);
    }

    /// Sends every ECU its mission, whether or not it is due.
    pub(super) fn publish_mission(&mut self) {
        let road = &self.scenario.road;
        for ((truck, node), place) in self.nodes.iter_mut().enumerate().zip(&self.places) {
            let mission = Mission {
                truck_index: truck as u8,
                platoon_size: place.size as u8,
                run_state: self.run_state,
                spacing_m: place.spacing_m,
                set_speed_mps: place.speed_mps,
                desired_y_m: place.desired_y_m,
                lane_width_m: road.lane_width_m,
                right_edge_y_m: road.right_edge_y_m,
                left_edge_y_m: road.left_edge_y_m,
                loop_period_ns: (self.grid.step_ns * self.grid.steps_per_tick) as u32,
                place: place.place as u8,
                leader_truck: place.leader as u8,
                predecessor_truck: place.predecessor as u8,
                leader_distance_m: place.leader_distance_m,
            };
            node.send(&Message::Mission(mission), &mut self.tap);
        }
        let now_ns = self.time_ns();
        let is_moving = self.roster.is_moving(now_ns as f64 * 1e-9);
        let period_ns = if is_moving { MOVING_MISSION_PERIOD_NS } else { MISSION_PERIOD_NS };
        self.due.mission_ns = next_ns(now_ns, period_ns);
    }

    fn publish_obstacles(&mut self) {
        let seen = Surroundings {
            time_ns: self.tap.time_ns,
            trucks: &self.trucks,
            obstacles: &self.scenario.obstacles,
        };
        for (detector, node) in self.detectors.iter_mut().zip(&mut self.nodes) {
            let tap = &mut self.tap;
            detector.scan(&seen, |report| node.send(&Message::Obstacle(report), tap));
        }
    }

    /// Sends the state at the newest point of the loop's grid, unless that was sent before.
    fn publish_navigation(&mut self) {
        let Some(newest) = self.snapshots.first().map(|snapshot| snapshot.tick) else {
            return;
        };
        if self.published == Some(newest) {
            return;
        }
        self.published = Some(newest);
        self.tap.tick = newest;
        for (node, (navigation, snapshot)) in
            self.nodes.iter_mut().zip(self.navigation.iter_mut().zip(&self.snapshots))
        {
            node.note_actuators(snapshot.state.force_n, snapshot.state.steer_rad);
            node.send(&Message::EgoState(navigation.solve(snapshot)), &mut self.tap);
        }
    }

    /// Hands the noise-free world to the recorder.
    pub(super) fn record_truth(&mut self) {
        if self.tap.recorder.is_none() || !self.tap.is_open() {
            return;
        }
        let truth = self.truth();
        if let Some(recorder) = self.tap.recorder.as_mut() {
            recorder.push(truth);
        }
    }

    /// The noise-free world now.
    pub fn truth(&self) -> TruthRecord {
        let mut truth = TruthRecord { time_ns: self.time_ns(), ..TruthRecord::default() };
        let full = "a scenario has no more trucks and obstacles than a record";
        for truck in 0..self.trucks.len() {
            truth.trucks.push(self.truck_truth(truck)).expect(full);
        }
        let time_s = self.time_ns() as f64 * 1e-9;
        for (index, obstacle) in self.obstacles().iter().enumerate() {
            let motion = obstacle.motion(time_s);
            let row = ObstacleTruth {
                number: (index + 1) as u8,
                kind: recorded_kind(obstacle.kind),
                present: obstacle.present(time_s),
                x_m: motion.x_m,
                y_m: motion.y_m,
                vx_mps: motion.x_mps,
                vy_mps: motion.y_mps,
                length_m: obstacle.length_m,
                width_m: obstacle.width_m,
                heading_rad: motion.heading_rad(),
            };
            truth.obstacles.push(row).expect(full);
        }
        truth
    }

    fn truck_truth(&self, index: usize) -> TruckTruth {
        let (truck, command) = (&self.trucks[index], &self.commands[index]);
        let (state, acceleration) = (truck.state(), truck.acceleration());
        let place = &self.places[index];
        let errors = errors(&self.trucks, index, place);
        let delay_s = |from| self.channel.newest_delay_s(from, index).unwrap_or(0.0);
        TruckTruth {
            x_m: state.x_m,
            y_m: state.y_m,
            heading_rad: state.heading_rad,
            forward_mps: state.forward_mps,
            lateral_mps: state.lateral_mps,
            yaw_radps: state.yaw_radps,
            accel_forward_mps2: acceleration.forward_mps2,
            accel_lateral_mps2: acceleration.lateral_mps2,
            force_command_n: command.force_n,
            steering_command_rad: command.steer_rad,
            force_n: state.force_n,
            steering_rad: state.steer_rad,
            leader_error_m: errors.leader_m,
            predecessor_error_m: errors.predecessor_m,
            obstacle_clearance_m: self.clearance_m(index),
            leader_delay_s: delay_s(place.leader),
            predecessor_delay_s: delay_s(place.predecessor),
            front_m: FRONT_OVERHANG_M,
            rear_m: REAR_OVERHANG_M,
            width_m: WIDTH_M,
        }
    }

    /// Clearance of a truck to the nearest obstacle now \[m\]; infinite when there is none.
    fn clearance_m(&self, index: usize) -> f64 {
        let time_s = self.time_ns() as f64 * 1e-9;
        let own = self.trucks[index].rectangle();
        self.obstacles()
            .iter()
            .filter(|obstacle| obstacle.present(time_s) && obstacle.kind != Kind::Bump)
            .map(|obstacle| own.clearance_m(&obstacle.rectangle(&obstacle.motion(time_s))))
            .fold(f64::INFINITY, f64::min)
    }
}

/// The first multiple of a period after now: a late publication does not shift the next ones.
fn next_ns(now_ns: u64, period_ns: u64) -> u64 {
    (now_ns / period_ns + 1) * period_ns
}

fn recorded_kind(kind: Kind) -> ObstacleKind {
    match kind {
        Kind::Vehicle => ObstacleKind::Vehicle,
        Kind::Pedestrian => ObstacleKind::Pedestrian,
        Kind::Bump => ObstacleKind::Bump,
    }
}
