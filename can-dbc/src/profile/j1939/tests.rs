//! The profile as controller and rig meet it: messages in, messages out, over any bus.

use crate::j1939 as frames;
use crate::messages::{
    Actuation, ActuationStatus, EcuMode, EcuStatus, EgoState, Message, Mission, NavStatus,
    Obstacle, ObstacleKind, RunState, V2vOut, V2vState,
};
use crate::profile::{Decoder, Encoder, Heard, Profile, Refusal, Vehicle};
use crate::{BusTiming, Frame, FrameFlags};

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
        heading_rad: dice.between(-3.14, 3.14),
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
        heading_rad: dice.between(-3.14, 3.14),
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
        heading_rad: dice.between(-3.14, 3.14),
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
        ],
        Message::EcuStatus(m) => vec![
            (f64::from(m.ecu_mode.raw()), 0.0),
            (f64::from(m.gain_id), 0.0),
            (f64::from(m.tick_count), 0.0),
            (f64::from(m.misses), 0.0),
            (f64::from(m.skipped), 0.0),
        ],
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

#[test]
fn every_message_comes_back_within_half_a_resolution_in_any_order_of_arrival() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(1), pair());
    for tick in 0..3_000 {
        let time_ns = u64::from(tick) * TICK_NS;
        encoder.note_actuators(dice.between(-36e3, 22e3), dice.between(-0.18, 0.18));
        for message in messages(&mut dice, tick) {
            let mut frames = encode(&mut encoder, &message, time_ns);
            // The speed must come before the solution it belongs to, as its priority has it.
            let is_speed = |frame: &Frame| frame.id() == frames::Ccvs1::ID;
            frames.sort_by_key(|frame| !is_speed(frame));
            let first = usize::from(frames.first().is_some_and(is_speed));
            dice.shuffle(&mut frames[first..]);
            let heard = hear(&mut decoder, &frames);
            assert_eq!(heard.len(), 1, "{message:?}");
            assert_close(&message, &heard[0]);
        }
    }
}

#[test]
fn speed_and_force_come_back_as_well_as_standard_groups_can_tell_them() {
    let (mut encoder, mut decoder) = pair();
    let (mut worst_speed_mps, mut worst_force_n) = (0.0_f64, 0.0_f64);
    for tick in 0..6_000_u32 {
        let time_s = f64::from(tick) * 0.01;
        let time_ns = u64::from(tick) * TICK_NS;
        let (speed_forward_mps, accel_forward_mps2) =
            (15.0 + 5.0 * time_s.sin(), 5.0 * time_s.cos());
        let state = EgoState {
            tick,
            bench_time_ns: time_ns,
            speed_forward_mps,
            accel_forward_mps2,
            ..EgoState::default()
        };
        let frames = encode(&mut encoder, &Message::EgoState(state), time_ns);
        let Some(Message::EgoState(heard)) = hear(&mut decoder, &frames).pop() else {
            panic!("no state at tick {tick}");
        };
        let error_mps = (heard.speed_forward_mps - speed_forward_mps).abs();
        worst_speed_mps = worst_speed_mps.max(error_mps);

        // A force that changes no faster than an actuator does.
        let force_n = 20_000.0 * (0.5 * time_s).sin();
        let command = Actuation { answers_tick: tick, force_n, ..Actuation::default() };
        let frames = encode(&mut encoder, &Message::Actuation(command), time_ns);
        let Some(Message::Actuation(heard)) = hear(&mut decoder, &frames).pop() else {
            panic!("no command at tick {tick}");
        };
        worst_force_n = worst_force_n.max((heard.force_n - force_n).abs());
    }
    // Half a step of CCVS1, and 90 ms of half a step of the acceleration.
    assert!(worst_speed_mps <= 0.5 / 256.0 / 3.6 + 0.09 * 0.05 + 1e-3, "{worst_speed_mps} m/s");
    // 10 ms of 10 kN/s, and a step of torque.
    assert!(worst_force_n <= 100.0 + 12.5 && worst_force_n > 90.0, "{worst_force_n} N");
}

