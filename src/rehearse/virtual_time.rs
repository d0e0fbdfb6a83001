//! A rehearsal in virtual time: one thread alternates rig and ECUs, bit-identical for a seed.
//!
//! On ideal buses an ECU ticks right after the rig has published, and its command is there at once.
//! On emulated ones it ticks half a period later, as in real time, with what has arrived by then;
//! its own frames take their time too. Thinking takes no time in either.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bench_sim::{Results, Rig, Scenario};
use controller_rt::{Config, Controller, Ecu, Report, Slot};
use law::Calibration;
use platoon_dbc::{Bus, Clock, EcuMode, Emulated, Loopback, Profile};
use traces::{Overflow, Recorder, Source, TruthRecord};

use super::{Outcome, Plan};
use crate::bench::{LOOPBACK_FRAMES, recording_loss};
use crate::calibration;
use crate::cli::SolverKind;
use crate::clock::HostClock;
use crate::failure::Failure;
use crate::fault::{Fault, FaultKind};
use crate::process;
use crate::progress::ProgressLine;
use crate::run_folder::RunFolder;

/// Ticks between two looks at progress and Ctrl-C.
const TICKS_PER_LOOK: u32 = 64;

/// Runs the plan as fast as the processor allows.
///
/// # Errors
/// When the run cannot start.
pub(super) fn run(plan: &Plan<'_>, folder: &RunFolder) -> Result<Outcome, Failure> {
    let mut bench =
        Bench::assemble(&plan.experiment(), Setting::of(plan, folder), process::stop_flag()?)?;
    bench.begin()?;
    let line = ProgressLine::new(plan.scenario.duration_s);
    let interrupted = bench.alternate(Some(&line), &plan.args.fault, &mut |_| ());
    let mut outcome = bench.end();
    outcome.interrupted = interrupted;
    outcome.notes.extend(interrupted.then(|| "interrupted".to_owned()));
    outcome.notes.extend(plan.args.fault.iter().map(|fault| format!("fault injected: {fault}")));
    Ok(outcome)
}

/// A run that nobody recorded.
pub(super) struct Twin {
    /// What it came to.
    pub(super) results: Results,
    /// The world at every tick.
    pub(super) truth: Vec<TruthRecord>,
}

/// Runs the plan on CAN FD with ideal buses and without faults.
///
/// # Errors
/// When the run cannot start.
pub(super) fn twin(plan: &Plan<'_>) -> Result<Twin, Failure> {
    let line = ProgressLine::new(plan.scenario.duration_s);
    let mut truth = Vec::new();
    let stop = process::stop_flag()?;
    let mut watch = |rig: &Rig| truth.push(rig.truth());
    let experiment = Experiment { faults: &[], ..plan.experiment() };
    let ended = observe(&experiment, stop, Some(&line), Box::new(as_it_is), &mut watch)?;
    Ok(Twin { results: ended.results, truth })
}

/// What is run: trucks and traffic, their law, and how fast its loop is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Experiment<'a> {
    /// The scenario.
    pub(crate) scenario: &'a Scenario,
    /// The law's numbers, every override applied.
    pub(crate) calibration: Calibration,
    /// The gain among them, by its place in the library; 0 when it is from none.
    pub(crate) gain_id: u8,
    /// Who solves its QPs.
    pub(crate) solver: SolverKind,
    /// Rate of the control loop \[Hz\].
    pub(crate) rate_hz: u32,
    /// Seed of everything random.
    pub(crate) seed: u64,
    /// Whether the guards' emergency layer is off.
    pub(crate) without_emergency_braking: bool,
    /// What breaks, and when.
    pub(crate) faults: &'a [Fault],
}

/// The end of a run that was only watched.
pub(crate) struct Observed {
    /// What the rig saw.
    pub(crate) results: Results,
    /// What each ECU reports.
    pub(crate) ecus: Vec<Report>,
}

/// What is put between an ECU and its control law; it is told which truck that ECU drives.
pub(crate) type Wrap<'a> = Box<dyn Fn(u8, Box<dyn Controller>) -> Box<dyn Controller> + 'a>;

