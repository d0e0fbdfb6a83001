//! `platoon miss-budget`: how many deadlines in a row an ECU may miss before it costs clearance.
//!
//! A scenario is replayed in virtual time with one burst of misses put somewhere into it: for so
//! many ticks the ECUs neither compute nor send, and the trucks go on as the rig makes them without
//! commands. What a burst costs is the least clearance of the undisturbed run minus that of the
//! disturbed one, truck by truck, to obstacles and to each other.
//!
//! Which tick is the worst for a burst is searched from coarse to fine: at instants spread over the
//! run first, then nearer and nearer to the worst of them, down to a single tick. The number of
//! misses doubles until it does harm and is halved in on after that; both searches are heuristics,
//! and what was tried is part of the result.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bench_sim::Results;
use serde::Serialize;

use crate::campaign::{self, Cell, Outcome};
use crate::cli::MissBudgetArgs;
use crate::failure::Failure;
use crate::fault::{Fault, FaultKind};
use crate::process;
use crate::progress::ProgressLine;
use crate::table;

/// The worst that one number of misses in a row did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Burst {
    /// Deadlines missed in a row.
    pub misses: u32,
    /// How long nothing came of the ECUs \[ms\].
    pub silence_ms: f64,
    /// Most clearance lost by any truck \[m\]; negative when every one gained.
    pub loss_m: f64,
    /// The tick that was missed first then.
    pub tick: u64,
    /// Bench time of that tick \[s\].
    pub time_s: f64,
    /// The truck that lost it.
    pub truck: usize,
    /// What is left of its clearance \[m\].
    pub left_m: f64,
    /// Criteria of the scenario that held undisturbed and did not in any of the runs.
    pub broken: BTreeSet<String>,
    /// First ticks tried.
    pub tried: usize,
}

/// The budget of one scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MissBudget {
    /// The scenario.
    pub scenario: String,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// The truck whose ECU missed; all of them at once when there is none.
    pub truck: Option<u8>,
    /// Clearance that may be lost and still be called harmless \[m\].
    pub harmless_m: f64,
    /// Ticks of a run.
    pub ticks: u64,
    /// Least clearance of every truck without misses \[m\]; `None` when nothing is near.
    pub undisturbed_m: Vec<Option<f64>>,
    /// Every number of misses tried, ascending.
    pub bursts: Vec<Burst>,
    /// The largest number of misses found harmless, with every smaller one tried.
    pub harmless_misses: u32,
    /// Whether more misses than that were seen to do harm.
    pub is_bounded: bool,
    /// Runs it took.
    pub runs: usize,
}

/// Searches the budget, prints it and writes the JSON.
///
/// # Errors
/// When the scenario makes no sense, the search is interrupted, or the file cannot be written.
pub fn run(args: &MissBudgetArgs) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let cell =
        Cell { seed: args.seed, ..Cell::new(&args.scenario, &args.set, None, args.rate_hz)? };
    let budget = Search::new(args, cell, process::stop_flag()?)?.budget()?;
    budget.print();
    args.json.as_ref().map_or(Ok(()), |path| process::write_json(path, &budget))
}

/// A search and what it has found so far.
struct Search<'a> {
    args: &'a MissBudgetArgs,
    cell: Cell,
    /// Trucks whose ECUs miss their deadlines.
    trucks: Vec<u8>,
    ticks: u64,
    undisturbed: Results,
    stop: Arc<AtomicBool>,
    line: ProgressLine,
    runs: usize,
}

impl<'a> Search<'a> {
    fn new(args: &'a MissBudgetArgs, cell: Cell, stop: Arc<AtomicBool>) -> Result<Self, Failure> {
        let scenario = &cell.scenario;
        let driven = |&truck: &u8| scenario.has_ecu(usize::from(truck));
        let chosen = |&truck: &u8| args.truck.is_none_or(|only| only == truck);
        let trucks: Vec<u8> =
            (0..scenario.platoon.trucks as u8).filter(driven).filter(chosen).collect();
        if trucks.is_empty() {
            return Err(Failure::usage(format!(
                "--truck {}: no ECU drives that truck in scenario {}; leave it out, or name one of \
                 its {} trucks, 0 being the leader",
                args.truck.unwrap_or_default(),
                scenario.name,
                scenario.platoon.trucks
            )));
        }
        let ticks = (scenario.duration_s * f64::from(cell.rate_hz)) as u64;
        let line = ProgressLine::counting();
        let undisturbed = Results::default();
        let mut search = Self { args, cell, trucks, ticks, undisturbed, stop, line, runs: 0 };
        search.undisturbed = search.run(vec![search.cell.clone()])?.remove(0).results;
        Ok(search)
    }

