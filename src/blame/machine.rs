//! The machine under test, a process of its own so that it can be stopped as a whole: sentinel,
//! rig and one ECU in real time over a real bus, and whoever disturbs them.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use bench_sim::rig::{self, Progress, RunOptions};
use bench_sim::{Rig, Scenario};
use controller_rt::{Config, Controller, Ecu, LawController, Report};
use law::{Calibration, Law};
use platoon_dbc::{Bus, EgoState, Frame};
use serde::{Deserialize, Serialize};
use traces::{Capacity, Overflow, Recorder, RecorderOptions, Source};
use vcan_setup::floor::{FloorOptions, Sentinel};
use vcan_setup::pauses::PauseLog;
use vcan_setup::realtime::{self, Policy, Request, environment};

use super::accomplices::{self, Backlog, Hog, Inflated, Order, Tampered};
use super::conductor::{Conductor, Means};
use super::kind::Kind;
use super::strikes::{Arm, Beat, FIRST_NS, Strike, StrikeLog};
use crate::bus::BusChoice;
use crate::calibration;
use crate::cli::{BlameArgs, SolverKind};
use crate::clock::HostClock;
use crate::cpu_plan::CpuPlan;
use crate::failure::Failure;
use crate::process::{self, ECU_PRIORITY, RIG_PRIORITY};
use crate::run_folder::RunFolder;
use crate::witness::HostWitness;

/// What the run is about: one truck with its ECU.
const SCENARIO: &str = "obstacle-avoidance";
/// The truck.
const TRUCK: u8 = 0;
/// The number of the bus that a flood comes from.
const BACKLOG: u8 = 1;
/// Lowest real-time priority: above every ordinary thread, below the bench.
const LEAST_PRIORITY: u8 = 1;
/// Ticks that wait for the recorder where the loop is to wait for it.
const SHORT_RING_TICKS: usize = 8;
/// What the process says when it may be stopped.
pub const RUNNING: &str = "running";

/// What the machine under test leaves behind.
#[derive(Debug, Serialize, Deserialize)]
pub struct Aftermath {
    /// Faults injected by itself.
    pub strikes: Vec<Strike>,
    /// What the ECU reports.
    pub ecu: Report,
}

impl Aftermath {
    /// Where it is written.
    pub fn file(folder: &RunFolder) -> PathBuf {
        folder.process_report("aftermath")
    }
}

/// Everything the parts of the machine share.
struct Machine {
    kind: Kind,
    period_ns: u64,
    rig_cpu: usize,
    ecu_cpu: usize,
    beat: Beat,
    order: Order,
    /// Raised when the backlog of a flood is full.
    full: Arc<Arm>,
    stop: Arc<AtomicBool>,
}

/// Runs the machine until every fault was injected, or somebody stops it.
///
/// # Errors
/// When it cannot start.
pub fn run(args: &BlameArgs, kind: Kind) -> Result<(), Failure> {
    process::die_with_parent();
    let machine = Machine::new(args, kind, process::stop_flag()?)?;
    let folder = RunFolder::open(args.out.as_deref().unwrap_or(Path::new(".")))?;
    let bus = BusChoice::for_run(args.bus, &args.place, usize::from(BACKLOG) + 1)?;
    let scenario = one_truck()?;
    let calibration = calibration::from_table(&scenario.name, &scenario.law)?;
    // Threads that are started from here on stay out of the ECU's way.
    let _aside = realtime::acquire(&machine.request(None, machine.rig_cpu));
    let log = PauseLog::new().map_err(Failure::cannot_start)?;
    let cpus = environment().online_cpus;
    let sentinel = FloorOptions::beside(machine.period_ns, cpus, RIG_PRIORITY + 1);
    let sentinel = Sentinel::start_noting(&sentinel, Some(&log)).map_err(Failure::cannot_start)?;
    let rig_end = machine.rig_end(bus.open_for_rig(TRUCK)?);
    let mut rig = Rig::new(&scenario, 1, kind.rate_hz(args.rate_hz), vec![rig_end], None)
        .map_err(Failure::usage)?;
    let accomplice = machine.accomplice(&bus)?;
    let recorder = machine.recorder(&folder)?;
    let ecu = machine.start_ecu(machine.ecu_end(&bus)?, calibration, recorder, log.path())?;
    let pace = machine.drive(&mut rig);
    machine.stop.store(true, Ordering::Relaxed);
    let report = ecu.join().map_err(|_| Failure::cannot_start("the ECU's thread ended early"))?;
    if let Some(accomplice) = accomplice {
        accomplice.thread().unpark();
        accomplice
            .join()
            .map_err(|_| Failure::cannot_start("who injects faults ended early"))??;
    }
    drop(sentinel);
    pace?;
    let aftermath = Aftermath { strikes: machine.order.log.strikes(), ecu: report };
    process::write_json(&Aftermath::file(&folder), &aftermath)
}

