use super::*;
use crate::frame::FrameFlags;

fn state() -> EgoState {
    EgoState {
        tick: 4_000_000_000,
        bench_time_ns: 123_456_789_012,
        position_x_m: 1_234.567_84,
        position_y_m: -3.500_06,
        heading_rad: 0.123_456,
        speed_forward_mps: 20.000_04,
        speed_lateral_mps: -0.25,
        yaw_rate_radps: 0.01,
        accel_forward_mps2: -1.0005,
        nav_status: NavStatus::Valid,
    }
}

fn obstacle(page: u8) -> Obstacle {
    Obstacle {
        page,
        kind: ObstacleKind::PlatoonTruck,
        member: 3,
        measured_time_ns: (1 << 48) - 1,
        position_x_m: -36.0,
        position_y_m: 3.5,
        speed_x_mps: 17.0,
        speed_y_mps: -0.0001,
        heading_rad: -3.123_46,
        length_m: 16.5,
        width_m: 2.55,
    }
}

#[test]
fn a_message_comes_back_within_half_a_factor() {
    let sent = state();
    let frame = sent.encode(17).expect("in range");
    let (seen, counter) = EgoState::decode(&frame).expect("undamaged");
    assert_eq!((seen.tick, seen.bench_time_ns, counter), (sent.tick, sent.bench_time_ns, 17));
    assert!((seen.position_x_m - sent.position_x_m).abs() <= 0.5e-4);
    assert!((seen.position_y_m - sent.position_y_m).abs() <= 0.5e-4);
    assert!((seen.heading_rad - sent.heading_rad).abs() <= 0.5e-5);
    assert!((seen.speed_forward_mps - sent.speed_forward_mps).abs() <= 0.5e-4);
}

#[test]
fn what_was_decoded_encodes_to_the_same_frame() {
    for raw in (-8_388_608_i64..=8_388_607).step_by(997).chain([8_388_607]) {
        let sent = EgoState { position_y_m: raw as f64 * 0.0001, ..state() };
        let frame = sent.encode(0).expect("in range");
        let (seen, _) = EgoState::decode(&frame).expect("undamaged");
        assert_eq!(seen.encode(0), Ok(frame), "raw {raw}");
    }
}

#[test]
fn halves_round_to_even() {
    // A factor of 0.1 N: 0.05 is half a step, 0.15 one and a half.
    let force_raw = |force_n| {
        let frame = Actuation { force_n, ..Actuation::default() }.encode(0).expect("in range");
        let mut raw = None;
        crate::decode_signals(&frame, &mut |signal, value, _| {
            if signal.name == "Force" {
                raw = Some(value);
            }
        });
        raw.expect("the message has a Force")
    };
    assert_eq!([0.05, 0.25, -0.05, -0.25].map(force_raw), [0, 2, 0, -2]);
    assert_eq!([0.051, 0.249, -0.051].map(force_raw), [1, 2, -1]);
}

#[test]
fn what_is_no_number_or_does_not_fit_is_refused_by_name() {
    let with = |force_n| Actuation { force_n, ..Actuation::default() }.encode(0);
    assert_eq!(with(f64::NAN), Err(EncodeError::NotANumber("Force")));
    assert_eq!(with(f64::INFINITY), Err(EncodeError::OutOfRange("Force")));
    assert_eq!(with(838_860.8), Err(EncodeError::OutOfRange("Force")));
    assert!(with(838_860.7).is_ok() && with(-838_860.8).is_ok());
    let mission = Mission { platoon_size: 17, ..Mission::default() };
    assert_eq!(mission.encode(0), Err(EncodeError::OutOfRange("PlatoonSize")));
    let late = EgoState { bench_time_ns: 1 << 48, ..state() };
    assert_eq!(late.encode(0), Err(EncodeError::OutOfRange("BenchTime")));
}

#[test]
fn every_obstacle_page_is_its_own() {
    for page in 0..8 {
        let frame = obstacle(page).encode(page).expect("in range");
        let (seen, counter) = Obstacle::decode(&frame).expect("undamaged");
        assert_eq!(counter, page);
        assert_eq!((seen.page, seen.kind, seen.member), (page, ObstacleKind::PlatoonTruck, 3));
        assert!((seen.heading_rad - -3.123_46).abs() <= 0.5e-5);
        let mut names = Vec::new();
        crate::decode_signals(&frame, &mut |signal, _, _| names.push(signal.name));
        assert_eq!(names.len(), 13);
        assert!(names[3..].iter().all(|name| name.ends_with(&format!("_{page}"))));
    }
    assert_eq!(obstacle(8).encode(0), Err(EncodeError::OutOfRange("ObstaclePage")));
}

