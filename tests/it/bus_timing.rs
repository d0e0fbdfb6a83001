//! Rehearsals on emulated buses: frames take the time of a real bus, and every summary says whether
//! there is one that would do.

use platoon_dbc::{BusTiming, Profile};
use serde_json::Value;

use crate::bench::{self, Run, frame};

fn emulated(name: &str, arguments: &[&str]) -> Run {
    bench::rehearse_virtually(name, &[arguments, &["--bus-timing", "emulate"]].concat())
}

/// Every frame of one bus in the order of the trace, with the time it was through \[ns\].
fn carried(run: &Run, bus: u8) -> Vec<(u64, bool, platoon_dbc::Frame)> {
    run.trace()
        .with_topics([format!("/can/bus{bus}/frames")])
        .map(|message| frame(&message))
        .map(|record| (record.stamp_ns, record.tx, record.frame))
        .collect()
}

#[test]
fn an_emulated_run_is_the_same_bit_for_bit() {
    let run = |name: &str| {
        let run = emulated(name, &["--seed", "7", "--rate-hz", "100", "--duration-s", "20"]);
        (0..4).map(|bus| carried(&run, bus)).collect::<Vec<_>>()
    };
    let (once, again) = (run("emulated-once"), run("emulated-again"));
    assert!(once.iter().all(|frames| frames.len() > 4000));
    assert!(once == again, "the wires carried something else");
}

#[test]
fn a_wire_carries_one_frame_at_a_time_and_the_trace_has_their_order() {
    for (profile, hz) in [(Profile::Fd, "1000"), (Profile::J1939, "100")] {
        let name = format!("emulated-wire-{profile}");
        let word = profile.to_string();
        let arguments = ["--profile", word.as_str(), "--rate-hz", hz, "--duration-s", "5"];
        let run = emulated(&name, &arguments);
        let timing: BusTiming = profile.timing();
        let frames = carried(&run, 3);
        assert!(frames.len() > 5000, "{}", frames.len());
        // What was said before and after the run took no time and has none.
        let on_wire: Vec<_> = frames.iter().filter(|(stamp_ns, ..)| *stamp_ns > 0).collect();
        assert!(frames.len() - on_wire.len() < 50, "{} of {}", on_wire.len(), frames.len());
        for pair in on_wire.windows(2) {
            let ((before_ns, ..), (stamp_ns, _, frame)) = (pair[0], pair[1]);
            let began_ns = stamp_ns.checked_sub(timing.frame_time_ns(frame));
            assert!(began_ns >= Some(*before_ns), "{frame:?} from {began_ns:?} to {stamp_ns}");
        }
    }
}

#[test]
fn no_frame_of_an_emulated_rehearsal_takes_longer_than_its_bound() {
    for (profile, hz) in [("fd", "1000"), ("fd", "100"), ("j1939", "100"), ("j1939", "30")] {
        let arguments = ["--profile", profile, "--rate-hz", hz, "--duration-s", "10"];
        let bus = emulated(&format!("emulated-{profile}-{hz}"), &arguments).summary().bus;
        assert!(bus.fits, "{bus:?}");
        assert_eq!(bus.overflowed, 0);
        assert!(bus.observed.len() >= 7, "{bus:?}");
        for seen in &bus.observed {
            let bound_us = seen.bound_us.expect("what fits has a bound");
            assert!(seen.p99_us <= seen.max_us && seen.max_us <= bound_us, "{seen:?} at {hz} Hz");
        }
    }
}

#[test]
fn an_overloaded_bus_is_felt_and_told() {
    let run = emulated("emulated-overload", &["--rate-hz", "3000", "--duration-s", "5"]);
    let bus = run.summary().bus;
    assert!(!bus.fits && bus.load_percent.iter().all(|percent| *percent > 100.0), "{bus:?}");
    assert_eq!(bus.fitting_rate.as_deref(), Some("1M/8M"));
    assert_eq!(bus.response_us["Actuation"], None);
    // The most urgent message still gets through in time, the least urgent does not.
    let seen = |message: &str| bus.observed.iter().find(|seen| seen.message == message);
    let most_urgent = seen("EgoState").expect("carried");
    assert!(Some(most_urgent.max_us) <= most_urgent.bound_us, "{bus:?}");
    assert!(seen("EcuStatus").is_none_or(|seen| seen.max_us > 100_000.0), "{bus:?}");
    assert!(bus.overflowed > 0, "{bus:?}");
    assert!(run.stdout.contains("does not fit, but would at 1M/8M"), "{}", run.stdout);
}

#[test]
fn every_summary_says_whether_a_real_bus_would_do() {
    let run = bench::rehearse_virtually("ideal", &["--rate-hz", "100", "--duration-s", "1"]);
    let bus = &run.json()["bus"];
    assert_eq!((&bus["fits"], &bus["timing"]), (&Value::from(true), &Value::from("ideal")));
    assert_eq!((&bus["profile"], &bus["fitting_rate"]), (&"fd".into(), &"500k/1M".into()));
    assert_eq!(
        (&bus["bit_rate_hz"], &bus["data_bit_rate_hz"]),
        (&500_000.into(), &2_000_000.into())
    );
    assert!(bus["response_us"]["EgoState"].as_f64().is_some_and(|us| us > 400.0), "{bus}");
    assert_eq!(bus["observed"], Value::Array(Vec::new()));
    assert!(run.stdout.contains("fits"), "{}", run.stdout);
}

#[test]
fn buses_are_emulated_in_real_time_too() {
    let arguments = ["--bus", "udp", "--rate-hz", "100", "--duration-s", "4", "--bus-timing"];
    let run = bench::rehearse("emulated-real-time", &[&arguments[..], &["emulate"]].concat());
    assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
    let summary = run.summary();
    assert_eq!((summary.bus.overflowed, summary.ecus.len()), (0, 4));
    assert!((summary.duration_s - 4.0).abs() < 1e-6, "{} s", summary.duration_s);
    assert!(summary.rig_pace.is_some_and(|pace| pace.service_gap_ns_max > 0));
    let timing = BusTiming::default();
    for seen in &summary.bus.observed {
        // Nothing is ever faster than its own bits; the machine may make it slower than its bound.
        let shortest_us = 1e-3 * timing.bit_time_ns() as f64 * 48.0;
        assert!(seen.max_us > shortest_us, "{seen:?}");
    }
    assert!(summary.nodes.iter().all(|node| node.accepted > 0 && node.missing == 0));
}
