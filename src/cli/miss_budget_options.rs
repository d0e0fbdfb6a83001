//! Options of `miss-budget`.

use std::path::PathBuf;

use clap::Args;

use super::values::parse_set;

/// Options of `miss-budget`.
#[derive(Debug, Clone, Args)]
pub struct MissBudgetArgs {
    /// Scenario: a built-in name (see `platoon scenarios`) or the path of a TOML file.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenario: String,
    /// Rate of the control loop in Hz. A miss lasts one period: many misses at a high rate are as
    /// long as one at a low rate, and take longer to replay.
    #[arg(long, value_name = "HZ", default_value_t = 100,
        value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: u32,
    /// The truck whose ECU misses its deadlines; all of them at once when left out.
    #[arg(long, value_name = "N")]
    pub truck: Option<u8>,
    /// Most misses in a row that are tried.
    #[arg(long, value_name = "K", default_value_t = 64,
        value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub misses_max: u32,
    /// Clearance that may be lost and still be called harmless, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.05)]
    pub harmless_m: f64,
    /// Instants, evenly spread over the run, at which every number of misses is tried first.
    #[arg(long, value_name = "N", default_value_t = 16,
        value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub instants: u32,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Override a number of the scenario; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,
    /// Where to write every figure as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
