use super::*;

const MS: u64 = 1_000_000;
const FAST: OwnMotion = driving(true, 20.0);
const BLIND: OwnMotion = driving(false, 20.0);
const EMPTY_ROAD: [Option<Object>; PAGES] = [None; PAGES];

const fn driving(trusted: bool, forward_mps: f64) -> OwnMotion {
    OwnMotion {
        trusted,
        time_ns: 0,
        x_m: 0.0,
        y_m: 0.0,
        forward_mps,
        left_mps: 0.0,
        left_mps2: 0.0,
    }
}

fn solved(force_n: f64, steering_rad: f64) -> Option<Proposal> {
    Some(Proposal { force_n, steering_rad, plan: Plan::Solved })
}

fn shifted(force_n: f64, steering_rad: f64) -> Option<Proposal> {
    Some(Proposal { force_n, steering_rad, plan: Plan::Shifted })
}

/// A guard that has been admitting this command long enough not to be rate limited.
fn settled(force_n: f64, steering_rad: f64) -> Guard {
    let mut guard = Guard::new();
    for k in 0..30 {
        guard.admit(k * 100 * MS, solved(force_n, steering_rad), FAST, &EMPTY_ROAD);
    }
    guard
}

const SETTLED_NS: u64 = 2_900 * MS;

/// Values dense at `limit` (down to one representable step), sparse elsewhere.
fn around(limit: f64) -> Vec<f64> {
    let mut values = vec![limit, limit.next_up(), limit.next_down()];
    for exponent in -12..=1 {
        let step = limit.abs() * 10f64.powi(exponent);
        values.extend([limit - step, limit + step]);
    }
    values.extend([0.0, -0.0, f64::MIN_POSITIVE, f64::MAX, f64::MIN]);
    values
}

#[test]
fn force_passes_exactly_up_to_its_limits() {
    for limit in [FORCE_MIN_N, FORCE_MAX_N] {
        for force_n in around(limit) {
            let mut guard = settled(force_n.clamp(FORCE_MIN_N, FORCE_MAX_N), 0.0);
            let out = guard.admit(SETTLED_NS + 100 * MS, solved(force_n, 0.0), FAST, &EMPTY_ROAD);
            let inside = (FORCE_MIN_N..=FORCE_MAX_N).contains(&force_n);
            assert_eq!(out.reason == Reason::Passed, inside, "{force_n}: {out:?}");
            assert_eq!(out.force_n, force_n.clamp(FORCE_MIN_N, FORCE_MAX_N));
        }
    }
}

#[test]
fn steering_passes_exactly_up_to_its_limits_at_low_speed() {
    let slow = driving(true, 3.0);
    for limit in [-STEERING_MAX_RAD, STEERING_MAX_RAD] {
        for steering_rad in around(limit) {
            let mut guard = Guard::new();
            for k in 0..30 {
                guard.admit(k * 100 * MS, solved(0.0, steering_rad), slow, &EMPTY_ROAD);
            }
            let out =
                guard.admit(SETTLED_NS + 100 * MS, solved(0.0, steering_rad), slow, &EMPTY_ROAD);
            assert_eq!(out.reason == Reason::Passed, steering_rad.abs() <= STEERING_MAX_RAD);
            assert_eq!(out.steering_rad, steering_rad.clamp(-STEERING_MAX_RAD, STEERING_MAX_RAD));
        }
    }
}

#[test]
fn steering_never_exceeds_the_lateral_limit_at_any_speed() {
    for tenth in 0..=400 {
        let forward_mps = f64::from(tenth) * 0.1;
        let bound = steering_bound_rad(forward_mps).min(STEERING_MAX_RAD);
        for steering_rad in around(bound) {
            let own = driving(true, forward_mps);
            let mut guard = Guard::new();
            let mut out = guard.admit(0, solved(0.0, steering_rad), own, &EMPTY_ROAD);
            for k in 1..12 {
                out = guard.admit(k * 100 * MS, solved(0.0, steering_rad), own, &EMPTY_ROAD);
            }
            assert!(out.steering_rad.abs() <= bound, "{forward_mps} m/s: {out:?}");
            assert_eq!(out.reason == Reason::Passed, steering_rad.abs() <= bound);
        }
    }
}

#[test]
fn the_lateral_bound_agrees_with_steady_cornering() {
    // At 20 m/s: a_y = 400 δ / (5 + 0.0123·400) = 40.3 δ, so 4 m/s² is 0.0992 rad.
    assert!((steering_bound_rad(20.0) - 0.099_2).abs() < 1e-4);
    // What the law needs in the paper's scenarios, 0.075 rad at 20 m/s, passes.
    assert!(steering_bound_rad(20.0) > 0.075);
}

