//! A rig of a few lines for one follower's ECU over loopback, without a plant.

use std::cell::Cell;

use controller_rt::{Config, Controller, Ecu, LawController};
use law::qp::ActiveSet;
use law::{Calibration, Law, Structure};
use platoon_dbc::{
    Actuation, Bus, Clock, EgoState, Loopback, Message, Mission, NavStatus, Obstacle, ObstacleKind,
    RunState, V2vState, V2vTrajectory,
};
use traces::Recorder;

/// The loop's period \[ns\].
pub const PERIOD_NS: u64 = 1_000_000;

/// A clock that stands still until it is set.
#[derive(Default)]
pub struct StillClock(Cell<u64>);

impl StillClock {
    /// Sets the clock \[ns\].
    pub fn set(&self, now_ns: u64) {
        self.0.set(now_ns);
    }
}

impl Clock for StillClock {
    fn now_ns(&self) -> u64 {
        self.0.get()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.0.set(deadline_ns);
    }
}

/// Truck 1's ECU with this law, and the rig at the other end of its bus.
pub fn follower(law: Box<dyn Controller>, recorder: Option<Recorder>) -> (Rig, Ecu) {
    let (bus, ecu_bus) = Loopback::pair("loopback1", 1024);
    let config = Config { truck: 1, ..Config::default() };
    let ecu = Ecu::new(config, Box::new(ecu_bus), law, recorder);
    (Rig { bus, counters: [0; 9] }, ecu)
}

/// A law with this structure.
pub fn law(structure: Structure) -> Box<dyn Controller> {
    let calibration = Calibration { structure, ..Calibration::default() };
    Box::new(LawController::new(Law::new(calibration, ActiveSet)))
}

/// The other end of the bus.
pub struct Rig {
    /// For frames that are put on the bus as they are.
    pub bus: Loopback,
    counters: [u8; 9],
}

impl Rig {
    /// Sends the mission.
    pub fn invite(&mut self) {
        self.send(&Message::Mission(Mission {
            truck_index: 1,
            place: 1,
            platoon_size: 2,
            run_state: RunState::Running,
            spacing_m: 25.0,
            leader_distance_m: 25.0,
            set_speed_mps: 20.0,
            lane_width_m: 3.5,
            right_edge_y_m: -1.75,
            left_edge_y_m: 5.25,
            loop_period_ns: PERIOD_NS as u32,
            ..Mission::default()
        }));
    }

    /// Sends what the follower gets in tick `n`: its state, its V2V, an obstacle to pass.
    pub fn publish(&mut self, n: u64) {
        let (time_ns, t) = (n * PERIOD_NS, 1e-3 * n as f64);
        self.send(&Message::EgoState(EgoState {
            tick: n as u32,
            bench_time_ns: time_ns,
            position_x_m: 20.0 * t,
            speed_forward_mps: 20.0,
            nav_status: NavStatus::Valid,
            ..EgoState::default()
        }));
        if n.is_multiple_of(20) {
            self.send(&Message::V2vState(V2vState {
                generation_time_ns: time_ns.saturating_sub(50_000_000),
                position_x_m: 25.0 + 20.0 * t,
                speed_mps: 20.0,
                ..V2vState::default()
            }));
        }
        if n.is_multiple_of(100) {
            self.send(&Message::V2vTrajectory(V2vTrajectory {
                generation_time_ns: time_ns.saturating_sub(50_000_000),
                position_x_m: 25.0 + 20.0 * t,
                speed_mps: [20.0; 21],
                ..V2vTrajectory::default()
            }));
        }
        if n.is_multiple_of(50) {
            self.send(&Message::Obstacle(Obstacle {
                kind: ObstacleKind::Vehicle,
                measured_time_ns: time_ns,
                position_x_m: 60.0 + 15.0 * t,
                speed_x_mps: 15.0,
                length_m: 5.0,
                width_m: 2.0,
                ..Obstacle::default()
            }));
        }
    }

    /// Reads the bus empty; the last command on it.
    pub fn hear(&mut self) -> Option<Actuation> {
        let mut last = None;
        while let Some(received) = self.bus.receive().expect("up") {
            if let Ok((Message::Actuation(command), _)) = Message::decode(&received.frame) {
                last = Some(command);
            }
        }
        last
    }

    fn send(&mut self, message: &Message) {
        let counter = &mut self.counters[message.index()];
        self.bus.send(&message.encode(*counter).expect("in range")).expect("room");
        *counter = counter.wrapping_add(1);
    }
}
