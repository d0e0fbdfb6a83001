//! The profile as controller and rig meet it: messages in, messages out, over any bus.

mod faults;
mod rates;
mod round_trip;

use crate::Frame;
use crate::j1939 as frames;
use crate::messages::{
    Actuation, ActuationStatus, EcuMode, EcuStatus, EgoState, Message, Mission, NavStatus,
    Obstacle, ObstacleKind, RunState, V2vOut, V2vState,
};
use crate::profile::{Decoder, Encoder, Profile, Vehicle};
use std::f64::consts::PI;

const TICK_NS: u64 = 10_000_000;

/// Knuth's MMIX generator; its high bits are random enough here.
struct Dice(u64);

impl Dice {
    fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        self.0 ^ self.0 >> 29
    }

    fn below(&mut self, bound: u64) -> u64 {
        (self.word() >> 16) % bound
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.word() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last as u64 + 1) as usize);
        }
    }
}

fn ego_state(dice: &mut Dice, tick: u32) -> EgoState {
    EgoState {
        tick,
        bench_time_ns: u64::from(tick) * TICK_NS,
        position_x_m: dice.between(-100_000.0, 100_000.0),
        position_y_m: dice.between(-1_000.0, 1_000.0),
        heading_rad: dice.between(-PI, PI),
        speed_forward_mps: dice.between(0.0, 40.0),
        speed_lateral_mps: dice.between(-5.0, 5.0),
        yaw_rate_radps: dice.between(-1.0, 1.0),
        accel_forward_mps2: dice.between(-10.0, 10.0),
        nav_status: [NavStatus::Valid, NavStatus::Degraded, NavStatus::Lost]
            [dice.below(3) as usize],
    }
}

fn actuation(dice: &mut Dice, tick: u32) -> Actuation {
    Actuation {
        answers_tick: tick,
        force_n: dice.between(-36_000.0, 22_000.0),
        steering_rad: dice.between(-0.18, 0.18),
        actuation_status: ActuationStatus::from_raw(dice.below(4) as i64).expect("one of four"),
    }
}

fn v2v_state(dice: &mut Dice) -> V2vState {
    V2vState {
        source_truck: dice.below(16) as u8,
        sequence: dice.word() as u16,
        generation_time_ns: dice.below(42_949_672_950_000),
        position_x_m: dice.between(-100_000.0, 100_000.0),
        position_y_m: dice.between(-1_000.0, 1_000.0),
        speed_mps: dice.between(-5.0, 50.0),
        accel_mps2: dice.between(-30.0, 30.0),
        intended_accel_mps2: dice.between(-30.0, 30.0),
    }
}

fn v2v_out(dice: &mut Dice) -> V2vOut {
    let state = v2v_state(dice);
    V2vOut {
        sequence: state.sequence,
        generation_time_ns: state.generation_time_ns,
        position_x_m: state.position_x_m,
        position_y_m: state.position_y_m,
        heading_rad: dice.between(-PI, PI),
        speed_mps: state.speed_mps,
        yaw_rate_radps: dice.between(-1.3, 1.3),
        accel_mps2: state.accel_mps2,
        intended_accel_mps2: state.intended_accel_mps2,
    }
}

fn obstacle(dice: &mut Dice) -> Obstacle {
    Obstacle {
        page: dice.below(8) as u8,
        kind: ObstacleKind::from_raw(dice.below(5) as i64).expect("one of five"),
        member: [255, 0, 3, 15][dice.below(4) as usize],
        measured_time_ns: dice.below(53_687_000_000_000),
        position_x_m: dice.between(-100_000.0, 100_000.0),
        position_y_m: dice.between(-1_000.0, 1_000.0),
        speed_x_mps: dice.between(-50.0, 50.0),
        speed_y_mps: dice.between(-50.0, 50.0),
        heading_rad: dice.between(-PI, PI),
        length_m: dice.between(0.0, 40.0),
        width_m: dice.between(0.0, 10.0),
    }
}

fn mission(dice: &mut Dice) -> Mission {
    Mission {
        truck_index: dice.below(16) as u8,
        platoon_size: 1 + dice.below(16) as u8,
        run_state: RunState::from_raw(dice.below(3) as i64).expect("one of three"),
        spacing_m: dice.between(0.0, 1_000.0),
        set_speed_mps: dice.between(-1.0, 50.0),
        desired_y_m: dice.between(-800.0, 800.0),
        lane_width_m: dice.between(0.0, 60.0),
        right_edge_y_m: dice.between(-800.0, 800.0),
        left_edge_y_m: dice.between(-800.0, 800.0),
        loop_period_ns: 50_000 + dice.below(900_000_000) as u32,
        place: dice.below(16) as u8,
        leader_truck: dice.below(16) as u8,
        predecessor_truck: dice.below(16) as u8,
        leader_distance_m: dice.between(0.0, 16_000.0),
    }
}

fn ecu_status(dice: &mut Dice) -> EcuStatus {
    EcuStatus {
        ecu_mode: EcuMode::from_raw(dice.below(5) as i64).expect("one of five"),
        gain_id: dice.word() as u8,
        tick_count: dice.word() as u32,
        misses: dice.below(1 << 24) as u32,
        skipped: dice.word() as u16,
    }
}

