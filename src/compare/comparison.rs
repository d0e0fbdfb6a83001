//! The whole comparison as one value: what is printed, and what goes into JSON and Markdown.

use bench_sim::Scenario;
use serde::Serialize;

use super::arm::{Arm, Contender, Plant, Situation, TUNED_POSITION_WEIGHT};
use super::claim::Claim;
use super::claims;
use super::design::{BENCH_RATE_HZ, Design, Evidence, FIRST_SEED, RATE_SITUATIONS, Runs};
use super::errata::{ERRATA, Erratum, OUT_OF_SCOPE, OutOfScope};
use super::figure::Figure;
use super::figures;
use super::improvement::{self, Improvement, Placement};
use super::measure;
use super::requirement::{self, Requirement};
use super::spread::Spread;
use super::uniformity::Uniformity;
use crate::campaign::Outcome;
use crate::summary::{Verdict, ecu_criteria};

/// How far a loop rate's largest error may be from that at 1000 Hz, as a share of it, or
/// [`RATE_BAND_M`].
const RATE_SHARE: f64 = 0.10;
/// How far it may be in any case \[m\]: a centimetre or two of a small number is no difference.
const RATE_BAND_M: f64 = 0.05;

/// The comparison. Field names are a contract; see `docs/compare.md`.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Version of this program.
    pub version: String,
    /// Whether everything we hold ourselves to holds.
    pub verdict: Verdict,
    /// First seed.
    pub first_seed: u64,
    /// How many seeds.
    pub seeds: usize,
    /// Loop rate \[Hz\].
    pub rate_hz: u32,
    /// How many runs it took.
    pub runs: usize,
    /// Weight of the slot in the tuned baseline.
    pub tuned_position_weight: f64,
    /// The paper's claims beside ours.
    pub claims: Vec<Claim>,
    /// Table III, every controller there is.
    pub table_iii: Vec<TableIii>,
    /// MCF against its baseline.
    pub improvements: Vec<Improvement>,
    /// Every place of obstacle 2.
    pub placements: Vec<Placement>,
    /// What we hold ourselves to.
    pub requirements: Vec<Requirement>,
    /// Lemma 1; none when it was not run.
    pub uniformity: Option<Uniformity>,
    /// The same runs at other loop rates.
    pub loop_rates: Vec<LoopRate>,
    /// Every scenario against its own criteria.
    pub scenarios: Vec<ScenarioVerdict>,
    /// The paper's inconsistencies.
    pub errata: Vec<Erratum>,
    /// What of the paper is not here.
    pub out_of_scope: Vec<OutOfScope>,
    /// The figures.
    pub figures: Vec<FigureEntry>,
}

/// A controller's row of Table III.
#[derive(Debug, Clone, Serialize)]
pub struct TableIii {
    /// The controller.
    pub controller: String,
    /// ‖s̄₂‖ / ‖s̄₁‖.
    pub ratio_2_1: Spread,
    /// ‖s̄₃‖ / ‖s̄₂‖.
    pub ratio_3_2: Spread,
    /// max ‖s̄ᵢ‖ \[m\].
    pub max_m: Spread,
    /// What the paper prints for it: the ratios, and the maximum \[m\].
    pub published: Option<[f64; 3]>,
}

/// A situation at one loop rate.
#[derive(Debug, Clone, Serialize)]
pub struct LoopRate {
    /// The situation.
    pub situation: String,
    /// The loop rate \[Hz\].
    pub rate_hz: u32,
    /// Largest s̄, median \[m\].
    pub largest_error_m: f64,
    /// Least clearance, median \[m\]; none without an obstacle.
    pub clearance_m: Option<f64>,
    /// How far the error is from that at 1000 Hz, in per cent of it.
    pub off_percent: f64,
    /// Whether that is near enough.
    pub holds: bool,
}

/// A scenario of the bench against its own criteria.
#[derive(Debug, Clone, Serialize)]
pub struct ScenarioVerdict {
    /// Its name.
    pub name: String,
    /// What happens in it.
    pub description: String,
    /// How many runs there were.
    pub runs: usize,
    /// How many of them passed.
    pub passed: usize,
    /// Criteria that failed in any.
    pub failed: Vec<String>,
}

/// Where a figure is.
#[derive(Debug, Clone, Serialize)]
pub struct FigureEntry {
    /// What the paper calls it.
    pub of: String,
    /// What it shows.
    pub title: String,
    /// What to look at.
    pub caption: String,
    /// Its picture, beside the Markdown.
    pub picture: String,
    /// Its numbers, below `--out`.
    pub data: Vec<String>,
}

impl FigureEntry {
    fn new(figure: &Figure) -> Self {
        Self {
            of: figure.of.clone(),
            title: figure.title.clone(),
            caption: figure.caption.clone(),
            picture: format!("pictures/{}.svg", figure.file),
            data: figure.tables().iter().map(|(name, _)| format!("data/{name}")).collect(),
        }
    }
}

