//! Straight-line braking, driving and coasting.

use super::*;

/// Brakes a truck from a speed to a stop; how far it went \[m\].
fn stopping_distance_m(p: TwoTrackParameters, from_mps: f64, force_n: f64) -> f64 {
    let mut truck = rolling(p, from_mps);
    drive(&mut truck, 60.0, |_, _| Command { force_n, steer_rad: 0.0 });
    assert_eq!(truck.state.forward_mps, 0.0);
    truck.state.x_m
}

#[test]
fn stopping_takes_the_distance_of_theory() {
    // With force F from the start, M u' = -(F + f m g) - c u² stops after
    // M / (2 c) ln(1 + c u² / (F + f m g)); the lag τ of the force adds u τ - a τ² / 2 or so
    // (M: effective mass). Within 0.5 %: the engine brake hands over to the air brakes, which have
    // a lag of their own, while the clutch opens.
    let p = TwoTrackParameters::default();
    let mass_kg = p.effective_mass_kg();
    for (from_mps, force_n) in [(15.0, -12_000.0), (20.0, -20_000.0), (25.0, -34_000.0)] {
        let steady_n = -force_n + p.rolling * p.mass_kg * GRAVITY_MPS2;
        let drag = p.drag_n_s2_per_m2;
        let braked_m =
            0.5 * mass_kg / drag * libm::log(1.0 + drag * from_mps * from_mps / steady_n);
        let lagged_m =
            from_mps * p.drive_lag_s - 0.5 * steady_n / mass_kg * p.drive_lag_s * p.drive_lag_s;
        let found_m = stopping_distance_m(p, from_mps, force_n);
        let what = format!("from {from_mps} m/s with {force_n} N");
        assert_close(found_m, braked_m + lagged_m, 5e-3, &what);
    }
}

#[test]
fn every_command_becomes_its_force_on_the_road() {
    // Steady force = M a + resistances, at 0.5 %: the speed, and with it the drag, still moves.
    let p = TwoTrackParameters::default();
    for force_n in [-34_000.0, -20_000.0, -8_000.0, 8_000.0, 15_000.0, 20_000.0] {
        let mut truck = truck_at(if force_n > 0.0 { 6.0 } else { 24.0 });
        drive(&mut truck, 2.0, |_, _| Command { force_n, steer_rad: 0.0 });
        let given_n = p.effective_mass_kg() * truck.acceleration.forward_mps2
            + p.resistance_n(truck.state.forward_mps);
        assert_close(given_n, force_n, 5e-3, &format!("{force_n} N"));
        assert_close(truck.state().force_n, force_n, 5e-3, "what the bench sees");
    }
}

#[test]
fn braking_moves_the_load_that_statics_asks_for() {
    // Moment about the ground: m a h of the truck, J ω' of the wheels, drag above the ground;
    // within 0.5 %, for the truck still pitches a little after its onset.
    let p = TwoTrackParameters::default();
    for force_n in [-34_000.0, -15_000.0, 10_000.0] {
        let mut truck = truck_at(20.0);
        drive(&mut truck, 2.0, |_, _| Command { force_n, steer_rad: 0.0 });
        let (a, loads_n) = (truck.acceleration.forward_mps2, truck.wheel_loads_n());
        let front_n = loads_n[0] + loads_n[1];
        let weight_n = p.mass_kg * GRAVITY_MPS2;
        let spin_kgm2 = 2.0 * (p.wheel_inertia_kgm2[0] + p.wheel_inertia_kgm2[1]);
        let u = truck.state.forward_mps;
        let moment_nm = p.mass_kg * p.cg_height_m() * a
            + spin_kgm2 * a / p.wheel_radius_m
            + p.pressure_height_m * p.drag_n_s2_per_m2 * u * u;
        let moved_n = weight_n * p.static_share(0) - front_n;
        assert_close(moved_n, moment_nm / p.wheelbase_m(), 5e-3, &format!("{force_n} N"));
        assert_close(loads_n.iter().sum(), weight_n, 2e-3, "all loads");
    }
}

#[test]
fn no_wheel_locks_on_a_dry_road_within_the_controllers_limits() {
    // 12 % slip is where anti-lock control would begin; below 3 m/s slip loses its meaning.
    let mut truck = truck_at(25.0);
    drive(&mut truck, 1e-3, |_, _| Command::default());
    while truck.state.forward_mps > 3.0 {
        truck.step(&Command { force_n: -34_000.0, steer_rad: 0.0 }, STEP_S);
        assert!(truck.slips().into_iter().all(|slip| slip > -0.12), "{:?}", truck.slips());
    }
}

