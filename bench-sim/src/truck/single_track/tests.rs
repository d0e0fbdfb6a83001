//! The nonlinear bicycle against closed forms and physical sense.

use super::*;

const STEP_S: f64 = 1e-3;

fn truck_at(forward_mps: f64) -> SingleTrack {
    SingleTrack::new(TruckParameters::default(), TruckState::rolling(0.0, 0.0, forward_mps))
}

/// A force that holds the speed, for tests that need a steady state.
fn holding(truck: &SingleTrack, forward_mps: f64, steer_rad: f64) -> Command {
    let error_mps = forward_mps - truck.state().forward_mps;
    let force_n = truck.parameters().resistance_n(forward_mps) + 20_000.0 * error_mps;
    Command { force_n, steer_rad }
}

#[test]
fn gentle_cornering_follows_the_understeer_gradient() {
    // Yaw rate r = u δ / (L + K u²), K = m (l_r C_r - l_f C_f) / (L C_f C_r): Rajamani, eq. 3.11.
    let p = TruckParameters::default();
    let (cf, cr) = (p.front_stiffness_n_per_rad, p.rear_stiffness_n_per_rad);
    let length_m = p.wheelbase_m();
    let gradient = p.mass_kg * (p.rear_axle_m * cr - p.front_axle_m * cf) / (length_m * cf * cr);
    for forward_mps in [5.0, 10.0, 18.0, 25.0] {
        let steer_rad = 0.2 * (length_m / (forward_mps * forward_mps) + gradient);
        let mut truck = truck_at(forward_mps);
        for _ in 0..20_000 {
            let command = holding(&truck, forward_mps, steer_rad);
            truck.step(&command, STEP_S);
        }
        let u = truck.state().forward_mps;
        let expected_radps = u * steer_rad / (length_m + gradient * u * u);
        let ratio = truck.state().yaw_radps / expected_radps;
        assert!(
            (ratio - 1.0).abs() < 8e-3,
            "at {u} m/s the yaw rate is {ratio} of the closed form"
        );
        assert!((truck.acceleration().lateral_mps2 - 0.2).abs() < 2e-3);
    }
}

#[test]
fn coasting_down_matches_the_analytic_solution() {
    // m u' = -c u² - f m g  =>  u(t) = k tan(atan(u0 / k) - t sqrt(c f g / m)),
    // k = sqrt(f m g / c).
    let mut truck = truck_at(25.0);
    let p = *truck.parameters();
    let k = (p.rolling * p.mass_kg * GRAVITY_MPS2 / p.drag_n_s2_per_m2).sqrt();
    let pace = (p.drag_n_s2_per_m2 * p.rolling * GRAVITY_MPS2 / p.mass_kg).sqrt();
    for second in 1..=60 {
        for _ in 0..1000 {
            truck.step(&Command::default(), STEP_S);
        }
        let expected_mps = k * libm::tan(libm::atan(25.0 / k) - pace * f64::from(second));
        assert!((truck.state().forward_mps - expected_mps).abs() < 1e-9);
    }
}

#[test]
fn energy_lost_equals_work_done() {
    let mut truck = truck_at(20.0);
    let p = *truck.parameters();
    let energy_j =
        |t: &SingleTrack| 0.5 * p.mass_kg * t.state().forward_mps * t.state().forward_mps;
    let (start_j, mut work_j) = (energy_j(&truck), 0.0);
    let command = Command { force_n: -8_000.0, steer_rad: 0.0 };
    let power_w = |t: &SingleTrack| {
        let s = t.state();
        (s.force_n - p.resistance_n(s.forward_mps)) * s.forward_mps
    };
    for _ in 0..5_000 {
        let before_w = power_w(&truck);
        truck.step(&command, STEP_S);
        work_j += 0.5 * STEP_S * (before_w + power_w(&truck));
    }
    let change_j = energy_j(&truck) - start_j;
    assert!((change_j - work_j).abs() < 1e-5 * start_j, "{change_j} J against {work_j} J");
}

#[test]
fn braking_cannot_exceed_friction() {
    for friction in [0.2, 0.5, 0.85] {
        let parameters = TruckParameters::new(5760.0, 0.25, friction);
        let mut truck = SingleTrack::new(parameters, TruckState::rolling(0.0, 0.0, 25.0));
        let command = Command { force_n: -1e6, steer_rad: 0.0 };
        let mut hardest_mps2: f64 = 0.0;
        for _ in 0..2_000 {
            truck.step(&command, STEP_S);
            hardest_mps2 = hardest_mps2.max(-truck.acceleration().forward_mps2);
        }
        let p = truck.parameters();
        let limit_mps2 = friction * GRAVITY_MPS2 + p.resistance_n(25.0) / p.mass_kg;
        assert!(hardest_mps2 <= limit_mps2 && hardest_mps2 > 0.9 * friction * GRAVITY_MPS2);
    }
}

