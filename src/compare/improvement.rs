//! How much lower the largest error is with the paper's framework than with its baseline.
//!
//! The error is s̄_i, to the truck ahead, as in the paper's Fig. 17, and the largest of all trucks.

use serde::{Deserialize, Serialize};

use super::arm::{Contender, PLACEMENTS_M, Plant, Situation};
use super::design::{Evidence, drivers};
use super::measure;
use super::spread::Spread;

/// MCF against one form of the baseline in one situation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Improvement {
    /// The situation.
    pub situation: String,
    /// The form of the baseline.
    pub baseline: String,
    /// What the paper prints, in per cent; the abstract and section III-D contradict each other.
    pub published: String,
    /// Largest s̄ of MCF \[m\].
    pub mcf_m: Spread,
    /// Largest s̄ of the baseline \[m\].
    pub baseline_m: Spread,
    /// How much lower MCF's is, seed by seed, in per cent; negative when it is higher.
    pub percent: Spread,
}

/// The three situations: name, what the paper prints, and the arms.
const SITUATIONS: [(&str, &str, &[i8]); 3] = [
    ("platooning", "19.2", &[]),
    ("merging", "59.8 (abstract), 15.3 (III-D)", &[]),
    ("obstacle avoidance", "15.3 (abstract), 59.8 (III-D)", &PLACEMENTS_M),
];

/// Every improvement whose runs were made.
pub fn improvements(evidence: &Evidence<'_>) -> Vec<Improvement> {
    let baselines = drivers().into_iter().filter(|contender| *contender != Contender::MCF);
    let baselines: Vec<Contender> = baselines.collect();
    let pair = |((name, published, placements), baseline): ((&str, &str, &[i8]), Contender)| {
        let situations: Vec<Situation> = match name {
            "platooning" => vec![Situation::Platooning],
            "merging" => vec![Situation::Merging],
            _ => placements.iter().map(|&metres| Situation::Avoidance(metres)).collect(),
        };
        improvement(evidence, &situations, baseline).map(|(mcf_m, baseline_m, percent)| {
            Improvement {
                situation: name.into(),
                baseline: baseline.name(),
                published: published.into(),
                mcf_m,
                baseline_m,
                percent,
            }
        })
    };
    let pairs = SITUATIONS.iter().flat_map(|&s| baselines.iter().map(move |&b| (s, b)));
    pairs.filter_map(pair).collect()
}

/// Both contenders' largest errors and the improvement, over all seeds of these situations.
fn improvement(
    evidence: &Evidence<'_>,
    situations: &[Situation],
    baseline: Contender,
) -> Option<(Spread, Spread, Spread)> {
    let pairs = |&situation: &Situation| {
        let of = |contender| {
            let outcomes = evidence.of(situation, contender, Plant::SingleTrack).iter();
            outcomes.map(measure::largest_predecessor_error_m)
        };
        of(Contender::MCF).zip(of(baseline)).collect::<Vec<(f64, f64)>>()
    };
    let pairs: Vec<(f64, f64)> = situations.iter().flat_map(pairs).collect();
    Some((
        Spread::of(pairs.iter().map(|(mcf, _)| *mcf))?,
        Spread::of(pairs.iter().map(|(_, other)| *other))?,
        Spread::of(pairs.iter().map(|(mcf, other)| 100.0 * (1.0 - mcf / other)))?,
    ))
}

/// One contender with obstacle 2 at one place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// How much further ahead obstacle 2 is than usual \[m\].
    pub obstacle_2_further_m: i8,
    /// The contender.
    pub contender: String,
    /// Largest s̄ \[m\].
    pub largest_error_m: Spread,
    /// Least clearance to an obstacle \[m\].
    pub clearance_m: Spread,
    /// When every truck is at its speed for good \[s\]; infinite when one never is.
    pub settled_speed_s: Option<Spread>,
    /// Least distance of a truck to an obstacle when that appears \[m\].
    pub spawn_clearance_m: Spread,
}

/// Every contender at every placement whose runs were made.
pub fn placements(evidence: &Evidence<'_>) -> Vec<Placement> {
    let one = |(metres, contender): (i8, Contender)| {
        let outcomes = evidence.of(Situation::Avoidance(metres), contender, Plant::SingleTrack);
        let settled = Spread::of(outcomes.iter().map(measure::settled_speed_s));
        Some(Placement {
            obstacle_2_further_m: metres,
            contender: contender.name(),
            largest_error_m: Spread::of(outcomes.iter().map(measure::largest_predecessor_error_m))?,
            clearance_m: Spread::of(outcomes.iter().map(measure::clearance_m))?,
            settled_speed_s: settled.filter(|spread| spread.max.is_finite()),
            spawn_clearance_m: Spread::of(outcomes.iter().filter_map(|o| o.spawn_clearance_m))?,
        })
    };
    let all = PLACEMENTS_M.into_iter().flat_map(|m| drivers().into_iter().map(move |c| (m, c)));
    all.filter_map(one).collect()
}
