//! Distributed MPC as part of the whole law, on the plant it believes in.

extern crate std;

use std::vec::Vec;

use super::*;
use crate::law::Law;
use crate::observation::{Ego, Mission, OBSTACLES_MAX, Plans, V2v};
use crate::qp::ActiveSet;

const TICK_NS: u64 = 20_000_000;
const SPACING_M: f64 = 20.0;

/// A truck with its law; in the plant nothing is discretised but the force, held over a tick.
struct Truck {
    law: Law,
    memory: LawMemory,
    state: State,
    /// Announced plans, newest last.
    announced: Vec<Plan>,
    most_mps: f64,
}

impl Truck {
    fn new(structure: Structure, x_m: f64) -> Self {
        let cal = Calibration { structure, ..Calibration::default() };
        let hold_mps2 = drive().holding(20.0).0;
        let law = Law::new(cal, ActiveSet);
        let state = [x_m, 20.0, hold_mps2];
        Self { law, memory: LawMemory::new(), state, announced: Vec::new(), most_mps: 20.0 }
    }

    fn seen(&self, place: u8, time_ns: u64, plans: Plans) -> Observation {
        let [x_m, speed_mps, traction] = self.state;
        Observation {
            time_ns,
            ego: Ego {
                time_ns,
                x_m,
                forward_mps: speed_mps,
                accel_mps2: traction - drive().holding(speed_mps).0,
                ..Ego::default()
            },
            mission: Mission {
                truck: place,
                trucks: 4,
                spacing_m: SPACING_M,
                leader_distance_m: f64::from(place) * SPACING_M,
                set_speed_mps: 20.0,
                lane_width_m: 3.75,
                right_edge_y_m: -1.875,
                left_edge_y_m: 1.875,
                ..Mission::default()
            },
            leader: None,
            predecessor: None,
            plans,
            obstacles: [None; OBSTACLES_MAX],
        }
    }

    fn step(&mut self, seen: &Observation) {
        let decision = self.law.step(&mut self.memory, seen);
        self.announced.extend(decision.announced);
        let cal = self.law.calibration();
        let (u, lag_s) = (decision.force_n / cal.truck.mass_kg, cal.dmpc.lag_s);
        for _ in 0..20 {
            let ([x, v, a], dt) = (self.state, 1e-3);
            let v_next = v + dt * (a - drive().holding(v).0);
            self.state = [x + 0.5 * dt * (v + v_next), v_next, a + dt / lag_s * (u - a)];
        }
        self.most_mps = self.most_mps.max(self.state[1]);
    }

    /// The newest plan that is at least this old.
    fn heard(&self, time_ns: u64, age_ns: u64) -> Option<Plan> {
        self.announced.iter().rev().find(|plan| plan.start_ns + age_ns <= time_ns).copied()
    }
}

fn drive() -> Drive {
    let cal = Calibration::default();
    Drive::new(&cal.truck, cal.dmpc.lag_s, Discretisation::Hold)
}

/// From 20 to 22 m/s between 1 s and 2 s.
fn leader_at(time_s: f64) -> (f64, f64) {
    let t = (time_s - 1.0).clamp(0.0, 1.0);
    (20.0 * time_s + t * t + 2.0 * (time_s - 1.0 - t).max(0.0), 20.0 + 2.0 * t)
}

fn leader_plan(time_ns: u64) -> Plan {
    let at = |k: usize| leader_at(1e-9 * time_ns as f64 + STEP_S * k as f64);
    Plan {
        start_ns: time_ns,
        x_m: core::array::from_fn(|k| at(k).0),
        speed_mps: core::array::from_fn(|k| at(k).1),
    }
}

/// Three trucks behind a leader, what they hear `age_ns` old; per truck its largest error behind
/// the leader, and its last.
fn platoon(structure: Structure, age_ns: u64) -> [(f64, f64); 3] {
    let mut trucks = [1, 2, 3].map(|place| Truck::new(structure, -SPACING_M * f64::from(place)));
    let mut errors = [(0.0_f64, 0.0); 3];
    for tick in 0..400 {
        let time_ns = tick * TICK_NS;
        let leader = time_ns.checked_sub(age_ns).map(leader_plan);
        let mut predecessor = leader;
        for (i, truck) in trucks.iter_mut().enumerate() {
            let seen = truck.seen(i as u8 + 1, time_ns, Plans { leader, predecessor });
            predecessor = truck.heard(time_ns, age_ns);
            truck.step(&seen);
            let (x_m, _) = leader_at(1e-9 * (time_ns + TICK_NS) as f64);
            let error = x_m - SPACING_M * (i + 1) as f64 - truck.state[0];
            errors[i] = (errors[i].0.max(error.abs()), error);
        }
    }
    errors
}

