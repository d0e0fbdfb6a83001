//! `platoon rehearse`: rig and ECUs together, judged at the end.

mod floors;
mod profile_cost;
mod real_time;
mod trace;
pub(crate) mod virtual_time;

use std::collections::BTreeMap;
use std::fs;
use std::time::Instant;

use bench_sim::rig::RunReport;
use bench_sim::{Results, Scenario};
use controller_rt::Report;
use law::Calibration;
use vcan_setup::floor::Floor;
use vcan_setup::realtime::environment;

use crate::bench::load_scenario;
use crate::bus::BusChoice;
use crate::calibration;
use crate::cli::{BusKind, BusTimingKind, EcuChoice, RehearseArgs, Word};
use crate::failure::Failure;
use crate::fault::{Fault, FaultKind};
use crate::gain::{self, Settled};
use crate::gateway::Gateway;
use crate::live::Live;
use crate::process;
use crate::report;
use crate::run_folder::RunFolder;
use crate::summary::{Files, Ingredients, Summary, Verdict};

pub use floors::{Floors, cyclictest_json};
pub use profile_cost::{ProfileCost, TruckCost};
use virtual_time::Experiment;

/// A rehearsal that is ready to run: everything is checked, nothing is written yet.
struct Plan<'a> {
    args: &'a RehearseArgs,
    scenario: Scenario,
    calibration: Calibration,
    /// The gain's number in the library, and what is to be said about it.
    gain_id: u8,
    gain_note: Option<String>,
    /// Rate of the control loop \[Hz\].
    rate_hz: u32,
}

/// Who serves others while a run is on.
struct Beside {
    gateway: Option<Gateway>,
    live: Option<Live>,
}

/// How a run ended, before it is judged.
#[derive(Default)]
struct Outcome {
    results: Option<Results>,
    rig_pace: Option<RunReport>,
    ecus: Vec<Report>,
    floor: Option<Floors>,
    notes: Vec<String>,
    interrupted: bool,
}

/// Rehearses, prints the summary, leaves the run's files.
///
/// # Errors
/// When the run cannot start.
pub fn run(args: &RehearseArgs) -> Result<Verdict, Failure> {
    let plan = Plan::new(args)?;
    if plan.is_virtual() {
        let bus = BusChoice::loopback();
        let folder = RunFolder::create(args.out.as_deref(), &args.scenario)?;
        plan.conclude(&folder, &bus, || virtual_time::run(&plan, &folder))
    } else {
        let bus = BusChoice::for_run(args.bus, &args.place, plan.trucks())?;
        let gateway = real_time::start_gateway(&plan, &bus)?;
        let folder = RunFolder::create(args.out.as_deref(), &args.scenario)?;
        let live = real_time::start_live(&plan, &folder)?;
        plan.announce(&bus, gateway.as_ref(), live.as_ref());
        let beside = Beside { gateway, live };
        plan.conclude(&folder, &bus, || real_time::run(&plan, &folder, &bus, beside))
    }
}

/// A run in real time for its deadlines alone.
pub(crate) struct Timed {
    /// What each ECU reports.
    pub(crate) ecus: Vec<Report>,
    /// How late the machine woke the sentinel beside the run.
    pub(crate) floor: Floor,
    /// The kind of its bus.
    pub(crate) backend: String,
    /// What happened that was not asked for.
    pub(crate) notes: Vec<String>,
    /// Whether somebody stopped it.
    pub(crate) interrupted: bool,
}

/// Runs rig and ECUs in real time; their recordings stay in parts, and nothing is judged.
///
/// # Errors
/// When the run cannot start.
pub(crate) fn time(args: &RehearseArgs, folder: &RunFolder) -> Result<Timed, Failure> {
    let plan = Plan::new(args)?;
    let bus = BusChoice::for_run(args.bus, &args.place, plan.trucks())?;
    plan.write_inputs(folder)?;
    let beside = Beside { gateway: None, live: None };
    let outcome = real_time::run(&plan, folder, &bus, beside)?;
    let Outcome { ecus, notes, interrupted, floor, .. } = outcome;
    let floor = floor.map_or(Floor { cpus: Vec::new() }, |floors| floors.beside);
    Ok(Timed { ecus, floor, backend: bus.backend().to_owned(), notes, interrupted })
}