#[test]
fn engine_and_brakes_are_never_asked_together_and_the_brakes_are_asked_every_20_ms() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(2), pair());
    let (mut brakes, mut drives, mut released_late) = (false, false, 0);
    for tick in 0..2_000 {
        let command = actuation(&mut dice, tick);
        let time_ns = u64::from(tick) * TICK_NS;
        let frames = encode(&mut encoder, &Message::Actuation(command), time_ns);
        let has_xbr = frames.iter().any(|frame| frame.id() == frames::Xbr::ID);
        assert_eq!(has_xbr, tick % 2 == 0, "tick {tick}");
        for frame in &frames {
            if let Ok((torque, _)) = frames::Tsc1::decode(frame) {
                drives = torque.override_control_mode == frames::OverrideControlMode::TorqueControl;
            }
            if let Ok((brake, _)) = frames::Xbr::decode(frame) {
                brakes = brake.xbr_control_mode == frames::XbrControlMode::MaximumMode;
            }
        }
        assert!(!(brakes && drives), "tick {tick}");
        let Some(Message::Actuation(heard)) = hear(&mut decoder, &frames).pop() else {
            panic!("no command at tick {tick}");
        };
        // With an XBR the force is the one asked for; between, engine or brakes may have to wait.
        if has_xbr {
            let half_n = if command.force_n < 0.0 { 0.5 * 5760.0 / 2048.0 } else { 12.5 };
            assert!((heard.force_n - command.force_n).abs() <= half_n + 1e-6, "tick {tick}");
        }
        released_late += u32::from(command.force_n > 20.0 && heard.force_n <= 0.0);
    }
    assert!(released_late > 100, "{released_late}");
}

#[test]
fn a_lost_frame_costs_its_message_and_no_other_and_is_counted() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(3), pair());
    for tick in 0..4_000 {
        let time_ns = u64::from(tick) * TICK_NS;
        for message in messages(&mut dice, tick) {
            let mut frames = encode(&mut encoder, &message, time_ns);
            let mut delivered = 1;
            if tick % 5 == 3 {
                let missing = frames.remove(dice.below(frames.len() as u64) as usize);
                // What the rig plays beside, and a speed that can be continued, costs nothing.
                let is_part = !matches!(
                    missing.id(),
                    frames::Eec1::ID
                        | frames::Ebc1::ID
                        | frames::Ebc2::ID
                        | frames::Ebc5::ID
                        | frames::Ccvs1::ID
                );
                delivered = usize::from(!is_part);
            }
            let heard = hear(&mut decoder, &frames);
            // A command whose brake request was lost waits for the next one, 20 ms later.
            let waits = matches!(message, Message::Actuation(_)) && tick % 5 == 4;
            if !waits {
                assert_eq!(heard.len(), delivered, "tick {tick}: {message:?}");
            }
            heard.iter().for_each(|heard| assert_close(&message, heard));
        }
    }
}

#[test]
fn missing_frames_are_counted_by_their_counters() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(4), pair());
    let (mut dropped, mut lost) = (0, 0);
    for _ in 0..1_000 {
        for frame in encode(&mut encoder, &Message::V2vOut(v2v_out(&mut dice)), 0) {
            if dice.below(10) == 0 {
                dropped += 1;
            } else {
                lost += decoder.take(&frame).expect("sound").lost;
            }
        }
    }
    assert!(dropped > 300 && lost <= dropped && lost + 4 >= dropped, "{lost} of {dropped}");
}

