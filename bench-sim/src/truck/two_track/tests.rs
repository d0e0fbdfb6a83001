//! The two-track truck against theory: every tolerance says where the difference comes from.

mod braking;
mod cornering;
mod energy;
mod numerics;
mod response;
mod slopes;
mod standstill;

use super::*;
use crate::truck::GRAVITY_MPS2;

const STEP_S: f64 = 1e-3;

fn rolling(parameters: TwoTrackParameters, forward_mps: f64) -> TwoTrack {
    TwoTrack::new(parameters, &TruckState::rolling(0.0, 0.0, forward_mps))
}

fn truck_at(forward_mps: f64) -> TwoTrack {
    rolling(TwoTrackParameters::default(), forward_mps)
}

/// The nominal truck on a road of another friction.
fn on_friction(friction: f64) -> TwoTrackParameters {
    TwoTrackParameters {
        surroundings: Surroundings::level(friction),
        ..TwoTrackParameters::default()
    }
}

/// Drives a truck for a while; the command may depend on time and truck.
fn drive(truck: &mut TwoTrack, seconds: f64, command: impl Fn(f64, &TwoTrack) -> Command) {
    for step in 0..libm::round(seconds / STEP_S) as u32 {
        let command = command(f64::from(step) * STEP_S, truck);
        truck.step(&command, STEP_S);
    }
}

/// A command that keeps the speed.
fn holding(truck: &TwoTrack, forward_mps: f64, steer_rad: f64) -> Command {
    let error_mps = forward_mps - truck.state.forward_mps;
    let force_n = truck.parameters.resistance_n(forward_mps) + 20_000.0 * error_mps;
    Command { force_n, steer_rad }
}

/// Fails unless two numbers agree to a share of the expected one.
#[track_caller]
fn assert_close(found: f64, expected: f64, share: f64, what: &str) {
    let off = found / expected - 1.0;
    assert!(off.abs() <= share, "{what}: {found} against {expected}, {:.2} % off", 100.0 * off);
}

/// The nominal truck without air and rolling resistance, as the closed forms of the bicycle have
/// it. Drag moves load to the rear, air has a side force, and the outer wheels of a turn roll
/// harder than the inner ones: together 3 % of the yaw rate at 18 m/s.
fn unresisted() -> TwoTrackParameters {
    TwoTrackParameters {
        rolling: 0.0,
        drag_n_s2_per_m2: 0.0,
        side_drag_n_s2_per_m2: 0.0,
        ..TwoTrackParameters::default()
    }
}

/// Cornering stiffness of an axle with its load shared equally \[N/rad\].
fn cornering_under(p: &TwoTrackParameters, axle: usize, load_n: f64) -> f64 {
    let tyres = 2.0 * p.tyres_per_wheel[axle];
    tyres * p.tyres(axle).cornering_n_per_rad(load_n / tyres)
}

/// Front cornering stiffness with the steering's compliance, and the rear one \[N/rad\].
fn effective_stiffness(p: &TwoTrackParameters, axle_loads_n: [f64; AXLES]) -> (f64, f64) {
    let front = cornering_under(p, 0, axle_loads_n[0]);
    let rear = cornering_under(p, 1, axle_loads_n[1]);
    (front / (1.0 + front * p.steer_compliance_rad_per_n()), rear)
}

/// Loads of the axles on a level road at rest \[N\].
fn static_loads_n(p: &TwoTrackParameters) -> [f64; AXLES] {
    [0, 1].map(|axle| p.static_share(axle) * p.mass_kg * GRAVITY_MPS2)
}

/// Understeer gradient K of the linear bicycle \[rad s²/m\] (Rajamani, section 3.3).
fn understeer_gradient(p: &TwoTrackParameters) -> f64 {
    let (front, rear) = effective_stiffness(p, static_loads_n(p));
    p.mass_kg / p.wheelbase_m() * (p.rear_axle_m / front - p.front_axle_m / rear)
}
