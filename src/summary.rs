//! What a rehearsal ends with: one value, for programs as JSON and for people as a page of text.

mod bus;
mod page;

use std::collections::BTreeMap;

use bench_sim::rig::RunReport;
use bench_sim::{ChannelReport, Criterion, NodeCounts, Results, Scenario, TruckResult};
use controller_rt::{Ending, Report};
use platoon_dbc::Profile;
use serde::{Deserialize, Serialize};
use vcan_setup::floor::{Floor, Percentiles};

use crate::cli::BusTimingKind;
use crate::rehearse::{Floors, ProfileCost};
use crate::timing::{self, Timing, TimingVerdict};

pub use bus::{BusSummary, Observed};

/// The summary of one run. Field names are a contract; see the README.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Summary {
    /// Version of this program.
    pub version: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// QP solver of the motion layer.
    pub solver: String,
    /// Whether the behaviour passed.
    pub verdict: Verdict,
    /// Whether the deadlines were met, net of the machine's own floor.
    pub timing_verdict: TimingVerdict,
    /// What that verdict stands on; none in virtual time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<Timing>,
    /// The bus.
    pub bus: BusSummary,
    /// Bench time covered \[s\].
    pub duration_s: f64,
    /// How long the run took \[s\] of real time.
    pub elapsed_s: f64,
    /// How each truck did.
    pub trucks: Vec<TruckResult>,
    /// How each ECU did; a killed one left no report.
    pub ecus: Vec<Report>,
    /// Wake-up lateness of this machine without any controller; none in virtual time.
    pub machine_floor_us: Option<MachineFloor>,
    /// What happened on every truck's bus, as the rig saw it.
    pub nodes: Vec<NodeCounts>,
    /// How well the rig kept time; none in virtual time.
    pub rig_pace: Option<RunReport>,
    /// The V2V channel, measured from the messages delivered.
    pub v2v: ChannelReport,
    /// What the profile's rates and resolutions cost; none on CAN FD.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile_cost: Option<ProfileCost>,
    /// The scenario's criteria.
    pub criteria: Vec<Criterion>,
    /// What happened that was not asked for.
    pub notes: Vec<String>,
    /// The machine.
    pub environment: BTreeMap<String, String>,
    /// Where everything is.
    pub files: Files,
}

/// Pass or fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Every criterion holds.
    Pass,
    /// At least one does not, or the run was cut short.
    Fail,
}

/// How late the bare machine wakes a thread \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MachineFloor {
    /// Half of all wake-ups.
    pub p50: f64,
    /// 99 % of them.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// All.
    pub max: f64,
    /// Share of wake-ups more than half a loop period late.
    pub late_share: f64,
    /// The same before the run began.
    #[serde(default)]
    pub before: Option<Lateness>,
    /// The same after it.
    #[serde(default)]
    pub after: Option<Lateness>,
}

/// How late the machine woke a thread, without the run \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lateness {
    /// Half of all wake-ups.
    pub p50: f64,
    /// 99 % of them.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// All.
    pub max: f64,
}

/// Where a run's files are.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Files {
    /// The merged trace; absent when it could not be written.
    pub mcap: Option<String>,
    /// The page for people.
    pub report: Option<String>,
    /// The machine's floor beside the run as cyclictest writes it; absent in virtual time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<String>,
}

/// Everything a summary is made of.
pub struct Ingredients<'a> {
    /// The scenario as run.
    pub scenario: &'a Scenario,
    /// Seed.
    pub seed: u64,
    /// Loop rate \[Hz\].
    pub rate_hz: u32,
    /// Solver's name.
    pub solver: String,
    /// The rig's results; none when the rig died.
    pub results: Option<Results>,
    /// How well the rig kept time; none in virtual time or when it died.
    pub rig_pace: Option<RunReport>,
    /// The ECUs' reports.
    pub ecus: Vec<Report>,
    /// The machine's floor and the number of wake-ups it stands on; none in virtual time.
    pub floor: Option<&'a Floors>,
    /// Startup grace \[s\].
    pub grace_s: f64,
    /// Which CPUs rig and ECUs were kept on.
    pub cpu_plan: String,
    /// Backend, reason and interfaces.
    pub bus: (String, String, Vec<String>),
    /// How it carried messages.
    pub profile: Profile,
    /// Whether trucks told each other their plans.
    pub announces: bool,
    /// Whether frames took their time.
    pub bus_timing: BusTimingKind,
    /// What the profile cost against CAN FD.
    pub profile_cost: Option<ProfileCost>,
    /// How long the run took \[s\].
    pub elapsed_s: f64,
    /// What happened that was not asked for.
    pub notes: Vec<String>,
    /// Whether somebody stopped it before its end.
    pub interrupted: bool,
    /// Environment, for the record.
    pub environment: BTreeMap<String, String>,
}

