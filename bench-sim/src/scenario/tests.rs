//! Scenarios load, take overrides, and refuse nonsense in one line.

use super::*;

fn load(sets: &[(&str, &str)]) -> Result<Scenario, ScenarioError> {
    let sets: Vec<_> = sets.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    Scenario::load("obstacle-avoidance", &sets)
}

/// The one-line refusal of an override, which must contain every one of `parts`.
fn refused(key: &str, value: &str, parts: &[&str]) {
    let message = load(&[(key, value)]).expect_err(&format!("{key}={value}")).to_string();
    assert!(!message.contains('\n'), "{message:?} is more than one line");
    for part in parts.iter().chain(&["obstacle-avoidance"]) {
        assert!(message.contains(part), "{message:?} does not say {part:?}");
    }
}

#[test]
fn every_built_in_scenario_loads_under_its_own_name() {
    for summary in Scenario::list() {
        let scenario = Scenario::load(summary.name, &[]).expect(summary.name);
        assert_eq!(scenario.name, summary.name);
        assert!(!summary.description.is_empty());
    }
}

#[test]
fn the_hil_scenarios_differ_from_the_first_in_the_v2v_delay_only() {
    let first = Scenario::load("obstacle-avoidance", &[]).expect("loads");
    let delays =
        [("hil-obstacle-avoidance", 0.0, 0.0), ("hil-obstacle-avoidance-delay", 0.05, 0.25)];
    for (name, delay_min_s, delay_max_s) in delays {
        let mut hil = Scenario::load(name, &[]).expect("loads");
        assert_eq!((hil.v2v.delay_min_s, hil.v2v.delay_max_s), (delay_min_s, delay_max_s));
        hil.v2v = first.v2v;
        hil.name.clone_from(&first.name);
        hil.description.clone_from(&first.description);
        assert_eq!(first, hil);
    }
}

#[test]
fn the_second_van_is_where_the_reference_numbers_put_it() {
    let scenario = load(&[]).expect("loads");
    let van = &scenario.obstacles[1];
    assert!((van.motion(49.0).x_m - 797.0).abs() < 1e-9 && van.appears_s == 40.0);
    let mut back = Scenario::load("obstacle-avoidance-12m-back", &[]).expect("loads");
    assert!((back.obstacles[1].motion(49.0).x_m - 785.0).abs() < 1e-9);
    back.obstacles[1].x_m += 12.0;
    assert_eq!(back.obstacles, scenario.obstacles);
}

#[test]
fn overrides_reach_their_keys() {
    let scenario = load(&[
        ("platoon.trucks", "6"),
        ("platoon.speed_mps", "20"),
        ("obstacles.1.x_m", "70.5"),
        ("obstacles.2.kind", "pedestrian"),
        ("trucks.5.mass_kg", "9000"),
        ("trucks.0.drive_lag_s", "0.4"),
        ("criteria.min_clearance_m", "0.5"),
        ("law.lml_every_ticks", "50"),
        ("law.anything.deep", "[1, 2]"),
    ])
    .expect("loads");
    assert_eq!((scenario.platoon.trucks, scenario.platoon.speed_mps), (6, 20.0));
    assert_eq!(scenario.obstacles[0].x_m, 70.5);
    assert_eq!(scenario.obstacles[1].kind, crate::obstacle::Kind::Pedestrian);
    assert_eq!(scenario.truck_parameters(5).mass_kg, 9000.0);
    assert_eq!(scenario.truck_parameters(4).mass_kg, 5760.0);
    assert_eq!(scenario.truck_parameters(0).drive_lag_s, 0.4);
    assert_eq!(scenario.criteria.min_clearance_m, Some(0.5));
    assert_eq!(scenario.law["lml_every_ticks"].as_integer(), Some(50));
}

#[test]
fn keys_that_only_make_sense_together_can_be_set_together() {
    let key = |field| format!("obstacles.2.lane_change.{field}");
    let (to, from, until) = (key("to_y_m"), key("from_s"), key("until_s"));
    let scenario = load(&[(&to, "0"), (&from, "50"), (&until, "54")]).expect("loads");
    assert_eq!(scenario.obstacles[1].motion(60.0).y_m, 0.0);
    refused(&to, "0", &["missing field", "from_s"]);
}

