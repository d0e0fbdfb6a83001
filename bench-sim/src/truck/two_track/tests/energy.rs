//! The balance of energy: what the truck has, against what forces and torques did to it.

use super::*;

/// Kinetic energy of motion, roll and wheels, and what the springs hold against the leaning \[J\].
fn energy_j(truck: &TwoTrack) -> f64 {
    let (p, s) = (&truck.parameters, &truck.state);
    let q = p.sprung_kg() * p.roll_arm_m();
    let (u, v, r, roll, roll_rate) =
        (s.forward_mps, s.lateral_mps, s.yaw_radps, s.roll_rad, s.roll_radps);
    let stiffness = p.roll_stiffness_nm_per_rad[0] + p.roll_stiffness_nm_per_rad[1];
    let spin_j: f64 = (0..WHEELS)
        .map(|i| 0.5 * p.wheel_inertia_kgm2[i / 2] * s.spin_radps[i] * s.spin_radps[i])
        .sum();
    0.5 * p.mass_kg * (u * u + v * v)
        + 0.5 * p.yaw_inertia_kgm2 * r * r
        + 0.5 * (p.roll_inertia_kgm2 + q * p.roll_arm_m()) * roll_rate * roll_rate
        - q * roll_rate * (v + p.sprung_ahead_m() * r)
        + 0.5 * (stiffness - q * truck.forces(s).gravity_mps2[2]) * roll * roll
        + spin_j
}

/// Power of everything from outside: road on the tyres' contact points, torques on the wheels,
/// air, gravity, and the roll dampers \[W\].
fn power_w(truck: &TwoTrack) -> f64 {
    let (p, s) = (&truck.parameters, &truck.state);
    let forces = truck.forces(s);
    let [gravity_x, gravity_y, _] = forces.gravity_mps2;
    let q = p.sprung_kg() * p.roll_arm_m();
    let damping = p.roll_damping_nms_per_rad[0] + p.roll_damping_nms_per_rad[1];
    let wheels_w: f64 = (0..WHEELS)
        .map(|i| {
            let (wheel, spin) = (forces.wheels[i], s.spin_radps[i]);
            wheel.along_n * (wheel.along_mps - spin * p.wheel_radius_m)
                + wheel.across_n * wheel.across_mps
                + wheel.torques.on(truck.turning[i]) * spin
        })
        .sum();
    let axis_m = p.sprung_height_m - p.roll_arm_m();
    let air_w = forces.air_n[0] * s.forward_mps
        + forces.air_n[1]
            * (s.lateral_mps + p.pressure_ahead_m * s.yaw_radps
                - (p.pressure_height_m - axis_m) * s.roll_radps);
    let gravity_w = p.mass_kg * (gravity_x * s.forward_mps + gravity_y * s.lateral_mps)
        - q * gravity_y * s.roll_radps;
    wheels_w + air_w + gravity_w - damping * s.roll_radps * s.roll_radps
}

/// Share of the energy turned over that is not accounted for.
fn unexplained(p: TwoTrackParameters, command: impl Fn(f64) -> Command) -> f64 {
    let mut truck = rolling(p, 20.0);
    let start_j = energy_j(&truck);
    let (mut work_j, mut turned_over_j) = (0.0, 0.0);
    for step in 0..8_000 {
        let before_w = power_w(&truck);
        truck.step(&command(f64::from(step) * STEP_S), STEP_S);
        let mean_w = 0.5 * (before_w + power_w(&truck));
        work_j += mean_w * STEP_S;
        turned_over_j += mean_w.abs() * STEP_S;
    }
    (energy_j(&truck) - start_j - work_j).abs() / turned_over_j
}

#[test]
fn energy_gained_equals_work_done_while_braking_and_driving() {
    let share = unexplained(TwoTrackParameters::default(), |t_s| Command {
        force_n: if t_s < 3.0 { -15_000.0 } else { 12_000.0 },
        steer_rad: 0.0,
    });
    assert!(share < 1e-5, "{share} of the energy is unexplained");
}

#[test]
fn energy_gained_equals_work_done_while_swerving() {
    // Terms of second order in roll are left out of the equations of motion, hence not zero.
    let share = unexplained(TwoTrackParameters::default(), |t_s| Command {
        force_n: 2_000.0,
        steer_rad: 0.05 * libm::sin(2.5 * t_s),
    });
    assert!(share < 2e-3, "{share} of the energy is unexplained");
}

#[test]
fn energy_gained_equals_work_done_on_a_windy_slope() {
    let mut surroundings = Surroundings::level(0.85);
    (surroundings.grade, surroundings.banking) = (0.03, -0.02);
    (surroundings.wind_x_mps, surroundings.wind_y_mps) = (-8.0, 6.0);
    let p = TwoTrackParameters { surroundings, ..TwoTrackParameters::default() };
    let share =
        unexplained(p, |t_s| Command { force_n: -4_000.0, steer_rad: 0.03 * libm::sin(1.5 * t_s) });
    assert!(share < 1e-3, "{share} of the energy is unexplained");
}