#[test]
fn a_repeated_frame_has_no_effect() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(5), pair());
    for tick in 0..200 {
        for message in messages(&mut dice, tick) {
            let frames = encode(&mut encoder, &message, u64::from(tick) * TICK_NS);
            for frame in &frames {
                let before = decoder.take(frame).expect("sound");
                let again = decoder.take(frame);
                let info = crate::message_info(frame.id()).expect("known");
                match info.counter {
                    Some(_) => assert_eq!(again, Err(Refusal::Repeated), "{}", info.name),
                    None => assert_eq!(again, Ok(Heard { message: None, lost: 0 })),
                }
                assert!(before.message.is_none_or(|m| m.index() == message.index()));
            }
        }
    }
}

/// Frames of several messages, reordered as the priority of their identifiers has it.
#[test]
fn messages_sent_at_once_are_never_mixed() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(6), pair());
    for _ in 0..500 {
        let mut sent = Vec::new();
        for page in 0..8 {
            sent.push(Message::Obstacle(Obstacle { page, ..obstacle(&mut dice) }));
        }
        for _ in 0..3 {
            sent.push(Message::V2vState(v2v_state(&mut dice)));
        }
        let mut frames: Vec<_> =
            sent.iter().flat_map(|message| encode(&mut encoder, message, 0)).collect();
        frames.sort_by_key(Frame::id);
        let mut heard = hear(&mut decoder, &frames);
        assert_eq!(heard.len(), sent.len());
        // V2V has the higher priority.
        heard.rotate_left(3);
        sent.iter().zip(&heard).for_each(|(sent, heard)| assert_close(sent, heard));
    }
}

#[test]
fn the_emitted_order_is_that_of_priority() {
    let (mut dice, (mut encoder, _)) = (Dice(7), pair());
    encoder.note_actuators(100.0, 0.0);
    for tick in 0..100 {
        for message in messages(&mut dice, tick) {
            let frames = encode(&mut encoder, &message, u64::from(tick) * TICK_NS);
            assert!(frames.is_sorted_by_key(Frame::id), "{frames:?}");
        }
    }
}

/// The command and its parts with one bit of the data or of the identifier changed.
#[test]
fn no_single_bit_error_in_a_command_or_mission_has_an_effect() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(8), pair());
    let (mut refused, mut missed) = (0, 0);
    for tick in 0..300 {
        let time_ns = u64::from(tick) * TICK_NS;
        // Only beyond 106 % can the checksum of TSC1 miss an error, as its other bytes are.
        let mut command = actuation(&mut dice, tick);
        if tick % 4 > 0 {
            command.force_n = dice.between(21_200.0, 22_000.0);
        }
        let command = Message::Actuation(command);
        for message in [command, Message::Mission(mission(&mut dice))] {
            let frames = encode(&mut encoder, &message, time_ns);
            for damaged in 0..frames.len() {
                for bit in 0..64 {
                    let mut trial = decoder;
                    let mut heard = Vec::new();
                    for (index, frame) in frames.iter().enumerate() {
                        let frame = if index == damaged { flip(frame, bit) } else { *frame };
                        match trial.take(&frame) {
                            Ok(Heard { message, .. }) => {
                                heard.extend(message);
                                missed += u32::from(index == damaged);
                            }
                            Err(refusal) => {
                                assert!(matches!(refusal, Refusal::Crc | Refusal::Malformed));
                                refused += 1;
                            }
                        }
                    }
                    assert!(heard.is_empty(), "frame {damaged} bit {bit}: {heard:?}");
                }
            }
            hear(&mut decoder, &frames);
        }
    }
    // What the checksum of TSC1 misses, the digest of the command finds.
    assert!(missed > 0 && refused > 100 * missed, "{missed} of {refused}");
}

fn flip(frame: &Frame, bit: usize) -> Frame {
    let mut data = frame.data().to_vec();
    data[bit / 8] ^= 1 << (bit % 8);
    Frame::new(frame.id(), frame.flags(), &data).expect("a frame")
}

