//! A small, honest tuning of the delay-compensated single-structure MPC, on seeds 1 to 20.
//!
//! What is free is the weight Q_X of the distance to the slot, which the paper does not print. More
//! of it always lowers the errors, by less and less; we take the first weight of which four times
//! as much lowers the largest error in platooning by less than a tenth. It is the best baseline of
//! the errors alone: the table says how near each weight comes to the obstacles, wherever obstacle
//! 2 is.

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
const WEIGHTS: [f64; 7] = [40.0, 80.0, 160.0, 640.0, 2_560.0, 10_240.0, 40_960.0];
/// Seeds for tuning in platooning.
const PLATOONING_SEEDS: u64 = 20;
/// In merging, which takes longer and depends less on them.
const MERGING_SEEDS: u64 = 3;
/// At every place of obstacle 2.
const AVOIDANCE_SEEDS: u64 = 1;
/// Four times the weight must lower the error at least to this share of it.
const WORTHWHILE: f64 = 0.9;

/// What one weight gives.
struct Trial {
    weight: f64,
    /// Largest s̄ \[m\] in platooning, merging and obstacle avoidance.
    errors_m: [Spread; 3],
    clearance_m: f64,
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
    let best = best(&trials).unwrap_or(f64::NAN);
    anstream::println!("{}", table(&trials, best));
    anstream::println!("in use: {TUNED_POSITION_WEIGHT}, best: {best}");
    let is_best = best == TUNED_POSITION_WEIGHT;
    Ok(Some(if is_best { Verdict::Pass } else { Verdict::Fail }))
}

/// The first weight of which four times as much is not worth it; else the largest.
fn best(trials: &[Trial]) -> Option<f64> {
    let platooning_m = |trial: &Trial| trial.errors_m[0].median;
    let is_enough = |trial: &&Trial| {
        let more = trials.iter().find(|other| other.weight == 4.0 * trial.weight);
        more.is_some_and(|more| platooning_m(more) > WORTHWHILE * platooning_m(trial))
    };
    trials.iter().find(is_enough).or(trials.last()).map(|trial| trial.weight)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_is_taken_where_more_of_it_is_not_worth_it() {
        let trial = |weight, error_m: f64| {
            let error_m = Spread::of([error_m]).expect("a number");
            Trial { weight, errors_m: [error_m; 3], clearance_m: 1.0 }
        };
        let trials = [trial(10.0, 2.0), trial(40.0, 1.0), trial(160.0, 0.95)];
        assert_eq!(best(&trials), Some(40.0));
        assert_eq!(best(&trials[..2]), Some(40.0));
        assert_eq!(best(&[]), None);
    }
}
