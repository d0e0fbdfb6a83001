use super::*;
use crate::observation::{Ego, Mission, Obstacle, Plans, V2v};
use crate::qp::WorkingSet;

const MS: u64 = 1_000_000;

/// A follower at 18 m/s, 30 m behind a slow van, 1 m behind its slot.
fn seen(time_ns: u64) -> Observation {
    let mut obstacles = [None; crate::OBSTACLES_MAX];
    obstacles[0] = Some(Obstacle {
        time_ns,
        x_m: 30.0 + 15.0 * 1e-9 * time_ns as f64,
        vx_mps: 15.0,
        length_m: 6.0,
        width_m: 2.2,
        ..Obstacle::default()
    });
    let x_m = 18.0 * 1e-9 * time_ns as f64;
    let leader = V2v { generated_ns: time_ns, x_m: x_m + 51.0, speed_mps: 18.0, ..V2v::default() };
    Observation {
        time_ns,
        ego: Ego { time_ns, x_m, forward_mps: 18.0, ..Ego::default() },
        mission: Mission {
            truck: 1,
            trucks: 4,
            spacing_m: 50.0,
            leader_distance_m: 50.0,
            set_speed_mps: 18.0,
            lane_width_m: 3.75,
            right_edge_y_m: -1.875,
            left_edge_y_m: 5.625,
            ..Mission::default()
        },
        leader: Some(leader),
        predecessor: Some(leader),
        plans: Plans::default(),
        obstacles,
    }
}

fn law(every: u32) -> Law {
    Law::new(Calibration { lml_every_ticks: every, ..Calibration::default() }, ActiveSet)
}

#[test]
fn a_truck_behind_a_slow_van_steers_to_its_left() {
    let mut memory = Memory::new();
    let last = (0..300).map(|k| law(1).step(&mut memory, &seen(k * MS))).last();
    let decision = last.expect("300 steps");
    assert_eq!(decision.outcome, Outcome::Solved);
    assert!(decision.steering_rad > 0.0, "{}", decision.steering_rad);
    assert!(decision.lml.q_ref > 187.5 && decision.lml.potential > 0.0);
}

#[test]
fn commands_keep_to_the_actuators_rates_at_any_loop_rate() {
    let cal = Calibration::default().lml;
    for period_ns in [MS / 2, MS, 5 * MS, 10 * MS] {
        for every in [1, 7] {
            let (law, mut memory) = (law(every), Memory::new());
            let mut before: Option<Decision> = None;
            for k in 0..200 {
                let now = law.step(&mut memory, &seen(k * period_ns));
                if let Some(before) = before {
                    let dt = 1e-9 * period_ns as f64;
                    let force = (now.force_n - before.force_n).abs();
                    let steering = (now.steering_rad - before.steering_rad).abs();
                    assert!(force <= 1e3 * cal.force_rate_kn_per_s * dt + 1e-6);
                    assert!(steering <= cal.steering_rate_radps * dt + 1e-9);
                }
                before = Some(now);
            }
        }
    }
}

#[test]
fn a_restored_memory_repeats_the_decisions_bit_for_bit() {
    let law = law(1);
    let mut memory = Memory::new();
    for k in 0..50 {
        law.step(&mut memory, &seen(k * MS));
    }
    let mut restored = memory;
    for k in 50..100 {
        let (a, b) = (law.step(&mut memory, &seen(k * MS)), law.step(&mut restored, &seen(k * MS)));
        assert_eq!(a.force_n.to_bits(), b.force_n.to_bits());
        assert_eq!(a.steering_rad.to_bits(), b.steering_rad.to_bits());
    }
}

#[test]
fn an_observation_that_is_not_finite_holds_the_plan_and_does_not_panic() {
    let law = law(1);
    let mut memory = Memory::new();
    let before = law.step(&mut memory, &seen(0));
    for poison in 0..3 {
        let mut seen = seen(MS);
        match poison {
            0 => seen.ego.forward_mps = f64::NAN,
            1 => seen.ego.y_m = f64::INFINITY,
            _ => seen.ego.heading_rad = f64::NAN,
        }
        let decision = law.step(&mut memory.clone(), &seen);
        assert_eq!(decision.outcome, Outcome::Infeasible);
        assert!((decision.force_n - before.force_n).abs() < 100.0, "{}", decision.force_n);
        assert!(decision.steering_rad.abs() < 0.01);
    }
}

#[test]
fn between_solves_the_last_command_is_held() {
    let (law, mut memory) = (law(10), Memory::new());
    let outcomes = [(); 12].map(|()| {
        let time_ns = memory.stepped_ns.map_or(0, |t| t + MS);
        law.step(&mut memory, &seen(time_ns)).outcome
    });
    let solved = outcomes.iter().filter(|&&o| o == Outcome::Solved).count();
    assert_eq!((outcomes[0], outcomes[10], solved), (Outcome::Solved, Outcome::Solved, 2));
}

/// A solver that never gets done.
struct Capped;

impl QpSolver for Capped {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        Solution { status: SolveStatus::IterationCap, ..ActiveSet.solve(qp, warm) }
    }
}

#[test]
fn at_the_iteration_cap_the_plan_before_runs_on_and_the_outcome_says_so() {
    let (law, capped) = (law(1), Law::new(Calibration::default(), Capped));
    let mut memory = Memory::new();
    for k in 0..100 {
        law.step(&mut memory, &seen(k * MS));
    }
    let cal = Calibration::default().lml;
    for k in 100..600 {
        let (planned, applied) = (memory.plan, memory.applied);
        let decision = capped.step(&mut memory, &seen(k * MS));
        assert_eq!(decision.outcome, Outcome::IterationCap);
        assert_eq!(memory.plan, lml::shifted(&planned, 1e-3));
        // Towards that plan, no faster than the actuators, whatever the solver left behind.
        let force_kn = 1e-3 * decision.force_n;
        assert!((force_kn - applied[0]).abs() <= cal.force_rate_kn_per_s * 1e-3 + 1e-9);
        assert!(decision.lml.slack.iter().all(|slack| slack.is_nan()));
    }
}