#[test]
fn no_frame_makes_the_decoder_panic() {
    let (mut dice, (_, mut decoder)) = (Dice(9), pair());
    let classic = FrameFlags { is_extended: true, ..FrameFlags::default() };
    for _ in 0..300_000 {
        let info = &frames::MESSAGES[dice.below(frames::MESSAGES.len() as u64) as usize];
        let mut data = dice.word().to_le_bytes();
        // Make the protected ones pass their checksum, so that their values are reached.
        let mut payload = [0; Frame::CAPACITY];
        payload[..8].copy_from_slice(&data);
        info.protection.seal(&mut payload, 8, info.id);
        data.copy_from_slice(&payload[..8]);
        let length = if dice.below(50) == 0 { dice.below(9) as usize } else { 8 };
        let frame = Frame::new(info.id, classic, &data[..length]).expect("a frame");
        if let Ok(Heard { message: Some(message), .. }) = decoder.take(&frame) {
            assert!(numbers(&message).iter().all(|(value, _)| value.is_finite()), "{message:?}");
        }
    }
}

#[test]
fn frames_of_the_other_profile_are_foreign() {
    let (mut dice, vehicle) = (Dice(10), Vehicle::default());
    let profiles = [Profile::Fd, Profile::J1939];
    for (sender, receiver) in [(profiles[0], profiles[1]), (profiles[1], profiles[0])] {
        let mut encoder = Encoder::new(sender, vehicle);
        let mut decoder = Decoder::new(receiver, vehicle);
        for message in messages(&mut dice, 0) {
            for frame in encode(&mut encoder, &message, 0) {
                assert_eq!(decoder.take(&frame), Err(Refusal::UnknownId));
            }
        }
    }
}

#[test]
fn a_state_without_the_speed_or_the_yaw_rate_is_not_delivered() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(11), pair());
    let frames = encode(&mut encoder, &Message::EgoState(ego_state(&mut dice, 0)), 0);
    let without_speed: Vec<_> =
        frames.iter().filter(|frame| frame.id() != frames::Ccvs1::ID).copied().collect();
    assert!(without_speed.len() < frames.len());
    assert_eq!(hear(&mut decoder, &without_speed), []);
    let blind = frames::Vdc2::default().encode().expect("in range");
    let state = Message::EgoState(ego_state(&mut dice, 1));
    let frames: Vec<_> = encode(&mut encoder, &state, TICK_NS)
        .into_iter()
        .map(|frame| if frame.id() == frames::Vdc2::ID { blind } else { frame })
        .collect();
    assert_eq!(hear(&mut decoder, &frames), []);
}

#[test]
fn what_does_not_fit_is_refused_by_name_and_costs_nothing() {
    let (mut encoder, _) = pair();
    let before = encoder;
    for (message, signal) in [
        (Message::EgoState(EgoState { yaw_rate_radps: 4.0, ..EgoState::default() }), "YawRate"),
        (Message::EgoState(EgoState { heading_rad: 4.0, ..EgoState::default() }), "Heading"),
        (
            Message::Actuation(Actuation { force_n: 25_300.0, ..Actuation::default() }),
            "RequestedTorque",
        ),
        (
            Message::Actuation(Actuation { force_n: -91_000.0, ..Actuation::default() }),
            "AccelerationDemand",
        ),
        (Message::Actuation(Actuation { steering_rad: 0.4, ..Actuation::default() }), "Steering"),
        (Message::Obstacle(Obstacle { member: 40, ..Obstacle::default() }), "Member"),
        (Message::Mission(Mission { platoon_size: 17, ..Mission::default() }), "PlatoonSize"),
    ] {
        let refused = encoder.encode(&message, 0, &mut |_| panic!("emitted"));
        assert_eq!(refused, Err(crate::EncodeError::OutOfRange(signal)));
        assert_eq!(encoder, before);
    }
    let nan = Message::Actuation(Actuation { force_n: f64::NAN, ..Actuation::default() });
    let refused = encoder.encode(&nan, 0, &mut |_| panic!("emitted"));
    assert!(matches!(refused, Err(crate::EncodeError::NotANumber(_))));
}

