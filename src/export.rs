//! `platoon export`: a recorded run in the formats of other tools.
//!
//! The logs, candump and ASC, hold the frames of every bus as the rig saw them, with the kernel's
//! time where there is one. The tables, CSV and Parquet, hold the signals decoded at full rate: one
//! file per bus and message, a row per frame, a column per signal, empty where a page of a
//! multiplexed message or its sender has no value.

pub mod asc;
pub mod candump;
mod csv;
mod parquet;
mod table;

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use traces::{FrameRecord, Record, Topic};

use crate::cli::{ExportArgs, ExportFormat};
use crate::failure::Failure;
use crate::trace::{Events, Trace, seconds};

use table::Tables;

/// Writes a run in another format.
///
/// # Errors
/// When the trace cannot be read, or the files not be written.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let trace = Trace::open(&args.run)?;
    let out = args.out.clone().unwrap_or_else(|| default_out(&trace, args.to));
    let times = seconds(args.from, args.until, "--until")?;
    let (events, bus) = (frames(&trace, times, args.bus)?, args.bus);
    let done = match args.to {
        ExportFormat::Candump | ExportFormat::Asc => log(&trace, events, args.to, &out)?,
        ExportFormat::Csv | ExportFormat::Parquet => tables(events, args.to, &out)?,
    };
    if done.frames == 0 {
        let of_bus = bus.map_or_else(String::new, |bus| format!(" of bus {bus}"));
        anstream::eprintln!("warning: the trace has no frame{of_bus} in that time");
    }
    if let Some(damage) = &done.damage {
        anstream::eprintln!("warning: the file is damaged: {damage}");
    }
    anstream::println!("{} frames in {}", done.frames, out.display());
    Ok(())
}

/// What an export came to.
struct Done {
    frames: u64,
    damage: Option<String>,
}

/// The frames that were on the buses.
fn frames(trace: &Trace, times: Range<u64>, bus: Option<u8>) -> Result<Events, Failure> {
    let is_asked = move |topic| match topic {
        Topic::Frames(on) => bus.is_none_or(|bus| bus == on),
        _ => false,
    };
    trace.events(is_asked, times)
}

/// Beside the trace, with the format's ending; a folder for tables.
fn default_out(trace: &Trace, format: ExportFormat) -> PathBuf {
    trace.path().with_extension(match format {
        ExportFormat::Candump => "log",
        ExportFormat::Asc => "asc",
        ExportFormat::Csv => "csv.d",
        ExportFormat::Parquet => "parquet.d",
    })
}

/// Wall clock of a frame \[ns since 1970\]: the kernel's where it stamped, else bench time on the
/// clock of the start.
fn wall_ns(trace: &Trace, record: &FrameRecord) -> u64 {
    match record.stamp_ns {
        0 => trace.start_wall_ns().saturating_add(record.time_ns),
        stamp_ns => stamp_ns,
    }
}

fn log(
    trace: &Trace,
    mut events: Events,
    format: ExportFormat,
    out: &Path,
) -> Result<Done, Failure> {
    let failed = |error: io::Error| cannot_write(out, &error);
    let mut file = BufWriter::new(File::create(out).map_err(failed)?);
    if format == ExportFormat::Asc {
        asc::write_head(&mut file, trace.start_wall_ns()).map_err(failed)?;
    }
    let mut frames = 0;
    for event in &mut events {
        let Record::Frame(record) = event.record else { continue };
        let written = match format {
            ExportFormat::Asc => asc::write(&mut file, &record),
            _ => {
                let wall_ns = wall_ns(trace, &record);
                candump::write(&mut file, wall_ns, &trace.interface(record.bus), &record)
            }
        };
        written.map_err(failed)?;
        frames += 1;
    }
    if format == ExportFormat::Asc {
        asc::write_foot(&mut file).map_err(failed)?;
    }
    file.flush().map_err(failed)?;
    Ok(Done { frames, damage: events.damage() })
}

fn tables(mut events: Events, format: ExportFormat, out: &Path) -> Result<Done, Failure> {
    fs::create_dir_all(out).map_err(|error| cannot_write(out, &error))?;
    let open: table::Open = match format {
        ExportFormat::Parquet => parquet::open,
        _ => csv::open,
    };
    let mut tables = Tables::new(out.to_owned(), open);
    let mut frames = 0;
    for event in &mut events {
        let Record::Frame(record) = event.record else { continue };
        tables.add(&record).map_err(|error| cannot_write(out, &error))?;
        frames += 1;
    }
    tables.finish().map_err(|error| cannot_write(out, &error))?;
    Ok(Done { frames, damage: events.damage() })
}

fn cannot_write(path: &Path, error: &io::Error) -> Failure {
    Failure::cannot_start(format!(
        "cannot write {}: {error}; name another place with -o",
        path.display()
    ))
}
