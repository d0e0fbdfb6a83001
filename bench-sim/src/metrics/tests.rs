//! The measurements on hand-made motions.

use super::*;
use crate::roster::Roster;
use crate::truck::TruckParameters;

fn scenario() -> Scenario {
    Scenario::load("obstacle-avoidance", &[]).expect("built in")
}

fn truck(x_m: f64, y_m: f64, forward_mps: f64) -> Truck {
    Truck::new(TruckParameters::default(), x_m, y_m, forward_mps)
}

/// Samples a platoon whose trucks are given per instant, one second apart, obstacle-free.
fn measure(instants: &[Vec<Truck>], obstacles: &[Obstacle]) -> Vec<TruckResult> {
    let mut metrics = Metrics::new(&scenario());
    let mut places = [Place::default(); 4];
    Roster::new(&scenario()).places(0.0, &mut places);
    let (places, commands) = (&places[..], vec![Command::default(); 4]);
    for (second, trucks) in instants.iter().enumerate() {
        let time_ns = second as u64 * 1_000_000_000;
        metrics.sample(&Sample { time_ns, trucks, places, commands: &commands, obstacles });
    }
    metrics.results([(&CommandRange::default(), 0); 4].into_iter())
}

fn platoon(offsets_m: [f64; 4], y_m: f64, forward_mps: f64) -> Vec<Truck> {
    let place = |(i, offset_m): (usize, f64)| truck(offset_m - 50.0 * i as f64, y_m, forward_mps);
    offsets_m.into_iter().enumerate().map(place).collect()
}

#[test]
fn errors_are_positive_for_a_truck_that_lags() {
    let results = measure(&[platoon([0.0, -1.0, -3.0, 0.0], 0.0, 18.0)], &[]);
    let leader: Vec<f64> = results.iter().map(|t| t.max_abs_leader_error_m).collect();
    let last: Vec<f64> = results.iter().map(|t| t.final_predecessor_error_m).collect();
    assert_eq!(leader, [0.0, 1.0, 3.0, 0.0]);
    assert_eq!(last, [0.0, 1.0, 2.0, -3.0]);
}

#[test]
fn settling_is_the_last_instant_outside_and_never_when_that_is_the_end() {
    let (home, away) = (platoon([0.0; 4], 0.0, 18.0), platoon([0.0, -0.6, 0.0, 0.0], 0.0, 18.0));
    let slow = platoon([0.0; 4], 0.0, 17.7);
    let results = measure(&[home.clone(), away.clone(), home.clone(), slow, home.clone()], &[]);
    assert_eq!(
        (results[1].settled_position_s, results[2].settled_position_s),
        (Some(1.0), Some(0.0))
    );
    assert_eq!(results[0].settled_speed_s, Some(3.0));
    assert_eq!(measure(&[home, away], &[])[1].settled_position_s, None);
}

#[test]
fn lane_crossings_ignore_a_wobble_on_the_line() {
    let at = |y_m| platoon([0.0; 4], y_m, 18.0);
    let path = [0.0, 1.8, 1.95, 1.8, 2.0, 3.75, 1.8, 1.7, 1.9, 0.0];
    let results = measure(&path.map(at), &[]);
    assert_eq!(results[0].lane_crossings, 2);
}

#[test]
fn a_truck_is_off_centre_only_after_it_came_back_and_had_time() {
    let at = |y_m| platoon([0.0; 4], y_m, 18.0);
    let never = measure(&[0.0, 0.5, 0.5].map(at), &[]);
    assert_eq!(never[0].max_abs_off_centre_m, None);
    // One sample a second: away at 1 s, back at 2 s, judged from 13 s on.
    let mut path = vec![0.0, 3.75];
    path.extend([0.6; 11]);
    path.extend([0.1, -0.2, 0.1, 3.0, 3.0]);
    let results = measure(&path.into_iter().map(at).collect::<Vec<_>>(), &[]);
    assert_eq!(results[0].max_abs_off_centre_m, Some(0.2));
}

#[test]
fn gaps_and_clearances_are_between_boxes() {
    let mut van = scenario().obstacles[0].clone();
    (van.x_m, van.y_m, van.speed_mps) = (0.0, 3.75, 0.0);
    let results = measure(&[platoon([0.0; 4], 0.0, 0.0)], &[van]);
    let clearance_m = results[0].min_obstacle_clearance_m.expect("there is a van");
    assert!((clearance_m - (3.75 - 1.25 - 1.1)).abs() < 1e-12);
    let gap_m = results[3].min_truck_gap_m.expect("there are others");
    assert!((gap_m - (50.0 - 2.31 - 5.4)).abs() < 1e-12);
}

#[test]
fn passing_needs_to_have_been_behind() {
    let mut van = scenario().obstacles[0].clone();
    (van.x_m, van.y_m, van.speed_mps, van.appears_s) = (20.0, 3.75, 0.0, 1.0);
    let start = platoon([0.0; 4], 0.0, 18.0);
    let later = platoon([40.0, 85.0, 75.0, 0.0], 0.0, 18.0);
    let passed = |instants: &[Vec<Truck>]| -> Vec<usize> {
        let results = measure(instants, std::slice::from_ref(&van));
        results.iter().filter(|t| t.passed_obstacles == [1]).map(|t| t.index).collect()
    };
    assert_eq!(passed(&[start.clone(), start.clone(), later.clone()]), [0, 1]);
    assert!(passed(&[start, later]).is_empty(), "ahead when it appeared is not passed");
}

#[test]
fn one_truck_that_never_settles_fails_the_platoon() {
    let limits = scenario().criteria;
    let good = TruckResult {
        settled_position_s: Some(60.0),
        settled_speed_s: Some(60.0),
        lane_crossings: 2,
        met_obstacles: vec![1],
        passed_obstacles: vec![1],
        ..TruckResult::default()
    };
    let failed = |trucks: &[TruckResult]| -> Vec<String> {
        judge(&limits, trucks).into_iter().filter(|c| !c.passed).map(|c| c.name).collect()
    };
    assert!(failed(&[good.clone(), good.clone()]).is_empty());
    let bad = TruckResult {
        settled_position_s: None,
        lane_crossings: 3,
        passed_obstacles: vec![],
        min_obstacle_clearance_m: Some(0.9),
        max_abs_steer_rad: 0.11,
        min_force_n: -34_000.1,
        lost_commands: 1,
        ..good.clone()
    };
    let mut names = failed(&[good, bad]);
    names.sort();
    let expected = [
        "lane_crossings",
        "max_lost_commands",
        "max_steer_rad",
        "min_clearance_m",
        "min_force_n",
        "passed_obstacle_1",
        "settled_position_s",
    ];
    assert_eq!(names, expected);
}

#[test]
fn every_limit_of_the_scenario_is_judged_except_the_ecus_own() {
    let judged = judge(&scenario().criteria, &[TruckResult::default()]);
    let table = toml::Table::try_from(scenario().criteria).expect("criteria are TOML");
    let keys = table.keys().filter(|key| !key.ends_with("_band_m") && !key.ends_with("_band_mps"));
    for key in
        keys.filter(|key| !["max_qp_failures", "max_emergency_brakings"].contains(&key.as_str()))
    {
        let stem = key.strip_suffix("_obstacles").map_or(key.as_str(), |_| "passed_obstacle_1");
        assert!(judged.iter().any(|c| c.name == stem), "{key} is not judged");
    }
}