/// Ten seconds of truck 3 at 100 Hz: V2V of leader and predecessor, three trucks and two
/// obstacles in sight.
fn ten_seconds(mut see: impl FnMut(u64, &Frame)) {
    let vehicle = Vehicle::default();
    let mut rig = Encoder::new(Profile::J1939, vehicle);
    let mut ecu = Encoder::new(Profile::J1939, vehicle);
    let mut dice = Dice(12);
    for tick in 0..1_000_u32 {
        let time_ns = u64::from(tick) * TICK_NS;
        rig.note_actuators(dice.between(-1e4, 1e4), dice.between(-0.1, 0.1));
        let mut of_rig = Vec::new();
        if tick % 100 == 0 {
            of_rig.push(Message::Mission(mission(&mut dice)));
        }
        if tick % 2 == 0 {
            of_rig.extend([(); 2].map(|()| Message::V2vState(v2v_state(&mut dice))));
        }
        if tick % 5 == 0 {
            of_rig.extend([(); 5].map(|()| Message::Obstacle(obstacle(&mut dice))));
        }
        of_rig.push(Message::EgoState(ego_state(&mut dice, tick)));
        for message in &of_rig {
            rig.encode(message, time_ns, &mut |frame| see(time_ns, frame)).expect("in range");
        }
        let mut of_ecu = vec![Message::Actuation(actuation(&mut dice, tick))];
        if tick % 2 == 0 {
            of_ecu.push(Message::V2vOut(v2v_out(&mut dice)));
        }
        if tick % 10 == 0 {
            of_ecu.push(Message::EcuStatus(ecu_status(&mut dice)));
        }
        for message in &of_ecu {
            ecu.encode(message, time_ns, &mut |frame| see(time_ns, frame)).expect("in range");
        }
    }
}

#[test]
fn at_100_hz_every_frame_has_exactly_its_rate() {
    let mut times: Vec<(u32, Vec<u64>)> =
        frames::MESSAGES.iter().map(|info| (info.id, Vec::new())).collect();
    ten_seconds(|time_ns, frame| {
        let row = times.iter_mut().find(|(id, _)| *id == frame.id()).expect("in the table");
        row.1.push(time_ns);
    });
    for (id, mut times) in times {
        let info = crate::message_info(id).expect("known");
        // Several trucks and obstacles share a kind of message.
        times.dedup();
        let period_ns = u64::from(info.cycle_time_ms) * 1_000_000;
        assert_eq!(times.len() as u64, 10_000_000_000 / period_ns, "{}", info.name);
        let is_regular = times.windows(2).all(|pair| pair[1] - pair[0] == period_ns);
        assert!(is_regular, "{}", info.name);
    }
}

#[test]
fn truck_3_with_obstacles_in_sight_loads_a_500_kbit_bus_by_less_than_60_percent() {
    let timing = Profile::J1939.timing();
    assert_eq!(timing.nominal_hz, BusTiming::default().nominal_hz);
    let (mut busy_ns, mut count) = (0, 0);
    ten_seconds(|_, frame| {
        assert!(!frame.flags().is_fd && frame.data().len() == 8);
        busy_ns += timing.frame_time_ns(frame);
        count += 1;
    });
    let load_percent = busy_ns as f64 * 1e-8;
    println!("{count} frames in 10 s, {load_percent:.1} % of the bus");
    assert!((35.0..60.0).contains(&load_percent), "{load_percent} %");
}

#[test]
fn identifiers_of_the_profiles_do_not_collide() {
    let mut ids: Vec<_> = Profile::ALL
        .into_iter()
        .flat_map(Profile::messages)
        .map(|info| (info.id, info.name))
        .collect();
    ids.sort_unstable();
    for pair in ids.windows(2) {
        assert_ne!(pair[0].0, pair[1].0, "{} and {}", pair[0].1, pair[1].1);
    }
    let mut names: Vec<_> = ids.iter().map(|(_, name)| *name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), ids.len(), "two messages of one name");
}
