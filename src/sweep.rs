//! `platoon sweep`: the same scenarios over many seeds, every run judged by its own criteria.
//!
//! One run says what one sequence of V2V delays does. Here every criterion gets its distribution
//! over the seeds, its worst value with the seed that made it, ready to be rehearsed again, and the
//! number of runs that broke it.

#[cfg(test)]
mod tests;

use std::time::Instant;

use bench_sim::{Criterion, Scenario};
use serde::Serialize;

use crate::campaign::{self, Cell, Outcome};
use crate::cli::SweepArgs;
use crate::compare::spread::Spread;
use crate::failure::Failure;
use crate::process;
use crate::progress::ProgressLine;
use crate::summary::{Verdict, ecu_criteria};
use crate::table::{self, number};

/// One scenario on one plant, over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Swept {
    /// The scenario.
    pub scenario: String,
    /// Its plant.
    pub plant: String,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// Seeds, in the order of the runs.
    pub seeds: Vec<u64>,
    /// Seeds of the runs in which a criterion did not hold.
    pub failed_seeds: Vec<u64>,
    /// Every criterion.
    pub criteria: Vec<SweptCriterion>,
}

/// One criterion over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweptCriterion {
    /// Its key in the scenario.
    pub name: String,
    /// The limit.
    pub limit: f64,
    /// How its value varies; `None` when no run has one.
    pub values: Option<Spread>,
    /// The value nearest to the limit, or farthest beyond it; `None` when a run that had to have
    /// one had none (it never settled).
    pub worst: Option<f64>,
    /// The seed that made it.
    pub worst_seed: u64,
    /// Seeds with which it did not hold.
    pub failed_seeds: Vec<u64>,
}

/// Makes the runs, prints one table per scenario and plant, writes the JSON. Passed when every
/// criterion held in every run.
///
/// # Errors
/// When a scenario or its law makes no sense, or the file cannot be written.
pub fn run(args: &SweepArgs) -> Result<Verdict, Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let seeds: Vec<u64> = args.seeds.0.clone().collect();
    let rows = rows(args)?;
    let cells: Vec<Cell> = rows
        .iter()
        .flat_map(|row| seeds.iter().map(|&seed| Cell { seed, ..row.clone() }))
        .collect();
    let threads = args.threads.map_or_else(campaign::threads, usize::from);
    anstream::eprintln!("{} runs in {threads} thread(s)", cells.len());
    let (line, began) = (ProgressLine::counting(), Instant::now());
    let tell = |runs: usize, share: f64| line.show_share(share, &format!("{runs} runs done"));
    let outcomes = campaign::run(&cells, threads, &process::stop_flag()?, &tell)?;
    line.clear();
    let outcomes = outcomes
        .ok_or_else(|| Failure::cannot_start("interrupted: nothing is judged or written"))?;
    let swept: Vec<Swept> = rows
        .iter()
        .zip(outcomes.chunks(seeds.len()))
        .map(|(row, outcomes)| Swept::new(row, &seeds, outcomes))
        .collect();
    for one in &swept {
        one.print();
    }
    anstream::eprintln!("took {:.0} s", began.elapsed().as_secs_f64());
    if let Some(path) = &args.json {
        process::write_json(path, &swept)?;
    }
    let passed = swept.iter().all(|one| one.failed_seeds.is_empty());
    Ok(if passed { Verdict::Pass } else { Verdict::Fail })
}

/// A cell for every scenario on every plant.
fn rows(args: &SweepArgs) -> Result<Vec<Cell>, Failure> {
    let plants: Vec<Option<&String>> = match args.plant.as_slice() {
        [] => vec![None],
        named => named.iter().map(Some).collect(),
    };
    let mut rows = Vec::new();
    for scenario in &args.scenarios {
        for plant in &plants {
            let mut sets = args.set.clone();
            sets.extend(plant.map(|plant| ("plant.model".to_owned(), plant.clone())));
            rows.push(Cell::new(scenario, &sets, None, args.rate_hz)?.with_law(&args.law_options)?);
        }
    }
    Ok(rows)
}