/// One message of each kind.
fn messages(dice: &mut Dice, tick: u32) -> [Message; 7] {
    [
        Message::EgoState(ego_state(dice, tick)),
        Message::Actuation(actuation(dice, tick)),
        Message::V2vState(v2v_state(dice)),
        Message::V2vOut(v2v_out(dice)),
        Message::Obstacle(obstacle(dice)),
        Message::Mission(mission(dice)),
        Message::EcuStatus(ecu_status(dice)),
    ]
}

/// Numbers of a message, each with half its resolution on this profile.
fn numbers(message: &Message) -> Vec<(f64, f64)> {
    // Millimetres, 1e-4 rad and 10 µs on Proprietary B.
    let (mm, angle, time) = (0.5e-3, 0.5e-4, 5e3);
    match message {
        Message::EgoState(m) => vec![
            (f64::from(m.tick), 0.0),
            (m.bench_time_ns as f64, time),
            (m.position_x_m, mm),
            (m.position_y_m, mm),
            (m.heading_rad, angle),
            (m.speed_lateral_mps, mm),
            (m.yaw_rate_radps, 0.5 / 8192.0),
            (m.accel_forward_mps2, 0.05),
            (f64::from(m.nav_status.raw()), 0.0),
        ],
        Message::Actuation(m) => vec![
            (f64::from(m.answers_tick), 0.0),
            (m.steering_rad, 0.5e-5),
            (f64::from(m.actuation_status.raw()), 0.0),
        ],
        Message::V2vState(m) => vec![
            (f64::from(m.source_truck), 0.0),
            (f64::from(m.sequence), 0.0),
            (m.generation_time_ns as f64, time),
            (m.position_x_m, mm),
            (m.position_y_m, mm),
            (m.speed_mps, mm),
            (m.accel_mps2, mm),
            (m.intended_accel_mps2, mm),
        ],
        Message::V2vOut(m) => vec![
            (f64::from(m.sequence), 0.0),
            (m.generation_time_ns as f64, time),
            (m.position_x_m, mm),
            (m.position_y_m, mm),
            (m.heading_rad, angle),
            (m.speed_mps, mm),
            (m.yaw_rate_radps, angle),
            (m.accel_mps2, mm),
            (m.intended_accel_mps2, mm),
        ],
        Message::Obstacle(m) => vec![
            (f64::from(m.page), 0.0),
            (f64::from(m.kind.raw()), 0.0),
            (f64::from(m.member), 0.0),
            (m.measured_time_ns as f64, 5e4),
            (m.position_x_m, mm),
            (m.position_y_m, mm),
            (m.speed_x_mps, mm),
            (m.speed_y_mps, mm),
            (m.heading_rad, angle),
            (m.length_m, 5e-3),
            (m.width_m, 5e-3),
        ],
        Message::Mission(m) => vec![
            (f64::from(m.truck_index), 0.0),
            (f64::from(m.platoon_size), 0.0),
            (f64::from(m.run_state.raw()), 0.0),
            (m.spacing_m, mm),
            (m.set_speed_mps, mm),
            (m.desired_y_m, mm),
            (m.lane_width_m, mm),
            (m.right_edge_y_m, mm),
            (m.left_edge_y_m, mm),
            (f64::from(m.loop_period_ns), 0.0),
            (f64::from(m.place), 0.0),
            (f64::from(m.leader_truck), 0.0),
            (f64::from(m.predecessor_truck), 0.0),
            (m.leader_distance_m, mm),
        ],
        Message::EcuStatus(m) => vec![
            (f64::from(m.ecu_mode.raw()), 0.0),
            (f64::from(m.gain_id), 0.0),
            (f64::from(m.tick_count), 0.0),
            (f64::from(m.misses), 0.0),
            (f64::from(m.skipped), 0.0),
        ],
        Message::V2vTrajectory(_) | Message::V2vTrajectoryOut(_) => {
            unreachable!("the profile does not carry plans")
        }
    }
}

#[track_caller]
fn assert_close(sent: &Message, heard: &Message) {
    assert_eq!(sent.index(), heard.index());
    for ((sent_value, half_step), (value, _)) in numbers(sent).into_iter().zip(numbers(heard)) {
        let slack = 1e-9 * (1.0 + sent_value.abs());
        assert!((value - sent_value).abs() <= half_step + slack, "{sent:?}\n{heard:?}");
    }
}

fn pair() -> (Encoder, Decoder) {
    let vehicle = Vehicle::default();
    (Encoder::new(Profile::J1939, vehicle), Decoder::new(Profile::J1939, vehicle))
}

fn encode(encoder: &mut Encoder, message: &Message, time_ns: u64) -> Vec<Frame> {
    let mut frames = Vec::new();
    encoder.encode(message, time_ns, &mut |frame| frames.push(*frame)).expect("in range");
    frames
}

/// What a decoder makes of sound frames.
fn hear(decoder: &mut Decoder, frames: &[Frame]) -> Vec<Message> {
    frames.iter().filter_map(|frame| decoder.take(frame).expect("sound").message).collect()
}
