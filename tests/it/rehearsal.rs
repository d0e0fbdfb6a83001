//! Whole rehearsals in virtual time: what obstacle avoidance must look like, whatever the seed, the
//! noise, the loop rate or the solver.

use std::sync::LazyLock;

use bench_sim::TruckResult;
use platoon::summary::{Summary, Verdict};

use crate::bench::{self, Run};

/// Seeds nobody tuned with.
const SEEDS: std::ops::RangeInclusive<u64> = 1001..=1020;

/// Asserts everything the paper's obstacle avoidance must show.
#[track_caller]
fn assert_avoids_the_obstacle(run: &Run) {
    run.expect_code(0);
    let summary = run.summary();
    assert_eq!(summary.verdict, Verdict::Pass);
    assert_eq!(failed_criteria(&summary), Vec::<String>::new());
    assert_eq!(summary.trucks.len(), 4);
    assert_eq!(summary.ecus.len(), 4);
    for truck in &summary.trucks {
        assert_truck_avoids_the_obstacle(truck);
    }
    for ecu in &summary.ecus {
        assert_eq!(ecu.qp.failures, 0, "truck {}", ecu.truck);
        assert!(ecu.qp.solves > 0, "truck {} solved no QP", ecu.truck);
    }
}

#[track_caller]
fn assert_truck_avoids_the_obstacle(truck: &TruckResult) {
    assert!(truck.passed_obstacles.contains(&1), "{truck:#?}");
    assert_eq!(truck.lane_crossings, 2, "{truck:#?}");
    assert!(truck.min_obstacle_clearance_m.is_some_and(|m| m >= 1.0), "{truck:#?}");
    assert!(truck.max_abs_predecessor_error_m < 10.0, "{truck:#?}");
    assert!(truck.settled_position_s.is_some_and(|s| s <= 68.0), "{truck:#?}");
    assert!(truck.settled_speed_s.is_some_and(|s| s <= 69.0), "{truck:#?}");
    assert!(truck.max_abs_steer_rad < 0.10, "{truck:#?}");
    assert!(truck.max_abs_lateral_accel_mps2 < 2.8, "{truck:#?}");
    assert_eq!(truck.lost_commands, 0, "{truck:#?}");
}

fn failed_criteria(summary: &Summary) -> Vec<String> {
    let failed = summary.criteria.iter().filter(|criterion| !criterion.passed);
    failed.map(|c| format!("{}: {:?}, limit {}", c.name, c.value, c.limit)).collect()
}

fn rehearse(name: &str, seed: u64, rate_hz: u32, more: &[&str]) -> Run {
    let (seed, rate_hz) = (seed.to_string(), rate_hz.to_string());
    let arguments = ["obstacle-avoidance", "--seed", &seed, "--rate-hz", &rate_hz];
    bench::rehearse_virtually(name, &[&arguments, more].concat())
}

#[test]
fn obstacle_avoidance_passes_with_perfect_sensors() {
    for seed in [1001, 1002] {
        assert_avoids_the_obstacle(&rehearse("rehearsal-perfect", seed, 100, &[]));
    }
}

#[test]
fn obstacle_avoidance_passes_with_sensor_noise() {
    for seed in [1001, 1002] {
        let noise = ["--set", "sensors.noise=1"];
        assert_avoids_the_obstacle(&rehearse("rehearsal-noise", seed, 100, &noise));
    }
}

#[test]
fn the_hil_scenario_passes() {
    let arguments = ["hil-obstacle-avoidance", "--seed", "1001", "--rate-hz", "100"];
    assert_avoids_the_obstacle(&bench::rehearse_virtually("rehearsal-hil", &arguments));
}

