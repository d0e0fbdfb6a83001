//! `platoon bench`: the rig as a process of its own, and beside it the ECUs it is told to host.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use bench_sim::rig::{self, Progress, RunEnd, RunOptions, RunReport};
use bench_sim::{Results, Rig, Scenario};
use controller_rt::{Config, Ecu, Ending, Realtime, Report};
use law::Calibration;
use platoon_dbc::{Bus, Clock, Emulated, Loopback};
use serde::{Deserialize, Serialize};
use traces::{Overflow, Recorder, Source};

use crate::bus::BusChoice;
use crate::calibration;
use crate::cli::{BenchArgs, BusTimingKind, RunArgs, V2vDelay};
use crate::clock::{HostClock, wall_ns};
use crate::failure::Failure;
use crate::gain;
use crate::process;
use crate::progress::ProgressLine;
use crate::run_folder::RunFolder;
use crate::stall::stalling;
use crate::summary::Verdict;
use crate::witness::HostWitness;

/// How long ECUs may take to get ready that were started together with the rig \[ns\].
const SUPERVISED_READY_NS: u64 = 30_000_000_000;
/// Frames a hosted ECU's loopback bus holds: a second of silence on either side.
pub const LOOPBACK_FRAMES: usize = 8192;

/// What the rig's process leaves behind for the one that supervises it.
#[derive(Debug, Serialize, Deserialize)]
pub struct RigReport {
    /// What the run came to.
    pub results: Results,
    /// How well the rig kept time.
    pub pace: RunReport,
    /// The ECUs hosted beside the rig.
    pub hosted: Vec<Report>,
    /// Real-time privileges of the rig.
    pub realtime: Realtime,
    /// Records that did not reach the trace, in words; none when all did.
    pub recording: Option<String>,
}

/// One line on standard output for the process that supervises this one.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProgressMessage {
    /// Waiting for this many ECUs.
    Preparing(usize),
    /// Bench time \[s\].
    Running(f64),
}

/// Loads a scenario with everything the command line says about it.
///
/// # Errors
/// When it cannot be run.
pub fn load_scenario(
    name: &str,
    run: &RunArgs,
    v2v_delay: Option<V2vDelay>,
) -> Result<Scenario, Failure> {
    let mut sets: Vec<(String, String)> =
        v2v_delay.map(V2vDelay::as_sets).into_iter().flatten().collect();
    sets.extend(
        run.duration_s.map(|s| ("duration_s".to_owned(), toml::Value::Float(s).to_string())),
    );
    sets.extend(run.set.iter().cloned());
    Scenario::load(name, &sets).map_err(Failure::usage)
}

/// Runs the rig until the scenario ends or somebody stops it.
///
/// # Errors
/// When it cannot start.
pub fn run(args: &BenchArgs) -> Result<Verdict, Failure> {
    if args.supervised {
        process::die_with_parent();
    }
    let stop = process::stop_flag()?;
    let scenario = load_scenario(&args.scenario, &args.run, args.v2v_delay)?;
    let calibration = calibration::from_table(&scenario.name, &scenario.law)?;
    let calibration = calibration::asked_for(calibration, &args.law_options, args.run.profile)?;
    let rate_hz = args.run.rate_hz()?;
    let trucks = scenario.platoon.trucks;
    let driven = |truck: usize| truck < trucks && scenario.has_ecu(truck);
    if let Some(truck) = args.host.iter().find(|truck| !driven(usize::from(**truck))) {
        let first = usize::from(!scenario.has_ecu(0));
        return Err(Failure::usage(format!(
            "--host {truck}: ECUs drive trucks {first} to {} of the scenario",
            trucks - 1
        )));
    }
    let bus = if args.supervised {
        BusChoice::joining(args.bus, &args.place)?
    } else {
        BusChoice::for_run(args.bus, &args.place, trucks)?
    };
    let law = &args.law_options;
    let settled = (!args.host.is_empty()).then(|| gain::settled(calibration, law, Some(trucks)));
    let settled = settled.transpose()?;
    let folder = RunFolder::open(&args.out)?;
    process::reserve_json(&folder.process_report(&process::rig_name()))?;
    let mut hosted = Vec::new();
    let mut ends: Vec<Box<dyn Bus>> = Vec::new();
    for truck in 0..trucks as u8 {
        if let Some(settled) = settled.as_ref().filter(|_| args.host.contains(&truck)) {
            let (rig_end, ecu_end) = Loopback::pair(&format!("loopback{truck}"), LOOPBACK_FRAMES);
            ends.push(timed(Box::new(rig_end), &args.run));
            let own = calibration::of_truck(&settled.calibration, &scenario, truck);
            let law = (own, settled.gain_id);
            hosted.push(host(args, law, &folder, truck, ecu_end, &stop)?);
        } else {
            ends.push(timed(bus.open_for_rig(truck)?, &args.run));
        }
    }
    let names = process::bus_names(&ends);
    if !args.supervised {
        invite_people(&bus, &names, &args.host);
    }
    let recorder = process::recorder(&folder, Source::Rig, Overflow::DropNewest, names)?;
    let rig = Rig::new(&scenario, args.run.seed, rate_hz, ends, Some(recorder))
        .map_err(Failure::usage)?
        .speaking(args.run.profile);
    let report = drive(rig, args, hosted, &stop)?;
    process::write_json(&folder.process_report(&process::rig_name()), &report)?;
    let passed = report.pace.end == RunEnd::Finished && report.results.passed();
    Ok(if passed { Verdict::Pass } else { Verdict::Fail })
}