/// The scenario with a single truck, long enough for any number of faults.
fn one_truck() -> Result<Scenario, Failure> {
    let sets = [("platoon.trucks", "1"), ("duration_s", "3600.0")];
    let sets = sets.map(|(key, value)| (key.to_owned(), value.to_owned()));
    Scenario::load(SCENARIO, &sets).map_err(Failure::usage)
}

impl Machine {
    fn new(args: &BlameArgs, kind: Kind, stop: Arc<AtomicBool>) -> Result<Self, Failure> {
        let cpus = environment().online_cpus;
        let (Some(rig_cpu), Some(ecu_cpu)) =
            (CpuPlan::Auto.of_rig(&cpus), CpuPlan::Auto.of_ecu(&cpus, TRUCK))
        else {
            return Err(Failure::cannot_start(
                "blame needs two CPUs, one for the rig and one for the ECU; give it two",
            ));
        };
        let period_ns = 1_000_000_000 / u64::from(kind.rate_hz(args.rate_hz));
        let lasts_ns = match kind {
            // Until after the tick, which is due half a period after the frame.
            Kind::LateFrame => period_ns * 4 / 5,
            Kind::RecorderStall => (SHORT_RING_TICKS as u64 + 6) * period_ns,
            _ => period_ns * 5 / 2,
        };
        let order = Order { arm: Arc::default(), lasts_ns, log: StrikeLog::new(args.each) };
        let strikes = match kind {
            // Who stops the machine counts.
            Kind::HostPause => u32::MAX,
            _ => args.each,
        };
        let beat = Beat::new(period_ns, kind.spacing(), strikes);
        Ok(Self { kind, period_ns, rig_cpu, ecu_cpu, beat, order, full: Arc::default(), stop })
    }

    /// Privileges of a thread. New memory is there at once where memory is locked.
    fn request(&self, priority: Option<u8>, cpu: usize) -> Request {
        Request {
            priority,
            cpus: vec![cpu],
            lock_memory: self.kind != Kind::PageFault,
            hold_cpu_latency: true,
        }
    }

    fn rig_end(&self, bus: Box<dyn Bus>) -> Box<dyn Bus> {
        if self.kind != Kind::LateFrame {
            return bus;
        }
        let order = self.order.clone();
        let before_send = move |frame: &Frame| {
            if frame.id() == EgoState::ID {
                order.sleep_if_asked();
            }
        };
        Box::new(Tampered { bus, before_send, receive_first: || None })
    }

    fn ecu_end(&self, place: &BusChoice) -> Result<Box<dyn Bus>, Failure> {
        let (bus, order) = (place.open(TRUCK)?, self.order.clone());
        Ok(match self.kind {
            Kind::BlockedBus => {
                let before_send = move |_: &Frame| order.sleep_if_asked();
                Box::new(Tampered { bus, before_send, receive_first: || None })
            }
            Kind::FrameFlood => {
                let (full, other) = (Arc::clone(&self.full), place.open(BACKLOG)?);
                let mut backlog = Backlog { bus: other, full, log: order.log, since_ns: None };
                let receive_first = move || backlog.receive();
                Box::new(Tampered { bus, before_send: |_: &Frame| (), receive_first })
            }
            _ => bus,
        })
    }

    /// Starts the thread that strikes, where one does.
    fn accomplice(
        &self,
        bus: &BusChoice,
    ) -> Result<Option<JoinHandle<Result<(), Failure>>>, Failure> {
        let (order, stop) = (self.order.clone(), Arc::clone(&self.stop));
        let (urgent, ecu_cpu) = (ECU_PRIORITY + 1, self.ecu_cpu);
        let hog = match self.kind {
            // Asked for in one tick, it takes the CPU before the next is due.
            Kind::RunQueueHog => {
                Hog { cpu: ecu_cpu, priority: urgent, delay_ns: self.period_ns * 7 / 10 }
            }
            Kind::PreemptingHog => Hog { cpu: ecu_cpu, priority: urgent, delay_ns: 0 },
            Kind::RecorderStall => Hog { cpu: self.rig_cpu, priority: LEAST_PRIORITY, delay_ns: 0 },
            Kind::FrameFlood => {
                let (mut end, full) = (bus.open(BACKLOG)?, Arc::clone(&self.full));
                return Ok(Some(thread::spawn(move || {
                    accomplices::fill(&mut *end, &order, &full, &stop);
                    Ok(())
                })));
            }
            _ => return Ok(None),
        };
        Ok(Some(thread::spawn(move || hog.run(&order, &stop))))
    }