#[test]
fn rates_follow_the_true_elapsed_time() {
    for elapsed_ms in [1, 2, 5, 10, 50, 100] {
        let elapsed_s = elapsed_ms as f64 * 1e-3;
        for (factor, passes) in [(0.999_999, true), (1.000_001, false)] {
            for sign in [-1.0, 1.0] {
                let force_n = sign * FORCE_RATE_NPS * elapsed_s * factor;
                let steering_rad = sign * STEERING_RATE_RADPS * elapsed_s * factor;
                let now_ns = SETTLED_NS + elapsed_ms * MS;
                let out = settled(0.0, 0.0).admit(
                    now_ns,
                    solved(force_n, steering_rad),
                    FAST,
                    &EMPTY_ROAD,
                );
                assert_eq!(out.reason == Reason::Passed, passes, "{elapsed_ms} ms: {out:?}");
                assert!(out.force_n.abs() <= FORCE_RATE_NPS * elapsed_s * (1.0 + 1e-12));
                assert!(out.steering_rad.abs() <= STEERING_RATE_RADPS * elapsed_s * (1.0 + 1e-12));
            }
        }
    }
}

#[test]
fn a_long_gap_does_not_buy_a_jump() {
    let out = settled(0.0, 0.0).admit(
        SETTLED_NS + 60_000 * MS,
        solved(-30_000.0, 0.0),
        FAST,
        &EMPTY_ROAD,
    );
    assert_eq!(out.reason, Reason::Rate);
    assert!((out.force_n + 6_200.0).abs() < 1e-6);
}

#[test]
fn no_time_passing_means_no_change() {
    let out = settled(1_000.0, 0.01).admit(SETTLED_NS, solved(9_000.0, -0.05), FAST, &EMPTY_ROAD);
    assert_eq!((out.force_n, out.steering_rad), (1_000.0, 0.01));
}

#[test]
fn what_is_not_a_number_is_never_sent() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for proposal in [solved(bad, 0.0), solved(0.0, bad), solved(bad, bad), shifted(bad, 0.0)] {
            let mut guard = settled(2_000.0, 0.02);
            let out = guard.admit(SETTLED_NS + MS, proposal, FAST, &EMPTY_ROAD);
            assert_eq!(out.reason, Reason::NotFinite);
            assert_eq!((out.force_n, out.steering_rad), (2_000.0, 0.02), "held at first");
        }
    }
}

#[test]
fn a_speed_that_is_not_a_number_still_gives_a_finite_command() {
    for forward_mps in [f64::NAN, f64::INFINITY] {
        let own = driving(true, forward_mps);
        let out = settled(0.0, 0.0).admit(SETTLED_NS + MS, solved(10.0, 0.001), own, &EMPTY_ROAD);
        assert!(out.force_n.is_finite() && out.steering_rad.is_finite());
    }
}

/// The force and steering after `ms` without anything to trust, one tick per millisecond.
fn after_blindness(ms: u64) -> Admitted {
    let mut guard = settled(5_000.0, 0.02);
    (1..=ms)
        .map(|k| guard.admit(SETTLED_NS + k * MS, None, BLIND, &EMPTY_ROAD))
        .last()
        .expect("at least one tick")
}

#[test]
fn a_blind_truck_holds_then_coasts_straight_then_brakes() {
    let held = after_blindness(100);
    assert_eq!((held.force_n, held.steering_rad), (5_000.0, 0.02));
    assert_eq!(held.reason, Reason::EgoStale);
    let coasting = after_blindness(300);
    assert_eq!((coasting.force_n, coasting.steering_rad), (0.0, 0.0));
    let braking = after_blindness(1_000);
    assert_eq!((braking.force_n, braking.steering_rad), (-23_040.0, 0.0));
}

#[test]
fn a_truck_that_sees_again_drives_on_within_the_rates() {
    let mut guard = settled(5_000.0, 0.02);
    for k in 1..=1_000 {
        guard.admit(SETTLED_NS + k * MS, None, BLIND, &EMPTY_ROAD);
    }
    let out = guard.admit(SETTLED_NS + 1_001 * MS, solved(5_000.0, 0.0), FAST, &EMPTY_ROAD);
    assert_eq!(out.reason, Reason::Rate);
    assert!((out.force_n - (-23_040.0 + 62.0)).abs() < 1e-6);
}

