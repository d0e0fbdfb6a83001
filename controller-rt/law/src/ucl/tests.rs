//! The coordination layer on the plant Theorem 1 assumes: a' = (u - a)/tau, tau = 0.45 s, spacing
//! 20 m, leader from 20 to 22 m/s at 2 m/s² between 1 s and 2 s (Zheng et al. 2016). Expected
//! figures are those of an independent simulation of the same delay-differential equation.

use super::*;
use crate::observation::{Ego, Mission, Plans, V2v};

const TAU_S: f64 = 0.45;
const SPACING_M: f64 = 20.0;
const MS: u64 = 1_000_000;
const FOLLOWERS: usize = 3;

#[derive(Clone, Copy)]
struct Vehicle {
    x_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
    intended_mps2: f64,
}

/// What a run showed.
struct Run {
    /// Largest |error to the predecessor| of each follower \[m\].
    peak_m: [f64; FOLLOWERS],
    /// Error to the leader at the end \[m\].
    last_m: [f64; FOLLOWERS],
}

fn message(v: &Vehicle, time_ns: u64) -> V2v {
    V2v {
        generated_ns: time_ns,
        x_m: v.x_m,
        speed_mps: v.speed_mps,
        accel_mps2: v.accel_mps2,
        intended_accel_mps2: v.intended_mps2,
        ..V2v::default()
    }
}

/// Runs the published gain with one constant delay on every link.
fn run(reading: DelayReading, delay_ms: usize) -> Run {
    let cal = UclCalibration { delay_reading: reading, ..crate::Calibration::default().ucl };
    run_with(cal, delay_ms)
}

/// Runs another law, with Eq. 4's reading of the delay.
fn run_law(law: CoordinationLaw, delay_ms: usize) -> Run {
    run_with(UclCalibration { law, ..crate::Calibration::default().ucl }, delay_ms)
}

/// Runs the platoon for 12 s.
fn run_with(cal: UclCalibration, delay_ms: usize) -> Run {
    // Theorem 1 knows no actuator limits.
    let cal = UclCalibration { accel_min_mps2: -100.0, accel_max_mps2: 100.0, ..cal };
    let mut vehicles: [Vehicle; FOLLOWERS + 1] = core::array::from_fn(|i| Vehicle {
        x_m: -SPACING_M * i as f64,
        speed_mps: 20.0,
        accel_mps2: 0.0,
        intended_mps2: 0.0,
    });
    // Messages on their way: what every vehicle sent, one slot per millisecond of delay.
    const SLOTS: usize = 512;
    let mut air = [[V2v::default(); FOLLOWERS + 1]; SLOTS];
    let mut memories = [Memory::new(); FOLLOWERS];
    let mut result = Run { peak_m: [0.0; FOLLOWERS], last_m: [0.0; FOLLOWERS] };
    for k in 0..12_000_usize {
        let now_ns = k as u64 * MS;
        air[k % SLOTS] = core::array::from_fn(|i| message(&vehicles[i], now_ns));
        let heard = k.checked_sub(delay_ms).map(|sent| air[sent % SLOTS]);

        let mut commands = [0.0; FOLLOWERS];
        for i in 1..=FOLLOWERS {
            let v = &vehicles[i];
            let seen = Observation {
                time_ns: now_ns,
                ego: Ego {
                    time_ns: now_ns,
                    x_m: v.x_m,
                    forward_mps: v.speed_mps,
                    accel_mps2: v.accel_mps2,
                    ..Ego::default()
                },
                mission: Mission {
                    truck: i as u8,
                    trucks: FOLLOWERS as u8 + 1,
                    predecessor: i as u8 - 1,
                    spacing_m: SPACING_M,
                    leader_distance_m: i as f64 * SPACING_M,
                    set_speed_mps: 20.0,
                    ..Mission::default()
                },
                leader: heard.map(|all| all[0]),
                predecessor: heard.map(|all| all[i - 1]),
                plans: Plans::default(),
                obstacles: [None; crate::OBSTACLES_MAX],
            };
            memories[i - 1].note_seen(&seen);
            let asked = coordinate(&cal, &memories[i - 1], &seen, 1e-3).accel_mps2;
            memories[i - 1].asked_mps2 = asked;
            commands[i - 1] = asked;
        }

        let dt = 1e-3;
        let leader_accel = if (1_000..2_000).contains(&k) { 2.0 } else { 0.0 };
        for (i, v) in vehicles.iter_mut().enumerate() {
            let before = v.accel_mps2;
            // Exact for a command held over the step.
            v.accel_mps2 = match i {
                0 => leader_accel,
                _ => commands[i - 1] + (before - commands[i - 1]) * libm::exp(-dt / TAU_S),
            };
            let mean = if i == 0 { leader_accel } else { 0.5 * (before + v.accel_mps2) };
            v.intended_mps2 = if i == 0 { leader_accel } else { commands[i - 1] };
            v.x_m += dt * (v.speed_mps + 0.5 * dt * mean);
            v.speed_mps += dt * mean;
        }
        for i in 0..FOLLOWERS {
            let error = vehicles[i].x_m - vehicles[i + 1].x_m - SPACING_M;
            result.peak_m[i] = result.peak_m[i].max(error.abs());
            let place = (i + 1) as f64;
            result.last_m[i] = vehicles[0].x_m - vehicles[i + 1].x_m - place * SPACING_M;
        }
    }
    result
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
    let cal = crate::Calibration::default().ucl;
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
