//! A small, honest tuning of the delay-compensated single-structure MPC, on seeds 1 to 20.
//!
//! What is free is the weight Q_X of the distance to the slot, which the paper does not print. The
//! best weight has the least product of the median largest errors in platooning and merging, among
//! those that touch no obstacle in any run, wherever obstacle 2 is placed. Runs in which obstacle 2
//! appears within 2 m of a truck do not count: that is the scenario's doing.

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
const WEIGHTS: [f64; 6] = [80.0, 160.0, 320.0, 640.0, 1280.0, 2560.0];
/// Seeds for tuning in platooning.
const PLATOONING_SEEDS: u64 = 20;
/// In merging, which takes longer and depends less on them.
const MERGING_SEEDS: u64 = 3;
/// At every place of obstacle 2.
const AVOIDANCE_SEEDS: u64 = 1;
/// Least clearance of a weight that may be chosen \[m\].
const CLEARANCE_M: f64 = 0.0;
/// Obstacle 2 must not appear nearer to a truck than this \[m\].
const SPAWN_CLEARANCE_M: f64 = 2.0;

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
        if self.clearance_m <= CLEARANCE_M {
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

fn seeds(situation: Situation) -> u64 {
    match situation {
        Situation::Platooning => PLATOONING_SEEDS,
        Situation::Merging => MERGING_SEEDS,
        _ => AVOIDANCE_SEEDS,
    }
}

fn trial_cells(weight: f64, situation: Situation, rate_hz: u32) -> Result<Vec<Cell>, Failure> {
    let contender = Contender::COMPENSATED;
    let mut cell = Arm { situation, contender, plant: Plant::SingleTrack, rate_hz }.cell()?;
    cell.calibration.single_mpc.position_weight = weight;
    Ok((1..=seeds(situation)).map(|seed| Cell { seed, ..cell.clone() }).collect())
}

/// One weight's numbers from its outcomes, which are in the order of the situations.
fn trial((weight, outcomes): (f64, &[Outcome])) -> Option<Trial> {
    let (platooning, rest) = outcomes.split_at(PLATOONING_SEEDS as usize);
    let (merging, avoidance) = rest.split_at(MERGING_SEEDS as usize);
    let largest = |outcomes: &[Outcome]| {
        Spread::of(outcomes.iter().map(measure::largest_predecessor_error_m))
    };
    let errors_m = [largest(platooning)?, largest(merging)?, largest(avoidance)?];
    let is_fair = |o: &&Outcome| o.spawn_clearance_m.is_none_or(|m| m >= SPAWN_CLEARANCE_M);
    let clearances_m = outcomes.iter().filter(is_fair).map(measure::clearance_m);
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
