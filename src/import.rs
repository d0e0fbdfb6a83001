//! `platoon import`: a log of another tool as a trace of ours, to be played, exported or read.
//!
//! candump and ASC logs are read here; python-can's `can.logconvert` makes one of them of BLF, MF4
//! and others. Every interface or channel of the log becomes a truck's bus, in the order of their
//! names. What was in the log is what is in the trace: an ECU that consumed it is not.

mod asc;
mod candump;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use platoon_dbc::{Frame, Profile, message_info};
use traces::{
    Attachment, FrameRecord, MergeOptions, Overflow, Recorder, RecorderOptions, Source, TRUCKS_MAX,
};

use crate::cli::ImportArgs;
use crate::failure::Failure;
use crate::process;

/// The rig's node in the DBC: what it sent counts as sent by the recording node.
const RIG: &str = "Rig";
/// Faulty lines that are told one by one.
const FAULTS_SHOWN: usize = 3;

/// A frame of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Logged {
    /// Time as the log has it \[ns\]: since 1970, or since its start.
    pub time_ns: u64,
    /// Interface or channel.
    pub interface: String,
    /// The frame.
    pub frame: Frame,
}

/// What a line of a log is.
#[derive(Debug, Clone, PartialEq)]
pub enum Line {
    /// A frame.
    Frame(Logged),
    /// Something else that belongs there.
    Other,
    /// Nothing that is known.
    Faulty,
}

/// Reads a log and writes a trace.
///
/// # Errors
/// When the log cannot be read or holds no frame, or the trace not be written.
pub fn run(args: &ImportArgs) -> Result<(), Failure> {
    process::check_parent("-o", &args.out)?;
    let log = read(&args.log)?;
    let buses = buses(&log.frames, &args.log)?;
    let start_ns = log.frames.iter().map(|logged| logged.time_ns).min().unwrap_or(0);
    let part = record(&args.out, &log.frames, &buses, start_ns)?;
    let merged =
        traces::merge(std::slice::from_ref(&part), &args.out, &options(args, &log, &buses));
    // A part that cannot be removed only takes room.
    let _ = fs::remove_file(part);
    merged.map_err(Failure::cannot_start)?;
    let names: Vec<String> =
        buses.iter().map(|(name, bus)| format!("{name} as bus {bus}")).collect();
    anstream::println!(
        "{} frames of {} in {}",
        log.frames.len(),
        names.join(", "),
        args.out.display()
    );
    if !log.faults.is_empty() {
        let shown = log.faults.iter().take(FAULTS_SHOWN).map(usize::to_string);
        anstream::eprintln!(
            "warning: {} lines are no frames, the first: line {}",
            log.faults.len(),
            shown.collect::<Vec<_>>().join(", ")
        );
    }
    Ok(())
}

/// A log as it was read.
struct Log {
    frames: Vec<Logged>,
    /// Numbers of lines that could not be read.
    faults: Vec<usize>,
}

fn read(path: &Path) -> Result<Log, Failure> {
    let name = path.display();
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let is_asc = ending.eq_ignore_ascii_case("asc");
    let other = ["blf", "mf4", "mdf", "trc", "db"];
    if other.iter().any(|known| ending.eq_ignore_ascii_case(known)) {
        return Err(Failure::usage(format!(
            "{name}: {ending} logs are not read here; make a candump log of it with python-can: \
             `python -m can.logconvert {name} {}`",
            path.with_extension("log").display()
        )));
    }
    let failed = |error| Failure::cannot_start(format!("cannot read {name}: {error}"));
    let mut reader = BufReader::new(File::open(path).map_err(failed)?);
    let mut log = Log { frames: Vec::new(), faults: Vec::new() };
    let (mut head, mut bytes, mut number) = (asc::Head::default(), Vec::new(), 0);
    loop {
        bytes.clear();
        if reader.read_until(b'\n', &mut bytes).map_err(failed)? == 0 {
            break;
        }
        number += 1;
        let line = String::from_utf8_lossy(&bytes);
        let read = if is_asc { head.line(line.trim_end()) } else { candump::line(line.trim_end()) };
        match read {
            Line::Frame(logged) => log.frames.push(logged),
            Line::Other => {}
            Line::Faulty => log.faults.push(number),
        }
    }
    if log.frames.is_empty() {
        return Err(Failure::usage(format!(
            "{name}: no frame in it; give a log of `candump -l`, or an ASC log named .asc"
        )));
    }
    Ok(log)
}

/// The bus of each interface.
fn buses(frames: &[Logged], path: &Path) -> Result<BTreeMap<String, u8>, Failure> {
    let mut buses: BTreeMap<String, u8> = BTreeMap::new();
    for logged in frames {
        if !buses.contains_key(&logged.interface) {
            buses.insert(logged.interface.clone(), 0);
        }
    }
    if buses.len() > TRUCKS_MAX {
        return Err(Failure::usage(format!(
            "{}: {} interfaces; a trace has at most {TRUCKS_MAX} buses",
            path.display(),
            buses.len()
        )));
    }
    for (bus, number) in buses.values_mut().zip(0..) {
        *bus = number;
    }
    Ok(buses)
}

/// Records the frames as a rig would have.
fn record(
    out: &Path,
    frames: &[Logged],
    buses: &BTreeMap<String, u8>,
    start_ns: u64,
) -> Result<PathBuf, Failure> {
    let mut name = out.as_os_str().to_owned();
    name.push(".rig.part.mcap");
    let path = PathBuf::from(name);
    let options = RecorderOptions {
        start_wall_ns: start_ns,
        overflow: Overflow::Wait,
        interfaces: buses.keys().cloned().collect(),
        ..RecorderOptions::new(Source::Rig)
    };
    let mut recorder = Recorder::start(&path, options).map_err(Failure::cannot_start)?;
    for Logged { time_ns, interface, frame } in frames {
        let sender = message_info(frame.id()).map(|info| info.sender);
        recorder.push(FrameRecord {
            bus: buses.get(interface).copied().unwrap_or(0),
            time_ns: time_ns - start_ns,
            stamp_ns: 0,
            tick: 0,
            tx: sender == Some(RIG),
            frame: *frame,
        });
    }
    match recorder.finish().error {
        Some(error) => Err(Failure::cannot_start(format!("{}: {error}", path.display()))),
        None => Ok(path),
    }
}

fn options(args: &ImportArgs, log: &Log, buses: &BTreeMap<String, u8>) -> MergeOptions {
    let is_fd = log.frames.iter().any(|logged| logged.frame.flags().is_fd);
    let (name, profile) =
        if is_fd { ("platoon.dbc", Profile::Fd) } else { ("j1939.dbc", Profile::J1939) };
    let named = buses.iter().map(|(interface, bus)| (format!("truck{bus}"), interface.clone()));
    let origin = ("imported_from".to_owned(), args.log.display().to_string());
    MergeOptions {
        attachments: vec![Attachment {
            name: name.into(),
            media_type: "text/plain".into(),
            data: profile.dbc().as_bytes().to_vec(),
        }],
        metadata: BTreeMap::from([
            ("platoon.run".to_owned(), BTreeMap::from([origin])),
            ("platoon.bus".to_owned(), named.collect()),
        ]),
        ..MergeOptions::default()
    }
}