impl Swept {
    fn new(row: &Cell, seeds: &[u64], outcomes: &[Outcome]) -> Self {
        let judged: Vec<Vec<Criterion>> =
            outcomes.iter().map(|outcome| judged(&row.scenario, outcome)).collect();
        let seeds_where = |fails: &dyn Fn(&[Criterion]) -> bool| -> Vec<u64> {
            let runs = seeds.iter().zip(&judged);
            runs.filter(|(_, run)| fails(run)).map(|(&seed, _)| seed).collect()
        };
        let count = judged.first().map_or(0, Vec::len);
        let criteria = (0..count).map(|place| {
            let of_all: Vec<&Criterion> = judged.iter().map(|run| &run[place]).collect();
            SweptCriterion::new(seeds, &of_all)
        });
        Self {
            scenario: row.scenario.name.clone(),
            plant: row.scenario.plant.model.to_string(),
            rate_hz: row.rate_hz,
            seeds: seeds.to_vec(),
            failed_seeds: seeds_where(&|run| run.iter().any(|criterion| !criterion.passed)),
            criteria: criteria.collect(),
        }
    }

    fn print(&self) {
        let runs = self.seeds.len();
        let passed = runs - self.failed_seeds.len();
        anstream::println!(
            "\n{}, {}, {} Hz: {passed} of {runs} runs pass",
            self.scenario,
            self.plant,
            self.rate_hz
        );
        let header = ["criterion", "limit", "worst", "seed", "median", "5 %", "95 %", "broken"];
        let mut table = table::numbers(header);
        for criterion in &self.criteria {
            let spread = |of: fn(&Spread) -> f64| {
                criterion.values.as_ref().map_or("-".to_owned(), |values| number(of(values)))
            };
            table.add_row([
                criterion.name.clone(),
                number(criterion.limit),
                criterion.worst.map_or("never".to_owned(), number),
                criterion.worst_seed.to_string(),
                spread(|values| values.median),
                spread(|values| values.p5),
                spread(|values| values.p95),
                criterion.failed_seeds.len().to_string(),
            ]);
        }
        anstream::println!("{table}");
    }
}

impl SweptCriterion {
    /// A criterion from its judgement in every run.
    fn new(seeds: &[u64], runs: &[&Criterion]) -> Self {
        let worst = (0..runs.len()).reduce(|a, b| if is_worse(runs[b], runs[a]) { b } else { a });
        let worst = worst.expect("a sweep has a seed");
        let failed = seeds.iter().zip(runs).filter(|(_, run)| !run.passed);
        Self {
            name: runs[worst].name.clone(),
            limit: runs[worst].limit,
            values: Spread::of(runs.iter().filter_map(|run| run.value)),
            worst: runs[worst].value,
            worst_seed: seeds[worst],
            failed_seeds: failed.map(|(&seed, _)| seed).collect(),
        }
    }
}

/// Whether a run stands worse to a criterion than another: farther on the wrong side of the limit,
/// or nearer to it. No value is the worst where it fails, and no concern where it holds.
fn is_worse(one: &Criterion, other: &Criterion) -> bool {
    if one.passed != other.passed {
        return other.passed;
    }
    match (one.value, other.value) {
        (Some(one_value), Some(other_value)) if one.is_lower_limit() => one_value < other_value,
        (Some(one_value), Some(other_value)) => one_value > other_value,
        (None, Some(_)) => !one.passed,
        (Some(_), None) => one.passed,
        (None, None) => false,
    }
}

/// All criteria of a run, those of the rig and those of the ECUs.
fn judged(scenario: &Scenario, outcome: &Outcome) -> Vec<Criterion> {
    let mut judged = outcome.results.criteria.clone();
    judged.extend(ecu_criteria(scenario, &outcome.ecus));
    judged
}