#[test]
fn a_series_keeps_its_order_and_half_a_step_of_each_value() {
    let speed_mps = std::array::from_fn(|k| 19.9 + 0.123_456 * k as f64);
    let sent = V2vTrajectory { source_truck: 2, speed_mps, ..V2vTrajectory::default() };
    let (heard, _) = V2vTrajectory::decode(&sent.encode(1).expect("in range")).expect("sound");
    for (heard, sent) in heard.speed_mps.iter().zip(sent.speed_mps) {
        assert!((heard - sent).abs() <= 0.001 + 1e-12, "{heard} {sent}");
    }
    let mut broken = sent;
    broken.speed_mps[20] = 65.54;
    assert_eq!(broken.encode(1), Err(EncodeError::OutOfRange("Speed_20")));
}

#[test]
fn writing_a_page_leaves_nothing_of_another() {
    let other = obstacle(1).encode(5).expect("in range");
    let empty = Obstacle { page: 1, ..Obstacle::default() };
    assert_ne!(empty.encode(5), Ok(other));
    let again =
        Obstacle { member: 255, ..Obstacle::decode(&empty.encode(5).expect("ok")).expect("ok").0 };
    assert_eq!(again, empty);
}

#[test]
fn frames_that_are_not_the_message_are_told_apart() {
    let frame = state().encode(0).expect("in range");
    let flags = frame.flags();
    let rebuilt = |flags, data: &[u8]| Frame::new(EgoState::ID, flags, data).expect("valid");
    assert_eq!(Actuation::decode(&frame), Err(DecodeError::UnknownId));
    let short = rebuilt(flags, &frame.data()[..24]);
    assert_eq!(EgoState::decode(&short), Err(DecodeError::WrongLength));
    let classic = FrameFlags { is_fd: false, brs: false, ..flags };
    assert_eq!(EgoState::decode(&rebuilt(classic, &[0; 8])), Err(DecodeError::WrongFlags));
    let mut damaged = frame.data().to_vec();
    damaged[20] ^= 4;
    assert_eq!(EgoState::decode(&rebuilt(flags, &damaged)), Err(DecodeError::Crc));
    let unknown = Frame::new(0x123, FrameFlags::default(), &[]).expect("valid");
    assert_eq!(Message::decode(&unknown), Err(DecodeError::UnknownId));
    // The bit rate of the data phase is no part of the message.
    let slow = rebuilt(FrameFlags { brs: false, ..flags }, frame.data());
    assert!(EgoState::decode(&slow).is_ok());
}

#[test]
fn a_value_without_meaning_is_refused_even_when_its_crc_is_right() {
    let frame = state().encode(9).expect("in range");
    let mut data = frame.data().to_vec();
    data[31] |= 0xF0; // NavStatus, the last four bits
    crate::e2e::protect(&mut data, EgoState::E2E_DATA_ID, 9);
    let forged = Frame::new(EgoState::ID, frame.flags(), &data).expect("valid");
    assert_eq!(EgoState::decode(&forged), Err(DecodeError::OutOfRange("NavStatus")));
}

#[test]
fn start_values_encode() {
    let defaults = [
        Message::EgoState(EgoState::default()),
        Message::Actuation(Actuation::default()),
        Message::V2vState(V2vState::default()),
        Message::V2vOut(V2vOut::default()),
        Message::Obstacle(Obstacle::default()),
        Message::Mission(Mission::default()),
        Message::EcuStatus(EcuStatus::default()),
        Message::V2vTrajectory(V2vTrajectory::default()),
        Message::V2vTrajectoryOut(V2vTrajectoryOut::default()),
    ];
    assert_eq!(defaults.len(), MESSAGES.len());
    for (index, message) in defaults.iter().enumerate() {
        let frame = message.encode(1).expect("start values are in range");
        assert_eq!(message.index(), index);
        assert_eq!(frame.data().len(), MESSAGES[index].length);
        assert_eq!(Message::decode(&frame), Ok((*message, 1)));
    }
    assert_eq!(EgoState::default().nav_status, NavStatus::Lost);
    assert_eq!(Obstacle::default().member, 255);
}

#[test]
fn no_payload_makes_decoding_panic() {
    let mut word = 1_u64;
    for round in 0..100_000_usize {
        let message = &MESSAGES[round % MESSAGES.len()];
        let mut data = vec![0; message.length];
        for byte in &mut data {
            // Knuth's MMIX generator; its high byte is random enough here.
            word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *byte = (word >> 56) as u8;
        }
        let crate::Protection::E2eP05 { data_id } = message.protection else {
            panic!("{message:?}");
        };
        crate::e2e::protect(&mut data, data_id, 0);
        let flags = state().encode(0).expect("in range").flags();
        let frame = Frame::new(message.id, flags, &data).expect("valid");
        if let Ok((seen, counter)) = Message::decode(&frame) {
            assert_eq!(counter, 0);
            let again = seen.encode(0).expect("what decodes also encodes");
            assert_eq!(Message::decode(&again), Ok((seen, 0)));
        }
        crate::decode_signals(&frame, &mut |signal, _, reading| {
            assert!(reading.value().is_some_and(f64::is_finite), "{}", signal.name);
        });
    }
}
