//! Section III-D: Table III and Fig. 17.

use super::super::arm::{Contender, Plant, Situation};
use super::super::claim::{Agreement, Claim};
use super::super::design::Evidence;
use super::super::improvement::Improvement;
use super::super::measure;
use super::super::spread::Spread;

/// A row of Table III: controller, s̄₂/s̄₁, s̄₃/s̄₂, max s̄ \[m\].
pub const TABLE_III: [(&str, [f64; 3]); 3] =
    [("mcf", [0.21, 0.15, 0.61]), ("dmpc-pf", [0.90, 0.94, 0.2]), ("dmpc-plf", [0.89, 0.98, 0.2])];

const RATIOS: &str = "A delay common to all trucks gives 0.11 for any drive lag, in closed form; \
    0.21 and 0.15 come with six of 2000 draws of independent delays, and the second ratio is of \
    centimetres. Smaller is better.";
const DMPC: &str = "The paper quotes passenger cars without delay, plant mismatch or CAN, from its \
    reference [15]; ours are trucks in the platooning scenario, with delay.";

pub(super) fn claims(evidence: &Evidence<'_>, improvements: &[Improvement]) -> Vec<Claim> {
    let mut claims = Vec::new();
    for contender in Contender::all() {
        let published = TABLE_III.iter().find(|(word, _)| *word == contender.name());
        if let Some((_, published)) = published {
            claims.extend(row(evidence, contender, published));
        }
    }
    claims.extend(faster(evidence));
    claims.extend(["platooning", "merging", "obstacle avoidance"].into_iter().filter_map(|name| {
        improved(
            improvements
                .iter()
                .find(|i| i.situation == name && i.baseline == Contender::SINGLE.name())?,
        )
    }));
    claims
}

fn row(evidence: &Evidence<'_>, contender: Contender, published: &[f64; 3]) -> Vec<Claim> {
    let outcomes = evidence.of(Situation::Platooning, contender, Plant::SingleTrack);
    let is_ours = contender == Contender::MCF;
    let name = contender.name();
    let numbers = [
        ("s̄₂ / s̄₁", Spread::of(outcomes.iter().map(|o| measure::ratio(o, 2)))),
        ("s̄₃ / s̄₂", Spread::of(outcomes.iter().map(|o| measure::ratio(o, 3)))),
        ("max s̄", Spread::of(outcomes.iter().map(measure::largest_predecessor_error_m))),
    ];
    let claim = |((what, spread), &published): ((&str, Option<Spread>), &f64)| {
        let spread = spread?;
        let agreement = match is_ours {
            true => Agreement::of_number(published, &spread),
            false => Agreement::NotComparable,
        };
        let (unit, why) = match (what, is_ours) {
            (_, false) => (if what == "max s̄" { "m" } else { "" }, DMPC),
            ("max s̄", true) => {
                ("m", "Fits a drive lag of 0.43 to 0.45 s in Theorem 1's model, too.")
            }
            (_, true) => ("", RATIOS),
        };
        let published = format!("{published} {unit}");
        let about = format!("{what} of {name}");
        let source = ("III-D, Table III", about.as_str());
        Some(Claim::number(source, (published.trim_end(), agreement), (spread, 2, unit), why))
    };
    numbers.into_iter().zip(published).filter_map(claim).collect()
}

fn faster(evidence: &Evidence<'_>) -> Option<Claim> {
    let decreasing = |o: &crate::campaign::Outcome| {
        let errors: Vec<f64> = (1..4).map(|truck| measure::predecessor_error_m(o, truck)).collect();
        f64::from(errors[0] > errors[1] && errors[0] > errors[2])
    };
    let share = evidence.spread(Situation::Platooning, decreasing)?;
    Some(Claim::statement(
        ("III-D, Fig. 17", "errors along the string in platooning"),
        "decrease from s̄₁ to s̄₃",
        (
            if share.min == 1.0 {
                "s̄₁ is the largest, every seed"
            } else {
                "not for every seed"
            },
            Agreement::when(share.min == 1.0),
        ),
        "s̄₂ and s̄₃ are both a few centimetres; with delay their order changes from seed to seed.",
    ))
}

fn improved(improvement: &Improvement) -> Option<Claim> {
    let (published, why) = match improvement.situation.as_str() {
        "platooning" => (
            "19.2 %",
            "The baseline's weight of the distance to its slot is not printed: 80 here, on raw \
             delayed states, which leaves it a standing error. Tuned and delay-compensated: below.",
        ),
        "merging" => (
            "59.8 % (abstract) or 15.3 % (III-D)",
            "The paper contradicts itself. As in platooning, the baseline's weight decides.",
        ),
        _ => (
            "15.3 % (abstract) or 59.8 % (III-D)",
            "The paper contradicts itself. Over six places of obstacle 2: the peak is set by how \
             long truck 2 is blocked, not by the controller, and a baseline that lags is blocked \
             elsewhere.",
        ),
    };
    // By the median alone: over the places of obstacle 2 the band holds nearly every number.
    let is_near = [19.2, 59.8, 15.3].iter().any(|number| {
        published.contains(&number.to_string())
            && (improvement.percent.median - number).abs() <= 0.15 * number
    });
    let what = format!("largest s̄ lower than single-structure MPC's, {}", improvement.situation);
    let source = ("III-D, Fig. 17", what.as_str());
    let number = (improvement.percent, 0, "%");
    Some(Claim::number(source, (published, Agreement::when(is_near)), number, why))
}
