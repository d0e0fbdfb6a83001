//! `platoon compare`: the paper's claims, tables and figures beside our own runs.
//!
//! ```text
//! design -> campaign -> runs -> claims, improvements, requirements, figures -> page, files
//! ```
//!
//! Everything after the runs is a pure function of them, so the same seeds give the same bytes.

mod arm;
mod claim;
mod claims;
mod comparison;
mod design;
mod errata;
pub(crate) mod figure;
mod figures;
mod files;
mod improvement;
mod markdown;
mod measure;
mod page;
pub(crate) mod picture;
mod requirement;
mod road;
pub(crate) mod spread;
#[cfg(test)]
mod tests;
mod tuning;
mod uniformity;

use std::time::Instant;

use comparison::Comparison;
use design::{Design, Runs};

use crate::campaign;
use crate::cli::CompareArgs;
use crate::failure::Failure;
use crate::process;
use crate::progress::ProgressLine;
use crate::summary::Verdict;

/// Makes the runs, prints the tables, writes what is asked for.
///
/// # Errors
/// When a run cannot start or a file cannot be written.
pub fn run(args: &CompareArgs) -> Result<Verdict, Failure> {
    files::check(args)?;
    let threads = args.threads.map_or_else(campaign::threads, usize::from);
    let stop = process::stop_flag()?;
    let line = ProgressLine::counting();
    let tell = |runs: usize, share: f64| line.show_share(share, &format!("{runs} runs done"));
    let began = Instant::now();
    let verdict = if args.tune {
        tuning::run(args.rate_hz, threads, &stop, &tell)
    } else {
        let design =
            Design { seeds: args.seeds.into(), rate_hz: args.rate_hz, parts: args.only.clone() };
        let arms = design.arms();
        let cells = design::cells(&arms)?;
        anstream::eprintln!("{} runs in {threads} thread(s)", cells.len());
        let outcomes = campaign::run(&cells, threads, &stop, &tell)?;
        line.clear();
        outcomes.map(|outcomes| conclude(args, &design, &Runs::new(&arms, outcomes))).transpose()
    };
    line.clear();
    let verdict = verdict?.unwrap_or_else(|| {
        anstream::eprintln!("interrupted: nothing is compared or written");
        Verdict::Fail
    });
    anstream::eprintln!("took {:.0} s", began.elapsed().as_secs_f64());
    Ok(verdict)
}

fn conclude(args: &CompareArgs, design: &Design, runs: &Runs) -> Result<Verdict, Failure> {
    let (comparison, figures) = Comparison::new(design, runs);
    anstream::println!("{}", page::page(&comparison));
    files::write(args, &comparison, &figures)?;
    Ok(comparison.verdict)
}