/// The rig's end of a bus, which takes its time if that is asked for.
fn timed(bus: Box<dyn Bus>, run: &RunArgs) -> Box<dyn Bus> {
    match run.bus_timing {
        BusTimingKind::Ideal => bus,
        BusTimingKind::Emulate => Box::new(Emulated::new(bus, run.profile.timing())),
    }
}

/// The rig's loop, and the end of everything it hosts.
fn drive(
    mut rig: Rig,
    args: &BenchArgs,
    hosted: Vec<JoinHandle<Report>>,
    stop: &Arc<AtomicBool>,
) -> Result<RigReport, Failure> {
    let clock = HostClock::default();
    let obtained = process::become_realtime(process::RIG_PRIORITY, args.cpu);
    let wall_minus_clock_ns = Some(wall_ns().wrapping_sub(clock.now_ns()));
    let serves_buses = args.run.bus_timing == BusTimingKind::Emulate;
    let mut options =
        RunOptions { wall_minus_clock_ns, serves_buses, ..RunOptions::new(&clock, stop) };
    if args.supervised {
        // The ECUs were started with this process; only a slow machine keeps them.
        options.ready_timeout_ns = SUPERVISED_READY_NS;
    }
    let line = ProgressLine::new(rig.scenario().duration_s);
    let pace = rig::run(&mut rig, &options, &mut |progress| show(progress, args.supervised, &line));
    line.clear();
    if pace.is_err() {
        // The hosted ECUs must end too, whatever they were waiting for.
        stop.store(true, Ordering::Relaxed);
    }
    let hosted = hosted.into_iter().filter_map(|ecu| ecu.join().ok()).collect();
    let recording = rig.take_recorder().and_then(recording_loss);
    Ok(RigReport {
        results: rig.results(),
        pace: pace.map_err(Failure::cannot_start)?,
        hosted,
        realtime: process::as_reported(&obtained),
        recording,
    })
}

/// Closes a recording; what it lost, in words.
pub fn recording_loss(recorder: Recorder) -> Option<String> {
    let finished = recorder.finish();
    let missing = finished.dropped.total() + finished.lost;
    (missing > 0).then(|| {
        let reason = finished.error.unwrap_or_else(|| "the writer was too slow".into());
        format!("{missing} records did not reach the trace: {reason}")
    })
}

/// Runs an ECU in a thread of this process, over a loopback bus.
fn host(
    args: &BenchArgs,
    (calibration, gain_id): (Calibration, u8),
    folder: &RunFolder,
    truck: u8,
    end: Loopback,
    stop: &Arc<AtomicBool>,
) -> Result<JoinHandle<Report>, Failure> {
    let law = calibration::controller(calibration, args.law_options.solver);
    let controller = stalling(law, &args.told.fault, truck);
    let (overruns, pauses) = (args.overrun.overruns(), args.told.pauses.clone());
    let interfaces = vec![end.name().to_owned()];
    let source = Source::Ecu(truck);
    let recorder = process::recorder(folder, source, Overflow::DropNewest, interfaces)?;
    let stop = Arc::clone(stop);
    let profile = args.run.profile;
    let vehicle = calibration::vehicle(&calibration);
    let without_emergency_braking = args.law_options.no_emergency_braking;
    let run = move || {
        let obtained = process::become_realtime(process::ECU_PRIORITY, None);
        let realtime = Some(process::as_reported(&obtained));
        let config = Config {
            truck,
            gain_id,
            profile,
            vehicle,
            realtime,
            without_emergency_braking,
            overruns,
        };
        let witness = HostWitness::of_this_thread(&obtained.cpus, pauses.as_deref());
        let ecu = Ecu::new(config, Box::new(end), controller, Some(recorder))
            .witnessed_by(Box::new(witness));
        let report = controller_rt::run(ecu, &HostClock::default(), &stop);
        if report.ending == Ending::Overrun {
            stop.store(true, Ordering::Relaxed);
        }
        report
    };
    thread::Builder::new()
        .name(process::ecu_name(truck))
        .spawn(run)
        .map_err(|error| Failure::cannot_start(format!("no thread for ECU {truck}: {error}")))
}

fn show(progress: &Progress, supervised: bool, line: &ProgressLine) {
    match (supervised, *progress) {
        (true, Progress::Preparing { missing }) => tell(ProgressMessage::Preparing(missing)),
        (true, Progress::Running { time_s, .. }) => tell(ProgressMessage::Running(time_s)),
        (false, Progress::Preparing { missing }) => {
            line.say(&format!("waiting for {missing} ECU(s)"));
        }
        (false, Progress::Running { time_s, duration_s, .. }) => line.show(time_s, duration_s),
    }
}

/// One line to the supervisor. Nobody listening is no reason to stop the rig.
fn tell(message: ProgressMessage) {
    use std::io::Write;
    if let Ok(mut text) = serde_json::to_string(&message) {
        text.push('\n');
        let _ = std::io::stdout().write_all(text.as_bytes());
    }
}

/// Tells a person which ECUs to start.
fn invite_people(bus: &BusChoice, names: &[String], hosted: &[u8]) {
    anstream::eprintln!("rig on {} ({}); start the ECUs:", bus.backend(), bus.reason);
    let arguments = bus.as_arguments().join(" ");
    for (truck, _) in names.iter().enumerate().filter(|(t, _)| !hosted.contains(&(*t as u8))) {
        anstream::eprintln!("  platoon controller --truck {truck} {arguments}");
    }
}