#[test]
fn changes_of_speed_and_lane_are_one_table_or_a_list() {
    let one = "{ to_speed_mps = 0, from_s = 5, until_s = 7.5 }";
    let scenario = load(&[("obstacles.1.speed_change", one)]).expect("loads");
    assert_eq!(scenario.obstacles[0].motion(8.0).x_mps, 0.0);
    let more = "[{ to_speed_mps = 0, from_s = 5, until_s = 7.5 }, \
                 { to_speed_mps = 4, from_s = 8, until_s = 12 }]";
    let scenario = load(&[
        ("obstacles.1.speed_change", more),
        ("obstacles.1.speed_change.2.to_speed_mps", "6"),
    ]);
    assert_eq!(scenario.expect("loads").obstacles[0].motion(20.0).x_mps, 6.0);
}

#[test]
fn impossible_courses_are_refused() {
    let hard = "{ to_speed_mps = 0, from_s = 5, until_s = 6 }";
    refused("obstacles.1.speed_change", hard, &["speed_change.1.until_s = 6", "6.5 to"]);
    let overlapping = "[{ to_speed_mps = 9, from_s = 5, until_s = 7 }, \
                        { to_speed_mps = 15, from_s = 6, until_s = 8 }]";
    refused("obstacles.1.speed_change", overlapping, &["speed_change.2.from_s = 6", "7 to"]);
    let fast = "{ to_speed_mps = 80, from_s = 5, until_s = 60 }";
    refused("obstacles.1.speed_change", fast, &["speed_change.1.to_speed_mps = 80", "40"]);
    let nameless = "{ to_mps = 0, from_s = 5, until_s = 7.5 }";
    refused("obstacles.1.speed_change", nameless, &["to_mps", "to_speed_mps"]);
    refused("obstacles.1.speed_change", "3", &["obstacles.1.speed_change=3"]);
    let back =
        "[{ to_y_m = 3.75, from_s = 5, until_s = 8 }, { to_y_m = 0, from_s = 7, until_s = 9 }]";
    refused("obstacles.1.lane_change", back, &["lane_change.2.from_s = 7", "8 to"]);
}

#[test]
fn a_written_scenario_loads_back_the_same() {
    let patches = "[{ from_x_m = 10, until_x_m = 20, friction = 0.2 }]";
    let scenario = load(&[
        ("trucks.1.mass_kg", "8000"),
        ("law.x", "1"),
        ("plant.model", "two-track"),
        ("road.friction_patches", patches),
        ("obstacles.1.speed_change", "{ to_speed_mps = 0, from_s = 5, until_s = 7.5 }"),
    ])
    .expect("loads");
    let back: Scenario = toml::from_str(&scenario.to_toml()).expect("parses");
    assert_eq!(back, scenario);
}

#[test]
fn impossible_values_are_refused_with_key_value_and_range() {
    refused("platoon.trucks", "0", &["platoon.trucks", "0", "1 to 16"]);
    refused("platoon.speed_mps", "nan", &["platoon.speed_mps", "NaN", "0 to 40"]);
    refused("platoon.spacing_m", "-5", &["platoon.spacing_m", "-5"]);
    refused("trucks.1.mass_kg", "-1", &["trucks.1.mass_kg", "-1", "1000"]);
    refused("trucks.4.mass_kg", "5000", &["trucks", "trucks.3"]);
    refused("plant.friction", "0", &["plant.friction", "0.05"]);
    refused("v2v.delay_min_s", "0.2", &["v2v.delay_max_s = 0.15", "0.2 to 5"]);
    refused("v2v.delay_max_s", "inf", &["v2v.delay_max_s"]);
    refused("v2v.loss", "1.5", &["v2v.loss", "0 to 1"]);
    refused("duration_s", "0", &["duration_s"]);
    refused("obstacles.1.width_m", "0", &["obstacles.1.width_m"]);
    refused("criteria.passed_obstacles", "[3]", &["passed_obstacles", "1 to 2"]);
    refused("criteria.max_steer_rad", "nan", &["criteria.max_steer_rad"]);
}