impl Summary {
    /// Judges a run.
    pub fn new(mut run: Ingredients<'_>) -> Self {
        let results = run.results.take().unwrap_or_default();
        let bus = BusSummary::new(&run, &results.wires);
        let mut notes = run.notes;
        let mut criteria = results.criteria;
        criteria.extend(ecu_criteria(run.scenario, &run.ecus));
        for ecu in &run.ecus {
            notes.extend(complaints(ecu));
        }
        let trucks = run.scenario.platoon.trucks;
        let driven = (0..trucks).filter(|&truck| run.scenario.has_ecu(truck)).count();
        let missing = driven.saturating_sub(run.ecus.len());
        if missing > 0 {
            notes.push(format!("{missing} ECU(s) ended without a report"));
        }
        let complete = !run.interrupted && missing == 0 && !results.trucks.is_empty();
        let passed = complete && criteria.iter().all(|criterion| criterion.passed);
        let period_ns = 1_000_000_000 / u64::from(run.rate_hz.max(1));
        let judged = run.floor.map(|floors| {
            Timing::new(&run.ecus, &floors.beside, period_ns, (run.grace_s, run.cpu_plan))
        });
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            scenario: run.scenario.name.clone(),
            seed: run.seed,
            rate_hz: run.rate_hz,
            solver: run.solver,
            verdict: if passed { Verdict::Pass } else { Verdict::Fail },
            timing_verdict: judged.as_ref().map_or(TimingVerdict::Virtual, |t| t.verdict),
            timing: judged,
            bus,
            duration_s: results.duration_s,
            elapsed_s: run.elapsed_s,
            trucks: results.trucks,
            ecus: run.ecus,
            machine_floor_us: run.floor.map(|floors| MachineFloor::new(floors, period_ns)),
            nodes: results.nodes,
            rig_pace: run.rig_pace,
            v2v: results.v2v,
            profile_cost: run.profile_cost,
            criteria,
            notes,
            environment: run.environment,
            files: Files::default(),
        }
    }

    /// The page for people.
    pub fn page(&self) -> String {
        page::page(self)
    }
}

impl MachineFloor {
    fn new(floors: &Floors, period_ns: u64) -> Self {
        let Percentiles { p50_us, p99_us, p999_us, max_us } = floors.beside.percentiles();
        let late = timing::late_wakeups(&floors.beside, &[], period_ns / 2);
        Self {
            p50: p50_us,
            p99: p99_us,
            p999: p999_us,
            max: max_us,
            late_share: late.share(),
            before: Some(Lateness::new(&floors.before)),
            after: Some(Lateness::new(&floors.after)),
        }
    }
}

impl Lateness {
    /// The percentiles of a floor.
    pub fn new(floor: &Floor) -> Self {
        let Percentiles { p50_us, p99_us, p999_us, max_us } = floor.percentiles();
        Self { p50: p50_us, p99: p99_us, p999: p999_us, max: max_us }
    }
}

/// The criteria the rig cannot see: what the ECUs count.
pub(crate) fn ecu_criteria(
    scenario: &Scenario,
    ecus: &[Report],
) -> impl Iterator<Item = Criterion> {
    let limits = &scenario.criteria;
    let failures: u64 = ecus.iter().map(|ecu| ecu.qp.failures).sum();
    let brakings: u64 = ecus.iter().map(|ecu| u64::from(ecu.emergency_brakings)).sum();
    let counted = [
        ("max_qp_failures", limits.max_qp_failures, failures),
        ("max_emergency_brakings", limits.max_emergency_brakings, brakings),
    ];
    counted.into_iter().filter_map(|(name, limit, count)| {
        limit.map(|limit| Criterion::at_most(name, limit.into(), Some(count as f64)))
    })
}

fn complaints(ecu: &Report) -> Vec<String> {
    let truck = ecu.truck;
    let mut notes = Vec::new();
    match ecu.ending {
        Ending::MissionEnded => (),
        Ending::Stopped => notes.push(format!("ECU {truck} was stopped before the end")),
        Ending::RigSilent => notes.push(format!("ECU {truck} ended because the rig fell silent")),
        Ending::Overrun => {
            notes.push(format!("ECU {truck} gave up: more slots lost than --max-overloads allows"));
        }
    }
    if ecu.dropped_records > 0 {
        notes.push(format!("ECU {truck}: {} records dropped", ecu.dropped_records));
    }
    if let Some(error) = &ecu.recording_error {
        notes.push(format!("ECU {truck}: recording incomplete: {error}"));
    }
    notes
}
