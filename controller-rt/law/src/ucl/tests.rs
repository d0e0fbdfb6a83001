//! The coordination layer on the plant Theorem 1 assumes; expected figures are those of an
//! independent simulation of the same delay-differential equation.

use super::*;
use crate::observation::{Ego, Mission, Plans};
use string::{Delay, Run, Setup, run_platoon};

#[path = "tests/string.rs"]
mod string;

/// The paper's gain, with the lead time and limits that the expected figures are for.
fn published() -> UclCalibration {
    UclCalibration {
        law: CoordinationLaw::Published,
        k1: UclCalibration::PUBLISHED_K1,
        k2: UclCalibration::PUBLISHED_K2,
        lead_time_s: 1.5,
        accel_min_mps2: -6.0,
        accel_max_mps2: 2.5,
        ..crate::Calibration::default().ucl
    }
}

/// Runs a law with one constant delay on every link and messages every millisecond.
fn run_with(cal: UclCalibration, delay_ms: usize) -> Run {
    run_platoon(&Setup { cal, delay: Delay::Constant(delay_ms), message_period_ms: 1 })
}

/// Runs the published gain.
fn run(reading: DelayReading, delay_ms: usize) -> Run {
    run_with(UclCalibration { delay_reading: reading, ..published() }, delay_ms)
}

/// Runs another law, with Eq. 4's reading of the delay.
fn run_law(law: CoordinationLaw, delay_ms: usize) -> Run {
    run_with(UclCalibration { law, ..published() }, delay_ms)
}

/// Largest error of each of `N` runs with random delays, smallest first.
fn random_peaks<const N: usize>(message_period_ms: usize, mut look: impl FnMut(&Run)) -> [f64; N] {
    let mut peaks = core::array::from_fn(|seed| {
        let delay = Delay::Random(seed as u64);
        let run = run_platoon(&Setup { cal: published(), delay, message_period_ms });
        look(&run);
        run.peak_m.into_iter().fold(0.0, f64::max)
    });
    peaks.sort_unstable_by(f64::total_cmp);
    peaks
}

fn assert_near(what: &str, value: f64, expected: f64, tolerance: f64) {
    assert!((value - expected).abs() <= tolerance, "{what}: {value}, expected {expected}");
}

#[test]
fn without_delay_errors_shrink_down_the_string_as_predicted() {
    let run = run(DelayReading::Eq4, 0);
    assert_near("peak", run.peak_m[0], 0.549, 0.005);
    assert_near("second ratio", run.peak_m[1] / run.peak_m[0], 0.108, 0.005);
    assert_near("third ratio", run.peak_m[2] / run.peak_m[1], 0.122, 0.005);
    assert_near("highest speed", run.speed_max_mps, 22.35, 0.02);
    assert!(run.settled_m < 0.02, "{}", run.settled_m);
}

#[test]
fn a_constant_delay_of_100_ms_costs_as_much_as_eq_4_says() {
    let run = run(DelayReading::Eq4, 100);
    assert_near("peak", run.peak_m[0], 0.605, 0.006);
    assert_near("second ratio", run.peak_m[1] / run.peak_m[0], 0.111, 0.005);
    assert_near("third ratio", run.peak_m[2] / run.peak_m[1], 0.122, 0.005);
    assert!(run.last_m.iter().all(|e| e.abs() < 0.02));
}

#[test]
fn random_delays_of_50_to_150_ms_cost_no_more_than_their_mean() {
    let peaks = random_peaks::<100>(1, |run| {
        assert!(run.settled_m < 0.05, "{}", run.settled_m);
        assert!(run.last_gap_m.iter().all(|e| e.abs() < 5e-3), "{:?}", run.last_gap_m);
    });
    assert_near("median", peaks[50], 0.604, 0.015);
    assert!(peaks[95] < 0.65, "{}", peaks[95]);
}

#[test]
fn rarer_messages_cost_what_half_their_period_more_delay_would() {
    for (message_period_ms, expected_m) in [(100, 0.675), (50, 0.637), (20, 0.615), (10, 0.609)] {
        let peaks = random_peaks::<25>(message_period_ms, |_| ());
        assert_near("median", peaks[12], expected_m, 0.02);
    }
}

#[test]
fn a_gain_synthesised_for_the_same_plant_takes_a_fifth_off_the_peak() {
    // Cone complementarity at gamma 0.5 for tau 0.45 s and delays up to 0.25 s.
    let cal = UclCalibration { k1: [3.12, 4.28, 1.26], k2: [0.0; 3], ..published() };
    assert_near("peak", run_with(cal, 100).peak_m[0], 0.470, 0.01);
}

#[test]
fn a_stale_leader_leaves_the_offset_that_its_age_explains() {
    // Speed 22 m/s times 0.1 s, and speed over the 20 m/s frame times 0.1 s.
    assert_near("leader", run(DelayReading::LeaderStale, 100).last_m[0], 2.20, 0.02);
    assert_near("frame", run(DelayReading::FrameStale, 100).last_m[0], 0.20, 0.02);
}

#[test]
fn extrapolating_messages_removes_the_offset() {
    let run = run(DelayReading::Compensated, 100);
    assert!(run.last_m.iter().all(|e| e.abs() < 1e-3), "{:?}", run.last_m);
}

#[test]
fn a_truck_that_hears_no_leader_holds_the_set_speed() {
    let cal = published();
    let seen = Observation {
        time_ns: 0,
        ego: Ego { forward_mps: 15.0, ..Ego::default() },
        mission: Mission { truck: 2, set_speed_mps: 18.0, ..Mission::default() },
        leader: None,
        predecessor: None,
        plans: Plans::default(),
        obstacles: [None; crate::OBSTACLES_MAX],
    };
    let report = coordinate(&cal, &Memory::new(), &seen, 0.0);
    assert_eq!((report.v_ref_mps, report.accel_mps2), (18.0, 0.0));
    assert!(report.leader_age_s.is_nan());
}

#[test]
fn feeding_the_leaders_acceleration_forward_halves_the_peak() {
    let run = run_law(CoordinationLaw::Feedforward, 100);
    assert_near("peak", run.peak_m[0], 0.296, 0.01);
    assert!(run.last_m.iter().all(|e| e.abs() < 0.02), "{:?}", run.last_m);
}

#[test]
fn the_path_law_settles_and_its_errors_shrink_down_the_string() {
    let run = run_law(CoordinationLaw::CaccPath, 100);
    assert!(run.peak_m[1] < run.peak_m[0] && run.peak_m[2] < run.peak_m[1], "{:?}", run.peak_m);
    assert!(run.last_m.iter().all(|e| e.abs() < 0.3), "{:?}", run.last_m);
}

#[test]
fn the_time_gap_law_opens_the_distance_with_the_speed() {
    // 2 m/s above the set speed at a time gap of 0.7 s: 1.4 m more to each truck ahead.
    let run = run_law(CoordinationLaw::Ploeg, 100);
    for (i, last_m) in run.last_m.into_iter().enumerate() {
        assert_near("distance", last_m, 1.4 * (i + 1) as f64, 0.35);
    }
    assert!(run.peak_m[2] <= 1.05 * run.peak_m[0], "{:?}", run.peak_m);
}

#[test]
fn without_coordination_trucks_hold_the_set_speed() {
    let run = run_law(CoordinationLaw::None, 100);
    // The leader leaves at 2 m/s; nobody follows: 1 m while it accelerates, 2 m/s for 10 s after.
    assert_near("leader error", run.last_m[0], 21.0, 0.05);
}
