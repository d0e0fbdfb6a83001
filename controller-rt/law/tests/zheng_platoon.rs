//! The platoon of the distributed MPC paper, driven by this crate's whole law.
//!
//! Y. Zheng, S. E. Li, K. Li, F. Borrelli, J. K. Hedrick, *Distributed Model Predictive Control for
//! Heterogeneous Vehicle Platoons Under Unidirectional Topologies*, IEEE Trans. Control Systems
//! Technology 25(3), 2017. Masses of the seven cars, and how everything else follows from them, are
//! from the authors' program (soc-ucsd/DMPC_for_platoons: `PlatoonParameter.mat`,
//! `Parameter_Initial.m`, `Platoon_PF.m`, `Platoon_PFL.m`). As there, cars advance by forward
//! Euler, the leader by backward Euler, and whoever listens to the leader knows its future.

use law::dmpc::{Discretisation, DmpcCalibration, Drive, POINTS, Plan, STEP_NS, STEP_S, State};
use law::qp::ActiveSet;
use law::{
    Calibration, Ego, Law, LmlCalibration, Memory, Mission, OBSTACLES_MAX, Observation, Outcome,
    Plans, Structure, TruckBelief,
};

const CARS: usize = 7;
/// As stored by the authors \[kg\]; they drew them once from 1000 to 2000.
const MASSES_KG: [f64; CARS] = [
    1035.7116785741896,
    1849.129305868777,
    1933.9932477575505,
    1678.7351548577735,
    1757.7401305783335,
    1743.1324681249162,
    1392.2270195341682,
];
const SPACING_M: f64 = 20.0;
const STEPS: usize = 80;
/// Standard gravity over the authors' 9.8 m/s².
const GRAVITY_SHARE: f64 = 9.8 / 9.80665;

fn calibration(mass_kg: f64, structure: Structure) -> Calibration {
    let above_ton = (mass_kg - 1000.0) / 1000.0;
    Calibration {
        structure,
        truck: TruckBelief {
            mass_kg,
            drag_n_per_mps2: 0.98 + 0.2 * above_ton,
            rolling_resistance: 0.01 * GRAVITY_SHARE,
            ..TruckBelief::default()
        },
        dmpc: DmpcCalibration {
            lag_s: 0.5 + 0.3 * above_ton,
            wheel_radius_m: 0.3 + 0.1 * (mass_kg - 2000.0) / 2000.0,
            efficiency: 0.96,
            discretisation: Discretisation::Euler,
            ..DmpcCalibration::default()
        },
        lml: LmlCalibration {
            force_min_kn: -6e-3 * mass_kg,
            force_max_kn: 6e-3 * mass_kg,
            force_rate_kn_per_s: 1e3,
            ..LmlCalibration::default()
        },
        ..Calibration::default()
    }
}

struct Car {
    law: Law,
    memory: Memory,
    drive: Drive,
    mass_kg: f64,
    state: State,
    announced: Plan,
}

impl Car {
    fn new(place: usize, structure: Structure) -> Self {
        let mass_kg = MASSES_KG[place - 1];
        let cal = calibration(mass_kg, structure);
        let drive = Drive::new(&cal.truck, cal.dmpc.lag_s, Discretisation::Euler);
        let state = [-SPACING_M * place as f64, 20.0, drive.holding(20.0).0];
        let announced = Plan::steady(0, state[0], state[1]);
        let law = Law::new(cal, ActiveSet);
        Self { law, memory: Memory::new(), drive, mass_kg, state, announced }
    }

