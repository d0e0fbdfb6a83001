//! What goes out when.

use super::*;
use crate::BusTiming;

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
