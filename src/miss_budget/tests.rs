use bench_sim::{Criterion, TruckResult};
use clap::Parser;

use super::*;
use crate::cli::{Cli, Verb};

fn args(words: &[&str]) -> MissBudgetArgs {
    let cli = Cli::parse_from([&["platoon", "miss-budget"], words].concat());
    match cli.verb {
        Some(Verb::MissBudget(args)) => args,
        other => panic!("{other:?}"),
    }
}

fn search(args: &MissBudgetArgs) -> Result<Search<'_>, Failure> {
    let cell = Cell::new(&args.scenario, &args.set, None, args.rate_hz)?;
    Search::new(args, cell, Arc::new(AtomicBool::new(false)))
}

const SHORT: [&str; 7] =
    ["platooning", "--rate-hz", "20", "--set", "duration_s=4.0", "--instants", "2"];

#[test]
fn a_truck_without_commands_loses_clearance_and_the_worst_tick_is_told() {
    let args = args(&[&SHORT[..], &["--misses-max", "40"]].concat());
    let mut search = search(&args).expect("the scenario is built in");
    let one = search.worst(1, [].iter()).expect("runs");
    let many = search.worst(40, [].iter()).expect("runs");
    assert!(many.loss_m > one.loss_m && many.loss_m > 0.0, "{one:?} {many:?}");
    assert!((many.silence_ms - 2000.0).abs() < 1e-9);
    assert!(many.tried > 2 && many.tick <= 40);
}

#[test]
fn bursts_last_as_many_ticks_as_there_are_misses() {
    let args = args(&SHORT);
    let search = search(&args).expect("the scenario is built in");
    for (misses, tick) in [(1, 0), (3, 7), (17, 60)] {
        let cell = search.disturbed(misses, tick);
        // The leader of `platooning` is scripted: it has no ECU that could miss anything.
        assert_eq!(cell.faults.iter().map(|fault| fault.truck).collect::<Vec<_>>(), [1, 2, 3]);
        let missed = |tick: u64| cell.faults[0].stops(1, tick as f64 * 0.05);
        let found: Vec<u64> = (0..80).filter(|&tick| missed(tick)).collect();
        assert_eq!(found, (tick..tick + u64::from(misses)).collect::<Vec<_>>());
    }
}

#[test]
fn losses_to_obstacles_and_to_trucks_count_each_for_themselves() {
    let truck = |obstacle_m, gap_m| TruckResult {
        min_obstacle_clearance_m: obstacle_m,
        min_truck_gap_m: Some(gap_m),
        ..TruckResult::default()
    };
    let results = |trucks| Results { trucks, ..Results::default() };
    let was = results(vec![truck(Some(1.0), 40.0), truck(None, 40.0)]);
    let is = results(vec![truck(Some(0.9), 40.5), truck(None, 38.0)]);
    assert_eq!(loss(&was, &is), (1, 2.0, 38.0));
}

#[test]
fn a_criterion_that_only_the_burst_breaks_is_named() {
    let results = |values: [f64; 2]| Results {
        criteria: vec![
            Criterion::at_most("position_error_max_m", 1.0, Some(values[0])),
            Criterion::at_most("settle_s", 1.0, Some(values[1])),
        ],
        ..Results::default()
    };
    let names = |was, is| broken(&results(was), &results(is)).into_iter().collect::<Vec<_>>();
    assert_eq!(names([0.5, 2.0], [1.5, 2.0]), ["position_error_max_m"]);
    assert!(names([0.5, 0.5], [0.6, 0.6]).is_empty());
}

#[test]
fn a_truck_nobody_drives_is_refused_with_a_reason() {
    let args = args(&["platooning", "--rate-hz", "20", "--truck", "9"]);
    assert!(search(&args).is_err());
}
