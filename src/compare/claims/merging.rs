//! Section III-B: a vehicle merges between the trucks, Figs. 8 to 10.

use super::super::arm::Situation;
use super::super::claim::{Agreement, Claim};
use super::super::design::Evidence;
use super::super::measure;
use super::super::spread::fixed;

pub(super) fn claims(evidence: &Evidence<'_>) -> Vec<Claim> {
    let claims = [overtaking(evidence), asynchronous(evidence), errors(evidence), speeds(evidence)];
    claims.into_iter().flatten().chain(safe(evidence)).collect()
}

fn overtaking(evidence: &Evidence<'_>) -> Option<Claim> {
    let spread = evidence.spread(Situation::Merging, |o| measure::first_out_s(o, 1))?;
    Some(Claim::number(
        ("III-B, Fig. 8", "truck 1 begins to overtake"),
        ("1.6 s", Agreement::when((1.2..=2.4).contains(&spread.median))),
        (spread, 1, "s"),
        "Ours is when its centre of gravity is 1 m out of its lane; where the van starts is ours.",
    ))
}

fn asynchronous(evidence: &Evidence<'_>) -> Option<Claim> {
    let outcomes = evidence.mcf(Situation::Merging);
    let out = |truck| evidence.spread(Situation::Merging, |o| measure::first_out_s(o, truck));
    let (one, two, three) = (out(1)?, out(2)?, out(3)?);
    let in_turn = |o: &&crate::campaign::Outcome| {
        let times: Vec<f64> = (1..4).map(|truck| measure::first_out_s(o, truck)).collect();
        times.is_sorted() && times.iter().all(|time| time.is_finite())
    };
    let all = outcomes.iter().filter(in_turn).count() == outcomes.len();
    let [one, two, three] = [one, two, three].map(|spread| fixed(spread.median, 1));
    Some(Claim::statement(
        ("III-B, Fig. 8", "who changes lane when"),
        "one after the other",
        (&format!("trucks 1, 2, 3 at {one}, {two}, {three} s"), Agreement::when(all)),
        "",
    ))
}

fn errors(evidence: &Evidence<'_>) -> Option<Claim> {
    let position = evidence.spread(Situation::Merging, measure::settled_position_s)?;
    let lateral = evidence.spread(Situation::Merging, measure::settled_lateral_s)?;
    let ours = format!(
        "in slot (0.5 m) after {} s, back in lane after {} s",
        position.text(1),
        lateral.text(1)
    );
    Some(Claim::statement(
        ("III-B, Fig. 9", "position errors"),
        "fluctuate, converge after 30 s",
        (&ours, Agreement::when(position.max <= 34.0 && lateral.max <= 34.0)),
        "Our followers pass the van without leaving their slots by more than 0.5 m; the last one \
         is back in lane 2 to 3 s later than the paper's, as our van starts where we chose.",
    ))
}

fn speeds(evidence: &Evidence<'_>) -> Option<Claim> {
    let speed = evidence.spread(Situation::Merging, measure::settled_speed_s)?;
    let lateral = evidence.spread(Situation::Merging, measure::settled_lateral_s)?;
    Some(Claim::number(
        ("III-B, Fig. 10", "speeds"),
        ("converge after the avoidance", Agreement::when(speed.max <= lateral.max + 5.0)),
        (speed, 1, "s"),
        "When every speed is within 0.2 m/s of the set speed for good.",
    ))
}

fn safe(evidence: &Evidence<'_>) -> Option<Claim> {
    let spread = evidence.spread(Situation::Merging, measure::clearance_m)?;
    Some(Claim::number(
        ("III-B", "safe operation: least distance of a truck to the van"),
        ("no contact", Agreement::when(spread.min > 0.0)),
        (spread, 2, "m"),
        "",
    ))
}