#[test]
fn the_horizon_ends_where_and_how_fast_it_has_to_and_steady() {
    let cal = Calibration::default();
    let drive = drive();
    for (error_m, speed_mps) in [(0.0, 20.0), (1.0, 20.5), (-1.5, 19.0), (0.4, 21.5)] {
        let own = Plan::steady(0, 0.0, 20.0);
        let slot = Plan::steady(0, error_m, speed_mps);
        let mut problem = Problem {
            drive: &drive,
            input_limits_mps2: [-5.9, 3.4],
            weights: &Weights::new(&cal.dmpc, cal.truck.mass_kg),
            start: [0.0, 20.0, 0.5],
            start_ns: 0,
            inputs: [drive.holding(20.0).0; STEPS],
            leader: None,
            own,
            neighbour: Some(slot),
            terminal: Terminal { x_m: Some(slot.x_m[STEPS]), speed_mps },
        };
        // Far from what it is linearised about, and then close to it, as from plan to plan.
        for tolerance in [5e-3, 5e-4] {
            let solved = problem.solve().expect("convex");
            let missed = [
                solved.end[0] - slot.x_m[STEPS],
                solved.end[1] - speed_mps,
                solved.end[2] - drive.holding(speed_mps).0,
            ];
            assert!(missed.iter().all(|miss| miss.abs() < tolerance), "{error_m}: {missed:?}");
            problem.inputs = solved.inputs;
        }
    }
}

#[test]
fn a_string_of_equal_trucks_keeps_its_slots_and_passes_no_error_on() {
    for structure in [Structure::DmpcPf, Structure::DmpcPlf] {
        let errors = platoon(structure, 0);
        for (i, (largest, last)) in errors.into_iter().enumerate() {
            assert!(largest < 0.25 && last.abs() < 5e-3, "{structure:?} {i}: {largest} {last}");
        }
    }
}

#[test]
fn plans_that_come_late_are_worth_as_much_as_their_sender_kept_to_them() {
    for structure in [Structure::DmpcPf, Structure::DmpcPlf] {
        for (age_ms, limit_m) in [(50, 0.3), (150, 0.4), (400, 0.8)] {
            let errors = platoon(structure, age_ms * 1_000_000);
            for (largest, last) in errors {
                assert!(largest < limit_m, "{structure:?} {age_ms} ms: {largest}");
                assert!(last.abs() < 0.02, "{structure:?} {age_ms} ms: {last}");
            }
        }
    }
}

#[test]
fn a_truck_far_behind_its_slot_approaches_it_at_a_bounded_speed_and_arrives() {
    let mut truck = Truck::new(Structure::DmpcPf, -SPACING_M - 40.0);
    for tick in 0..1_500 {
        let time_ns = tick * TICK_NS;
        let leader = Plan::steady(time_ns, 20e-9 * time_ns as f64, 20.0);
        let plans = Plans { leader: Some(leader), predecessor: Some(leader) };
        let seen = truck.seen(1, time_ns, plans);
        truck.step(&seen);
    }
    let slot_m = 20.0 * 30.0 - SPACING_M;
    assert!((truck.state[0] - slot_m).abs() < 0.02, "{}", truck.state[0] - slot_m);
    assert!((truck.state[1] - 20.0).abs() < 0.02, "{}", truck.state[1]);
    assert!(truck.most_mps < 24.5 && truck.most_mps > 23.0, "{}", truck.most_mps);
}

#[test]
fn without_a_plan_the_last_state_is_continued_and_without_that_the_set_speed_held() {
    let mut truck = Truck::new(Structure::DmpcPlf, -SPACING_M - 1.0);
    let mut alone = Truck::new(Structure::DmpcPlf, 0.0);
    alone.state[1] = 15.0;
    for tick in 0..500 {
        let time_ns = tick * TICK_NS;
        let mut seen = truck.seen(1, time_ns, Plans::default());
        // A state every second alone: what is between is the law's own continuation.
        let told_ns = time_ns / 1_000_000_000 * 1_000_000_000;
        let x_m = 20e-9 * told_ns as f64;
        seen.leader = Some(V2v { generated_ns: told_ns, x_m, speed_mps: 20.0, ..V2v::default() });
        seen.predecessor = seen.leader;
        truck.step(&seen);
        let seen = alone.seen(2, time_ns, Plans::default());
        alone.step(&seen);
    }
    assert!((truck.state[0] - (200.0 - SPACING_M)).abs() < 0.02, "{}", truck.state[0]);
    assert!((alone.state[1] - 20.0).abs() < 0.01, "{}", alone.state[1]);
}

#[test]
fn a_plan_is_announced_once_per_step_at_any_rate() {
    for tick_ns in [1_000_000, 20_000_000, 30_000_000, 100_000_000] {
        let mut truck = Truck::new(Structure::DmpcPf, -SPACING_M);
        for tick in 0..3_000_000_000 / tick_ns {
            let seen = truck.seen(1, tick * tick_ns, Plans::default());
            truck.announced.extend(truck.law.step(&mut truck.memory, &seen).announced);
        }
        assert_eq!(truck.announced.len(), 30, "{tick_ns}");
    }
}

#[test]
fn what_is_not_a_number_leaves_the_last_plan_in_force() {
    let mut truck = Truck::new(Structure::DmpcPf, -SPACING_M);
    let good = truck.seen(1, 0, Plans { leader: Some(leader_plan(0)), ..Plans::default() });
    truck.step(&good);
    let mut broken = leader_plan(0);
    broken.x_m[STEPS] = f64::NAN;
    let seen = truck.seen(1, STEP_NS, Plans { leader: Some(broken), ..Plans::default() });
    truck.step(&seen);
    let plan = truck.announced[1];
    assert!(plan.x_m.iter().chain(&plan.speed_mps).all(|value| value.is_finite()));
}