#[test]
fn full_steering_cannot_exceed_friction() {
    let mut truck = truck_at(25.0);
    for _ in 0..5_000 {
        let command = holding(&truck, 25.0, 0.17);
        truck.step(&command, STEP_S);
        assert!(truck.acceleration().lateral_mps2.abs() <= 0.85 * GRAVITY_MPS2);
        assert!(truck.state().forward_mps.is_finite());
    }
}

#[test]
fn braking_to_standstill_stays_at_standstill() {
    for steer_rad in [0.0, 0.1, -0.17] {
        let mut truck = truck_at(15.0);
        let command = Command { force_n: -23_040.0, steer_rad };
        for _ in 0..8_000 {
            truck.step(&command, STEP_S);
            assert!(truck.state().forward_mps >= 0.0);
        }
        let rest = *truck.state();
        assert_eq!((rest.forward_mps, rest.lateral_mps, rest.yaw_radps), (0.0, 0.0, 0.0));
        for _ in 0..30_000 {
            truck.step(&command, STEP_S);
        }
        let later = truck.state();
        assert_eq!(
            (later.x_m, later.y_m, later.heading_rad),
            (rest.x_m, rest.y_m, rest.heading_rad)
        );
        assert_eq!(*truck.acceleration(), BodyAcceleration::default());
    }
}

#[test]
fn a_standing_truck_needs_more_than_rolling_resistance_to_move() {
    let mut truck = truck_at(0.0);
    let rolling_n = truck.parameters().resistance_n(0.0);
    for _ in 0..5_000 {
        truck.step(&Command { force_n: 0.9 * rolling_n, steer_rad: 0.1 }, STEP_S);
    }
    assert_eq!(truck.state().x_m, 0.0);
    for _ in 0..5_000 {
        truck.step(&Command { force_n: 2.0 * rolling_n, steer_rad: 0.0 }, STEP_S);
    }
    assert!(truck.state().x_m > 0.1);
}

#[test]
fn left_and_right_are_mirror_images() {
    let (mut left, mut right) = (truck_at(18.0), truck_at(18.0));
    for step in 0..20_000 {
        let t_s = f64::from(step) * STEP_S;
        let force_n = 9_000.0 * libm::sin(0.9 * t_s) - 2_000.0;
        let steer_rad = 0.1 * libm::sin(2.0 * t_s);
        left.step(&Command { force_n, steer_rad }, STEP_S);
        right.step(&Command { force_n, steer_rad: -steer_rad }, STEP_S);
    }
    let (l, r) = (left.state(), right.state());
    assert_eq!((l.x_m, l.forward_mps), (r.x_m, r.forward_mps));
    assert_eq!((l.y_m, l.lateral_mps, l.yaw_radps), (-r.y_m, -r.lateral_mps, -r.yaw_radps));
}

#[test]
fn actuators_lag_and_steering_is_rate_limited() {
    let mut truck = truck_at(18.0);
    let command = Command { force_n: 10_000.0, steer_rad: 0.17 };
    for _ in 0..250 {
        truck.step(&command, STEP_S);
    }
    let expected_n = 10_000.0 * (1.0 - libm::exp(-1.0));
    assert!((truck.state().force_n - expected_n).abs() < 1e-3);
    // 0.6 rad/s until the lag's own rate is lower, 0.06 rad before the target.
    let reached_s = (0.17 - 0.06) / 0.6;
    let expected_rad = 0.17 - 0.06 * libm::exp(-(0.25 - reached_s) / 0.1);
    assert!((truck.state().steer_rad - expected_rad).abs() < 1e-4);
}

#[test]
fn a_finer_step_gives_the_same_trajectory() {
    let travel = |step_s: f64, steps: u32| {
        let mut truck = truck_at(18.0);
        for step in 0..steps {
            let t_s = f64::from(step) * step_s;
            let steer_rad = if t_s < 2.0 { 0.05 } else { -0.05 };
            truck.step(&Command { force_n: -5_000.0, steer_rad }, step_s);
        }
        *truck.state()
    };
    let (coarse, fine) = (travel(1e-3, 4_000), travel(2.5e-4, 16_000));
    assert!((coarse.x_m - fine.x_m).abs() < 1e-6 && (coarse.y_m - fine.y_m).abs() < 1e-6);
}
