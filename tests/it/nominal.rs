//! Numbers that stand in two crates on purpose, held together here: what is (the plant), what the
//! controller believes, and what the guard allows.

use bench_sim::truck::{
    NOMINAL_MASS_KG, PredictionParameters, TruckParameters, TwoTrackParameters, WIDTH_M,
};
use controller_rt::guard;
use law::Calibration;

#[test]
fn the_controllers_belief_is_the_plants_nominal_truck() {
    let plant = TruckParameters::new(NOMINAL_MASS_KG, 0.25, 0.85);
    let belief = Calibration::default().truck;
    let pairs = [
        ("mass", plant.mass_kg, belief.mass_kg),
        ("front axle", plant.front_axle_m, belief.cg_to_front_m),
        ("rear axle", plant.rear_axle_m, belief.cg_to_rear_m),
        ("yaw inertia", plant.yaw_inertia_kgm2, belief.yaw_inertia_kgm2),
        ("front tyres", plant.front_stiffness_n_per_rad, belief.front_stiffness_n_per_rad),
        ("rear tyres", plant.rear_stiffness_n_per_rad, belief.rear_stiffness_n_per_rad),
        ("half width", 0.5 * WIDTH_M, belief.half_width_m),
    ];
    for (what, is, believed) in pairs {
        assert_eq!(is, believed, "{what}");
    }
}

#[test]
fn every_plant_is_the_same_truck() {
    let belief = Calibration::default().truck;
    let believed =
        [belief.mass_kg, belief.yaw_inertia_kgm2, belief.cg_to_front_m, belief.cg_to_rear_m];
    let two = TwoTrackParameters::default();
    let is = [two.mass_kg, two.yaw_inertia_kgm2, two.front_axle_m, two.rear_axle_m];
    assert_eq!(is, believed, "two-track");
    // The rear axle's stiffness follows from its load and is a third of Table II's.
    let ratio = two.static_cornering_n_per_rad(0) / belief.front_stiffness_n_per_rad;
    assert!((ratio - 1.0).abs() < 1e-3, "front tyres {ratio}");
    assert_eq!(two.drive_lag_s, Calibration::default().dmpc.lag_s, "two-track");
    let one = PredictionParameters::default();
    let is = [one.mass_kg, one.yaw_inertia_kgm2, one.front_axle_m, one.rear_axle_m];
    assert_eq!(is, believed, "prediction");
    assert_eq!(one.front_stiffness_n_per_rad, belief.front_stiffness_n_per_rad);
    assert_eq!(one.rear_stiffness_n_per_rad, belief.rear_stiffness_n_per_rad);
    assert_eq!(one.drag_n_s2_per_m2, belief.drag_n_per_mps2);
    assert_eq!(one.rolling, belief.rolling_resistance);
}

#[test]
fn the_vehicle_that_frames_are_scaled_by_is_the_nominal_truck() {
    let vehicle = platoon_dbc::Vehicle::default();
    let belief = Calibration::default();
    assert_eq!(vehicle.mass_kg, NOMINAL_MASS_KG);
    assert_eq!(vehicle.mass_kg, belief.truck.mass_kg);
    assert_eq!(vehicle.full_torque_force_n, 1e3 * belief.lml.force_max_kn);
}

#[test]
fn the_plant_resists_more_than_the_controller_believes() {
    let plant = TruckParameters::new(NOMINAL_MASS_KG, 0.25, 0.85);
    let belief = Calibration::default().truck;
    let ratio = plant.drag_n_s2_per_m2 / belief.drag_n_per_mps2;
    assert!((ratio - 1.15).abs() < 1e-12, "drag {ratio}");
    let ratio = plant.rolling / belief.rolling_resistance;
    assert!((ratio - 1.15).abs() < 1e-12, "rolling {ratio}");
}

#[test]
fn the_guard_lets_the_law_use_its_limits_and_little_more() {
    let lml = Calibration::default().lml;
    let pairs = [
        ("least force", -guard::FORCE_MIN_N, -1e3 * lml.force_min_kn),
        ("largest force", guard::FORCE_MAX_N, 1e3 * lml.force_max_kn),
        ("force rate", guard::FORCE_RATE_NPS, 1e3 * lml.force_rate_kn_per_s),
        ("steering", guard::STEERING_MAX_RAD, lml.steering_max_rad),
        ("steering rate", guard::STEERING_RATE_RADPS, lml.steering_rate_radps),
        ("lateral acceleration", guard::LATERAL_ACCEL_MAX_MPS2, lml.lateral_accel_max_mps2),
    ];
    for (what, guard, law) in pairs {
        assert!((1.0..1.5).contains(&(guard / law)), "{what}: guard {guard}, law {law}");
    }
}
