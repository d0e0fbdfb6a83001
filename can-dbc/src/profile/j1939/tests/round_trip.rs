//! What was sent is what is heard.

use super::*;

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