/// Runs in virtual time and leaves what each process recorded in a part of its own.
///
/// # Errors
/// When the run cannot start.
pub(crate) fn record(args: &RehearseArgs, folder: &RunFolder) -> Result<(), Failure> {
    let plan = Plan::new(args)?;
    plan.write_inputs(folder)?;
    virtual_time::run(&plan, folder).map(drop)
}

/// The trucks of a run that an ECU drives.
///
/// # Errors
/// When the run makes no sense.
pub(crate) fn ecus(args: &RehearseArgs) -> Result<Vec<u8>, Failure> {
    Plan::new(args).map(|plan| plan.ecus().collect())
}

impl<'a> Plan<'a> {
    /// Checks everything that can be checked without touching the machine.
    fn new(args: &'a RehearseArgs) -> Result<Self, Failure> {
        if args.virtual_time && !matches!(args.bus, BusKind::Auto | BusKind::Loopback) {
            return Err(Failure::usage(
                "--virtual-time runs on the loopback bus; leave out --bus, or --virtual-time",
            ));
        }
        if args.socketcand.is_some() && (args.virtual_time || args.bus == BusKind::Loopback) {
            return Err(Failure::usage(
                "--socketcand: the bus of a run in virtual time lives inside one process, nobody \
                 can join it; leave out --virtual-time (and --bus loopback), or --socketcand",
            ));
        }
        let stalls = |fault: &Fault| matches!(fault.kind, FaultKind::Stall { .. });
        if let Some(fault) = args.fault.iter().find(|fault| stalls(fault) && is_virtual(args)) {
            return Err(Failure::usage(format!(
                "--fault {fault}: thinking takes no time in virtual time; leave out \
                 --virtual-time (and --bus loopback), or the stall"
            )));
        }
        if let Some(cpu) = args.timing.cpus.missing(&environment().online_cpus) {
            return Err(Failure::usage(format!(
                "--cpus {}: CPU {cpu} is not online; online are {:?}",
                args.timing.cpus,
                environment().online_cpus
            )));
        }
        if (args.live.is_some() || args.tui) && (args.virtual_time || args.bus == BusKind::Loopback)
        {
            return Err(Failure::usage(
                "--live and --tui: virtual time is over before anybody looks; leave out \
                 --virtual-time (and --bus loopback), or look at the run's report.html and \
                 run.mcap afterwards",
            ));
        }
        if let Some(path) = &args.json {
            process::check_parent("--json", path)?;
        }
        let scenario = load_scenario(&args.scenario, &args.run, args.v2v_delay)?;
        let calibration = calibration::from_table(&scenario.name, &scenario.law)?;
        let calibration = calibration::asked_for(calibration, &args.law_options, args.run.profile)?;
        let trucks = scenario.platoon.trucks;
        let settled = gain::settled(calibration, &args.law_options, Some(trucks))?;
        let Settled { calibration, gain_id, note: gain_note } = settled;
        let rate_hz = args.run.rate_hz()?;
        let plan = Self { args, scenario, calibration, gain_id, gain_note, rate_hz };
        let first = usize::from(!plan.scenario.has_ecu(0));
        let allowed = format!("ECUs drive trucks {first} to {} of it", plan.trucks() - 1);
        let known = |truck: u8| plan.ecus().any(|ecu| ecu == truck);
        if let EcuChoice::One(truck) = args.ecu
            && !known(truck)
        {
            let name = &plan.scenario.name;
            return Err(Failure::usage(format!("--ecu {truck}: scenario {name}: {allowed}")));
        }
        match args.fault.iter().find(|fault| !known(fault.truck)) {
            Some(fault) => {
                let (truck, name) = (fault.truck, &plan.scenario.name);
                Err(Failure::usage(format!("--fault truck={truck}: scenario {name}: {allowed}")))
            }
            None => Ok(plan),
        }
    }

