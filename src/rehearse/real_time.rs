//! A rehearsal in real time: the rig and every ECU are processes of their own, and this one only
//! starts them, watches them, breaks them where asked, and ends them.

mod arguments;

use std::fs::{self, File};
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use controller_rt::Ending;
use rustix::process::{Pid, Signal, kill_process};
use tokio::io::{AsyncBufReadExt, BufReader, Lines};
use tokio::process::{ChildStdout, Command};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, sleep_until, timeout};
use vcan_setup::floor::{self, Floor, FloorOptions, Sentinel};
use vcan_setup::pauses::PauseLog;
use vcan_setup::realtime::environment;

use arguments::{CommandLines, is_stall};

use super::{Beside, Floors, Outcome, Plan};
use crate::bench::{ProgressMessage, RigReport};
use crate::bus::BusChoice;
use crate::cli::EcuChoice;
use crate::dashboard::{self, Dashboard};
use crate::failure::Failure;
use crate::fault::FaultKind;
use crate::gateway::{Buses, Gateway};
use crate::live::{Feed, Live};
use crate::process;
use crate::progress::ProgressLine;
use crate::run_folder::RunFolder;
use crate::scenery;

/// How long processes may take to end by themselves once they should.
const GRACE: Duration = Duration::from_secs(5);
/// How long the machine's floor is measured before the run and again after it, as a share of the
/// run, and at most \[s\].
const ALONE_SHARE: f64 = 0.05;
const ALONE_S_MAX: f64 = 2.0;
/// How far ahead of a fault its timer is set \[s\]: more than the time between two progress lines.
const FAULT_LEAD_S: f64 = 0.5;

/// Runs the plan on the machine's own clock.
///
/// # Errors
/// When the run cannot start.
pub(super) fn run(
    plan: &Plan<'_>,
    folder: &RunFolder,
    bus: &BusChoice,
    beside: Beside,
) -> Result<Outcome, Failure> {
    let dashboard = start_dashboard(plan, folder)?;
    let line = match dashboard {
        Some(_) => ProgressLine::hidden(),
        None => ProgressLine::new(plan.scenario.duration_s),
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::cannot_start(format!("cannot supervise processes: {error}")))?;
    let alone = Duration::from_secs_f64((ALONE_SHARE * plan.scenario.duration_s).min(ALONE_S_MAX));
    let before = measure_floor(plan, alone)?;
    let pauses = PauseLog::new()
        .map_err(|error| Failure::cannot_start(format!("cannot log pauses: {error}")))?;
    let sentinel = Sentinel::start_noting(&sentinel_options(plan), Some(&pauses))
        .map_err(Failure::cannot_start)?;
    let outcome = runtime.block_on(supervise(plan, folder, bus, &line, &pauses.path()));
    line.clear();
    dashboard.into_iter().for_each(Dashboard::finish);
    let beneath = sentinel.stop();
    let floor = Some(Floors { before, beside: beneath, after: measure_floor(plan, alone)? });
    let shown = beside.live.map(|live| {
        let lost = "live view: it ended before the run".to_owned();
        live.finish().map_or(lost, |report| report.to_string())
    });
    let served = beside.gateway.map(|gateway| {
        let lost = "socketcand: the gateway ended before the run".to_owned();
        gateway.finish().map_or(lost, |report| report.to_string())
    });
    outcome.map(|mut outcome| {
        outcome.notes.extend(served);
        outcome.notes.extend(shown);
        Outcome { floor, ..outcome }
    })
}

/// Lets others attach, where that is asked for; hosted ECUs have no bus to attach to.
///
/// # Errors
/// When its port cannot be had.
pub(super) fn start_gateway(plan: &Plan<'_>, bus: &BusChoice) -> Result<Option<Gateway>, Failure> {
    let Some(place) = plan.args.gateway() else { return Ok(None) };
    let buses = Buses::new(bus.address().clone(), separate_ecus(plan).collect());
    Gateway::start(place, buses).map(Some)
}

/// Lets others look on, where that is asked for.
///
/// # Errors
/// When its port cannot be had.
pub(super) fn start_live(plan: &Plan<'_>, folder: &RunFolder) -> Result<Option<Live>, Failure> {
    let Some(port) = plan.args.live else { return Ok(None) };
    Live::start(port, format!("platoon {}", plan.scenario.name), feed(plan, folder)).map(Some)
}

/// What rig and ECUs record, for those who look on.
fn feed(plan: &Plan<'_>, folder: &RunFolder) -> Feed {
    let scenery = scenery::of(&plan.scenario, &plan.calibration);
    Feed::new(folder, plan.trucks(), scenery)
}