    /// The product's recorder, which never makes the loop wait; one that does where it is to stall.
    fn recorder(&self, folder: &RunFolder) -> Result<Recorder, Failure> {
        let source = Source::Ecu(TRUCK);
        if self.kind != Kind::RecorderStall {
            return process::recorder(folder, source, Overflow::DropNewest, Vec::new());
        }
        let capacity = Capacity { ticks: SHORT_RING_TICKS, ..Capacity::of(source) };
        let options =
            RecorderOptions { overflow: Overflow::Wait, capacity, ..RecorderOptions::new(source) };
        Recorder::start(&folder.part(&source.to_string()), options).map_err(Failure::cannot_start)
    }

    fn start_ecu(
        &self,
        bus: Box<dyn Bus>,
        calibration: Calibration,
        recorder: Recorder,
        pauses: PathBuf,
    ) -> Result<JoinHandle<Report>, Failure> {
        let vehicle = calibration::vehicle(&calibration);
        let config = Config { truck: TRUCK, vehicle, ..Config::default() };
        let ecu = Ecu::new(config, bus, self.controller(calibration), Some(recorder));
        let (request, cpu) = (self.request(Some(ECU_PRIORITY), self.ecu_cpu), self.ecu_cpu);
        let stop = Arc::clone(&self.stop);
        let run = move || {
            let _obtained = realtime::acquire(&request);
            let witness = HostWitness::of_this_thread(&[cpu], Some(&pauses));
            let ecu = ecu.witnessed_by(Box::new(witness));
            controller_rt::run(ecu, &HostClock::default(), &stop)
        };
        let thread = thread::Builder::new().name(process::ecu_name(TRUCK));
        thread.spawn(run).map_err(Failure::cannot_start)
    }

    /// The law, with whoever conducts the strikes before it.
    fn controller(&self, calibration: Calibration) -> Box<dyn Controller> {
        let law: Box<dyn Controller> = match self.kind {
            Kind::QpInflation => {
                let solver = Inflated { order: self.order.clone() };
                Box::new(LawController::new(Law::new(calibration, solver)))
            }
            _ => calibration::controller(calibration, SolverKind::ActiveSet),
        };
        let means = match self.kind {
            Kind::Undisturbed | Kind::HostPause => Means::Nothing,
            Kind::LongLaw => Means::Computing(self.order.lasts_ns),
            Kind::PageFault => Means::TouchingMemory(self.order.lasts_ns),
            _ => Means::Asking(Arc::clone(&self.order.arm)),
        };
        let (log, stop) = (Arc::clone(&self.order.log), Arc::clone(&self.stop));
        Conductor { beat: self.beat, means, log, stop }.before(law)
    }

    /// The rig's loop, in the calling thread, until the run is stopped.
    fn drive(&self, rig: &mut Rig) -> Result<(), Failure> {
        let obtained = realtime::acquire(&self.request(Some(RIG_PRIORITY), self.rig_cpu));
        if obtained.policy != Policy::Fifo {
            let why = obtained.refused.first().map_or_else(String::new, ToString::to_string);
            return Err(Failure::cannot_start(format!(
                "without SCHED_FIFO nothing can be told about causes: {why}; platoon vcan check \
                 says how to get it"
            )));
        }
        let (clock, mut has_told) = (HostClock::default(), false);
        let mut tell = |progress: &Progress| {
            let is_on = |time_s: f64| 1e9 * time_s >= FIRST_NS as f64;
            if !has_told && matches!(progress, Progress::Running { time_s, .. } if is_on(*time_s)) {
                has_told = true;
                // Nobody listening is no reason to stop.
                let _ = writeln!(std::io::stdout(), "{RUNNING}");
            }
        };
        rig::run(rig, &RunOptions::new(&clock, &self.stop), &mut tell)
            .map(drop)
            .map_err(Failure::cannot_start)
    }
}
