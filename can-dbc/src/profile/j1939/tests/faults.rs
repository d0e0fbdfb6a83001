//! What is lost, repeated, damaged, foreign or does not fit.

use super::*;
use crate::FrameFlags;
use crate::profile::{Heard, Refusal};

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
    let plan = Message::V2vTrajectoryOut(crate::V2vTrajectoryOut::default());
    let refused = encoder.encode(&plan, 0, &mut |_| panic!("emitted"));
    assert_eq!(refused, Err(crate::EncodeError::NotInProfile("j1939")));
}

/// Every slot with parts that wait for the rest: the largest that a decoder gets.
#[test]
fn a_decoder_has_no_more_than_four_kilobytes_of_state() {
    let (mut dice, (mut encoder, mut decoder)) = (Dice(13), pair());
    for tick in 0..8 {
        for message in messages(&mut dice, tick) {
            let frames = encode(&mut encoder, &message, u64::from(tick) * TICK_NS);
            hear(&mut decoder, &frames[..frames.len() - 1]);
        }
    }
    let bytes = |state: Result<Vec<u8>, _>| state.expect("serialises").len();
    let decoder = bytes(postcard::to_allocvec(&decoder));
    let encoder = bytes(postcard::to_allocvec(&encoder));
    println!("decoder {decoder} bytes, encoder {encoder}");
    assert!(decoder < 4096 && encoder < 256, "decoder {decoder} bytes, encoder {encoder}");
}