#[test]
fn unknown_keys_and_wrong_types_are_refused_with_what_is_allowed() {
    refused("platoon.speed_kmh", "60", &["platoon.speed_kmh", "speed_mps"]);
    refused("platon.trucks", "4", &["platon.trucks", "platoon"]);
    refused("platoon.trucks", "four", &["platoon.trucks=four", "whole number"]);
    refused("platoon.trucks", "4.5", &["platoon.trucks=4.5"]);
    refused("platoon.trucks", "-4", &["platoon.trucks=-4"]);
    refused("platoon.trucks.x", "4", &["platoon.trucks is a value"]);
    refused("plant.model", "four-track", &["four-track", "single-track", "two-track"]);
    refused("obstacles.3.x_m", "1", &["obstacles.1 to obstacles.2"]);
    refused("obstacles.0.x_m", "1", &["obstacles.1 to obstacles.2"]);
    refused("obstacles.first.x_m", "1", &["obstacles.1 to obstacles.2"]);
    refused("obstacles", "3", &["obstacles=3"]);
    refused("obstacles.1.kind", "cow", &["cow", "vehicle"]);
    refused("trucks.one.mass_kg", "5000", &["one", "trucks.0"]);
    refused("", "1", &["empty"]);
    refused("platoon.", "1", &["empty"]);
    refused("sensors.noise", "on", &["sensors.noise=on"]);
}

