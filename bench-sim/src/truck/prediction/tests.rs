//! The linear bicycle against closed forms.

use super::*;

const STEP_S: f64 = 1e-3;

fn truck_at(forward_mps: f64) -> Prediction {
    Prediction::new(PredictionParameters::default(), TruckState::rolling(0.0, 0.0, forward_mps))
}

fn drive(truck: &mut Prediction, seconds: f64, command: Command) {
    for _ in 0..libm::round(seconds / STEP_S) as u32 {
        truck.step(&command, STEP_S);
    }
}

#[test]
fn cornering_has_the_closed_form_at_any_amplitude() {
    // r = u δ / (L + K u²), K = m / L (l_r / C_f - l_f / C_r): Rajamani, section 3.3. It is linear,
    // so a violent turn obeys it as well as a gentle one; its own drag slows it a little.
    let p = PredictionParameters::default();
    let length_m = p.front_axle_m + p.rear_axle_m;
    let gradient = p.mass_kg / length_m
        * (p.rear_axle_m / p.front_stiffness_n_per_rad
            - p.front_axle_m / p.rear_stiffness_n_per_rad);
    for steer_rad in [0.002, 0.05, 0.15] {
        let mut truck = truck_at(15.0);
        let force_n = p.resistance_n(15.0);
        drive(&mut truck, 10.0, Command { force_n, steer_rad });
        let s = truck.state();
        let u = s.forward_mps;
        let expected_radps = u * steer_rad / (length_m + gradient * u * u);
        assert!((s.yaw_radps / expected_radps - 1.0).abs() < 5e-3, "{s:?}");
    }
}

#[test]
fn braking_to_standstill_stays_at_standstill() {
    for steer_rad in [0.0, 0.15] {
        let mut truck = truck_at(12.0);
        let command = Command { force_n: -20_000.0, steer_rad };
        drive(&mut truck, 10.0, command);
        let rest = *truck.state();
        assert_eq!((rest.forward_mps, rest.lateral_mps, rest.yaw_radps), (0.0, 0.0, 0.0));
        drive(&mut truck, 10.0, command);
        assert_eq!((truck.state().x_m, truck.state().y_m), (rest.x_m, rest.y_m));
    }
}

#[test]
fn a_force_gives_its_acceleration_behind_the_lag() {
    let mut truck = truck_at(18.0);
    let p = *truck.parameters();
    drive(&mut truck, p.drive_lag_s, Command { force_n: 10_000.0, steer_rad: 0.0 });
    let given_n = 10_000.0 * (1.0 - libm::exp(-1.0));
    let expected_mps2 = (given_n - p.resistance_n(truck.state().forward_mps)) / p.mass_kg;
    assert!((truck.acceleration().forward_mps2 - expected_mps2).abs() < 1e-6);
}