#[test]
fn a_missing_plan_is_driven_for_200_ms_and_then_braked_on_its_steering() {
    let mut guard = settled(1_000.0, 0.02);
    for k in 1..200 {
        let out = guard.admit(SETTLED_NS + k * MS, shifted(1_000.0, 0.02), FAST, &EMPTY_ROAD);
        assert_eq!(out.reason, Reason::Passed, "after {k} ms");
    }
    for k in 200..800 {
        let out = guard.admit(SETTLED_NS + k * MS, shifted(1_000.0, 0.02), FAST, &EMPTY_ROAD);
        assert_eq!((out.reason, out.steering_rad), (Reason::NoPlan, 0.02));
    }
    let out = guard.admit(SETTLED_NS + 800 * MS, shifted(1_000.0, 0.02), FAST, &EMPTY_ROAD);
    assert_eq!(out.force_n, -23_040.0);
    let out = guard.admit(SETTLED_NS + 801 * MS, solved(-23_040.0, 0.02), FAST, &EMPTY_ROAD);
    assert_eq!(out.reason, Reason::Passed, "one solved plan ends it");
}

#[test]
fn one_failed_solve_after_a_pause_is_not_a_missing_plan() {
    let mut guard = settled(1_000.0, 0.0);
    let out = guard.admit(SETTLED_NS + 3_000 * MS, shifted(1_000.0, 0.0), FAST, &EMPTY_ROAD);
    assert_eq!(out.reason, Reason::Passed);
}

#[test]
fn ticks_without_a_due_solve_neither_excuse_nor_accuse() {
    let mut guard = settled(0.0, 0.0);
    let held = Some(Proposal { force_n: 0.0, steering_rad: 0.0, plan: Plan::Held });
    for k in 1..=400 {
        let proposal = if k % 10 == 0 { shifted(0.0, 0.0) } else { held };
        let out = guard.admit(SETTLED_NS + k * MS, proposal, FAST, &EMPTY_ROAD);
        assert_eq!(out.reason == Reason::NoPlan, k >= 200, "after {k} ms");
    }
}

#[test]
fn braking_fades_out_at_standstill() {
    assert_eq!(brake_force_n(20.0), -23_040.0);
    assert_eq!(brake_force_n(0.25), -11_520.0);
    assert_eq!(brake_force_n(0.0), 0.0);
    assert_eq!(brake_force_n(-1.0), 0.0);
}

#[test]
fn random_proposals_never_break_a_limit() {
    // A small linear congruential generator (Knuth, MMIX) is random enough to sweep with.
    let mut state = 1_u64;
    let mut draw = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let (mut guard, mut now_ns, mut last) = (Guard::new(), 0, (0.0, 0.0));
    for k in 0..200_000 {
        let elapsed_ns = (draw() * 4e6) as u64;
        now_ns += elapsed_ns;
        let proposal = Proposal {
            force_n: if draw() < 0.01 { f64::NAN } else { (draw() - 0.5) * 1e5 },
            steering_rad: (draw() - 0.5) * 0.5,
            plan: if draw() < 0.5 { Plan::Solved } else { Plan::Shifted },
        };
        let own = driving(draw() > 0.01, 20.0);
        let mut objects = EMPTY_ROAD;
        objects[0] = (draw() < 0.5).then(|| Object {
            measured_ns: now_ns,
            x_m: if draw() < 0.01 { f64::NAN } else { 60.0 * draw() },
            y_m: 4.0 * draw() - 2.0,
            x_mps: 40.0 * draw() - 10.0,
            y_mps: 0.0,
            half_length_m: 3.0,
            half_width_m: 1.1,
        });
        let out = guard.admit(now_ns, Some(proposal), own, &objects);
        assert!((FORCE_MIN_N..=FORCE_MAX_N).contains(&out.force_n));
        assert!(out.steering_rad.abs() <= steering_bound_rad(20.0));
        if k > 0 {
            let elapsed_s = elapsed_ns as f64 * 1e-9;
            assert!((out.force_n - last.0).abs() <= FORCE_RATE_NPS * elapsed_s + 1e-9);
            assert!((out.steering_rad - last.1).abs() <= STEERING_RATE_RADPS * elapsed_s + 1e-12);
        }
        last = (out.force_n, out.steering_rad);
    }
    assert!(guard.emergency_brakings() > 100, "objects in the way are part of the sweep");
}
