//! The rig in real time: absolute deadlines, one per base step, or per few of them when the loop is
//! slow.
//!
//! When the rig wakes late it integrates every missed step and publishes only the latest state, so
//! bench time never lags the clock by more than one wake-up.
//!
//! Buses that pretend to have a bit rate are served between the steps as well, without integrating:
//! what they have carried is handed on, what the ECUs sent meanwhile is queued. A frame is later
//! than on a real bus by up to two such intervals, one for being found and one for being handed on,
//! and by what the rig wakes late; [`RunReport::service_gap_ns_max`] tells the longest interval.

use core::sync::atomic::{AtomicBool, Ordering};

use platoon_dbc::{Clock, EcuMode};
use serde::{Deserialize, Serialize};

use super::Rig;

/// Looks at the buses in a tick, at least, where a tick has as many base steps: an answer to a tick
/// takes effect a quarter of it late at most.
const LOOKS_PER_TICK: u64 = 4;
/// Time between invitations, and between reports of progress \[ns\].
const CYCLE_NS: u64 = 100_000_000;
/// Time between two looks at the buses while the run is prepared \[ns\].
const LOOK_NS: u64 = 5_000_000;
/// Time between the three farewells, and between looks at what is said after them \[ns\].
const FAREWELL_NS: u64 = 10_000_000;
/// Most looks after the farewells: two seconds, for an ECU that the machine keeps waiting.
const LAST_LOOKS_MAX: u32 = 200;
/// How long ECUs may take to get ready, unless told otherwise \[ns\].
const READY_TIMEOUT_NS: u64 = 10_000_000_000;

/// Time between two services of emulated buses \[ns\].
const SERVICE_NS: u64 = 250_000;

/// What a real-time run needs of its surroundings.
#[derive(Clone, Copy)]
pub struct RunOptions<'a> {
    /// What tells the time and waits for it.
    pub clock: &'a dyn Clock,
    /// Set by somebody else to end the run early.
    pub stop: &'a AtomicBool,
    /// How long ECUs may take to get ready \[ns\].
    pub ready_timeout_ns: u64,
    /// Wall clock (since 1970) minus `clock` \[ns\], for the recording's start time; `None` leaves
    /// the recorder as it is.
    pub wall_minus_clock_ns: Option<u64>,
    /// Whether buses are emulated and must be served between the steps.
    pub serves_buses: bool,
}

impl<'a> RunOptions<'a> {
    /// Ten seconds to get ready, the recorder's start time left alone, no emulated bus.
    pub fn new(clock: &'a dyn Clock, stop: &'a AtomicBool) -> Self {
        Self {
            clock,
            stop,
            ready_timeout_ns: READY_TIMEOUT_NS,
            wall_minus_clock_ns: None,
            serves_buses: false,
        }
    }
}

/// How far a run is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// Waiting for this many ECUs.
    Preparing {
        /// ECUs not ready yet.
        missing: usize,
    },
    /// On the way.
    Running {
        /// Bench time \[s\].
        time_s: f64,
        /// Bench time at the end \[s\].
        duration_s: f64,
        /// Wake-ups that came at least one step late so far.
        late_wakes: u64,
    },
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RunEnd {
    /// At the end of the scenario.
    Finished,
    /// Because somebody asked.
    Stopped,
}

/// How well the rig kept time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunReport {
    /// How the run ended.
    pub end: RunEnd,
    /// Wake-ups.
    pub wakes: u64,
    /// Wake-ups that found more steps to do than they were for.
    pub late_wakes: u64,
    /// Steps that were integrated late, without a publication of their own.
    pub caught_up_steps: u64,
    /// Latest wake-up after its deadline \[ns\].
    pub lateness_ns_max: u64,
    /// Longest time between two services of emulated buses \[ns\]; 0 when none is emulated.
    pub service_gap_ns_max: u64,
    /// Services of emulated buses that came more than an interval late.
    pub late_services: u64,
}

/// Why a run did not start.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RunError {
    /// An ECU has not answered in time.
    #[error(
        "the ECU of truck {truck} on {bus} did not get ready within {seconds} s: \
         start its controller, on the same bus"
    )]
    Silent {
        /// The truck.
        truck: usize,
        /// The name of its bus.
        bus: String,
        /// How long the rig waited \[s\].
        seconds: u64,
    },
    /// An ECU reported a fault.
    #[error("the ECU of truck {truck} on {bus} reports a fault: see what its controller printed")]
    Fault {
        /// The truck.
        truck: usize,
        /// The name of its bus.
        bus: String,
    },
}

/// Runs a rig in real time from the first invitation to the farewell.
///
/// `progress` is called at about 10 Hz, from the loop: it must be quick.
///
/// # Errors
/// When an ECU does not get ready in time, or reports a fault before the start.
pub fn run(
    rig: &mut Rig,
    options: &RunOptions<'_>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<RunReport, RunError> {
    let report = RunReport {
        end: RunEnd::Stopped,
        wakes: 0,
        late_wakes: 0,
        caught_up_steps: 0,
        lateness_ns_max: 0,
        service_gap_ns_max: 0,
        late_services: 0,
    };
    let prepared = prepare(rig, options, progress);
    let report = match prepared {
        Ok(true) => pace(rig, options, progress, report),
        Ok(false) | Err(_) => report,
    };
    say_goodbye(rig, options.clock);
    prepared.map(|_| report)
}

