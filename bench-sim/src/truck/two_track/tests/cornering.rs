//! Steady cornering at low lateral acceleration (the idea of ISO 14792 and ISO 4138).

use super::*;

/// Corners steadily at a speed and roughly a lateral acceleration.
fn cornered(p: TwoTrackParameters, forward_mps: f64, lateral_mps2: f64) -> (TwoTrack, f64) {
    let per_curvature = p.wheelbase_m() + understeer_gradient(&p) * forward_mps * forward_mps;
    let steer_rad = per_curvature * lateral_mps2 / (forward_mps * forward_mps);
    let mut truck = rolling(p, forward_mps);
    drive(&mut truck, 30.0, |_, truck| holding(truck, forward_mps, steer_rad));
    (truck, steer_rad)
}

#[test]
fn the_understeer_gradient_is_that_of_the_cornering_stiffnesses() {
    // Within 1 %: load transfer and the tyres' curvature grow with the square of the lateral
    // acceleration, drive force takes a little of both axles' stiffness.
    let p = unresisted();
    for (forward_mps, lateral_mps2) in [(12.0, 0.5), (18.0, 0.5), (18.0, 1.0), (25.0, 0.5)] {
        let (truck, steer_rad) = cornered(p, forward_mps, lateral_mps2);
        let found_mps2 = truck.acceleration.lateral_mps2;
        let curvature = truck.state.yaw_radps / truck.state.forward_mps;
        let gradient = (steer_rad - p.wheelbase_m() * curvature) / found_mps2;
        let what = format!("understeer at {forward_mps} m/s and {found_mps2:.2} m/s²");
        assert_close(gradient, understeer_gradient(&p), 0.01, &what);
    }
}

#[test]
fn the_yaw_rate_gain_is_that_of_the_linear_bicycle() {
    // r = u δ / (L + K u²); within 0.3 % at 0.3 m/s², where everything is linear.
    let p = unresisted();
    for forward_mps in [5.0, 10.0, 15.0, 20.0, 25.0] {
        let (truck, steer_rad) = cornered(p, forward_mps, 0.3);
        let u = truck.state.forward_mps;
        let expected = u * steer_rad / (p.wheelbase_m() + understeer_gradient(&p) * u * u);
        assert_close(truck.state.yaw_radps, expected, 3e-3, &format!("yaw rate at {u} m/s"));
    }
}

#[test]
fn the_linear_tyres_of_the_paper_can_be_had() {
    // plant.rear_cornering_scale = 3.09 makes the rear axle Table II's, the front one always is.
    let nominal = TwoTrackParameters::default();
    assert_close(nominal.static_cornering_n_per_rad(0), 259_752.0, 1e-3, "front axle");
    let rear_tyre = TyreParameters { cornering_scale: 3.09, ..nominal.rear_tyre };
    let p = TwoTrackParameters { rear_tyre, ..unresisted() };
    assert_close(p.static_cornering_n_per_rad(1), 260_000.0, 2e-3, "rear axle");
    let (truck, steer_rad) = cornered(p, 18.0, 0.5);
    let curvature = truck.state.yaw_radps / truck.state.forward_mps;
    let gradient = (steer_rad - p.wheelbase_m() * curvature) / truck.acceleration.lateral_mps2;
    assert_close(gradient, understeer_gradient(&p), 0.01, "understeer");
}

#[test]
fn the_sprung_mass_leans_as_its_springs_allow() {
    // ϕ = m_s h a / (K - m_s g h): Gillespie, section 6.4.
    let p = TwoTrackParameters::default();
    let (truck, _) = cornered(p, 18.0, 1.0);
    let arm = p.sprung_kg() * p.roll_arm_m();
    let stiffness = p.roll_stiffness_nm_per_rad[0] + p.roll_stiffness_nm_per_rad[1];
    let expected = arm * truck.acceleration.lateral_mps2 / (stiffness - arm * GRAVITY_MPS2);
    assert_close(truck.state.roll_rad, expected, 5e-3, "roll");
    assert!(truck.state.roll_rad > 0.0, "a left turn leans to the right");
}

#[test]
fn each_axle_moves_the_load_that_statics_asks_of_it() {
    let p = TwoTrackParameters::default();
    let (truck, _) = cornered(p, 18.0, 1.0);
    let (a, loads_n) = (truck.acceleration.lateral_mps2, truck.wheel_loads_n());
    let mut overturning_nm = 0.0;
    for axle in 0..AXLES {
        let moved_n = 0.5 * (loads_n[2 * axle + 1] - loads_n[2 * axle]);
        overturning_nm += moved_n * p.track_m[axle];
        // Springs, links and own mass, each by its own arm; both axles corner their static share.
        let cornering_n = p.static_share(axle) * p.mass_kg * a;
        let links_nm = p.roll_centre_m[axle] * cornering_n
            + p.unsprung_kg[axle] * a * (p.wheel_radius_m - p.roll_centre_m[axle]);
        let springs_nm = p.roll_stiffness_nm_per_rad[axle] * truck.state.roll_rad;
        let expected = (links_nm + springs_nm) / p.track_m[axle];
        assert_close(moved_n, expected, 0.01, &format!("axle {axle}"));
    }
    // All together: the moment of the CG's acceleration about the ground, and of the leaning.
    let leaning_nm = p.sprung_kg() * GRAVITY_MPS2 * p.roll_arm_m() * truck.state.roll_rad;
    let expected = p.mass_kg * p.cg_height_m() * a + leaning_nm;
    assert_close(overturning_nm, expected, 0.01, "overturning moment");
}

#[test]
fn full_steering_cannot_exceed_friction() {
    let mut truck = truck_at(25.0);
    // 0.85 at the rated load; lighter tyres grip up to 8 % better.
    let limit_mps2 = 1.08 * 0.85 * GRAVITY_MPS2;
    for _ in 0..6_000 {
        let command = holding(&truck, 25.0, 0.17);
        truck.step(&command, STEP_S);
        assert!(truck.acceleration.lateral_mps2.abs() <= limit_mps2);
        assert!(truck.wheel_loads_n().into_iter().all(|load_n| load_n >= 0.0));
    }
    assert!(truck.state.yaw_radps > 0.1, "it turns");
}

#[test]
fn a_crawling_truck_turns_about_its_rear_axle() {
    // r = u tan δ / L; within 1 %, the tyres' slip at a tenth of a m/s².
    let p = TwoTrackParameters::default();
    for forward_mps in [0.3, 1.0, 2.5] {
        let mut truck = truck_at(forward_mps);
        drive(&mut truck, 20.0, |_, truck| holding(truck, forward_mps, 0.17));
        let s = truck.state;
        let expected = s.forward_mps * libm::tan(0.17) / p.wheelbase_m();
        assert_close(s.yaw_radps, expected, 0.01, &format!("yaw rate at {forward_mps} m/s"));
    }
}
