use super::*;
use crate::frame::FrameFlags;
use crate::{Reading, decode_signals};

fn frame(id: u32, data: [u8; 8]) -> Frame {
    let flags = FrameFlags { is_extended: true, ..FrameFlags::default() };
    Frame::new(id, flags, &data).expect("a frame")
}

/// The frame of a genset manual (Thomson MEC 310, option J): 700 rpm, 0 % torque.
#[test]
fn a_published_eec1_is_read_as_published() {
    let seen = frame(Eec1::ID, [0xFF, 0x7D, 0x7D, 0xE0, 0x15, 0xFF, 0xF0, 0xFF]);
    let engine = Eec1::decode(&seen).expect("sound");
    let expected = Eec1 {
        driver_demand_torque_percent: Reading::Value(0.0),
        actual_torque_percent: Reading::Value(0.0),
        engine_speed_rpm: Reading::Value(700.0),
        ..Eec1::default()
    };
    assert_eq!(engine, expected);
}

#[test]
fn before_anything_is_known_everything_but_the_protection_is_ones() {
    for empty in [Eec1::default().encode(), Vdc2::default().encode(), Ccvs1::default().encode()] {
        assert_eq!(empty.expect("in range").data(), [0xFF; 8]);
    }
    let empty = Xbr::default().encode(0).expect("in range");
    assert_eq!(empty.data()[3..7], [0xFF; 4]);
    assert_eq!(empty.data()[..2], [0xFF; 2]);
}

#[test]
fn the_top_of_a_raw_range_is_never_a_number() {
    for (raw, expected) in [
        (0x0000, Reading::Value(0.0)),
        (0xFAFF, Reading::Value(64_255.0 / 256.0)),
        (0xFB00, Reading::Error),
        (0xFE00, Reading::Error),
        (0xFEFF, Reading::Error),
        (0xFF00, Reading::NotAvailable),
        (0xFFFF, Reading::NotAvailable),
    ] {
        let [low, high] = u16::to_le_bytes(raw);
        let seen = frame(Ccvs1::ID, [0xFF, low, high, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]);
        let speed = Ccvs1::decode(&seen).expect("sound").wheel_based_speed_kmph;
        assert_eq!(speed, expected, "{raw:04X}");
        decode_signals(&seen, &mut |signal, _, reading| {
            if signal.name == "WheelBasedSpeed" {
                assert_eq!(reading, expected, "{raw:04X}");
            }
        });
    }
}

#[test]
fn codes_are_told_from_values_at_every_size() {
    // Byte, six bits, four bits and two bits: not available and, one below, error.
    let codes = |data: [u8; 8]| {
        let motion = Vdc2::decode(&frame(Vdc2::ID, data)).expect("sound");
        let engine = Eec1::decode(&frame(Eec1::ID, data)).expect("sound");
        (
            motion.longitudinal_acceleration_mps2,
            motion.steering_wheel_turns,
            engine.actual_torque_fraction_percent,
            motion.steering_wheel_sensor,
        )
    };
    use Reading::{Error, NotAvailable};
    let all = (NotAvailable, NotAvailable, NotAvailable, SteeringWheelSensor::NotAvailable);
    assert_eq!(codes([0xFF; 8]), all);
    // Of the fraction, everything from 8 eighths to 14 is reserved.
    let all = (Error, Error, Error, SteeringWheelSensor::Error);
    assert_eq!(codes([0xE0, 0xFF, 0xBE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFE]), all);
}

#[test]
fn an_error_is_sent_where_there_is_a_code_for_it_and_refused_elsewhere() {
    let broken = Vdc2 { yaw_rate_radps: Reading::Error, ..Vdc2::default() };
    let sent = broken.encode().expect("has a code");
    assert_eq!(sent.data()[3..5], [0x00, 0xFE]);
    assert_eq!(Vdc2::decode(&sent), Ok(broken));
    let broken = Tsc1 { requested_torque_fraction_percent: Reading::Error, ..Tsc1::default() };
    assert_eq!(broken.encode(0), Err(EncodeError::OutOfRange("RequestedTorqueFraction")));
}

#[test]
fn a_counter_beyond_its_range_is_refused_both_ways() {
    assert_eq!(Tsc1::default().encode(8), Err(EncodeError::OutOfRange("MessageCounter")));
    let mut data = [0; 8];
    data.copy_from_slice(Tsc1::default().encode(7).expect("in range").data());
    // "Counter not available" with the checksum that belongs to it.
    data[7] = 0x0F;
    data[7] |= crate::checksum::tsc1(&data, Tsc1::ID) << 4;
    let refused = Tsc1::decode(&frame(Tsc1::ID, data));
    assert_eq!(refused, Err(DecodeError::OutOfRange("MessageCounter")));
}

#[test]
fn frames_of_another_format_are_no_parameter_group() {
    let sent = Vdc2::default().encode().expect("in range");
    let flags = sent.flags();
    let fd = Frame::new(Vdc2::ID, FrameFlags { is_fd: true, ..flags }, sent.data());
    assert_eq!(Vdc2::decode(&fd.expect("a frame")), Err(DecodeError::WrongFlags));
    let short = Frame::new(Vdc2::ID, flags, &sent.data()[..7]).expect("a frame");
    assert_eq!(Vdc2::decode(&short), Err(DecodeError::WrongLength));
    assert_eq!(Ccvs1::decode(&sent), Err(DecodeError::UnknownId));
}

#[test]
fn parameter_groups_are_where_j1939_has_them() {
    // Priority, group, destination or group extension, source.
    let parts = |id: u32| (id >> 26, id >> 8 & 0x3_FFFF, id & 0xFF);
    for (id, priority, group, source) in [
        (Tsc1::ID, 3, 0, 0x2A),
        (Xbr::ID, 3, 0x040B, 0x2A),
        (Eec1::ID, 3, 61_444, 0x00),
        (Vdc2::ID, 6, 61_449, 0x0B),
        (Ebc1::ID, 6, 61_441, 0x0B),
        (Ebc2::ID, 6, 65_215, 0x0B),
        (Ebc5::ID, 6, 64_964, 0x0B),
        (Ccvs1::ID, 6, 65_265, 0x00),
        (SteerCommand::ID, 3, 0xFF20, 0x2A),
    ] {
        assert_eq!(parts(id), (priority, group, source), "{id:08X}");
    }
}

#[test]
fn the_last_part_of_a_command_and_of_a_solution_has_the_lowest_priority() {
    assert!([Tsc1::ID, Xbr::ID, SteerCommand::ID].is_sorted());
    let navigation = [Vdc2::ID, Ccvs1::ID, NavPosition::ID, NavMotion::ID, NavTime::ID];
    assert!(navigation.is_sorted());
}

#[test]
fn every_frame_decodes_to_what_encodes_to_it() {
    for info in MESSAGES {
        for fill in [0x00, 0x5A, 0x21] {
            let mut payload = [0; Frame::CAPACITY];
            payload[..8].fill(fill);
            info.protection.seal(&mut payload, 8, info.id);
            let mut data = [0; 8];
            data.copy_from_slice(&payload[..8]);
            let seen = frame(info.id, data);
            if let Ok((message, counter)) = Message::decode(&seen) {
                let sent = message.encode(counter.unwrap_or(0)).expect("what decodes encodes");
                assert_eq!(Message::decode(&sent), Ok((message, counter)), "{}", info.name);
            }
        }
    }
}