#[test]
fn anti_lock_brakes_use_a_slippery_road_without_locking() {
    let friction = 0.2;
    let mut truck = rolling(on_friction(friction), 20.0);
    let command = Command { force_n: -34_000.0, steer_rad: 0.0 };
    drive(&mut truck, 2.0, |_, _| command);
    for _ in 0..2_000 {
        truck.step(&command, STEP_S);
        assert!(truck.slips().into_iter().all(|slip| slip > -0.30), "{:?}", truck.slips());
        let used = -truck.acceleration.forward_mps2 / (friction * GRAVITY_MPS2);
        assert!((0.85..1.15).contains(&used), "{used} of the friction");
    }
    assert!(truck.state.forward_mps > 3.0, "still above the speeds without slip control");
}

#[test]
fn an_icy_patch_takes_the_grip_away_and_gives_it_back() {
    let ice = FrictionPatch { from_x_m: 20.0, until_x_m: 40.0, friction: 0.1 };
    let surroundings = Surroundings::level(0.85).with_patches([ice]);
    let p = TwoTrackParameters { surroundings, ..TwoTrackParameters::default() };
    let (mut truck, command) = (rolling(p, 20.0), Command { force_n: -30_000.0, steer_rad: 0.0 });
    let mut weakest_mps2: f64 = 100.0;
    while truck.state.x_m < 44.0 {
        truck.step(&command, STEP_S);
        if (27.0..38.0).contains(&truck.state.x_m) {
            weakest_mps2 = weakest_mps2.min(-truck.acceleration.forward_mps2);
        }
        assert!(truck.slips().into_iter().all(|slip| slip > -0.35), "{:?}", truck.slips());
    }
    assert!(weakest_mps2 < 0.15 * GRAVITY_MPS2, "on the ice {weakest_mps2} m/s²");
    drive(&mut truck, 0.5, |_, _| command);
    let after_mps2 = -truck.acceleration.forward_mps2;
    assert!(after_mps2 > 4.5, "behind the ice {after_mps2} m/s²");
    assert!(truck.state.y_m.abs() < 1e-9, "a patch over the whole width does not turn it");
}

#[test]
fn coasting_down_matches_the_analytic_solution() {
    // M u' = -c u² - f m g  =>  u(t) = k tan(atan(u0 / k) - t sqrt(c f m g) / M),
    // k = sqrt(f m g / c).
    // Within 1 mm/s: the wheels need a moment to find their slip.
    let mut truck = truck_at(25.0);
    let p = truck.parameters;
    let rolling_n = p.rolling * p.mass_kg * GRAVITY_MPS2;
    let k = libm::sqrt(rolling_n / p.drag_n_s2_per_m2);
    let pace = libm::sqrt(p.drag_n_s2_per_m2 * rolling_n) / p.effective_mass_kg();
    for second in 1..=60 {
        drive(&mut truck, 1.0, |_, _| Command::default());
        let expected_mps = k * libm::tan(libm::atan(25.0 / k) - pace * f64::from(second));
        let found_mps = truck.state.forward_mps;
        assert!((found_mps - expected_mps).abs() < 1e-3, "{found_mps} {expected_mps}");
    }
}

#[test]
fn power_limits_acceleration_at_speed() {
    // M u' = P / u - c u² - f m g, within 0.1 % once the drive line has caught up.
    let mut truck = truck_at(24.0);
    let p = truck.parameters;
    let command = Command { force_n: 25_000.0, steer_rad: 0.0 };
    drive(&mut truck, 2.0, |_, _| command);
    for _ in 0..10 {
        drive(&mut truck, 0.5, |_, _| command);
        let u = truck.state.forward_mps;
        assert!(truck.state().force_n * u <= p.power_max_w * (1.0 + 1e-9));
        let expected = (p.power_max_w / u - p.resistance_n(u)) / p.effective_mass_kg();
        assert_close(truck.acceleration.forward_mps2, expected, 1e-3, &format!("at {u} m/s"));
    }
}

#[test]
fn rear_wheel_drive_cannot_put_twenty_kilonewtons_on_the_road() {
    // Table II puts 22 % of the weight on the rear axle: even with the load that driving moves
    // there, friction carries about 14 kN. A leader that gains 2 m/s² needs 13 kN.
    let p = TwoTrackParameters { driven: DrivenAxles::Rear, ..TwoTrackParameters::default() };
    let mut truck = rolling(p, 6.0);
    drive(&mut truck, 2.0, |_, _| Command { force_n: 20_000.0, steer_rad: 0.0 });
    let given_n = p.effective_mass_kg() * truck.acceleration.forward_mps2
        + p.resistance_n(truck.state.forward_mps);
    assert!((11_000.0..15_000.0).contains(&given_n), "{given_n} N");
    let spun = truck.slips();
    assert!(spun[2] < 0.35 && spun[3] < 0.35, "traction control holds the wheels: {spun:?}");
}
