//! What the ingredients of the law are for: each left out alone, and what goes wrong then.
//!
//! These runs fail on purpose. If one passes, either the ingredient is superfluous or the scenario
//! no longer asks for it.

use bench_sim::TruckResult;

use crate::bench;

/// Every truck's result of a scenario in virtual time at 50 Hz, whatever the verdict.
fn trucks(run: &str, scenario: &str, options: &[&str]) -> Vec<TruckResult> {
    let arguments = [scenario, "--seed", "1001", "--rate-hz", "50"];
    bench::rehearse_virtually(run, &[&arguments, options].concat()).summary().trucks
}

/// The least distance of any truck's box to an obstacle's \[m\].
fn least_clearance_m(trucks: &[TruckResult]) -> f64 {
    trucks.iter().filter_map(|truck| truck.min_obstacle_clearance_m).fold(f64::INFINITY, f64::min)
}

#[test]
fn without_stamps_trucks_stand_behind_their_slots_by_the_leaders_way_while_the_message_flew() {
    // 22 m/s for 50 to 150 ms.
    let options = ["--delay-reading", "leader-stale"];
    for truck in &trucks("ingredients-stamps", "platooning", &options)[1..] {
        assert!(truck.settled_position_s.is_none(), "{truck:#?}");
        let error_m = truck.max_abs_leader_error_m;
        assert!((1.5..5.0).contains(&error_m), "{error_m}");
    }
}

#[test]
fn without_the_passing_side_rule_the_leader_stays_behind_the_van() {
    let options = ["--duration-s", "40", "--set", "law.lml.passing_side_rule=false"];
    let leader = &trucks("ingredients-side", "obstacle-avoidance", &options)[0];
    assert_eq!(leader.lane_crossings, 0, "{leader:#?}");
    assert!(leader.passed_obstacles.is_empty(), "{leader:#?}");
}

#[test]
fn with_obstacles_frozen_over_the_horizon_trucks_weave_and_nearly_touch_the_van() {
    let options = ["--no-emergency-braking", "--set", "law.lml.obstacles_predicted=false"];
    let trucks = trucks("ingredients-frozen", "merging", &options);
    let clearance_m = least_clearance_m(&trucks);
    assert!(clearance_m < 0.5, "{clearance_m}");
    assert!(trucks.iter().any(|truck| truck.lane_crossings > 2), "{trucks:#?}");
}
