//! What is done with a recorded run.

use std::fmt;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::values::{parse_seconds, parse_set};
use super::{BusKind, BusPlace, SolverKind};
use crate::capture::Trigger;

/// What of a rehearsal is kept at full rate.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct CaptureArgs {
    /// Keep the trace at full rate only around these events: miss, qp-fail, guard, clearance<METRES
    /// (to an obstacle), error>METRES (to the truck ahead). The rest is thinned.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub capture: Vec<Trigger>,
    /// Seconds before an event that are kept at least; it begins with the snapshot before them, at
    /// most 10 s earlier, so that it replays.
    #[arg(long, value_name = "S", requires = "capture", default_value_t = 2.0,
        value_parser = parse_seconds)]
    pub capture_before: f64,
    /// Seconds behind an event that are kept.
    #[arg(long, value_name = "S", requires = "capture", default_value_t = 1.0,
        value_parser = parse_seconds)]
    pub capture_after: f64,
}

impl fmt::Display for CaptureArgs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<String> = self.capture.iter().map(Trigger::to_string).collect();
        let (before, after) = (self.capture_before, self.capture_after);
        write!(f, "{}, {before} s before, {after} s behind", words.join(","))
    }
}

/// Options of `replay`.
#[derive(Debug, Clone, Args)]
pub struct ReplayArgs {
    /// A run.mcap, or the folder it is in.
    #[arg(value_name = "RUN.mcap")]
    pub run: PathBuf,
    /// Recompute one truck's ECU only.
    #[arg(long, value_name = "N")]
    pub ecu: Option<u8>,
    /// Compare from this bench time on, in seconds; recomputed from the snapshot before it.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub from: Option<f64>,
    /// Compare up to this bench time, in seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub to: Option<f64>,
    /// What if: change a number of the law (law.*) or of what an ECU is told (trucks.N.mass_kg);
    /// what it leads to is told, and is no failure. May be given more than once.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,
    /// Have every QP solved by this solver too, and compare: clarabel.
    #[arg(long, value_enum)]
    pub solver: Option<SolverKind>,
    /// Where to write the outcome as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Options of `diff`.
#[derive(Debug, Clone, Args)]
pub struct DiffArgs {
    /// A run.mcap, or the folder it is in.
    #[arg(value_name = "A")]
    pub a: PathBuf,
    /// Another one.
    #[arg(value_name = "B")]
    pub b: PathBuf,
    /// Compare one truck's ECU only.
    #[arg(long, value_name = "N")]
    pub ecu: Option<u8>,
    /// Where to write the outcome as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Options of `export`.
#[derive(Debug, Clone, Args)]
pub struct ExportArgs {
    /// A run.mcap, or the folder it is in.
    #[arg(value_name = "RUN.mcap")]
    pub run: PathBuf,
    /// Format.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub to: ExportFormat,
    /// File for a log, folder for tables (default: beside the run).
    #[arg(short, long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// One truck's bus only.
    #[arg(long, value_name = "N")]
    pub bus: Option<u8>,
    /// From this bench time on, in seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub from: Option<f64>,
    /// Up to this bench time, in seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub until: Option<f64>,
}

/// Formats of `export`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// The log of can-utils' candump; python-can turns it into BLF, MF4 and others.
    Candump,
    /// Vector's text log.
    Asc,
    /// Decoded signals: a file per bus and message, units in the head.
    Csv,
    /// The same, units in the schema's metadata.
    Parquet,
}

/// Options of `play`.
#[derive(Debug, Clone, Args)]
pub struct PlayArgs {
    /// A run.mcap, or the folder it is in.
    #[arg(value_name = "RUN.mcap")]
    pub run: PathBuf,
    /// Bus to play on.
    #[arg(long, value_enum, default_value_t = BusKind::Auto)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// How many times as fast as it was.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
    /// Begin again at the end, until interrupted.
    #[arg(long = "loop")]
    pub repeats: bool,
    /// Begin with this tick of the rig.
    #[arg(long, value_name = "N")]
    pub from_tick: Option<u32>,
    /// End at this bench time, in seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub until: Option<f64>,
    /// Play what one side sent: rig (to drive ECUs), ecu (to drive the rig), or all.
    #[arg(long, value_enum, default_value_t = Side::All)]
    pub sent_by: Side,
    /// Play these messages only, by name or hexadecimal identifier.
    #[arg(long, value_name = "NAME|ID,...", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Play one truck's bus only.
    #[arg(long, value_name = "N")]
    pub truck: Option<u8>,
    /// Where to write what became of the timing as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Whose frames are played.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Side {
    /// Everybody's.
    All,
    /// The rig's.
    Rig,
    /// The ECU's.
    Ecu,
}

/// Options of `extract`.
#[derive(Debug, Clone, Args)]
pub struct ExtractArgs {
    /// A run.mcap, or the folder it is in.
    #[arg(value_name = "RUN.mcap")]
    pub run: PathBuf,
    /// Tick of interest.
    #[arg(long, value_name = "T")]
    pub tick: u32,
    /// Seconds before it to keep.
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = parse_seconds)]
    pub before: f64,
    /// Seconds behind it to keep.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = parse_seconds)]
    pub after: f64,
    /// Keep one truck's ECU and bus only.
    #[arg(long, value_name = "N")]
    pub ecu: Option<u8>,
    /// The extract.
    #[arg(short, long, value_name = "FILE", default_value = "extract.mcap")]
    pub out: PathBuf,
}

/// Options of `import`.
#[derive(Debug, Clone, Args)]
pub struct ImportArgs {
    /// A log of `candump -l`, or an ASC log whose name ends in .asc.
    #[arg(value_name = "LOG")]
    pub log: PathBuf,
    /// The trace.
    #[arg(short, long, value_name = "RUN.mcap")]
    pub out: PathBuf,
}
