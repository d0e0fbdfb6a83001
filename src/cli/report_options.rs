//! How the page of a run is asked for.

use std::path::PathBuf;

use clap::Args;

/// Options of `report`.
#[derive(Debug, Clone, Args)]
pub struct ReportArgs {
    /// The trace of the run, or its folder; a summary.json beside it is used.
    #[arg(value_name = "RUN.mcap")]
    pub run: PathBuf,
    /// The trace of another run, to be shown over the first one.
    #[arg(value_name = "OTHER.mcap")]
    pub other: Option<PathBuf>,
    /// Where to write the page (default: report.html beside the first trace).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}