/// Takes the terminal over, where that is asked for and there is one.
fn start_dashboard(plan: &Plan<'_>, folder: &RunFolder) -> Result<Option<Dashboard>, Failure> {
    if !plan.args.tui {
        return Ok(None);
    }
    if !dashboard::has_terminal() {
        anstream::eprintln!("--tui: standard output is no terminal; going on without a dashboard");
        return Ok(None);
    }
    let road = &plan.scenario.road;
    let width_m = road.left_edge_y_m - road.right_edge_y_m;
    let run = dashboard::Run {
        scenario: plan.scenario.name.clone(),
        duration_s: plan.scenario.duration_s,
        period_ns: 1_000_000_000 / u64::from(plan.rate_hz),
        trucks: plan.trucks(),
        right_edge_y_m: road.right_edge_y_m,
        lane_width_m: road.lane_width_m,
        lanes: (width_m / road.lane_width_m.max(1.0)).round().clamp(1.0, 9.0) as usize,
    };
    Dashboard::start(run, feed(plan, folder)).map(Some)
}

/// How the sentinel measures how late this machine wakes a thread that does nothing else.
///
/// It outranks the processes under test, so that none of them can make it late.
fn sentinel_options(plan: &Plan<'_>) -> FloorOptions {
    let period_ns = 1_000_000_000 / u64::from(plan.rate_hz);
    FloorOptions::beside(period_ns, environment().online_cpus, process::RIG_PRIORITY + 1)
}

/// The machine's floor while nothing of the run is there.
fn measure_floor(plan: &Plan<'_>, duration: Duration) -> Result<Floor, Failure> {
    floor::measure(&sentinel_options(plan), duration).map_err(Failure::cannot_start)
}

/// One process of the run.
struct Member {
    name: String,
    /// The truck whose ECU it is; none for the rig.
    truck: Option<u8>,
    pid: Pid,
    running: bool,
}

/// A process has ended.
struct Ended {
    member: usize,
    status: Option<ExitStatus>,
}

/// The processes of a run and what is known about them.
struct Crew {
    members: Vec<Member>,
    ended: mpsc::UnboundedReceiver<Ended>,
    report_end: mpsc::UnboundedSender<Ended>,
}

impl Crew {
    fn new() -> Self {
        let (report_end, ended) = mpsc::unbounded_channel();
        Self { members: Vec::new(), ended, report_end }
    }

    /// Starts a process of this program; its standard output when that is wanted.
    fn start(
        &mut self,
        folder: &RunFolder,
        (name, truck): (String, Option<u8>),
        arguments: &[String],
    ) -> Result<Option<ChildStdout>, Failure> {
        let failed = |what: &str, error: std::io::Error| {
            Failure::cannot_start(format!("cannot start {name}: {what}: {error}"))
        };
        let program = std::env::current_exe().map_err(|error| failed("this program", error))?;
        let log = File::create(folder.log(&name)).map_err(|error| failed("its log", error))?;
        let is_rig = truck.is_none();
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(if is_rig { Stdio::piped() } else { Stdio::null() })
            .stderr(log)
            // Ctrl-C is for this process alone; it ends the others in order.
            .process_group(0)
            .kill_on_drop(true)
            .spawn()
            .map_err(|error| failed("the process", error))?;
        let pid = child.id().and_then(|id| Pid::from_raw(id as i32));
        let pid = pid.ok_or_else(|| {
            Failure::cannot_start(format!("cannot start {name}: it ended at once"))
        })?;
        let output = child.stdout.take();
        let (member, report_end) = (self.members.len(), self.report_end.clone());
        tokio::spawn(async move {
            let status = child.wait().await.ok();
            // Nobody listening means that the run is over.
            let _ = report_end.send(Ended { member, status });
        });
        self.members.push(Member { name, truck, pid, running: true });
        Ok(output)
    }

    fn send(&self, which: impl Fn(&Member) -> bool, what: Signal) {
        for member in self.members.iter().filter(|m| m.running && which(m)) {
            // It may have ended this instant.
            let _ = kill_process(member.pid, what);
        }
    }

    fn anyone_left(&self) -> bool {
        self.members.iter().any(|member| member.running)
    }
}

