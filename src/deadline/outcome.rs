//! What a deadline test comes to: its cells, judged, and the rates that are sustained.

use std::collections::BTreeMap;

use controller_rt::{Lapses, Miss, Report};
use serde::{Deserialize, Serialize};
use vcan_setup::floor::{Floor, Percentiles};

use super::load::Load;
use super::plan::{Cell, GRACE_S, Subject};
use crate::cli::{DeadlineArgs, Word};
use crate::rehearse::{Timed, describe_environment};
use crate::summary::Lateness;
use crate::timing::{Timing, TimingVerdict};

/// Misses kept of a cell, with their timelines.
const EXHIBITS: usize = 4;

/// The outcome of a test. Field names are a contract; see docs/real-time.md.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Deadline {
    /// Version of this program.
    pub version: String,
    /// Name of the scenario.
    pub scenario: String,
    /// The bus between rig and ECUs; none when no cell needed it.
    pub bus: Option<String>,
    /// The rate that decides \[Hz\].
    pub nominal_hz: u32,
    /// Whether the nominal rate keeps its deadlines under every load.
    pub verdict: TimingVerdict,
    /// The highest rates that are sustained.
    pub sustained: Vec<Sustained>,
    /// Every cell.
    pub cells: Vec<CellOutcome>,
    /// Stalls put into the law.
    pub faults: Vec<String>,
    /// How long the test took \[s\].
    pub elapsed_s: f64,
    /// The machine.
    pub environment: BTreeMap<String, String>,
}

/// The highest rate that something sustains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sustained {
    /// What.
    pub subject: Subject,
    /// Under which load; under every one that was tested when there is none.
    pub load: Option<Load>,
    /// The rate \[Hz\]; none when there is none that surely is.
    pub rate_hz: Option<u32>,
}

/// One cell, judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellOutcome {
    /// What was run.
    #[serde(flatten)]
    pub cell: Cell,
    /// Whether its deadlines were kept.
    pub verdict: TimingVerdict,
    /// The words for it: what was lost, why, and what the machine did.
    pub evidence: String,
    /// How long after its deadline the worst slot was served, or could have begun \[ms\]; negative
    /// when every slot was served in time.
    pub worst_lateness_ms: f64,
    /// The cause of most of the slots lost; none when none was.
    pub cause: Option<String>,
    /// Runs of lost slots by cause.
    pub causes: BTreeMap<String, Lapses>,
    /// What the verdict stands on.
    pub timing: Timing,
    /// How late the machine woke the sentinel beside it \[µs\].
    pub floor_us: Lateness,
    /// The worst misses with their timelines, worst first.
    pub worst_misses: Vec<Miss>,
    /// What happened that was not asked for.
    pub notes: Vec<String>,
}

impl CellOutcome {
    /// Judges a cell.
    pub fn new(cell: &Cell, timed: Timed, cpus: String) -> Self {
        let Timed { ecus, floor, mut notes, .. } = timed;
        let period_ns = 1_000_000_000 / u64::from(cell.rate_hz.max(1));
        let timing = Timing::new(&ecus, &floor, period_ns, (GRACE_S, cpus));
        let causes = causes(&ecus);
        let most = causes.iter().max_by_key(|(_, lapses)| lapses.slots);
        let cause = most.map(|(cause, _)| cause.clone());
        let slowest_us = ecus.iter().map(|ecu| ecu.slowest_us).fold(0.0, f64::max);
        let dropped: u64 = ecus.iter().map(|ecu| ecu.dropped_records).sum();
        if dropped > 0 {
            notes.push(format!("{dropped} records dropped"));
        }
        Self {
            cell: *cell,
            verdict: timing.verdict,
            evidence: evidence(&timing, &causes, &floor),
            worst_lateness_ms: (slowest_us - period_ns as f64 / 1e3) / 1e3,
            cause,
            causes,
            floor_us: Lateness::new(&floor),
            worst_misses: worst(&ecus),
            timing,
            notes,
        }
    }
}

/// Runs of lost slots of all ECUs by cause.
fn causes(ecus: &[Report]) -> BTreeMap<String, Lapses> {
    let mut all: BTreeMap<String, Lapses> = BTreeMap::new();
    for (cause, lapses) in ecus.iter().flat_map(|ecu| &ecu.lapses) {
        let sum = all.entry(cause.clone()).or_default();
        sum.times += lapses.times;
        sum.slots += lapses.slots;
    }
    all
}

fn worst(ecus: &[Report]) -> Vec<Miss> {
    let after_grace = |miss: &&Miss| miss.time_s >= GRACE_S;
    let misses = ecus.iter().flat_map(|ecu| &ecu.worst_misses).filter(after_grace);
    let mut worst: Vec<Miss> = misses.cloned().collect();
    worst.sort_by(|a, b| b.late_us.total_cmp(&a.late_us));
    worst.truncate(EXHIBITS);
    worst
}

