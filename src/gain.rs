//! `platoon gain`: designs gains, certifies them, and says which one an ECU may use.

mod certify;
mod choice;
mod conditions;
mod figures;
mod fleet;
mod scan;
mod synthesise;

use clap::{Args, Subcommand};

use certificate::library;

use crate::failure::Failure;
use crate::summary::Verdict;

pub use choice::{Settled, is_looked_up, settled};

use certify::CertifyArgs;
use fleet::FleetArgs;
use scan::ScanArgs;
use synthesise::SynthesiseArgs;

/// Options of `gain`.
#[derive(Debug, Clone, Args)]
pub struct GainArgs {
    /// What to do.
    #[command(subcommand)]
    verb: GainVerb,
}

/// The verbs of `gain`.
#[derive(Debug, Clone, Subcommand)]
enum GainVerb {
    /// Design a gain, prove what it claims, and write both into a file.
    Synthesise(SynthesiseArgs),
    /// Check a gain file without any of the code that made it; exit status 1 when it is refused.
    Certify(CertifyArgs),
    /// Design a gain and a proof for each of many trucks that differ, or prove one gain for all.
    Fleet(FleetArgs),
    /// Scan all gains on a grid: which of them beat the published one, and what that costs.
    Scan(ScanArgs),
    /// List the gains that come with the program.
    List,
}

/// Runs the verb.
///
/// # Errors
/// When a file cannot be read or written, or makes no sense.
pub fn run(args: &GainArgs) -> Result<Verdict, Failure> {
    match &args.verb {
        GainVerb::Synthesise(args) => synthesise::run(args),
        GainVerb::Certify(args) => certify::run(args),
        GainVerb::Fleet(args) => fleet::run(args),
        GainVerb::Scan(args) => scan::run(args).map(|()| Verdict::Pass),
        GainVerb::List => list().map(|()| Verdict::Pass),
    }
}

fn list() -> Result<(), Failure> {
    for file in library::all().map_err(Failure::cannot_start)? {
        let gamma = file.first_gamma().map_or("-".to_owned(), |gamma| format!("{gamma}"));
        anstream::println!(
            "{:22} {:33} delay up to {} s, gamma {gamma:7} {}",
            file.name,
            conditions::shown(&file.plant) + ",",
            file.delay.longest_s,
            file.about
        );
    }
    anstream::println!(
        "\nCheck one with `platoon gain certify NAME`, drive with `platoon rehearse --gain NAME`."
    );
    Ok(())
}