impl Comparison {
    /// Everything the runs say, and the figures they make.
    pub fn new(design: &Design, runs: &Runs) -> (Self, Vec<Figure>) {
        let evidence = &Evidence { design, runs };
        let uniformity = Uniformity::of(design, runs);
        let improvements = improvement::improvements(evidence);
        let requirements = requirement::requirements(evidence, &improvements, uniformity.as_ref());
        let figures = figures::figures(design, runs, uniformity.as_ref());
        let loop_rates = loop_rates(design, runs);
        let scenarios = scenarios(design, runs);
        let holds = requirements.iter().all(Requirement::holds)
            && loop_rates.iter().all(|rate| rate.holds)
            && scenarios.iter().all(|scenario| scenario.passed == scenario.runs);
        let comparison = Self {
            version: env!("CARGO_PKG_VERSION").into(),
            verdict: if holds { Verdict::Pass } else { Verdict::Fail },
            first_seed: FIRST_SEED,
            seeds: design.seeds,
            rate_hz: design.rate_hz,
            runs: runs.len(),
            tuned_position_weight: TUNED_POSITION_WEIGHT,
            claims: claims::claims(evidence, &improvements, uniformity.as_ref()),
            table_iii: table_iii(evidence),
            placements: improvement::placements(evidence),
            improvements,
            requirements,
            uniformity,
            loop_rates,
            scenarios,
            errata: ERRATA.to_vec(),
            out_of_scope: OUT_OF_SCOPE.to_vec(),
            figures: figures.iter().map(FigureEntry::new).collect(),
        };
        (comparison, figures)
    }
}

fn table_iii(evidence: &Evidence<'_>) -> Vec<TableIii> {
    let row = |contender: Contender| {
        let outcomes = evidence.of(Situation::Platooning, contender, Plant::SingleTrack);
        let spread = |of: fn(&Outcome) -> f64| Spread::of(outcomes.iter().map(of));
        let name = contender.name();
        let published = claims::TABLE_III.iter().find(|(word, _)| *word == name);
        Some(TableIii {
            ratio_2_1: spread(|outcome| measure::ratio(outcome, 2))?,
            ratio_3_2: spread(|outcome| measure::ratio(outcome, 3))?,
            max_m: spread(measure::largest_predecessor_error_m)?,
            published: published.map(|(_, numbers)| *numbers),
            controller: name,
        })
    };
    Contender::all().into_iter().filter_map(row).collect()
}

/// The situations that were run at 1000 Hz, at every rate they were run at.
fn loop_rates(design: &Design, runs: &Runs) -> Vec<LoopRate> {
    let mut rates = Vec::new();
    for situation in RATE_SITUATIONS {
        let arm =
            |rate_hz| Arm { rate_hz, ..design.arm(situation, Contender::MCF, Plant::SingleTrack) };
        let seeds = runs.of(arm(BENCH_RATE_HZ)).len();
        // The same seeds at every rate.
        let median = |rate_hz, of: fn(&Outcome) -> f64| {
            Spread::of(runs.of(arm(rate_hz)).iter().take(seeds).map(of)).map(|s| s.median)
        };
        let error = |rate_hz| median(rate_hz, measure::largest_predecessor_error_m);
        let Some(bench_m) = error(BENCH_RATE_HZ) else { continue };
        for rate_hz in design.rates_hz() {
            let Some(largest_error_m) = error(rate_hz) else { continue };
            let off_m = (largest_error_m - bench_m).abs();
            rates.push(LoopRate {
                situation: situation.name().into(),
                rate_hz,
                largest_error_m,
                clearance_m: median(rate_hz, measure::clearance_m).filter(|m| m.is_finite()),
                off_percent: 100.0 * (largest_error_m / bench_m - 1.0),
                holds: off_m <= (RATE_SHARE * bench_m).max(RATE_BAND_M),
            });
        }
    }
    rates
}

fn scenarios(design: &Design, runs: &Runs) -> Vec<ScenarioVerdict> {
    let verdict = |(place, summary): (usize, bench_sim::scenario::Summary)| {
        let situation = Situation::BuiltIn(place);
        let outcomes = runs.of(design.arm(situation, Contender::MCF, Plant::SingleTrack));
        let mut failed: Vec<String> =
            outcomes.iter().flat_map(|outcome| failures(outcome, summary.name)).collect();
        failed.sort();
        failed.dedup();
        (!outcomes.is_empty()).then(|| ScenarioVerdict {
            name: summary.name.into(),
            description: summary.description,
            runs: outcomes.len(),
            passed: outcomes.iter().filter(|o| failures(o, summary.name).is_empty()).count(),
            failed,
        })
    };
    Scenario::list().into_iter().enumerate().filter_map(verdict).collect()
}

/// Names of the criteria of its scenario that a run fails, the ECUs' among them.
fn failures(outcome: &Outcome, scenario: &str) -> Vec<String> {
    let scenario = Scenario::load(scenario, &[]).ok();
    let of_ecus = scenario.iter().flat_map(|s| ecu_criteria(s, &outcome.ecus).collect::<Vec<_>>());
    let all = outcome.results.criteria.iter().cloned().chain(of_ecus);
    all.filter(|criterion| !criterion.passed).map(|criterion| criterion.name).collect()
}
