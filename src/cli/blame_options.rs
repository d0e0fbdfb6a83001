//! Options of `blame`.

use std::path::PathBuf;

use clap::Args;

use super::{BusKind, BusPlace};
use crate::blame::Kind;

/// Options of `blame`.
#[derive(Debug, Clone, Args)]
pub struct BlameArgs {
    /// Kinds of fault to inject; all of them when left out.
    #[arg(long, value_enum, value_name = "NAMES", value_delimiter = ',')]
    pub kind: Vec<Kind>,
    /// Faults of each kind.
    #[arg(long, value_name = "N", default_value_t = 200,
        value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub each: u32,
    /// Rate of the control loop in Hz; the frame flood runs at a higher one of its own.
    #[arg(long, value_name = "HZ", default_value_t = 1000,
        value_parser = clap::value_parser!(u32).range(100..=2_000))]
    pub rate_hz: u32,
    /// Bus between rig and ECU; not loopback.
    #[arg(long, value_enum, default_value_t = BusKind::Udp)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// Folder for what each kind's run recorded (default: `runs/<time>-blame`).
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where to write every figure as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Be the machine under test for the one kind named, with its files in --out.
    #[arg(long, hide = true)]
    pub under_test: bool,
}
