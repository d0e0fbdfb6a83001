//! Grade, banking and wind against statics.

use super::*;

fn on(change: impl Fn(&mut Surroundings)) -> TwoTrackParameters {
    let mut surroundings = Surroundings::level(0.85);
    change(&mut surroundings);
    TwoTrackParameters { surroundings, ..TwoTrackParameters::default() }
}

/// Steers a truck straight along the road by its heading and yaw rate, until nothing moves; the
/// steering it settles at \[rad\].
fn straight_ahead(truck: &mut TwoTrack, forward_mps: f64) -> f64 {
    let (mut steer_rad, mut drift_rad) = (0.0, 0.0);
    for _ in 0..120_000 {
        // Direction of travel, not of the nose: banking makes a truck crab.
        let (_, across_mps) = truck.state.road_velocity_mps();
        let course_rad = across_mps / forward_mps;
        drift_rad += course_rad * STEP_S;
        steer_rad = -0.5 * course_rad - 0.3 * drift_rad - 0.3 * truck.state.yaw_radps;
        truck.step(&holding(truck, forward_mps, steer_rad), STEP_S);
    }
    assert!(truck.state.yaw_radps.abs() < 1e-6, "settled");
    steer_rad
}

#[test]
fn a_grade_takes_its_share_of_gravity() {
    for grade in [-0.06, 0.03, 0.06] {
        let p = on(|road| road.grade = grade);
        let mut truck = rolling(p, 15.0);
        drive(&mut truck, 2.0, |_, _| Command { force_n: 8_000.0, steer_rad: 0.0 });
        let steepness = libm::sqrt(1.0 + grade * grade);
        let pull_n = p.mass_kg * GRAVITY_MPS2 * grade / steepness;
        let expected =
            (8_000.0 - p.resistance_n(truck.state.forward_mps) - pull_n) / p.effective_mass_kg();
        assert_close(truck.acceleration.forward_mps2, expected, 5e-3, &format!("grade {grade}"));
    }
}

#[test]
fn a_banked_road_asks_for_the_steering_of_its_cornering_force() {
    // Going straight, the tyres carry m g sin β: without curvature δ = K g sin β, towards the high
    // side. Within 1 % like the understeer gradient itself.
    let p = TwoTrackParameters {
        surroundings: on(|road| road.banking = 0.05).surroundings,
        ..unresisted()
    };
    let mut truck = rolling(p, 18.0);
    let steer_rad = straight_ahead(&mut truck, 18.0);
    let aside_mps2 = GRAVITY_MPS2 * 0.05 / libm::sqrt(1.0025);
    assert_close(steer_rad, understeer_gradient(&p) * aside_mps2, 0.01, "steering");
    // Load moves to the low, right side: m g sin β h about the ground, and the leaning.
    let loads_n = truck.wheel_loads_n();
    let overturning_nm: f64 = (0..AXLES)
        .map(|axle| 0.5 * (loads_n[2 * axle + 1] - loads_n[2 * axle]) * p.track_m[axle])
        .sum();
    let leaning_nm = p.sprung_kg() * GRAVITY_MPS2 * p.roll_arm_m() * truck.state.roll_rad;
    let expected = p.mass_kg * aside_mps2 * p.cg_height_m() + leaning_nm;
    assert_close(overturning_nm, expected, 0.01, "overturning moment");
    assert!(truck.state.roll_rad > 0.0, "it leans to the low side");
}

#[test]
fn head_wind_adds_to_the_drag_as_the_square_of_the_airspeed() {
    let p = on(|road| road.wind_x_mps = -10.0);
    let truck = rolling(p, 20.0);
    let drag_n = -truck.forces(&truck.state).air_n[0];
    assert_close(drag_n, p.drag_n_s2_per_m2 * 900.0, 1e-12, "drag");
    let behind = rolling(on(|road| road.wind_x_mps = 20.0), 20.0);
    assert_eq!(behind.forces(&behind.state).air_n[0], 0.0);
}

#[test]
fn cross_wind_is_balanced_by_steering_into_it() {
    // The axles carry the side force and its moment; going straight, δ = Yf / Cf' - Yr / Cr, with
    // the stiffnesses under the loads that drag leaves. Within 3 %. The rear axle is so light that
    // it takes more slip than the front one, and the wheel turns downwind while the truck crabs.
    let p = on(|road| road.wind_y_mps = 8.0);
    let mut truck = rolling(p, 18.0);
    let steer_rad = straight_ahead(&mut truck, 18.0);
    let [_, side_n] = truck.forces(&truck.state).air_n;
    assert!(side_n > 0.0 && truck.state.heading_rad < 0.0, "it crabs with its nose upwind");
    let loads_n = truck.wheel_loads_n();
    let (front, rear) = effective_stiffness(&p, [loads_n[0] + loads_n[1], loads_n[2] + loads_n[3]]);
    let ahead_m = p.pressure_ahead_m;
    let front_n = -side_n * (p.rear_axle_m + ahead_m) / p.wheelbase_m();
    let rear_n = -side_n * (p.front_axle_m - ahead_m) / p.wheelbase_m();
    assert_close(steer_rad, front_n / front - rear_n / rear, 0.03, "steering");
    assert!(truck.state.roll_rad < 0.0, "it leans away from the wind");
}