/// Invites the ECUs until all are ready; false when the run was called off meanwhile.
fn prepare(
    rig: &mut Rig,
    options: &RunOptions<'_>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<bool, RunError> {
    let began_ns = options.clock.now_ns();
    let mut invite_ns = began_ns;
    while !options.stop.load(Ordering::Relaxed) {
        let now_ns = options.clock.now_ns();
        if now_ns >= invite_ns {
            rig.invite();
            progress(&Progress::Preparing { missing: rig.silent_trucks().count() });
            invite_ns = now_ns + CYCLE_NS;
        }
        if rig.ready() {
            return Ok(true);
        }
        refuse_faults(rig)?;
        if now_ns.saturating_sub(began_ns) > options.ready_timeout_ns {
            return Err(silent(rig, options.ready_timeout_ns));
        }
        options.clock.sleep_until_ns(now_ns + LOOK_NS);
    }
    Ok(false)
}

fn refuse_faults(rig: &Rig) -> Result<(), RunError> {
    let faulty = rig.nodes.iter().position(|node| node.ecu_mode == Some(EcuMode::Fault));
    match faulty {
        Some(truck) => Err(RunError::Fault { truck, bus: rig.bus(truck).name().to_owned() }),
        None => Ok(()),
    }
}

fn silent(rig: &Rig, waited_ns: u64) -> RunError {
    let truck = rig.silent_trucks().next().unwrap_or_default();
    RunError::Silent {
        truck,
        bus: rig.bus(truck).name().to_owned(),
        seconds: waited_ns / 1_000_000_000,
    }
}

/// The loop: wait, see how many steps are due, advance.
fn pace(
    rig: &mut Rig,
    options: &RunOptions<'_>,
    progress: &mut dyn FnMut(&Progress),
    mut report: RunReport,
) -> RunReport {
    let clock = options.clock;
    let start_ns = clock.now_ns();
    if let (Some(offset_ns), Some(recorder)) =
        (options.wall_minus_clock_ns, rig.tap.recorder.as_mut())
    {
        recorder.set_start_wall_ns(start_ns.wrapping_add(offset_ns));
    }
    rig.start();
    let stride = if options.serves_buses { 1 } else { stride(rig.steps_per_tick()) };
    let mut service = Service { start_ns, last_ns: start_ns };
    let mut progress_ns = 0;
    while !rig.finished() && !options.stop.load(Ordering::Relaxed) {
        let step_ns = rig.base_step_ns();
        let wanted = stride - rig.steps() % stride;
        let deadline_ns = start_ns + (rig.steps() + wanted) * step_ns;
        if options.serves_buses {
            service.until(deadline_ns, rig, clock, &mut report);
        }
        clock.sleep_until_ns(deadline_ns);
        let now_ns = clock.now_ns();
        if options.serves_buses {
            service.serve(now_ns, rig, &mut report);
        }
        let due = (now_ns.saturating_sub(start_ns) / step_ns).saturating_sub(rig.steps());
        if due < wanted {
            continue;
        }
        rig.advance(due);
        report.wakes += 1;
        report.late_wakes += u64::from(due > wanted);
        report.caught_up_steps += due - wanted;
        report.lateness_ns_max = report.lateness_ns_max.max(now_ns - deadline_ns);
        if rig.time_ns() >= progress_ns {
            progress(&running(rig, report.late_wakes));
            progress_ns = rig.time_ns() + CYCLE_NS;
        }
    }
    report.end = if rig.finished() { RunEnd::Finished } else { RunEnd::Stopped };
    report
}

/// Base steps from one wake-up to the next: as many as divide a tick evenly and still look at the
/// buses [`LOOKS_PER_TICK`] times in it. A slow loop gains nothing from a rig that wakes every
/// millisecond, and a slow machine loses by it.
fn stride(steps_per_tick: u64) -> u64 {
    let longest = (steps_per_tick / LOOKS_PER_TICK).max(1);
    (1..=longest).rev().find(|steps| steps_per_tick.is_multiple_of(*steps)).unwrap_or(1)
}

/// When emulated buses were served.
struct Service {
    /// Clock reading at bench time 0 \[ns\].
    start_ns: u64,
    /// Clock reading at the last service \[ns\].
    last_ns: u64,
}

impl Service {
    /// Serves the buses at every interval that ends before `deadline_ns`.
    fn until(
        &mut self,
        deadline_ns: u64,
        rig: &mut Rig,
        clock: &dyn Clock,
        report: &mut RunReport,
    ) {
        loop {
            let due_ns = self.last_ns + SERVICE_NS;
            if due_ns >= deadline_ns {
                return;
            }
            clock.sleep_until_ns(due_ns);
            self.serve(clock.now_ns(), rig, report);
        }
    }

    fn serve(&mut self, now_ns: u64, rig: &mut Rig, report: &mut RunReport) {
        let gap_ns = now_ns - self.last_ns;
        report.service_gap_ns_max = report.service_gap_ns_max.max(gap_ns);
        report.late_services += u64::from(gap_ns > 2 * SERVICE_NS);
        rig.service(now_ns - self.start_ns);
        self.last_ns = now_ns;
    }
}

fn running(rig: &Rig, late_wakes: u64) -> Progress {
    let time_s = rig.time_ns() as f64 * 1e-9;
    Progress::Running { time_s, duration_s: rig.scenario().duration_s, late_wakes }
}

/// Tells the ECUs three times that it is over, in case a frame is lost, and waits a little for
/// their last words, which belong to the recording.
fn say_goodbye(rig: &mut Rig, clock: &dyn Clock) {
    let look = |rig: &mut Rig| {
        clock.sleep_until_ns(clock.now_ns() + FAREWELL_NS);
        rig.listen();
    };
    for _ in 0..3 {
        rig.end();
        look(rig);
    }
    for _ in 0..LAST_LOOKS_MAX {
        if rig.is_silent() {
            break;
        }
        look(rig);
    }
}
