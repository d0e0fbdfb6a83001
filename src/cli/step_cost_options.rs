//! Options of `step-cost`.

use std::path::PathBuf;

use clap::Args;

use super::values::parse_set;

/// Options of `step-cost`.
#[derive(Debug, Clone, Args)]
pub struct StepCostArgs {
    /// Scenario: a built-in name (see `platoon scenarios`) or the path of a TOML file.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenario: String,
    /// Rate of the control loop in Hz.
    #[arg(long, value_name = "HZ", default_value_t = 1000,
        value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: u32,
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