    /// Doubles the misses until they do harm, then closes in on the largest number that does not.
    fn budget(mut self) -> Result<MissBudget, Failure> {
        let mut bursts = BTreeMap::new();
        let (mut harmless, mut harmful) = (0, None);
        let mut misses = 1;
        loop {
            let burst = self.worst(misses, bursts.values())?;
            match self.is_harmless(&burst) {
                true => harmless = misses,
                false => harmful = Some(misses),
            }
            bursts.insert(misses, burst);
            misses = match harmful {
                None if misses >= self.args.misses_max => break,
                None => (2 * misses).min(self.args.misses_max),
                Some(harmful) if harmful <= harmless + 1 => break,
                Some(harmful) => harmless.midpoint(harmful),
            };
        }
        self.line.clear();
        Ok(MissBudget {
            scenario: self.cell.scenario.name.clone(),
            rate_hz: self.cell.rate_hz,
            seed: self.cell.seed,
            truck: self.args.truck,
            harmless_m: self.args.harmless_m,
            ticks: self.ticks,
            undisturbed_m: clearances(&self.undisturbed).collect(),
            bursts: bursts.into_values().collect(),
            harmless_misses: harmless,
            is_bounded: harmful.is_some(),
            runs: self.runs,
        })
    }

    fn is_harmless(&self, burst: &Burst) -> bool {
        burst.loss_m <= self.args.harmless_m && burst.broken.is_empty()
    }

    /// The worst that so many misses do, from the coarse instants to a single tick. Where others
    /// were worst is tried too.
    fn worst<'b>(
        &mut self,
        misses: u32,
        others: impl Iterator<Item = &'b Burst>,
    ) -> Result<Burst, Failure> {
        let last = self.ticks.saturating_sub(u64::from(misses));
        let instants = u64::from(self.args.instants);
        let mut ticks: Vec<u64> = (0..instants).map(|n| last * n / instants).collect();
        ticks.extend(others.map(|burst| burst.tick.min(last)));
        ticks.sort_unstable();
        ticks.dedup();
        let mut worst = self.try_at(misses, &ticks, None)?;
        let mut reach = last.div_ceil(instants);
        while reach > 1 {
            reach = reach.div_ceil(2);
            let (before, after) = (worst.tick.saturating_sub(reach), worst.tick + reach);
            worst = self.try_at(misses, &[before, after.min(last)], Some(worst))?;
        }
        Ok(worst)
    }

    /// The worst of bursts that begin at these ticks, and of one found before.
    fn try_at(
        &mut self,
        misses: u32,
        ticks: &[u64],
        before: Option<Burst>,
    ) -> Result<Burst, Failure> {
        let cells = ticks.iter().map(|&tick| self.disturbed(misses, tick)).collect();
        let share = f64::from(misses) / f64::from(self.args.misses_max);
        self.line.show_share(share.min(1.0), &format!("{misses} in a row, {} runs", self.runs));
        let outcomes = self.run(cells)?;
        let period_s = 1.0 / f64::from(self.cell.rate_hz);
        let found = ticks.iter().zip(&outcomes).map(|(&tick, outcome)| {
            let (truck, loss_m, left_m) = loss(&self.undisturbed, &outcome.results);
            Burst {
                misses,
                silence_ms: 1e3 * f64::from(misses) * period_s,
                loss_m,
                tick,
                time_s: tick as f64 * period_s,
                truck,
                left_m,
                broken: broken(&self.undisturbed, &outcome.results),
                tried: 1,
            }
        });
        let worst = before.into_iter().chain(found).reduce(Burst::worse);
        Ok(worst.expect("there is a tick to try"))
    }

    /// The run with a burst that begins at a tick. Half a period early, so that no rounding of
    /// times adds or spares a tick.
    fn disturbed(&self, misses: u32, tick: u64) -> Cell {
        let period_s = 1.0 / f64::from(self.cell.rate_hz);
        let from_s = (tick as f64 - 0.5) * period_s;
        let kind = FaultKind::PauseEcu { duration_s: f64::from(misses) * period_s };
        let fault = |&truck: &u8| Fault { kind, at_s: from_s, truck };
        Cell { faults: self.trucks.iter().map(fault).collect(), ..self.cell.clone() }
    }

    fn run(&mut self, cells: Vec<Cell>) -> Result<Vec<Outcome>, Failure> {
        self.runs += cells.len();
        let outcomes = campaign::run(&cells, campaign::threads(), &self.stop, &|_, _| ())?;
        outcomes.ok_or_else(|| Failure::cannot_start("interrupted: there is no budget yet"))
    }
}