/// The two-track calibration of the leader under overrides that also choose that model.
fn two_track(sets: &[(&str, &str)]) -> TwoTrackParameters {
    let scenario = load(&[&[("plant.model", "two-track")], sets].concat()).expect("loads");
    match scenario.truck(0) {
        Specification::TwoTrack(parameters) => parameters,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_plant_model_is_chosen_by_its_key() {
    let truck = |model| load(&[("plant.model", model)]).expect("loads").truck(0);
    assert!(matches!(truck("single-track"), Specification::SingleTrack(_)));
    assert!(matches!(truck("two-track"), Specification::TwoTrack(_)));
    assert!(matches!(truck("prediction"), Specification::Prediction(_)));
    assert_eq!(load(&[]).expect("loads").plant.model, Model::SingleTrack);
}

#[test]
fn road_and_plant_keys_reach_the_two_track_truck() {
    let p = two_track(&[
        ("road.grade_percent", "3"),
        ("road.banking_percent", "-2"),
        ("road.wind_x_mps", "-5"),
        ("road.wind_y_mps", "4.5"),
        ("road.friction_patches", "[{ from_x_m = 10, until_x_m = 20, friction = 0.2 }]"),
        ("plant.power_max_w", "150e3"),
        ("plant.driven_axles", "rear"),
        ("plant.rear_cornering_scale", "3.09"),
        ("plant.friction", "0.6"),
        ("trucks.0.mass_kg", "11520"),
        ("trucks.0.drive_lag_s", "0.4"),
    ]);
    let ice = FrictionPatch { from_x_m: 10.0, until_x_m: 20.0, friction: 0.2 };
    let mut road = Surroundings::level(0.6).with_patches([ice]);
    (road.grade, road.banking, road.wind_x_mps, road.wind_y_mps) = (0.03, -0.02, -5.0, 4.5);
    assert_eq!(p.surroundings, road);
    assert_eq!((p.power_max_w, p.driven), (150e3, DrivenAxles::Rear));
    assert_eq!((p.rear_tyre.cornering_scale, p.tyre.cornering_scale), (3.09, 1.0));
    assert_eq!((p.mass_kg, p.yaw_inertia_kgm2, p.drive_lag_s), (11_520.0, 69_605.2, 0.4));
}

#[test]
fn what_the_chosen_plant_would_ignore_is_refused() {
    refused("road.grade_percent", "3", &["road.grade_percent = 3", "two-track"]);
    refused("road.wind_y_mps", "3", &["road.wind_y_mps = 3", "two-track"]);
    refused("plant.driven_axles", "rear", &["plant.driven_axles = rear", "two-track"]);
    let patch = "[{ from_x_m = 10, until_x_m = 20, friction = 0.2 }]";
    refused("road.friction_patches", patch, &["road.friction_patches = 1", "two-track"]);
}

#[test]
fn impossible_roads_are_refused() {
    refused("road.grade_percent", "45", &["road.grade_percent = 45", "-30 to 30"]);
    refused("plant.power_max_w", "0", &["plant.power_max_w", "1000"]);
    refused("plant.driven_axles", "front", &["front", "rear"]);
    refused("road.grade", "0.1", &["road.grade", "grade_percent"]);
    let patch = "[{ from_x_m = 30, until_x_m = 20, friction = 0.2 }]";
    refused("road.friction_patches", patch, &["road.friction_patches.1.until_x_m = 20", "30"]);
    let patch = "[{ from_m = 30, until_x_m = 20, friction = 0.2 }]";
    refused("road.friction_patches", patch, &["from_m", "from_x_m"]);
}

#[test]
fn an_unknown_scenario_lists_the_known_ones() {
    let message = Scenario::load("obstacle-avoidence", &[]).expect_err("unknown").to_string();
    assert!(message.contains("hil-obstacle-avoidance") && !message.contains('\n'), "{message}");
}

#[test]
fn a_broken_file_is_refused_with_its_line() {
    let folder = std::env::temp_dir().join(format!("platoon-scenario-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("temp folder");
    let path = folder.join("broken.toml");
    std::fs::write(&path, "name = \"x\"\nduration_s = = 3\n").expect("write");
    let name = path.to_str().expect("utf-8 path").to_owned();
    let message = Scenario::load(&name, &[]).expect_err("broken").to_string();
    let folder_message =
        Scenario::load(folder.to_str().expect("utf-8 path"), &[]).expect_err("folder").to_string();
    std::fs::remove_dir_all(&folder).expect("clean up");
    assert!(message.contains("broken.toml") && message.contains("line 2"), "{message}");
    assert!(!message.contains('\n') && folder_message.contains("folder"));
}

/// The one-line refusal of events, which must contain every one of `parts`.
fn refused_events(events: &str, parts: &[&str]) {
    refused("events", &format!("[{events}]"), parts);
}

#[test]
fn events_are_read_and_kept_in_order_of_time() {
    let events = "[{ at_s = 0, truck = 3, leads = true, speed_mps = 20 },
                   { at_s = 9, truck = 3, follows = 2, spacing_m = 30, over_s = 12 },
                   { at_s = 9, truck = 0, speed_mps = 0 }]";
    let scenario = load(&[("events", events)]).expect("loads");
    let [first, second, third] = scenario.events[..] else { panic!("{:?}", scenario.events) };
    assert_eq!((first.leads, first.follows, first.speed_mps), (true, None, Some(20.0)));
    assert_eq!((second.follows, second.spacing_m, second.until_s()), (Some(2), Some(30.0), 21.0));
    assert_eq!((third.truck, third.speed_mps, third.over_s), (0, Some(0.0), 0.0));
    let early = "{ at_s = 9, truck = 1, speed_mps = 0 }, { at_s = 8, truck = 1, speed_mps = 0 }";
    refused_events(early, &["events.2.at_s = 8", "9 to 3600"]);
    let again: Scenario = toml::from_str(&scenario.to_toml()).expect("its own text");
    assert_eq!(again, scenario);
}

#[test]
fn events_that_no_truck_can_follow_are_refused() {
    refused_events("{ at_s = 1, truck = 4, speed_mps = 0 }", &["events.1.truck = 4", "0 to 3"]);
    refused_events("{ at_s = 1, truck = 1, follows = 1, over_s = 5 }", &["events.1.follows = 1"]);
    refused_events("{ at_s = 1, truck = 1, follows = 9, over_s = 5 }", &["follows = 9", "0 to 3"]);
    let both = "{ at_s = 1, truck = 1, follows = 0, leads = true, over_s = 5 }";
    refused_events(both, &["events.1.follows = 0", "leads"]);
    let alone = "{ at_s = 1, truck = 1, leads = true, spacing_m = 20, over_s = 5 }";
    refused_events(alone, &["events.1.spacing_m = 20", "follows nobody"]);
    refused_events(
        "{ at_s = 1, truck = 1, spacing_m = 2, over_s = 5 }",
        &["spacing_m = 2", "8 to"],
    );
    refused_events("{ at_s = 1, truck = 1, place = 2 }", &["place", "follows"]);
    refused_events("{ at_s = 4000, truck = 1, speed_mps = 2 }", &["events.1.at_s = 4000"]);
    let scripted = [("leader.accelerations", "[]"), ("events", "[{ at_s = 1, truck = 0 }]")];
    let message = load(&scripted).expect_err("nobody drives truck 0").to_string();
    assert!(message.contains("events.1.truck = 0") && message.contains("1 to 3"), "{message}");
}

#[test]
fn distances_and_lanes_do_not_jump() {
    refused_events("{ at_s = 1, truck = 1, spacing_m = 51 }", &["events.1.over_s = 0", "1 to"]);
    refused_events("{ at_s = 1, truck = 1, desired_y_m = 1 }", &["events.1.over_s = 0", "1 to"]);
    // 40 m at 4 m/s at the fastest take 18.75 s.
    let hasty = "{ at_s = 1, truck = 1, spacing_m = 90, over_s = 18 }";
    refused_events(hasty, &["events.1.over_s = 18", "18.75 to"]);
    let at_start = "[{ at_s = 0, truck = 1, spacing_m = 90, desired_y_m = 3.75 }]";
    assert!(load(&[("events", at_start)]).is_ok(), "a run may start in any way");
}

#[test]
fn circles_and_shared_slots_are_refused_once_an_instant_is_over() {
    let circle = "{ at_s = 1, truck = 0, follows = 3, over_s = 5 }";
    refused_events(circle, &["events.1.follows", "does not follow itself"]);
    let shared = "{ at_s = 1, truck = 3, follows = 1, over_s = 5 }";
    refused_events(shared, &["events.1.follows = 1", "at most one truck behind each"]);
    let swap = "[{ at_s = 1, truck = 3, follows = 1, over_s = 5 },
                 { at_s = 1, truck = 2, follows = 3, over_s = 5 }]";
    assert!(load(&[("events", swap)]).is_ok(), "two events of one instant are one change");
}

#[test]
fn trucks_start_where_they_are_told() {
    let sets = [("trucks.3.start_x_m", "-300"), ("trucks.3.start_speed_mps", "22")];
    let scenario = load(&sets).expect("loads");
    assert_eq!(scenario.start(3), Start { x_m: -300.0, y_m: 0.0, speed_mps: 22.0 });
    assert_eq!(scenario.start(2), Start { x_m: -100.0, y_m: 0.0, speed_mps: 18.0 });
    refused("trucks.3.start_speed_mps", "-1", &["trucks.3.start_speed_mps = -1", "0 to 40"]);
}

#[test]
fn an_ecu_is_told_its_trucks_mass_only_when_the_scenario_says_so() {
    let heavy = ("trucks.1.mass_kg", "9000");
    let told = |sets: &[(&str, &str)]| load(sets).expect("loads").told_mass_kg(1);
    assert_eq!(told(&[heavy]), None);
    assert_eq!(told(&[heavy, ("plant.mass_told", "true")]), Some(9000.0));
    assert_eq!(told(&[("plant.mass_told", "true")]), None);
}

#[test]
fn a_rise_is_for_a_constant_acceleration_and_fits_in_twice() {
    let stretch = |more: &str| {
        let text = format!("[{{ from_s = 1, until_s = 2, accel_mps2 = -6, {more} }}]");
        load(&[("leader.accelerations", &text)])
    };
    assert!(stretch("rise_s = 0.5").is_ok());
    for more in ["rise_s = 0.6", "rise_s = 0.1, shape = \"sine\""] {
        let message = stretch(more).expect_err(more).to_string();
        assert!(message.contains("leader.accelerations.1.rise_s"), "{message}");
    }
}

#[test]
fn a_script_that_would_reverse_ends_at_standstill() {
    let brake = "[{ from_s = 1, until_s = 20, accel_mps2 = -6 }]";
    let scenario = load(&[("leader.accelerations", brake)]).expect("loads");
    assert_eq!(scenario.leader.expect("scripted").final_speed_mps(18.0), 0.0);
}
