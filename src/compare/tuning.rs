//! A small, honest tuning of the delay-compensated single-structure MPC, on seeds 1 to 20.
//!
//! What is free is the weight Q_X of the distance to the slot, which the paper does not print. The
//! best weight has the least product of the median largest errors in platooning and merging, among
//! those that keep 1 m from every obstacle in every run, wherever obstacle 2 is placed.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::arm::{Arm, Contender, PLACEMENTS_M, Plant, Situation, TUNED_POSITION_WEIGHT};
use super::measure;
use super::page;
use super::spread::{Spread, fixed};
use crate::campaign::{self, Cell, Outcome};
use crate::failure::Failure;
use crate::summary::Verdict;

/// Weights tried.
const WEIGHTS: [f64; 9] = [20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0, 2560.0, 5120.0];
/// Seeds for tuning.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=20;
/// Those used at every place of obstacle 2.
const SEEDS_PER_PLACEMENT: std::ops::RangeInclusive<u64> = 1..=2;
/// Least clearance of a weight that may be chosen \[m\].
const CLEARANCE_M: f64 = 1.0;

/// What one weight gives.
struct Trial {
    weight: f64,
    /// Largest s̄ \[m\] in platooning, merging and obstacle avoidance.
    errors_m: [Spread; 3],
    clearance_m: f64,
}

impl Trial {
    /// What the best weight has least of; infinite for one that must not be chosen.
    fn score(&self) -> f64 {
        if self.clearance_m < CLEARANCE_M {
            return f64::INFINITY;
        }
        self.errors_m[0].median * self.errors_m[1].median
    }
}

/// Tries every weight and prints the table; passes when the weight in use is the best.
///
/// # Errors
/// When a run cannot start.
pub fn run(
    rate_hz: u32,
    threads: usize,
    stop: &Arc<AtomicBool>,
    tell: &(dyn Fn(usize, f64) + Sync),
) -> Result<Option<Verdict>, Failure> {
    let mut cells = Vec::new();
    for weight in WEIGHTS {
        for situation in situations() {
            cells.extend(trial_cells(weight, situation, rate_hz)?);
        }
    }
    let Some(outcomes) = campaign::run(&cells, threads, stop, tell)? else {
        return Ok(None);
    };
    let each = outcomes.len() / WEIGHTS.len();
    let trials: Vec<Trial> =
        WEIGHTS.into_iter().zip(outcomes.chunks(each)).filter_map(trial).collect();
    let best = trials.iter().min_by(|a, b| a.score().total_cmp(&b.score()));
    let best = best.map_or(f64::NAN, |trial| trial.weight);
    anstream::println!("{}", table(&trials, best));
    anstream::println!("in use: {TUNED_POSITION_WEIGHT}, best: {best}");
    let is_best = best == TUNED_POSITION_WEIGHT;
    Ok(Some(if is_best { Verdict::Pass } else { Verdict::Fail }))
}

/// Platooning, merging, and every place of obstacle 2.
fn situations() -> Vec<Situation> {
    let places = PLACEMENTS_M.into_iter().map(Situation::Avoidance);
    [Situation::Platooning, Situation::Merging].into_iter().chain(places).collect()
}

fn seeds(situation: Situation) -> std::ops::RangeInclusive<u64> {
    match situation {
        Situation::Avoidance(_) => SEEDS_PER_PLACEMENT,
        _ => SEEDS,
    }
}

fn trial_cells(weight: f64, situation: Situation, rate_hz: u32) -> Result<Vec<Cell>, Failure> {
    let contender = Contender::COMPENSATED;
    let mut cell = Arm { situation, contender, plant: Plant::SingleTrack, rate_hz }.cell()?;
    cell.calibration.single_mpc.position_weight = weight;
    Ok(seeds(situation).map(|seed| Cell { seed, ..cell.clone() }).collect())
}

/// One weight's numbers from its outcomes, which are in the order of the situations.
fn trial((weight, outcomes): (f64, &[Outcome])) -> Option<Trial> {
    let runs = SEEDS.count();
    let (platooning, rest) = outcomes.split_at(runs);
    let (merging, avoidance) = rest.split_at(runs);
    let largest = |outcomes: &[Outcome]| {
        Spread::of(outcomes.iter().map(measure::largest_predecessor_error_m))
    };
    let errors_m = [largest(platooning)?, largest(merging)?, largest(avoidance)?];
    let clearances_m = outcomes.iter().map(measure::clearance_m);
    Some(Trial { weight, errors_m, clearance_m: clearances_m.fold(f64::INFINITY, f64::min) })
}

fn table(trials: &[Trial], best: f64) -> String {
    let mut table =
        page::table(&["weight", "platooning m", "merging m", "avoidance m", "clearance m", ""]);
    for trial in trials {
        let errors = trial.errors_m.map(|spread| spread.text(2));
        let mut row = vec![trial.weight.to_string()];
        row.extend(errors);
        row.push(fixed(trial.clearance_m, 2));
        row.push(if trial.weight == best { "best".into() } else { String::new() });
        table.add_row(row);
    }
    table.to_string()
}
