//! Platoons that change on the way, and leaders that stop: short rehearsals at a slow loop.

use platoon::summary::Summary;

use crate::bench;

/// Rehearses three trucks, 20 m apart at 20 m/s without a scripted leader, with these overrides.
fn rehearse(name: &str, duration_s: &str, sets: &[&str]) -> Summary {
    let fixed = ["platooning", "--rate-hz", "50", "--duration-s", duration_s];
    let cruise = ["platoon.trucks=3", "leader.accelerations=[]"];
    let sets = cruise.iter().chain(sets).flat_map(|set| ["--set", set]);
    let words: Vec<&str> = fixed.into_iter().chain(sets).collect();
    let run = bench::rehearse_virtually(name, &words);
    run.expect_code(0);
    run.summary()
}

const CHANGES: &str = "criteria={ settled_after_change_s = 8.0, min_truck_gap_m = 11.0 }";

#[track_caller]
fn assert_in_its_slot(summary: &Summary, truck: usize) {
    let truck = &summary.trucks[truck];
    assert!(truck.final_predecessor_error_m.abs() < 0.3, "{truck:#?}");
    assert!(truck.settled_after_change_s.is_some(), "{truck:#?}");
}

#[test]
fn a_truck_that_comes_up_from_behind_joins_at_the_tail() {
    let events = "events=[{ at_s = 0, truck = 2, leads = true },
                          { at_s = 1, truck = 2, follows = 1, over_s = 30 }]";
    let sets = [CHANGES, "trucks.2.start_x_m=-100", events];
    let summary = rehearse("roster-join", "42", &sets);
    assert_in_its_slot(&summary, 2);
    // A joiner is nobody's obstacle, and nobody is its: all stay in their lane.
    assert!(summary.trucks.iter().all(|truck| truck.max_y_m < 0.1), "{:#?}", summary.trucks);
}

#[test]
fn those_behind_a_truck_that_leaves_close_up() {
    let events = "events=[{ at_s = 1, truck = 1, desired_y_m = 3.75, over_s = 5 },
                          { at_s = 8, truck = 1, leads = true, speed_mps = 24, over_s = 4 },
                          { at_s = 8, truck = 2, follows = 0, over_s = 20 }]";
    let sets = ["criteria={ settled_after_change_s = 8.0, min_truck_gap_m = 1.0 }", events];
    let summary = rehearse("roster-leave", "38", &sets);
    assert_in_its_slot(&summary, 2);
    let gone = &summary.trucks[1];
    assert!((gone.final_speed_mps - 24.0).abs() < 0.2, "{gone:#?}");
    assert_eq!((gone.lane_crossings, summary.trucks[2].lane_crossings), (1, 0));
}

#[test]
fn the_rear_of_a_split_goes_on_under_its_own_leader() {
    let events = "events=[{ at_s = 1, truck = 1, spacing_m = 90, over_s = 33 },
                          { at_s = 36, truck = 1, leads = true, speed_mps = 18, over_s = 3 }]";
    let summary = rehearse("roster-split", "48", &[CHANGES, events]);
    assert_in_its_slot(&summary, 2);
    let speeds = summary.trucks.iter().map(|truck| truck.final_speed_mps);
    let expected = [20.0, 18.0, 18.0];
    for (speed_mps, expected_mps) in speeds.zip(expected) {
        assert!((speed_mps - expected_mps).abs() < 0.2, "{speed_mps} m/s");
    }
}

#[test]
fn a_platoon_stands_still_behind_its_leader_and_moves_off_again() {
    let script = "leader.accelerations=[
        { from_s = 1, until_s = 13, accel_mps2 = -2, rise_s = 0.5 },
        { from_s = 18, until_s = 24, accel_mps2 = 1, rise_s = 1 }]";
    let limits = "criteria={ settled_speed_s = 30, min_standstill_gap_m = 11.0 }";
    let summary = rehearse("roster-stop", "32", &[script, limits]);
    for truck in &summary.trucks {
        assert!(truck.min_standstill_gap_m.is_some(), "never stood still: {truck:#?}");
        assert!((truck.final_speed_mps - 5.0).abs() < 0.2, "{truck:#?}");
        assert!(truck.max_abs_steer_rad < 1e-3, "steers at standstill: {truck:#?}");
    }
}
