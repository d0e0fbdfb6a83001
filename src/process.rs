//! What the processes of a run have in common: how they are stopped, what they write.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use controller_rt::{Realtime, Report};
use platoon_dbc::Bus;
use serde::Serialize;
use serde::de::DeserializeOwned;
use signal_hook::consts::{SIGINT, SIGTERM};
use traces::{Overflow, Recorder, RecorderOptions, Source};
use vcan_setup::realtime::{self, Obtained, Request};

use crate::failure::Failure;
use crate::run_folder::RunFolder;

/// Priority of the rig: it must have published before an ECU ticks.
pub const RIG_PRIORITY: u8 = 80;
/// Priority of an ECU.
pub const ECU_PRIORITY: u8 = 79;

/// A flag that Ctrl-C and SIGTERM set.
///
/// # Errors
/// When the system refuses the handlers.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&flag))
            .map_err(|error| Failure::cannot_start(format!("cannot catch signals: {error}")))?;
    }
    Ok(flag)
}

/// Ends this process when the one that started it is gone: no ECU may outlive its run.
pub fn die_with_parent() {
    // Failing that, the rig falls silent and the ECU ends after two seconds all the same.
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::TERM));
}

/// Starts the recorder of one process of a run.
///
/// # Errors
/// When its file cannot be made.
pub fn recorder(
    folder: &RunFolder,
    source: Source,
    overflow: Overflow,
    interfaces: Vec<String>,
) -> Result<Recorder, Failure> {
    let options = RecorderOptions { overflow, interfaces, ..RecorderOptions::new(source) };
    Recorder::start(&folder.part(&source.to_string()), options).map_err(Failure::cannot_start)
}

/// Asks for real-time privileges for the calling thread and takes what comes.
pub fn become_realtime(priority: u8, cpu: Option<usize>) -> Obtained {
    realtime::acquire(&Request {
        priority: Some(priority),
        cpus: cpu.into_iter().collect(),
        lock_memory: true,
        hold_cpu_latency: true,
    })
}

/// Locks the memory and keeps the CPUs out of deep idle states, as far as that is allowed, while
/// what is returned lives.
pub fn hold_still() -> Obtained {
    realtime::acquire(&Request { lock_memory: true, hold_cpu_latency: true, ..Request::default() })
}

/// What was obtained, in the words of a report.
pub fn as_reported(obtained: &Obtained) -> Realtime {
    Realtime {
        policy: obtained.policy.name().into(),
        priority: obtained.priority.into(),
        cpus: obtained.cpus.clone(),
        mlock: obtained.mlock,
        cpu_latency_held: obtained.cpu_latency.is_some(),
    }
}

/// A bus, for places that log it.
pub fn bus_names(buses: &[Box<dyn Bus>]) -> Vec<String> {
    buses.iter().map(|bus| bus.name().to_owned()).collect()
}

/// Name of an ECU's process.
pub fn ecu_name(truck: u8) -> String {
    Source::Ecu(truck).to_string()
}

/// Name of the rig's process.
pub fn rig_name() -> String {
    Source::Rig.to_string()
}

/// A file that is written at the end of a long run must have a place from its start.
///
/// # Errors
/// When it has none.
pub fn check_parent(option: &str, path: &Path) -> Result<(), Failure> {
    let parent = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    if parent.is_dir() && !path.is_dir() {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{option} {}: cannot be written; name a file in a folder that exists",
        path.display()
    )))
}

/// Room kept for what is written at the end of a run \[bytes\]; the largest so far take a quarter.
const JSON_ROOM: usize = 128 << 10;

/// Keeps room for what [`write_json`] will write there: a recording may have filled the disk by
/// then, and that is just when somebody wants to know how the run went.
///
/// # Errors
/// When there is no room even now.
pub fn reserve_json(path: &Path) -> Result<(), Failure> {
    fs::write(partial(path), vec![0; JSON_ROOM]).map_err(|error| cannot_write(path, &error))
}

/// Gives back room that nothing was written into.
pub fn release_json(path: &Path) {
    // What cannot be removed does no harm.
    let _ = fs::remove_file(partial(path));
}

/// Writes a value as JSON, appearing whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let mut text = serde_json::to_string_pretty(value).map_err(|e| cannot_write(path, &e))?;
    text.push('\n');
    let write = || {
        // Not truncated: room that was kept is not given back on a full disk.
        let options = fs::File::options().create(true).write(true).truncate(false).to_owned();
        let mut file = options.open(partial(path))?;
        file.write_all(text.as_bytes())?;
        file.set_len(text.len() as u64)?;
        fs::rename(partial(path), path)
    };
    write().map_err(|error: std::io::Error| cannot_write(path, &error))
}

fn partial(path: &Path) -> PathBuf {
    path.with_extension("json.partial")
}

fn cannot_write(path: &Path, reason: &impl std::fmt::Display) -> Failure {
    Failure::cannot_start(format!("cannot write {}: {reason}", path.display()))
}

/// Reads what another process of this run wrote; `None` when it left nothing readable.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&fs::read(path).ok()?).ok()
}

/// The report an ECU's process left.
pub fn ecu_report(folder: &RunFolder, truck: u8) -> Option<Report> {
    read_json(&folder.process_report(&ecu_name(truck)))
}