    fn step(&mut self, place: usize, time_ns: u64, plans: Plans) -> Plan {
        let [x_m, speed_mps, traction] = self.state;
        let seen = Observation {
            time_ns,
            ego: Ego {
                time_ns,
                x_m,
                forward_mps: speed_mps,
                accel_mps2: traction - self.drive.holding(speed_mps).0,
                ..Ego::default()
            },
            mission: Mission {
                truck: place as u8,
                trucks: CARS as u8 + 1,
                spacing_m: SPACING_M,
                leader_distance_m: place as f64 * SPACING_M,
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
        };
        let decision = self.law.step(&mut self.memory, &seen);
        assert_eq!(decision.outcome, Outcome::Solved);
        self.state = self.drive.advance(&self.state, decision.force_n / self.mass_kg).state;
        decision.announced.expect("every step is a new plan")
    }
}

/// The leader's speed and position at the steps' ends: 2 m/s² over ten steps, backward Euler.
fn leader() -> Vec<(f64, f64)> {
    let mut course = vec![(0.0, 20.0)];
    for k in 1..STEPS + POINTS {
        let (x, v) = course[k - 1];
        let v = v + if (10..20).contains(&k) { 2.0 * STEP_S } else { 0.0 };
        course.push((x + v * STEP_S, v));
    }
    course
}

/// Largest errors of each car: against the car ahead, and against its slot behind the leader \[m\].
struct Errors {
    predecessor_m: [f64; CARS],
    leader_m: [f64; CARS],
}

impl Errors {
    fn of(structure: Structure) -> Self {
        let course = leader();
        let mut cars: Vec<_> = (1..=CARS).map(|place| Car::new(place, structure)).collect();
        let mut errors = Self { predecessor_m: [0.0; CARS], leader_m: [0.0; CARS] };
        for step in 0..STEPS {
            let time_ns = step as u64 * STEP_NS;
            let leader = Plan {
                start_ns: time_ns,
                x_m: core::array::from_fn(|k| course[step + k].0),
                speed_mps: core::array::from_fn(|k| course[step + k].1),
            };
            // All plan at once, from what was announced a step before.
            let mut ahead = leader;
            for (i, car) in cars.iter_mut().enumerate() {
                let plans = Plans { leader: Some(leader), predecessor: Some(ahead) };
                ahead = car.announced;
                car.announced = car.step(i + 1, time_ns, plans);
            }
            let leader_m = course[step + 1].0;
            let mut ahead_m = leader_m;
            for (i, car) in cars.iter().enumerate() {
                let note = |largest: &mut f64, error: f64| *largest = largest.max(error.abs());
                note(&mut errors.predecessor_m[i], ahead_m - SPACING_M - car.state[0]);
                let slot_m = leader_m - SPACING_M * (i + 1) as f64;
                note(&mut errors.leader_m[i], slot_m - car.state[0]);
                ahead_m = car.state[0];
            }
        }
        errors
    }
}

fn assert_near(what: &str, ours: f64, published: f64, share: f64) {
    let off = ours / published - 1.0;
    println!("{what}: {ours:.4}, published {published}, off by {:.1} %", 100.0 * off);
    assert!(off.abs() <= share, "{what}: {ours} instead of {published}");
}

fn assert_published(structure: Structure, ratios: [f64; 2]) {
    let errors = Errors::of(structure);
    println!("{structure:?}: of predecessor {:.4?}", errors.predecessor_m);
    println!("{structure:?}: of leader      {:.4?}", errors.leader_m);
    let largest = errors.predecessor_m.into_iter().fold(0.0, f64::max);
    assert_near("largest spacing error, m", largest, 0.2, 0.05);
    for (i, published) in ratios.into_iter().enumerate() {
        let ratio = errors.leader_m[i + 1] / errors.leader_m[i];
        assert_near(&format!("car {} over car {}", i + 2, i + 1), ratio, published, 0.10);
    }
}

#[test]
fn predecessor_following_has_the_published_error_and_ratios() {
    assert_published(Structure::DmpcPf, [0.90, 0.94]);
}

#[test]
fn predecessor_leader_following_has_the_published_error_and_ratios() {
    assert_published(Structure::DmpcPlf, [0.89, 0.98]);
}

#[test]
fn the_published_ratios_are_those_of_errors_behind_the_leader_not_behind_the_car_ahead() {
    for structure in [Structure::DmpcPf, Structure::DmpcPlf] {
        let errors = Errors::of(structure);
        let ratio = errors.predecessor_m[1] / errors.predecessor_m[0];
        assert!(ratio < 0.1, "{structure:?}: {ratio}");
    }
}
