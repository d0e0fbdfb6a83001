use super::*;
use crate::prediction::{STEP_S, STEPS, predict};
use crate::qp::BLOCKS;
use crate::resistance::{GRAVITY_MPS2, ROLLING_FADE_MPS};

/// Eqs. 13-15 as the paper writes them, slip angle by slip angle; the slope of all six states.
pub fn textbook_slope(truck: &TruckBelief, state: &State, input: [f64; 2]) -> State {
    let [u, v, r, phi, _, _] = *state;
    let (m, iz) = (truck.mass_kg, truck.yaw_inertia_kgm2);
    let (ue, _) = guarded_speed(u);
    let front_slip = (v + truck.cg_to_front_m * r) / ue - input[1].to_radians();
    let rear_slip = (v - truck.cg_to_rear_m * r) / ue;
    let front_n = -truck.front_stiffness_n_per_rad * front_slip;
    let rear_n = -truck.rear_stiffness_n_per_rad * rear_slip;
    let sign = u / libm::sqrt(u * u + ROLLING_FADE_MPS * ROLLING_FADE_MPS);
    let rolling_n = truck.rolling_resistance * m * GRAVITY_MPS2 * sign;
    let (sin, cos) = libm::sincos(phi);
    [
        (1e3 * input[0] - truck.drag_n_per_mps2 * u * u.abs() - rolling_n) / m + v * r,
        (front_n + rear_n) / m - u * r,
        (truck.cg_to_front_m * front_n - truck.cg_to_rear_m * rear_n) / iz,
        r,
        u * cos - v * sin,
        u * sin + v * cos,
    ]
}

fn model() -> Bicycle {
    Bicycle::new(&TruckBelief::default())
}

/// Highway, lane change, just above and below the guarded speed, crawling, standstill, backwards.
const CASES: [(State, [f64; 2]); 7] = [
    ([20.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.2, 0.0]),
    ([18.0, -0.2, 0.08, 0.05, 300.0, 1.4], [-15.0, 2.5]),
    ([9.01, -0.1, 0.05, 0.1, 0.0, 0.0], [-3.0, 1.0]),
    ([8.99, -0.1, 0.05, 0.1, 0.0, 0.0], [-3.0, 1.0]),
    ([4.0, 0.1, -0.15, -0.3, 10.0, 3.0], [5.0, -8.0]),
    ([0.0, 0.0, 0.0, 0.01, 0.0, 0.0], [0.5, 1.0]),
    ([-0.5, 0.0, 0.01, 0.0, 0.0, 0.0], [-2.0, 0.5]),
];

fn slope(core: Core, input: [f64; 2]) -> Core {
    let model = model();
    model.slope(core, input, &model.at_speed(core[0]))
}

#[test]
fn the_slope_is_the_textbooks() {
    for (state, input) in CASES {
        let textbook = textbook_slope(&TruckBelief::default(), &state, input);
        let found = slope([state[0], state[1], state[2]], input);
        for i in 0..3 {
            let error = (found[i] - textbook[i]).abs();
            assert!(error < 1e-13 * (1.0 + textbook[i].abs()), "{state:?}: {i} off by {error:e}");
        }
    }
}

#[test]
fn the_jacobian_agrees_with_central_differences() {
    for (state, input) in CASES {
        let core: Core = [state[0], state[1], state[2]];
        let inverse = Lanes::all(model().at_speed(core[0]).inverse);
        let j = model().jacobian(core.map(Lanes::all), inverse, 1.0);
        let rows = [[j.uu, j.uv, j.ur], [j.vu, j.vv, j.vr], [j.ru, j.rv, j.rr]];
        for c in 0..3 {
            let nudge = 1e-6;
            let moved = |sign: f64| {
                let mut core = core;
                core[c] += sign * nudge;
                slope(core, input)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for (i, row) in rows.iter().enumerate() {
                let difference = (up[i] - down[i]) / (2.0 * nudge);
                let error = (row[c].0[0] - difference).abs();
                assert!(
                    error < 2e-6 * (1.0 + difference.abs()),
                    "{state:?}: {i} by {c}: {error:e}"
                );
            }
        }
    }
}

#[test]
fn the_columns_of_the_input_agree_with_differences() {
    let [force, steering] = model().input_slopes();
    let (core, input) = ([18.0, -0.2, 0.08], [-15.0, 2.5]);
    let at = |input: [f64; 2]| slope(core, input);
    let base = at(input);
    for i in 0..3 {
        assert!((at([input[0] + 1.0, input[1]])[i] - base[i] - force[i]).abs() < 1e-12);
        assert!((at([input[0], input[1] + 1.0])[i] - base[i] - steering[i]).abs() < 1e-12);
    }
}

#[test]
fn holding_force_holds_the_speed() {
    let model = model();
    let plan = [[model.holding_force_kn(20.0), 0.0]; BLOCKS];
    let mut last = [0.0; STATES];
    predict(&model, &[20.0, 0.0, 0.0, 0.0, 0.0, 0.0], &plan, |_, instant| last = instant.state);
    assert!((last[0] - 20.0).abs() < 1e-12);
    assert!((last[4] - 20.0 * STEP_S * STEPS as f64).abs() < 1e-9);
}

#[test]
fn steady_cornering_has_the_textbook_yaw_rate() {
    // r = u delta / (L + K u^2), K = m (lr/Caf - lf/Car)/L
    // [Rajamani, Vehicle Dynamics and Control, 2nd ed., section 3.1.4].
    let truck = TruckBelief::default();
    let (u, delta_deg) = (15.0, 0.5_f64);
    let (mut v, mut r) = (0.0, 0.0);
    for _ in 0..20_000 {
        let slope = slope([u, v, r], [0.0, delta_deg]);
        (v, r) = (v + 1e-3 * slope[1], r + 1e-3 * slope[2]);
    }
    let length = truck.cg_to_front_m + truck.cg_to_rear_m;
    let understeer = truck.mass_kg / length
        * (truck.cg_to_rear_m / truck.front_stiffness_n_per_rad
            - truck.cg_to_front_m / truck.rear_stiffness_n_per_rad);
    let expected = u * delta_deg.to_radians() / (length + understeer * u * u);
    assert!((r - expected).abs() < 1e-4 * expected, "{r} {expected}");
}
