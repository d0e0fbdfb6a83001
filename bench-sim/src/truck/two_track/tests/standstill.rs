//! Stopping, standing, and starting again.

use super::*;

fn on_grade(grade: f64, friction: f64) -> TwoTrackParameters {
    let mut surroundings = Surroundings::level(friction);
    surroundings.grade = grade;
    TwoTrackParameters { surroundings, ..TwoTrackParameters::default() }
}

fn pushing(force_n: f64) -> Command {
    Command { force_n, steer_rad: 0.0 }
}

#[test]
fn braking_to_standstill_stays_at_standstill() {
    for steer_rad in [0.0, 0.1, -0.17] {
        let mut truck = truck_at(15.0);
        let command = Command { force_n: -23_040.0, steer_rad };
        drive(&mut truck, 8.0, |_, _| command);
        let rest = truck.state();
        assert_eq!((rest.forward_mps, rest.lateral_mps, rest.yaw_radps), (0.0, 0.0, 0.0));
        drive(&mut truck, 30.0, |_, _| command);
        let later = truck.state();
        assert_eq!(
            (later.x_m, later.y_m, later.heading_rad),
            (rest.x_m, rest.y_m, rest.heading_rad)
        );
        assert_eq!(*truck.acceleration(), BodyAcceleration::default());
        assert!(truck.state.pitch_rad.abs() < 1e-4, "the suspension has settled");
    }
}

#[test]
fn a_standing_truck_needs_more_than_rolling_resistance_to_move() {
    let mut truck = truck_at(0.0);
    let rolling_n = truck.parameters.resistance_n(0.0);
    drive(&mut truck, 5.0, |_, _| pushing(0.9 * rolling_n));
    assert_eq!(truck.state.x_m, 0.0);
    drive(&mut truck, 5.0, |_, _| pushing(2.0 * rolling_n));
    assert!(truck.state.x_m > 0.1);
}

#[test]
fn the_hill_holder_keeps_a_truck_from_rolling_back() {
    let p = on_grade(0.1, 0.85);
    let pull_n = p.mass_kg * GRAVITY_MPS2 * 0.1 / libm::sqrt(1.01);
    let mut truck = rolling(p, 0.0);
    drive(&mut truck, 20.0, |_, _| Command::default());
    drive(&mut truck, 5.0, |_, _| pushing(0.95 * pull_n));
    assert_eq!((truck.state.x_m, truck.state.forward_mps), (0.0, 0.0));
    drive(&mut truck, 5.0, |_, _| pushing(1.2 * pull_n));
    assert!(truck.state.x_m > 0.1, "and lets it start uphill");
}

#[test]
fn standing_on_a_grade_moves_load_downhill() {
    // m g sin h / L, and the weight shrinks by the cosine.
    let p = on_grade(0.1, 0.85);
    let mut truck = rolling(p, 0.0);
    drive(&mut truck, 10.0, |_, _| Command::default());
    let weight_n = p.mass_kg * GRAVITY_MPS2 / libm::sqrt(1.01);
    let moved_n = 0.1 * weight_n * p.cg_height_m() / p.wheelbase_m();
    let loads_n = truck.wheel_loads_n();
    let expected_n = weight_n * p.static_share(0) - moved_n;
    assert_close(loads_n[0] + loads_n[1], expected_n, 1e-3, "front axle");
}

#[test]
fn downhill_only_brakes_hold() {
    let p = on_grade(-0.05, 0.85);
    let mut braked = rolling(p, 0.0);
    let brake = pushing(-5_000.0);
    drive(&mut braked, 2.0, |_, _| brake);
    let rest_m = braked.state.x_m;
    assert!(rest_m < 0.1, "it rolls {rest_m} m until the brakes have filled");
    drive(&mut braked, 10.0, |_, _| brake);
    assert_eq!((braked.state.forward_mps, braked.state.x_m), (0.0, rest_m));
    let mut free = rolling(p, 0.0);
    drive(&mut free, 10.0, |_, _| Command::default());
    // M u' = m g sin - f m g cos - c u².
    let pull = p.mass_kg * GRAVITY_MPS2 * (0.05 - p.rolling) / libm::sqrt(1.0025);
    let k = libm::sqrt(pull / p.drag_n_s2_per_m2);
    let pace = libm::sqrt(pull * p.drag_n_s2_per_m2) / p.effective_mass_kg();
    assert_close(free.state.forward_mps, k * libm::tanh(pace * 10.0), 1e-3, "free roll");
}

#[test]
fn ice_on_a_steep_grade_cannot_hold() {
    let mut truck = rolling(on_grade(0.2, 0.1), 0.0);
    drive(&mut truck, 3.0, |_, _| pushing(-20_000.0));
    // Sliding with locked wheels: g (sin - µ' cos), µ' the sliding friction, 0.8 to 1.08 of µ.
    let fall_mps2 = -truck.state.forward_mps / 3.0;
    let bound = |share: f64| GRAVITY_MPS2 * (0.2 - share * 0.1) / libm::sqrt(1.04);
    assert!((bound(1.08)..bound(0.75)).contains(&fall_mps2), "{fall_mps2} m/s²");
    let mut dry = rolling(on_grade(0.2, 0.5), 0.0);
    drive(&mut dry, 3.0, |_, _| pushing(-20_000.0));
    assert_eq!(dry.state.x_m, 0.0);
}

#[test]
fn a_truck_rolling_back_is_stopped_and_held() {
    for grade in [0.0, 0.08] {
        let mut truck = rolling(on_grade(grade, 0.85), -1.0);
        drive(&mut truck, 3.0, |_, _| Command::default());
        assert_eq!(truck.state.forward_mps, 0.0);
        let rest_m = truck.state.x_m;
        assert!((-1.0..0.0).contains(&rest_m), "{rest_m} m");
        drive(&mut truck, 10.0, |_, _| Command::default());
        assert_eq!(truck.state.x_m, rest_m);
    }
}

#[test]
fn a_standing_truck_starts_with_its_wheels_turned() {
    let mut truck = truck_at(0.0);
    drive(&mut truck, 6.0, |_, _| Command { force_n: 6_000.0, steer_rad: -0.15 });
    let s = truck.state;
    assert!(s.forward_mps > 4.0 && s.yaw_radps < -0.05 && s.y_m < 0.0, "{s:?}");
}
