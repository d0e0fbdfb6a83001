//! `platoon deadline`: at which rates, and beside which other work, this machine keeps deadlines.
//!
//! A table of cells. In each, the real loops run for a few seconds at one rate, over the bus or one
//! ECU alone, while the machine is left in peace or put under a load that this program makes
//! itself. A sentinel runs beside every cell, every lost slot is given its cause, and the cell is
//! judged as a rehearsal is (`timing.rs`): what the machine lost is not the program's, and what
//! cannot be told apart is inconclusive, with the evidence.

mod alone;
mod load;
mod outcome;
mod page;
mod plan;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use std::{fs, path::Path};

use clap::{Args, FromArgMatches};
use vcan_setup::realtime::environment;

use crate::cli::{DeadlineArgs, RehearseArgs, Word};
use crate::failure::Failure;
use crate::fault::FaultKind;
use crate::process;
use crate::rehearse::{self, Timed};
use crate::run_folder::RunFolder;
use crate::summary::Verdict;

pub use load::{Load, run as load};

use alone::Feeds;
use load::Generators;
use outcome::{CellOutcome, Deadline};
use plan::{Cell, GRACE_S, Scope, Subject};

/// Runs every cell, prints the table, and writes it.
///
/// # Errors
/// When a cell cannot be run, somebody stops the test, or the nominal rate cannot be judged.
pub fn run(args: &DeadlineArgs) -> Result<Verdict, Failure> {
    let test = Test::new(args)?;
    let folder = RunFolder::create(args.out.as_deref(), "deadline")?;
    if folder.deadline().exists() {
        return Err(Failure::usage(format!(
            "--out {}: holds a test already; name another folder or remove this one",
            folder.path().display()
        )));
    }
    process::reserve_json(&folder.deadline())?;
    let deadline = test.run(&folder).inspect_err(|_| process::release_json(&folder.deadline()))?;
    anstream::println!("{}", page::text(&deadline));
    process::write_json(&folder.deadline(), &deadline)?;
    fs::write(folder.deadline_page(), page::markdown(&deadline)).map_err(|error| {
        Failure::cannot_start(format!("{}: {error}", folder.deadline_page().display()))
    })?;
    if let Some(path) = &args.json {
        process::write_json(path, &deadline)?;
    }
    anstream::println!("\ntable  {}", folder.deadline().display());
    deadline.verdict.strictly(Verdict::Pass)
}

/// A test that is ready to run.
struct Test<'a> {
    args: &'a DeadlineArgs,
    scope: Scope,
    /// Trucks with an ECU.
    ecus: Vec<u8>,
    stop: Arc<AtomicBool>,
}

impl<'a> Test<'a> {
    fn new(args: &'a DeadlineArgs) -> Result<Self, Failure> {
        let stalls = |kind| matches!(kind, FaultKind::Stall { .. });
        if let Some(fault) = args.fault.iter().find(|fault| !stalls(fault.kind)) {
            return Err(Failure::usage(format!(
                "--fault {fault}: the deadline test has room for stalls only; platoon rehearse \
                 takes the others"
            )));
        }
        if let Some(path) = &args.json {
            process::check_parent("--json", path)?;
        }
        let mut scope = scope(args);
        let nominal = scope.cells().into_iter().find(|cell| cell.rate_hz == args.rate_hz);
        let nominal = nominal.ok_or_else(|| Failure::usage("--loads: name one at least"))?;
        let ecus = rehearse::ecus(&rehearsal(args, &nominal)?)?;
        scope.ecus = ecus.len();
        Ok(Self { args, scope, ecus, stop: process::stop_flag()? })
    }

    fn run(&self, folder: &RunFolder) -> Result<Deadline, Failure> {
        let began = Instant::now();
        let cells = self.scope.cells();
        let total_s: f64 = cells.iter().map(|cell| cell.duration_s).sum();
        anstream::eprintln!(
            "{} cells, {total_s:.0} s and the time it takes to start them",
            cells.len()
        );
        let mut feeds = Feeds::default();
        let mut bus = None;
        let mut outcomes: Vec<CellOutcome> = Vec::new();
        for (number, cell) in cells.iter().enumerate() {
            let timed = self.time(cell, number, folder, &mut feeds)?;
            if timed.interrupted || self.stop.load(Ordering::Relaxed) {
                feeds.remove();
                return Err(Failure::cannot_start("interrupted: there is no table"));
            }
            if cell.subject == Subject::Bench {
                bus = Some(timed.backend.clone());
            }
            let outcome = CellOutcome::new(cell, timed, self.args.cpus.to_string());
            anstream::eprintln!("{:2}/{}  {}", number + 1, cells.len(), page::line(&outcome));
            outcomes.push(outcome);
        }
        feeds.remove();
        Ok(Deadline::new(outcomes, self.args, bus, began.elapsed().as_secs_f64()))
    }

    /// One cell beside its load; what it recorded is not kept.
    fn time(
        &self,
        cell: &Cell,
        number: usize,
        folder: &RunFolder,
        feeds: &mut Feeds,
    ) -> Result<Timed, Failure> {
        let args = rehearsal(self.args, cell)?;
        let own = RunFolder::open(&folder.path().join(format!("cell-{number}")))?;
        let feed = match cell.subject {
            Subject::Bench => None,
            Subject::Ecu => Some(feeds.of(&args, folder)?),
        };
        let cpus = environment().online_cpus.len();
        let mut generators = Generators::start(cell.load, cpus, own.path())?;
        let timed = match feed {
            None => rehearse::time(&args, &own),
            Some(feed) => alone::time(&args, cell, &self.ecus, (&feed, &own), &self.stop),
        };
        let ended = generators.casualties();
        drop(generators);
        remove(own.path());
        let mut timed = timed?;
        if ended > 0 {
            let load = cell.load.word();
            timed.notes.push(format!("{ended} process(es) of the load {load} ended early"));
        }
        Ok(timed)
    }
}

/// What the options ask for.
fn scope(args: &DeadlineArgs) -> Scope {
    let nominal_hz = args.rate_hz;
    let (rates_hz, ecu_rates_hz, loads) = match args.quick {
        true => (vec![nominal_hz], vec![nominal_hz], vec![Load::Idle, Load::All]),
        false => (args.rates.0.clone(), args.ecu_rates.0.clone(), args.loads.clone()),
    };
    let scope = Scope { rates_hz, ecu_rates_hz, loads, nominal_hz, slots: args.slots, ecus: 1 };
    scope.with_nominal()
}

/// The rehearsal that is timed in a cell.
fn rehearsal(args: &DeadlineArgs, cell: &Cell) -> Result<RehearseArgs, Failure> {
    let mut words = vec![
        args.scenario.clone(),
        format!("--bus={}", args.bus.word()),
        format!("--rate-hz={}", cell.rate_hz),
        format!("--duration-s={}", cell.duration_s),
        format!("--startup-grace-s={GRACE_S}"),
        format!("--cpus={}", args.cpus),
    ];
    words.extend(args.law_options.as_arguments());
    words.extend(args.fault.iter().map(|fault| format!("--fault={fault}")));
    let command = clap::Command::new("rehearse").no_binary_name(true);
    let matches = RehearseArgs::augment_args(command)
        .try_get_matches_from(words)
        .and_then(|matches| RehearseArgs::from_arg_matches(&matches));
    let rehearsal = matches.map_err(|error| Failure::usage(error.kind()))?;
    Ok(RehearseArgs { place: args.place.clone(), ..rehearsal })
}

fn remove(folder: &Path) {
    // What cannot be removed does no harm.
    let _ = fs::remove_dir_all(folder);
}