/// Starts everything, follows it to its end, and collects what was left behind.
async fn supervise(
    plan: &Plan<'_>,
    folder: &RunFolder,
    bus: &BusChoice,
    line: &ProgressLine,
    pauses: &Path,
) -> Result<Outcome, Failure> {
    let signals = Signals::listen()?;
    let mut crew = Crew::new();
    let (plan_of_cpus, cpus) = (&plan.args.timing.cpus, environment().online_cpus);
    let commands = CommandLines { plan, folder, bus, pauses };
    let rig = commands.rig(plan_of_cpus.of_rig(&cpus));
    let output = crew.start(folder, (process::rig_name(), None), &rig)?;
    let mut lines = output.map(|output| BufReader::new(output).lines());
    // The rig says its first word when it hears its buses. It records them, so no ECU may speak
    // earlier, and none needs to start when the rig does not.
    let first_word = timeout(GRACE, next_line(&mut lines)).await;
    if !matches!(first_word, Ok(None)) {
        for truck in separate_ecus(plan) {
            let cpu = plan_of_cpus.of_ecu(&cpus, truck);
            let name = (process::ecu_name(truck), Some(truck));
            crew.start(folder, name, &commands.ecu(truck, cpu))?;
        }
    }
    let mut outcome = Outcome::default();
    follow((plan, folder), &mut crew, (signals, lines), line, &mut outcome).await;
    collect(plan, folder, &mut outcome)?;
    Ok(outcome)
}

/// What asks this process to end.
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

impl Signals {
    fn listen() -> Result<Self, Failure> {
        let listen = |kind| {
            signal(kind)
                .map_err(|error| Failure::cannot_start(format!("cannot catch signals: {error}")))
        };
        let (interrupt, terminate) = (SignalKind::interrupt(), SignalKind::terminate());
        Ok(Self { interrupt: listen(interrupt)?, terminate: listen(terminate)? })
    }
}

/// Watches until every process has ended.
async fn follow(
    (plan, folder): (&Plan<'_>, &RunFolder),
    crew: &mut Crew,
    (mut signals, mut lines): (Signals, Option<Lines<BufReader<ChildStdout>>>),
    line: &ProgressLine,
    outcome: &mut Outcome,
) {
    let mut deadline: Option<Instant> = None;
    let mut armed = vec![false; plan.args.fault.len()];
    while crew.anyone_left() {
        tokio::select! {
            text = next_line(&mut lines) => match text.as_deref().map(serde_json::from_str) {
                Some(Ok(ProgressMessage::Preparing(missing))) => {
                    line.say(&format!("waiting for {missing} ECU(s)"));
                }
                Some(Ok(ProgressMessage::Running(time_s))) => {
                    line.show(time_s, plan.scenario.duration_s);
                    arm_faults(plan, crew, &mut armed, time_s, outcome);
                }
                Some(Err(_)) => (),
                None => lines = None,
            },
            Some(ended) = crew.ended.recv() => {
                let over = note_end(crew, &ended, outcome);
                if !over && deadline.is_none() && gave_up(folder, &crew.members[ended.member]) {
                    let name = &crew.members[ended.member].name;
                    outcome.notes.push(format!("{name} missed too many deadlines: run aborted"));
                    outcome.interrupted = true;
                    interrupted(crew, outcome, &mut deadline);
                }
                if over && deadline.is_none() {
                    deadline = Some(Instant::now() + GRACE);
                }
            }
            _ = signals.interrupt.recv() => interrupted(crew, outcome, &mut deadline),
            _ = signals.terminate.recv() => interrupted(crew, outcome, &mut deadline),
            () = until(deadline) => {
                for member in crew.members.iter().filter(|m| m.running) {
                    let name = &member.name;
                    outcome.notes.push(format!("{name} did not end by itself and was killed"));
                }
                crew.send(|_| true, Signal::KILL);
                deadline = Some(Instant::now() + GRACE);
            }
        }
    }
}

/// Whether an ECU ended because too many deadlines were missed.
fn gave_up(folder: &RunFolder, member: &Member) -> bool {
    let report = member.truck.and_then(|truck| process::ecu_report(folder, truck));
    report.is_some_and(|report| report.ending == Ending::Overrun)
}

/// Asks the rig to end; it tells the ECUs.
fn interrupted(crew: &Crew, outcome: &mut Outcome, deadline: &mut Option<Instant>) {
    if !outcome.interrupted {
        outcome.notes.push("interrupted".into());
    }
    outcome.interrupted = true;
    crew.send(|member| member.truck.is_none(), Signal::TERM);
    *deadline = Some(Instant::now() + GRACE);
}

/// Notes that a process has ended; true when that was the rig, so that the run is over.
fn note_end(crew: &mut Crew, ended: &Ended, outcome: &mut Outcome) -> bool {
    let member = &mut crew.members[ended.member];
    member.running = false;
    let is_rig = member.truck.is_none();
    let failed = ended.status.is_none_or(|status| status.code().is_none());
    if failed && !outcome.notes.iter().any(|note| note.contains(&member.name)) {
        outcome.notes.push(format!("{} was killed", member.name));
    }
    if is_rig && failed {
        crew.send(|_| true, Signal::TERM);
    }
    // An ECU paused by a fault could not end otherwise.
    if is_rig {
        crew.send(|_| true, Signal::CONT);
    }
    is_rig
}

/// Sets the timers of faults that are close.
fn arm_faults(
    plan: &Plan<'_>,
    crew: &Crew,
    armed: &mut [bool],
    time_s: f64,
    outcome: &mut Outcome,
) {
    for (fault, armed) in plan.args.fault.iter().zip(armed) {
        if *armed || fault.at_s - time_s > FAULT_LEAD_S {
            continue;
        }
        *armed = true;
        outcome.notes.push(format!("fault injected: {fault}"));
        if is_stall(fault) {
            continue;
        }
        let Some(pid) = crew.members.iter().find(|m| m.truck == Some(fault.truck)).map(|m| m.pid)
        else {
            outcome.notes.push(format!("truck {} has no process to break", fault.truck));
            continue;
        };
        let delay = Duration::from_secs_f64((fault.at_s - time_s).max(0.0));
        let kind = fault.kind;
        tokio::spawn(async move {
            sleep(delay).await;
            match kind {
                FaultKind::KillEcu => {
                    let _ = kill_process(pid, Signal::KILL);
                }
                FaultKind::PauseEcu { duration_s } => {
                    let _ = kill_process(pid, Signal::STOP);
                    sleep(Duration::from_secs_f64(duration_s)).await;
                    let _ = kill_process(pid, Signal::CONT);
                }
                FaultKind::Stall { .. } => (),
            }
        });
    }
}

/// The next line of the rig; never when there is nothing more to come.
async fn next_line(lines: &mut Option<Lines<BufReader<ChildStdout>>>) -> Option<String> {
    match lines {
        Some(lines) => lines.next_line().await.ok().flatten(),
        None => std::future::pending().await,
    }
}

async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}

