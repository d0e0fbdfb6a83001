//! `platoon blame`: injects faults of known kinds into a real loop and counts the causes found.
//!
//! Every kind has a run of its own: a process with a sentinel, a rig and one ECU, all of them the
//! product's, in real time over a real bus, into which a fault is put every few dozen ticks. What
//! the ECU recorded of its lost slots is then held against the times of the faults. The inquest
//! knows nothing of them.

mod accomplices;
mod conductor;
mod kind;
mod machine;
mod matrix;
mod strikes;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::ValueEnum;
use platoon_dbc::Clock;
use rustix::process::{Pid, Signal, kill_process};
use traces::{Record, TickRecord, Topic};

pub use kind::Kind;

use crate::cli::{BlameArgs, Word};
use crate::clock::HostClock;
use crate::failure::Failure;
use crate::process;
use crate::run_folder::RunFolder;
use crate::summary::Verdict;
use crate::trace::Trace;
use machine::Aftermath;
use matrix::Row;
use strikes::{Beat, FIRST_NS, Strike, Turn};

/// Injects the faults, prints the matrix and writes the JSON.
///
/// # Errors
/// When a run cannot start, is interrupted, or left nothing that can be judged.
pub fn run(args: &BlameArgs) -> Result<Verdict, Failure> {
    if let (true, [kind]) = (args.under_test, args.kind.as_slice()) {
        return machine::run(args, *kind).map(|()| Verdict::Pass);
    }
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let stop = process::stop_flag()?;
    let folder = RunFolder::create(args.out.as_deref(), "blame")?;
    let kinds = if args.kind.is_empty() { Kind::value_variants() } else { &args.kind };
    let mut rows = Vec::new();
    for &kind in kinds {
        anstream::eprintln!("{}: {} faults", kind.word(), args.each);
        rows.push(row(args, kind, &folder, &stop)?);
    }
    matrix::print(&rows);
    if let Some(path) = &args.json {
        process::write_json(path, &rows)?;
    }
    let is_good = rows.iter().all(Row::is_good);
    Ok(if is_good { Verdict::Pass } else { Verdict::Fail })
}

/// One kind's run, and what came of it.
fn row(
    args: &BlameArgs,
    kind: Kind,
    folder: &RunFolder,
    stop: &Arc<AtomicBool>,
) -> Result<Row, Failure> {
    let own = RunFolder::open(&folder.path().join(kind.word()))?;
    let mut child = start(args, kind, &own)?;
    let mut strikes = Vec::new();
    if kind == Kind::HostPause {
        strikes = pause_now_and_then(args, &mut child, stop)?;
    }
    let status = child.wait().map_err(Failure::cannot_start)?;
    if !status.success() || stop.load(Ordering::Relaxed) {
        return Err(Failure::cannot_start(format!("{}: its run ended early", kind.word())));
    }
    let aftermath: Aftermath = process::read_json(&Aftermath::file(&own)).ok_or_else(|| {
        Failure::cannot_start(format!("{}: its run left nothing to judge", kind.word()))
    })?;
    strikes.extend(aftermath.strikes);
    Ok(Row::judge(kind, kind.rate_hz(args.rate_hz), &strikes, &ticks(&own)?))
}

/// Starts the machine under test.
fn start(args: &BlameArgs, kind: Kind, folder: &RunFolder) -> Result<Child, Failure> {
    let program = std::env::current_exe().map_err(Failure::cannot_start)?;
    let mut command = Command::new(program);
    command.args(["blame", "--under-test", "--kind", &kind.word()]);
    command.args(["--each", &args.each.to_string(), "--rate-hz", &args.rate_hz.to_string()]);
    command.args(["--bus", &args.bus.word()]).arg("--out").arg(folder.path());
    if !args.place.interfaces.is_empty() {
        command.args(["--interfaces", &args.place.interfaces.join(",")]);
    }
    if let Some(port) = args.place.port {
        command.args(["--port", &port.to_string()]);
    }
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    command.spawn().map_err(Failure::cannot_start)
}

/// Stops the machine for a moment now and then, and in the end for good. It notices a stop as the
/// guest of a hypervisor does: everything on it stands still, and the clock does not.
fn pause_now_and_then(
    args: &BlameArgs,
    child: &mut Child,
    stop: &AtomicBool,
) -> Result<Vec<Strike>, Failure> {
    let period_ns = 1_000_000_000 / u64::from(args.rate_hz);
    let pid = Pid::from_child(child);
    let send = |signal| kill_process(pid, signal).map_err(Failure::cannot_start);
    let words = child.stdout.take().map(BufReader::new);
    if words.and_then(|words| words.lines().next()).is_none() {
        return Ok(Vec::new());
    }
    let (clock, mut strikes) = (HostClock::default(), Vec::new());
    let began_ns = clock.now_ns();
    let mut beat = Beat::new(period_ns, Kind::HostPause.spacing(), args.each);
    while !stop.load(Ordering::Relaxed) {
        match beat.at(FIRST_NS + clock.now_ns() - began_ns) {
            Turn::Rest => clock.sleep_until_ns(clock.now_ns() + period_ns / 3),
            Turn::End => break,
            Turn::Strike => {
                let from_ns = clock.now_ns();
                send(Signal::STOP)?;
                clock.sleep_until_ns(from_ns + period_ns * 5 / 2);
                send(Signal::CONT)?;
                strikes.push(Strike { from_ns, to_ns: clock.now_ns() });
            }
        }
    }
    send(Signal::TERM)?;
    Ok(strikes)
}

/// Every tick that the ECU recorded once it had settled, in order.
fn ticks(folder: &RunFolder) -> Result<Vec<TickRecord>, Failure> {
    let trace = Trace::open(&folder.part(&process::ecu_name(0)))?;
    // The tick before a strike may be a part of it.
    let events = trace.events(|topic| matches!(topic, Topic::Tick(_)), FIRST_NS / 2..u64::MAX)?;
    let ticks = events.filter_map(|event| match event.record {
        Record::Tick(tick) => Some(*tick),
        _ => None,
    });
    Ok(ticks.collect())
}
