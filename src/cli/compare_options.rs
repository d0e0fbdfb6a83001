//! How the paper is compared with our runs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// Options of `compare`.
#[derive(Debug, Clone, Args)]
pub struct CompareArgs {
    /// How many seeds of V2V delay, from 1001 on.
    #[arg(long, value_name = "N", default_value_t = 20,
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub seeds: u16,
    /// Make these parts of the comparison only; all when left out.
    #[arg(long, value_enum, value_name = "PART,...", value_delimiter = ',')]
    pub only: Vec<Part>,
    /// Rate of the control loop in Hz; the check of loop rates says what it costs.
    #[arg(long, value_name = "HZ", default_value_t = 50,
          value_parser = clap::value_parser!(u32).range(10..=1000))]
    pub rate_hz: u32,
    /// Threads to run in; as many as there are CPUs when left out. The results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Folder for everything: results.md, results.json, pictures/ and the figures' numbers in
    /// data/.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where to write the tables as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Where to write the tables as Markdown; the pictures go to pictures/ beside it.
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Tune the delay-compensated baseline on seeds 1 to 20 instead, and print what comes of it.
    #[arg(long, conflicts_with_all = ["out", "json", "markdown", "only", "seeds"])]
    pub tune: bool,
}

/// Parts of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Section III-A, Table III, Figs. 4 to 6.
    Platooning,
    /// Lemma 1: the same manoeuvre at other times.
    Uniformity,
    /// Section III-B, Figs. 8 to 10.
    Merging,
    /// Section III-C and IV, Figs. 12 to 16, 19, 20, and the places of obstacle 2.
    Avoidance,
    /// The same runs at other loop rates, up to 1000 Hz.
    Rates,
    /// Every scenario of the bench against its own criteria.
    Scenarios,
}