/// A peak of a truck with the size below which 10 % of it mean nothing.
type Peak = (&'static str, f64, fn(&TruckResult) -> f64);

/// Peaks of the motion. The floors are 1 % of what the criteria allow.
const MOTION_PEAKS: [Peak; 4] = [
    ("steer", 0.001, |t| t.max_abs_steer_rad),
    ("lateral acceleration", 0.028, |t| t.max_abs_lateral_accel_mps2),
    ("predecessor error", 0.1, |t| t.max_abs_predecessor_error_m),
    ("leader error", 0.1, |t| t.max_abs_leader_error_m),
];

/// Peaks of the force commanded, floors likewise.
const FORCE_PEAKS: [Peak; 2] =
    [("braking", 340.0, |t| t.min_force_n), ("driving", 200.0, |t| t.max_force_n)];

/// Largest difference of a settling time between two loop rates \[s\].
const TIME_DIFFERENCE_MAX_S: f64 = 1.0;

/// The same rehearsal at three loop rates; each is run once, for all the tests that look at it.
static AT_RATES: [LazyLock<Summary>; 3] = [
    LazyLock::new(|| at_rate(100)),
    LazyLock::new(|| at_rate(500)),
    LazyLock::new(|| at_rate(1000)),
];

fn at_rate(rate_hz: u32) -> Summary {
    let run = rehearse(&format!("rehearsal-{rate_hz}-hz"), 1001, rate_hz, &[]);
    assert_avoids_the_obstacle(&run);
    run.summary()
}

/// What every two rates differ in, by a measure of two trucks.
fn differences(of: impl Fn(&TruckResult, &TruckResult) -> Vec<String>) -> Vec<String> {
    let mut found = Vec::new();
    for (slow, fast) in [(0, 1), (0, 2), (1, 2)] {
        let (slow, fast) = (&AT_RATES[slow], &AT_RATES[fast]);
        for (a, b) in slow.trucks.iter().zip(&fast.trucks) {
            let place = format!("{} and {} Hz, truck {}", slow.rate_hz, fast.rate_hz, a.index);
            found.extend(of(a, b).into_iter().map(|what| format!("{place}: {what}")));
        }
    }
    found
}

/// Peaks of two trucks that are more than 10 % and their floor apart.
fn unequal_peaks(peaks: &[Peak], a: &TruckResult, b: &TruckResult) -> Vec<String> {
    let values = peaks.iter().map(|(name, floor, of)| (name, *floor, of(a), of(b)));
    values
        .filter(|(_, floor, a, b)| (a - b).abs() > (0.1 * a.abs().min(b.abs())).max(*floor))
        .map(|(name, _, a, b)| format!("{name} {a} and {b}"))
        .collect()
}

/// Settling times of two trucks that are too far apart, or that only one of them has.
fn unequal_times(a: &TruckResult, b: &TruckResult) -> Vec<String> {
    let times = [
        ("position settled", a.settled_position_s, b.settled_position_s),
        ("speed settled", a.settled_speed_s, b.settled_speed_s),
    ];
    let near = |a: f64, b: f64| (a - b).abs() <= TIME_DIFFERENCE_MAX_S;
    times
        .iter()
        .filter(|(_, a_s, b_s)| !a_s.zip(*b_s).is_some_and(|(a, b)| near(a, b)))
        .map(|(name, a_s, b_s)| format!("{name} {a_s:?} and {b_s:?}"))
        .collect()
}

#[test]
fn peaks_of_the_motion_do_not_depend_on_the_loop_rate() {
    let found = differences(|a, b| unequal_peaks(&MOTION_PEAKS, a, b));
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn peaks_of_the_force_do_not_depend_on_the_loop_rate() {
    let found = differences(|a, b| unequal_peaks(&FORCE_PEAKS, a, b));
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn settling_times_do_not_depend_on_the_loop_rate() {
    let found = differences(unequal_times);
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
#[ignore = "twenty whole rehearsals at 1000 Hz: ./test.sh --long"]
fn heavy_every_seed_passes_at_the_full_rate() {
    for seed in SEEDS {
        println!("seed {seed}");
        assert_avoids_the_obstacle(&rehearse("heavy-full-rate", seed, 1000, &[]));
    }
}

#[test]
#[ignore = "twenty whole rehearsals: ./test.sh --long"]
fn heavy_every_seed_passes_with_sensor_noise() {
    for seed in SEEDS {
        println!("seed {seed}");
        let noise = ["--set", "sensors.noise=1"];
        assert_avoids_the_obstacle(&rehearse("heavy-noise", seed, 100, &noise));
    }
}

#[test]
#[ignore = "a whole rehearsal with a third of the radio gone: ./test.sh --long"]
fn heavy_losing_three_in_ten_radio_messages_is_survived() {
    let run = rehearse("heavy-loss", 1001, 100, &["--set", "v2v.loss=0.3"]);
    let v2v = run.summary().v2v;
    let share = v2v.lost as f64 / (v2v.lost + v2v.delivered) as f64;
    assert!((share - 0.3).abs() < 0.02, "{v2v:?}");
    assert_avoids_the_obstacle(&run);
}
