//! Distributed MPC on the trucks: the whole bench, plans over the radio and all.

use platoon::summary::Verdict;

use crate::bench;

fn largest_error_m(name: &str, more: &[&str]) -> f64 {
    let arguments = ["platooning", "--seed", "1001", "--rate-hz", "50", "--duration-s", "10"];
    let run = bench::rehearse_virtually(name, &[&arguments, more].concat());
    run.expect_code(0);
    let summary = run.summary();
    assert_eq!(summary.verdict, Verdict::Pass);
    for ecu in &summary.ecus {
        assert_eq!((ecu.qp.failures, ecu.sent.encode_errors), (0, 0), "truck {}", ecu.truck);
    }
    let errors = summary.trucks.iter().map(|truck| truck.max_abs_predecessor_error_m);
    errors.fold(0.0, f64::max)
}

#[test]
fn trucks_that_know_each_others_plans_stay_within_a_third_of_a_metre() {
    for controller in ["dmpc-pf", "dmpc-plf"] {
        for delay in ["none", "50-150"] {
            let name = format!("{controller}-{delay}");
            let more = ["--controller", controller, "--v2v-delay", delay];
            let largest_m = largest_error_m(&name, &more);
            assert!(largest_m < 0.3, "{name}: {largest_m}");
        }
    }
}

#[test]
fn noise_and_losses_cost_little() {
    let more = ["--controller", "dmpc-plf", "--set", "sensors.noise=1", "--set", "v2v.loss=0.2"];
    let largest_m = largest_error_m("dmpc-noise", &more);
    assert!(largest_m < 0.5, "{largest_m}");
}
