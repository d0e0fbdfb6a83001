//! What stands or brakes in the way: obstacles the law alone does not master, and what becomes of
//! the trucks when a part of the answer is taken away.

use bench_sim::{Results, Rig, Scenario};
use controller_rt::{Config, Controller, Ecu, LawController, Phase, Slot};
use law::qp::ActiveSet;
use law::{Calibration, Decision, Law, Observation};
use platoon::summary::{Summary, Verdict};
use platoon_dbc::{Bus, Clock, Loopback};

use crate::bench;

/// The obstacle brakes to a stop and stays.
const STAYS: [&str; 4] = [
    "--set",
    "obstacles.1.speed_change={ to_speed_mps = 0.0, from_s = 14.0, until_s = 16.5 }",
    "--set",
    "obstacles.2.speed_change={ to_speed_mps = 0.0, from_s = 14.0, until_s = 16.5 }",
];

fn rehearse(name: &str, scenario: &str, more: &[&str]) -> Summary {
    let arguments = [scenario, "--rate-hz", "50"];
    bench::rehearse_virtually(name, &[&arguments, more].concat()).summary()
}

fn least_clearance_m(summary: &Summary) -> f64 {
    let clearances = summary.trucks.iter().filter_map(|truck| truck.min_obstacle_clearance_m);
    clearances.fold(f64::INFINITY, f64::min)
}

fn emergency_brakings(summary: &Summary) -> u32 {
    summary.ecus.iter().map(|ecu| ecu.emergency_brakings).sum()
}

#[test]
fn trucks_stop_behind_an_obstacle_that_brakes_to_a_standstill() {
    let summary = rehearse("hazards-brakes", "braking-obstacle", &["--seed", "1001"]);
    assert_eq!(summary.verdict, Verdict::Pass, "{:#?}", summary.criteria);
    assert!(least_clearance_m(&summary) >= 0.3);
    assert!(summary.ecus[0].emergency_brakings > 0, "the law managed alone: no test of the layer");
}

#[test]
fn trucks_stay_behind_an_obstacle_that_stays() {
    let summary = rehearse("hazards-stays", "braking-obstacle", &STAYS);
    let least_m = least_clearance_m(&summary);
    assert!(least_m >= 0.3, "{least_m} m");
    assert!(summary.trucks.iter().all(|truck| truck.final_speed_mps < 0.1), "they stand");
    assert!(summary.trucks.iter().all(|truck| truck.min_truck_gap_m > Some(1.0)));
}

#[test]
fn without_the_emergency_layer_the_law_runs_into_it() {
    let alone = [&STAYS[..], &["--no-emergency-braking"]].concat();
    let summary = rehearse("hazards-alone", "braking-obstacle", &alone);
    let least_m = least_clearance_m(&summary);
    assert!(least_m < 0.0, "{least_m} m: the layer is not needed");
    assert_eq!(emergency_brakings(&summary), 0);
    assert_eq!(summary.verdict, Verdict::Fail);
    assert!(summary.notes.iter().any(|note| note.contains("emergency layer was off")));
}

/// The paper's law, for which obstacles stand where they are seen.
struct Frozen(LawController<ActiveSet>);

impl Controller for Frozen {
    fn step(&mut self, seen: &Observation, mark: &mut dyn FnMut(Phase)) -> Decision {
        let mut seen = *seen;
        for obstacle in seen.obstacles.iter_mut().flatten() {
            (obstacle.vx_mps, obstacle.vy_mps) = (0.0, 0.0);
        }
        self.0.step(&seen, mark)
    }

    fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.0.note_applied(force_n, steering_rad);
    }

    fn save(&self, out: &mut [u8]) -> Option<usize> {
        self.0.save(out)
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.0.restore(bytes)
    }
}

/// A clock nobody looks at: thinking takes no time.
struct Still;

impl Clock for Still {
    fn now_ns(&self) -> u64 {
        0
    }

    fn sleep_until_ns(&self, _: u64) {}
}

/// Rig and ECUs in virtual time, at 20 Hz, with a controller of our own in every ECU.
fn drive(
    scenario: &Scenario,
    controller: fn(LawController<ActiveSet>) -> Box<dyn Controller>,
) -> Results {
    let (mut ends, mut ecus): (Vec<Box<dyn Bus>>, Vec<Ecu>) = (Vec::new(), Vec::new());
    for truck in 0..scenario.platoon.trucks as u8 {
        let (rig_end, ecu_end) = Loopback::pair(&format!("hazard{truck}"), 4096);
        let law = LawController::new(Law::new(Calibration::default(), ActiveSet));
        let config = Config { truck, without_emergency_braking: true, ..Config::default() };
        ends.push(Box::new(rig_end));
        ecus.push(Ecu::new(config, Box::new(ecu_end), controller(law), None));
    }
    let mut rig = Rig::new(scenario, 1001, 20, ends, None).expect("a bus per truck");
    let clock = Still;
    let prepare = |ecus: &mut [Ecu]| {
        for ecu in ecus {
            ecu.prepare(&clock);
        }
    };
    rig.invite();
    prepare(&mut ecus);
    rig.start();
    prepare(&mut ecus);
    let period_ns = rig.base_step_ns() * rig.steps_per_tick();
    while !rig.finished() {
        let slot = Slot::on_time(rig.tick(), period_ns, &clock);
        for ecu in &mut ecus {
            ecu.tick(slot, &clock);
        }
        rig.advance(rig.steps_per_tick());
    }
    rig.results()
}

fn clearance_m(results: &Results) -> f64 {
    let clearances = results.trucks.iter().filter_map(|truck| truck.min_obstacle_clearance_m);
    clearances.fold(f64::INFINITY, f64::min)
}

#[test]
fn obstacles_taken_for_standing_are_passed_too_closely() {
    let scenario = Scenario::load("merging", &[]).expect("built in");
    let least_m = scenario.criteria.min_clearance_m.expect("a criterion of this scenario");
    let (whole_m, frozen_m) = (
        clearance_m(&drive(&scenario, |law| Box::new(law))),
        clearance_m(&drive(&scenario, |law| Box::new(Frozen(law)))),
    );
    assert!(whole_m >= least_m && frozen_m < 0.5 * least_m, "{whole_m} m and {frozen_m} m");
}

#[test]
fn trucks_answer_a_cut_in_and_drive_over_bumps() {
    for scenario in ["cut-in", "bump"] {
        let summary = rehearse(&format!("hazards-{scenario}"), scenario, &["--seed", "1001"]);
        assert_eq!(summary.verdict, Verdict::Pass, "{scenario}: {:#?}", summary.criteria);
    }
}

#[test]
#[ignore = "twenty seeds of every hazard, with sensor noise: ./test.sh --long"]
fn heavy_every_seed_passes_every_hazard_with_sensor_noise() {
    for scenario in ["braking-obstacle", "cut-in", "bump", "obstacle-avoidance-12m-back"] {
        for seed in 1001..=1020 {
            let seed = seed.to_string();
            let more = ["--seed", &seed, "--set", "sensors.noise=1"];
            let summary = rehearse("heavy-hazards", scenario, &more);
            assert_eq!(
                summary.verdict,
                Verdict::Pass,
                "{scenario}, {seed}: {:#?}",
                summary.criteria
            );
        }
    }
}