/// The control law without anything around it.
pub(crate) fn as_it_is(_truck: u8, law: Box<dyn Controller>) -> Box<dyn Controller> {
    law
}

/// Runs an experiment on CAN FD with ideal buses, without recording; `watch` sees the rig at the
/// start of every tick. It ends early when `stop` is set.
///
/// # Errors
/// When the run cannot start.
pub(crate) fn observe(
    experiment: &Experiment<'_>,
    stop: Arc<AtomicBool>,
    line: Option<&ProgressLine>,
    wrap: Wrap<'_>,
    watch: &mut dyn FnMut(&Rig),
) -> Result<Observed, Failure> {
    let setting = Setting { folder: None, profile: Profile::Fd, is_emulated: false, wrap };
    let mut bench = Bench::assemble(experiment, setting, stop)?;
    bench.begin()?;
    bench.alternate(line, experiment.faults, watch);
    let Outcome { results, ecus, .. } = bench.end();
    Ok(Observed { results: results.unwrap_or_default(), ecus })
}

/// Everything about a run that is not the experiment itself.
struct Setting<'a> {
    /// Where to record, if anywhere.
    folder: Option<&'a RunFolder>,
    profile: Profile,
    is_emulated: bool,
    wrap: Wrap<'a>,
}

impl<'a> Setting<'a> {
    fn of(plan: &Plan<'_>, folder: &'a RunFolder) -> Self {
        let (profile, is_emulated) = (plan.args.run.profile, plan.is_emulated());
        Self { folder: Some(folder), profile, is_emulated, wrap: Box::new(as_it_is) }
    }

    fn recorder(&self, source: Source, buses: Vec<String>) -> Result<Option<Recorder>, Failure> {
        let record = |folder| process::recorder(folder, source, Overflow::Wait, buses);
        self.folder.map(record).transpose()
    }
}

/// Rig and ECUs, joined by loopback buses.
struct Bench {
    rig: Rig,
    /// One place per truck; empty for a scripted one, and once its ECU is dead.
    ecus: Vec<Option<Ecu>>,
    is_emulated: bool,
    clock: HostClock,
    stop: Arc<AtomicBool>,
}

impl Bench {
    fn assemble(
        experiment: &Experiment<'_>,
        setting: Setting<'_>,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, Failure> {
        let scenario = experiment.scenario;
        let mut ends: Vec<Box<dyn Bus>> = Vec::new();
        let mut ecus = Vec::new();
        for truck in 0..scenario.platoon.trucks as u8 {
            let (rig_end, ecu_end) = Loopback::pair(&format!("loopback{truck}"), LOOPBACK_FRAMES);
            ends.push(if setting.is_emulated {
                Box::new(Emulated::new(rig_end, setting.profile.timing()).stamping_bench_time())
            } else {
                Box::new(rig_end)
            });
            let is_driven = scenario.has_ecu(usize::from(truck));
            ecus.push(is_driven.then(|| ecu(experiment, &setting, truck, ecu_end)).transpose()?);
        }
        let names = process::bus_names(&ends);
        let recorder = setting.recorder(Source::Rig, names)?;
        let rig = Rig::new(scenario, experiment.seed, experiment.rate_hz, ends, recorder)
            .map_err(Failure::usage)?
            .speaking(setting.profile);
        let is_emulated = setting.is_emulated;
        Ok(Self { rig, ecus, is_emulated, clock: HostClock::default(), stop })
    }

    /// Invitation, answers, and the first state.
    fn begin(&mut self) -> Result<(), Failure> {
        self.rig.invite();
        self.prepare();
        if !self.rig.ready() {
            return Err(Failure::cannot_start("an ECU did not answer its invitation on loopback"));
        }
        self.rig.start();
        self.prepare();
        Ok(())
    }

    fn prepare(&mut self) {
        for ecu in self.ecus.iter_mut().flatten() {
            ecu.prepare(&self.clock);
        }
    }