    /// What is run, without how it is timed and recorded.
    fn experiment(&self) -> Experiment<'_> {
        Experiment {
            scenario: &self.scenario,
            calibration: self.calibration,
            gain_id: self.gain_id,
            solver: self.args.law_options.solver,
            rate_hz: self.rate_hz,
            seed: self.args.run.seed,
            without_emergency_braking: self.args.law_options.no_emergency_braking,
            faults: &self.args.fault,
        }
    }

    fn is_virtual(&self) -> bool {
        is_virtual(self.args)
    }

    /// Whether frames take the time of a real bus.
    fn is_emulated(&self) -> bool {
        self.args.run.bus_timing == BusTimingKind::Emulate
    }

    fn trucks(&self) -> usize {
        self.scenario.platoon.trucks
    }

    /// Trucks that an ECU drives.
    fn ecus(&self) -> impl Iterator<Item = u8> {
        (0..self.trucks() as u8).filter(|&truck| self.scenario.has_ecu(usize::from(truck)))
    }

    /// Whether the ECU of a truck knows more about its truck than the others.
    fn is_told(&self, truck: u8) -> bool {
        self.scenario.told_mass_kg(usize::from(truck)).is_some()
    }

    /// Says loudly which bus it is and why, and who may attach.
    fn announce(&self, bus: &BusChoice, gateway: Option<&Gateway>, live: Option<&Live>) {
        anstream::eprintln!(
            "{}: {} trucks at {} Hz, {:.0} s, on bus {} ({})",
            self.scenario.name,
            self.trucks(),
            self.rate_hz,
            self.scenario.duration_s,
            bus.backend(),
            bus.reason
        );
        if let Some(address) = live.map(Live::address) {
            anstream::eprintln!("Foxglove and Lichtblick may look at ws://{address}");
        }
        let Some(address) = gateway.map(Gateway::address) else { return };
        anstream::eprintln!("socketcand clients may attach at {address}");
        if !address.ip().is_loopback() {
            anstream::eprintln!(
                "warning: whoever reaches {address} can send frames to the rig and the ECUs; there \
                 is no password"
            );
        }
    }

    /// Runs, merges the recordings, judges, and writes and prints the summary.
    fn conclude(
        &self,
        folder: &RunFolder,
        bus: &BusChoice,
        run: impl FnOnce() -> Result<Outcome, Failure>,
    ) -> Result<Verdict, Failure> {
        self.write_inputs(folder)?;
        let began = Instant::now();
        let mut outcome = run()?;
        outcome.notes.extend(self.gain_note.clone());
        let elapsed_s = began.elapsed().as_secs_f64();
        anstream::eprintln!("merging the recordings into {}", folder.trace().display());
        let mut files =
            Files { report: Some(folder.report().display().to_string()), ..Files::default() };
        if let Some(floors) = &outcome.floor {
            let path = folder.floor();
            process::write_json(&path, &floors::cyclictest_json(&floors.beside))?;
            files.floor = Some(path.display().to_string());
        }
        match trace::merge(self, folder, bus, &outcome) {
            Ok(notes) => {
                files.mcap = Some(folder.trace().display().to_string());
                outcome.notes.extend(notes);
            }
            Err(why) => outcome.notes.push(why),
        }
        if self.args.law_options.no_emergency_braking {
            outcome.notes.push("the guards' emergency layer was off".to_owned());
        }
        let ran = outcome.results.as_ref().map_or(&[][..], |results| &results.trucks);
        // Who pressed Ctrl-C does not wait for another run to compare with.
        let measured = match outcome.interrupted {
            true => Ok(None),
            false => profile_cost::measure(self, folder, ran),
        };
        let cost = measured.unwrap_or_else(|why| {
            outcome.notes.push(format!("the cost of the profile is not known: {why}"));
            None
        });
        let mut summary = Summary::new(Ingredients {
            scenario: &self.scenario,
            seed: self.args.run.seed,
            rate_hz: self.rate_hz,
            solver: self.args.law_options.solver.word(),
            results: outcome.results,
            rig_pace: outcome.rig_pace,
            ecus: outcome.ecus,
            floor: outcome.floor.as_ref(),
            grace_s: self.args.timing.overrun.startup_grace_s,
            cpu_plan: self.args.timing.cpus.to_string(),
            bus: (bus.backend().into(), bus.reason.clone(), bus.interfaces(self.trucks())),
            profile: self.args.run.profile,
            announces: self.calibration.structure.announces(),
            bus_timing: self.args.run.bus_timing,
            profile_cost: cost,
            elapsed_s,
            notes: outcome.notes,
            interrupted: outcome.interrupted,
            environment: describe_environment(),
        });
        summary.files = files;
        let trace = summary.files.mcap.is_some().then(|| folder.trace());
        if let Err(why) = report::conclude(&folder.report(), trace.as_deref(), &summary) {
            // The run is over, and what came of it does not depend on a page.
            summary.files.report = None;
            summary.notes.push(format!("no report: {why}"));
        }
        self.publish(folder, &summary)?;
        if self.args.timing.strict_timing {
            return summary.timing_verdict.strictly(summary.verdict);
        }
        Ok(summary.verdict)
    }

    /// What the processes of the run read, and what somebody needs to repeat it.
    fn write_inputs(&self, folder: &RunFolder) -> Result<(), Failure> {
        let law = |calibration: &Calibration| {
            toml::to_string(calibration)
                .map_err(|error| Failure::cannot_start(format!("law.toml: {error}")))
        };
        let mut files = vec![
            (folder.scenario(), self.scenario.to_toml()),
            (folder.law(), law(&self.calibration)?),
        ];
        for truck in self.ecus().filter(|&truck| self.is_told(truck)) {
            files.push((
                folder.law_of(truck),
                law(&calibration::of_truck(&self.calibration, &self.scenario, truck))?,
            ));
        }
        process::reserve_json(&folder.summary())?;
        for (path, text) in files {
            fs::write(&path, text).map_err(|error| {
                Failure::cannot_start(format!("cannot write {}: {error}", path.display()))
            })?;
        }
        Ok(())
    }

    fn publish(&self, folder: &RunFolder, summary: &Summary) -> Result<(), Failure> {
        anstream::println!("{}", summary.page());
        process::write_json(&folder.summary(), summary)?;
        match &self.args.json {
            Some(path) => process::write_json(path, summary),
            None => Ok(()),
        }
    }
}

