use super::*;
use clap::Parser;

use crate::cli::{Cli, Verb};

fn at_most(value: Option<f64>) -> Criterion {
    Criterion::at_most("max_y_m", 1.0, value)
}

fn swept(runs: &[Criterion]) -> SweptCriterion {
    let seeds: Vec<u64> = (11..).take(runs.len()).collect();
    SweptCriterion::new(&seeds, &runs.iter().collect::<Vec<_>>())
}

fn arguments(words: &[&str]) -> SweepArgs {
    let cli = Cli::parse_from([&["platoon", "sweep"], words].concat());
    let Some(Verb::Sweep(args)) = cli.verb else { panic!("{words:?} is a sweep") };
    args
}

#[test]
fn the_worst_run_is_the_one_nearest_to_its_limit_or_farthest_beyond() {
    let upper = swept(&[at_most(Some(0.2)), at_most(Some(0.9)), at_most(Some(0.5))]);
    assert_eq!((upper.worst, upper.worst_seed), (Some(0.9), 12));
    let lower = |value| Criterion::at_least("min_y_m", 0.1, Some(value));
    let lower = swept(&[lower(0.2), lower(0.05), lower(0.01), lower(0.5)]);
    assert_eq!((lower.worst, lower.worst_seed), (Some(0.01), 13));
    assert_eq!(lower.failed_seeds, [12, 13]);
}

#[test]
fn a_run_that_never_settles_is_worse_than_one_that_settles_late() {
    let never = swept(&[at_most(Some(5.0)), at_most(None), at_most(Some(0.5))]);
    assert_eq!((never.worst, never.worst_seed, never.failed_seeds), (None, 12, vec![11, 12]));
    assert_eq!(never.values.map(|values| values.runs), Some(2));
}

#[test]
fn an_obstacle_that_nobody_met_is_no_concern() {
    let met = |value| Criterion::at_least("min_clearance_m", 1.0, value);
    let swept = swept(&[met(None), met(Some(1.2))]);
    assert_eq!((swept.worst, swept.failed_seeds.len()), (Some(1.2), 0));
}

#[test]
fn every_scenario_runs_on_every_plant_with_the_law_asked_for() {
    let args = arguments(&["platooning", "merging", "--plant", "single-track,two-track"]);
    let rows = rows(&args).expect("they make sense");
    let names: Vec<_> = rows.iter().map(|row| row.scenario.name.as_str()).collect();
    assert_eq!(names, ["platooning", "platooning", "merging", "merging"]);
    let published = arguments(&["platooning", "--ucl", "published"]);
    let published = rows_of(&published);
    assert_eq!(published.calibration.ucl.k1, law::UclCalibration::PUBLISHED_K1);
    assert_ne!(rows[0].calibration.ucl.k1, published.calibration.ucl.k1);
    let refused = rows_error(&arguments(&["platooning", "--plant", "three-track"]));
    assert!(refused.contains("three-track"), "{refused}");
}

fn rows_of(args: &SweepArgs) -> Cell {
    rows(args).expect("it makes sense").remove(0)
}

fn rows_error(args: &SweepArgs) -> String {
    rows(args).expect_err("it makes none").to_string()
}

#[test]
fn a_sweep_counts_the_runs_that_break_a_criterion() {
    let limit = ["--set", "criteria.max_predecessor_error_m=0.1", "--set", "duration_s=3"];
    let args = arguments(&[&["platooning", "--rate-hz", "50"], &limit[..]].concat());
    let row = rows_of(&args);
    let cells = [Cell { seed: 4, ..row.clone() }, Cell { seed: 5, ..row.clone() }];
    let stop = std::sync::Arc::default();
    let outcomes = campaign::run(&cells, 2, &stop, &|_, _| ()).expect("runs").expect("ended");
    let swept = Swept::new(&row, &[4, 5], &outcomes);
    let error = swept.criteria.iter().find(|c| c.name == "max_predecessor_error_m");
    let error = error.expect("it is a criterion");
    assert_eq!(error.failed_seeds, [4, 5]);
    assert_eq!(swept.failed_seeds, [4, 5]);
    assert!(error.worst.is_some_and(|worst| worst > 0.1), "{error:?}");
}