    /// Tick by tick until the scenario ends; true when somebody interrupted it. `watch` sees the
    /// rig at the start of every tick.
    fn alternate(
        &mut self,
        line: Option<&ProgressLine>,
        faults: &[Fault],
        watch: &mut dyn FnMut(&Rig),
    ) -> bool {
        let mut interrupted = false;
        while !self.rig.finished() && !interrupted {
            watch(&self.rig);
            let (tick, time_s) = (self.rig.tick(), self.rig.time_ns() as f64 * 1e-9);
            self.one_tick(faults, time_s);
            if tick.is_multiple_of(TICKS_PER_LOOK) {
                if let Some(line) = line {
                    line.show(time_s, self.rig.scenario().duration_s);
                }
                interrupted = self.stop.load(Ordering::Relaxed);
            }
        }
        if let Some(line) = line {
            line.clear();
        }
        interrupted
    }

    /// The steps of the rig between two publications, and the ECUs' tick among them.
    fn one_tick(&mut self, faults: &[Fault], time_s: f64) {
        let (tick, steps) = (self.rig.tick(), self.rig.steps_per_tick());
        let period_ns = self.rig.base_step_ns() * steps;
        let middle_ns = self.rig.time_ns() + period_ns / 2;
        let steps_before = if self.is_emulated { steps / 2 } else { 0 };
        for _ in 0..steps_before {
            self.rig.step();
        }
        self.carry(middle_ns);
        for (truck, place) in self.ecus.iter_mut().enumerate() {
            match stopped(faults, truck as u8, time_s) {
                Some(FaultKind::KillEcu) => drop(place.take()),
                Some(FaultKind::PauseEcu { .. } | FaultKind::Stall { .. }) => (),
                None => {
                    if let Some(ecu) = place {
                        let slot = Slot::on_time(tick, period_ns, &self.clock);
                        tick_if_running(ecu, slot, &self.clock);
                    }
                }
            }
        }
        // What the ECUs have just sent is queued now.
        self.carry(middle_ns);
        for _ in steps_before..steps {
            self.rig.step();
        }
    }

    /// Lets emulated buses carry what they can by then; ideal ones need nobody.
    fn carry(&mut self, time_ns: u64) {
        if self.is_emulated {
            self.rig.service(time_ns);
        }
    }

    /// The farewell, and what everybody has to report.
    fn end(mut self) -> Outcome {
        self.rig.end();
        let results = Some(self.rig.results());
        let mut outcome = Outcome { results, ..Outcome::default() };
        for mut ecu in self.ecus.into_iter().flatten() {
            ecu.prepare(&self.clock);
            outcome.ecus.push(ecu.finish(&self.clock));
        }
        // Their last words belong to the recording.
        self.rig.listen();
        outcome.notes.extend(self.rig.take_recorder().and_then(recording_loss));
        outcome
    }
}

fn ecu(
    experiment: &Experiment<'_>,
    setting: &Setting<'_>,
    truck: u8,
    end: Loopback,
) -> Result<Ecu, Failure> {
    let recorder = setting.recorder(Source::Ecu(truck), vec![end.name().to_owned()])?;
    let believed = calibration::of_truck(&experiment.calibration, experiment.scenario, truck);
    let law = calibration::controller(believed, experiment.solver);
    let config = Config {
        truck,
        gain_id: experiment.gain_id,
        profile: setting.profile,
        vehicle: calibration::vehicle(&believed),
        without_emergency_braking: experiment.without_emergency_braking,
        ..Config::default()
    };
    Ok(Ecu::new(config, Box::new(end), (setting.wrap)(truck, law), recorder))
}

/// An ECU that has not heard of the run yet keeps waiting for it.
fn tick_if_running(ecu: &mut Ecu, slot: Slot, clock: &dyn Clock) {
    let is_waiting = |ecu: &Ecu| matches!(ecu.mode(), EcuMode::Waiting | EcuMode::Ready);
    if is_waiting(ecu) {
        ecu.prepare(clock);
    }
    if !is_waiting(ecu) {
        ecu.tick(slot, clock);
    }
}

/// The fault that keeps an ECU from ticking now.
fn stopped(faults: &[Fault], truck: u8, time_s: f64) -> Option<FaultKind> {
    faults.iter().find(|fault| fault.stops(truck, time_s)).map(|fault| fault.kind)
}