/// Whether a run is asked for in virtual time.
fn is_virtual(args: &RehearseArgs) -> bool {
    args.virtual_time || args.bus == BusKind::Loopback
}

/// The machine, in words.
pub(crate) fn describe_environment() -> BTreeMap<String, String> {
    let host = environment();
    let list = |cpus: &[usize]| cpus.iter().map(usize::to_string).collect::<Vec<_>>().join(",");
    let limit = |limit: Option<u64>| limit.map_or("unlimited".into(), |n| n.to_string());
    BTreeMap::from([
        ("kernel".into(), host.kernel),
        ("preempt_rt".into(), host.preempt_rt.to_string()),
        ("tick_hz".into(), host.tick_hz.map_or("unknown".into(), |hz| hz.to_string())),
        ("clocksource".into(), host.clocksource.unwrap_or_else(|| "unknown".into())),
        ("governors".into(), host.governors.join(",")),
        ("online_cpus".into(), list(&host.online_cpus)),
        ("isolated_cpus".into(), list(&host.isolated_cpus)),
        ("rtprio_limit".into(), limit(host.rtprio_limit)),
        ("memlock_limit_bytes".into(), limit(host.memlock_limit_bytes)),
        ("virtual_machine".into(), host.virtual_machine.to_string()),
    ])
}