/// Reads what the processes left.
fn collect(plan: &Plan<'_>, folder: &RunFolder, outcome: &mut Outcome) -> Result<(), Failure> {
    let rig: Option<RigReport> = process::read_json(&folder.process_report(&process::rig_name()));
    let Some(rig) = rig else {
        return if outcome.interrupted {
            Ok(())
        } else {
            Err(Failure::cannot_start(last_words(folder, plan)))
        };
    };
    outcome.notes.extend(rig.recording);
    outcome.results = Some(rig.results);
    outcome.rig_pace = Some(rig.pace);
    outcome.ecus = rig.hosted;
    outcome.ecus.extend(separate_ecus(plan).filter_map(|truck| process::ecu_report(folder, truck)));
    outcome.ecus.sort_by_key(|report| report.truck);
    tidy_up(plan, folder);
    Ok(())
}

/// Removes what the summary now holds, and logs in which nobody said anything.
fn tidy_up(plan: &Plan<'_>, folder: &RunFolder) {
    for name in separate_ecus(plan).map(process::ecu_name).chain([process::rig_name()]) {
        // What cannot be removed does no harm.
        let _ = fs::remove_file(folder.process_report(&name));
        process::release_json(&folder.process_report(&name));
        let log = folder.log(&name);
        if fs::metadata(&log).is_ok_and(|log| log.len() == 0) {
            let _ = fs::remove_file(log);
        }
    }
}

/// Why the run did not come about: the first process that said something.
fn last_words(folder: &RunFolder, plan: &Plan<'_>) -> String {
    let names = separate_ecus(plan).map(process::ecu_name).chain([process::rig_name()]);
    let mut logs = names.filter_map(|name| {
        let path = folder.log(&name);
        let text = fs::read_to_string(&path).ok()?;
        let words = text.lines().rfind(|line| line.starts_with("platoon: "))?;
        Some(format!("{name}: {}", words.trim_start_matches("platoon: ")))
    });
    logs.next().unwrap_or_else(|| {
        format!("the rig ended without a word; see {}", folder.log(&process::rig_name()).display())
    })
}

/// Trucks whose ECU is a process of its own.
fn separate_ecus<'plan>(plan: &'plan Plan<'_>) -> impl Iterator<Item = u8> + use<'plan> {
    plan.ecus().filter(|&truck| match plan.args.ecu {
        EcuChoice::All => true,
        EcuChoice::One(only) => truck == only,
    })
}