/// What was lost, why, and what the machine did, in words.
fn evidence(timing: &Timing, causes: &BTreeMap<String, Lapses>, floor: &Floor) -> String {
    let percent = |share: f64| format!("{:.3}", 100.0 * share);
    let mut words = format!("{} of {} slots lost", timing.lost, timing.slots);
    if timing.lost > 0 {
        let word = |(cause, lapses): (&String, &Lapses)| match lapses.times {
            1 => format!("{cause} {} at once", lapses.slots),
            times => format!("{cause} {} in {times} runs", lapses.slots),
        };
        let causes: Vec<String> = causes.iter().map(word).collect();
        words += &format!(" ({})", causes.join(", "));
    }
    let (least, most) = timing.net_share;
    let (least, most, allowed) = (percent(least), percent(most), percent(timing.allowed_share));
    words += &format!(": {least} to {most} % net of pauses, allowed {allowed} %");
    let Percentiles { max_us, .. } = floor.percentiles();
    words += &format!("; sentinel up to {:.2} ms late", max_us / 1e3);
    let slack_us = timing.ecus.iter().map(|ecu| ecu.slack_us).fold(f64::INFINITY, f64::min);
    if slack_us.is_finite() {
        let (_, late) = timing.floor_share;
        words += &format!(", {} % at most more than {slack_us:.0} µs", percent(late));
    }
    words
}

impl Deadline {
    /// The outcome of these cells.
    pub fn new(
        cells: Vec<CellOutcome>,
        args: &DeadlineArgs,
        bus: Option<String>,
        elapsed_s: f64,
    ) -> Self {
        let verdicts: Vec<TimingVerdict> = cells
            .iter()
            .filter(|outcome| outcome.cell.rate_hz == args.rate_hz)
            .map(|outcome| outcome.verdict)
            .collect();
        let mut environment = describe_environment();
        environment.insert("solver".into(), args.law_options.solver.word());
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            scenario: args.scenario.clone(),
            bus,
            nominal_hz: args.rate_hz,
            verdict: worst_of(&verdicts),
            sustained: sustained(&cells),
            cells,
            faults: args.fault.iter().map(ToString::to_string).collect(),
            elapsed_s,
            environment,
        }
    }
}

/// A fail is a fail, and only passes make a pass.
fn worst_of(verdicts: &[TimingVerdict]) -> TimingVerdict {
    use TimingVerdict::{Fail, Inconclusive, Pass};
    if verdicts.contains(&Fail) {
        Fail
    } else if !verdicts.is_empty() && verdicts.iter().all(|verdict| *verdict == Pass) {
        Pass
    } else {
        Inconclusive
    }
}

/// The highest rates sustained, load by load and under all of them.
fn sustained(cells: &[CellOutcome]) -> Vec<Sustained> {
    let mut loads: Vec<Load> = Vec::new();
    for outcome in cells {
        if !loads.contains(&outcome.cell.load) {
            loads.push(outcome.cell.load);
        }
    }
    let each = loads.iter().copied().map(Some).chain([None]);
    [Subject::Bench, Subject::Ecu]
        .into_iter()
        .filter(|subject| cells.iter().any(|outcome| outcome.cell.subject == *subject))
        .flat_map(|subject| {
            each.clone().map(move |load| {
                let judged = cells.iter().filter(move |outcome| {
                    let Cell { subject: of, load: under, .. } = outcome.cell;
                    of == subject && load.is_none_or(|load| load == under)
                });
                let verdicts = judged.map(|outcome| (outcome.cell.rate_hz, outcome.verdict));
                Sustained { subject, load, rate_hz: highest(verdicts) }
            })
        })
        .collect()
}

/// The highest rate all of whose cells pass, with no fail below it. A lower rate that nobody can
/// judge does not count against it: who meets the tighter deadlines meets the wider ones.
fn highest(verdicts: impl Iterator<Item = (u32, TimingVerdict)>) -> Option<u32> {
    let mut by_rate: BTreeMap<u32, Vec<TimingVerdict>> = BTreeMap::new();
    for (rate_hz, verdict) in verdicts {
        by_rate.entry(rate_hz).or_default().push(verdict);
    }
    let mut highest = None;
    for (rate_hz, verdicts) in by_rate {
        match worst_of(&verdicts) {
            TimingVerdict::Pass => highest = Some(rate_hz),
            TimingVerdict::Fail => break,
            TimingVerdict::Inconclusive | TimingVerdict::Virtual => (),
        }
    }
    highest
}

#[cfg(test)]
mod tests;