impl Burst {
    /// The one that costs more; what was tried and what was held is of both.
    fn worse(self, other: Self) -> Self {
        let tried = self.tried + other.tried;
        let broken = &self.broken | &other.broken;
        let worse = if other.loss_m > self.loss_m { other } else { self };
        Self { tried, broken, ..worse }
    }
}

/// Criteria that held undisturbed and did not with a burst.
fn broken(undisturbed: &Results, disturbed: &Results) -> BTreeSet<String> {
    let pairs = undisturbed.criteria.iter().zip(&disturbed.criteria);
    let lost = pairs.filter(|(before, now)| before.passed && !now.passed);
    lost.map(|(_, now)| now.name.clone()).collect()
}

/// Least clearance of every truck, to obstacles and to other trucks \[m\].
fn clearances(results: &Results) -> impl Iterator<Item = Option<f64>> {
    results.trucks.iter().map(|truck| {
        let both = [truck.min_obstacle_clearance_m, truck.min_truck_gap_m];
        both.into_iter().flatten().reduce(f64::min)
    })
}

/// The truck that lost most, how much, and what it has left \[m\]; obstacles and other trucks count
/// each for themselves, so that a gap of 40 m does not hide behind a van at 1 m.
fn loss(undisturbed: &Results, disturbed: &Results) -> (usize, f64, f64) {
    let mut worst = (0, f64::NEG_INFINITY, f64::INFINITY);
    for (index, (was, is)) in undisturbed.trucks.iter().zip(&disturbed.trucks).enumerate() {
        for (was_m, is_m) in [
            (was.min_obstacle_clearance_m, is.min_obstacle_clearance_m),
            (was.min_truck_gap_m, is.min_truck_gap_m),
        ] {
            if let (Some(was_m), Some(is_m)) = (was_m, is_m)
                && was_m - is_m > worst.1
            {
                worst = (index, was_m - is_m, is_m);
            }
        }
    }
    worst
}

impl MissBudget {
    fn print(&self) {
        let who =
            self.truck.map_or("every ECU".into(), |truck| format!("the ECU of truck {truck}"));
        anstream::println!(
            "{}: {who} misses deadlines in a row, {} Hz, seed {}",
            self.scenario,
            self.rate_hz,
            self.seed
        );
        let mut table = table::numbers([
            "misses", "ms", "loss m", "at s", "truck", "left m", "tried", "criteria",
        ]);
        for burst in &self.bursts {
            let broken: Vec<&str> = burst.broken.iter().map(String::as_str).collect();
            table.add_row([
                burst.misses.to_string(),
                format!("{:.0}", burst.silence_ms),
                format!("{:.4}", burst.loss_m),
                format!("{:.2}", burst.time_s),
                burst.truck.to_string(),
                format!("{:.2}", burst.left_m),
                burst.tried.to_string(),
                if broken.is_empty() {
                    "hold".into()
                } else {
                    format!("not {}", broken.join(", "))
                },
            ]);
        }
        anstream::println!("{table}");
        let silence_ms = 1e3 * f64::from(self.harmless_misses) / f64::from(self.rate_hz);
        let bound = if self.is_bounded { "" } else { ", the most that were tried" };
        anstream::println!(
            "largest harmless: {} in a row ({silence_ms:.0} ms){bound}: no loss above {} m and the \
             criteria hold",
            self.harmless_misses,
            self.harmless_m
        );
        anstream::println!(
            "searched from coarse to fine: {} runs, of {} ticks a burst could begin at",
            self.runs,
            self.ticks
        );
    }
}
