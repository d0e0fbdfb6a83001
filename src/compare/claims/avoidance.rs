//! Section III-C: obstacle avoidance, Figs. 12 to 16.

use super::super::arm::{PLACEMENT_OF_THE_TEXT_M, Situation};
use super::super::claim::{Agreement, Claim};
use super::super::design::Evidence;
use super::super::measure;
use super::super::spread::{Spread, fixed};
use crate::campaign::Outcome;

const USUAL: Situation = Situation::Avoidance(0);
const BACK: Situation = Situation::Avoidance(PLACEMENT_OF_THE_TEXT_M);
/// When the obstacles block the road \[s\].
const BLOCKED_S: f64 = 49.0;

pub(super) fn claims(evidence: &Evidence<'_>) -> Vec<Claim> {
    let claims = [
        asynchronous(evidence),
        blocked(evidence),
        deviation(evidence),
        converged(evidence, USUAL, "speeds converged, obstacle 2 at 797 m"),
        converged(evidence, BACK, "speeds converged, obstacle 2 at 785 m"),
        fluctuation(evidence),
        brakes_first(evidence),
        weight(evidence),
        printed_weight(evidence),
        safe(evidence),
    ];
    claims.into_iter().flatten().collect()
}

fn asynchronous(evidence: &Evidence<'_>) -> Option<Claim> {
    let out = |truck| evidence.spread(USUAL, |o| measure::first_out_s(o, truck));
    let times = [out(0)?, out(1)?, out(2)?, out(3)?];
    let crossings = evidence.spread(USUAL, measure::crossings)?;
    let in_turn = times.windows(2).all(|pair| pair[0].max < pair[1].min);
    let times = times.map(|spread| fixed(spread.median, 1)).join(", ");
    Some(Claim::statement(
        ("III-C, Fig. 12", "who changes lane when"),
        "asynchronously; all carry out lane changing and overtaking",
        (
            &format!("at {times} s; every truck out and back once"),
            Agreement::when(in_turn && crossings.min == 2.0 && crossings.max == 2.0),
        ),
        "",
    ))
}

fn blocked(evidence: &Evidence<'_>) -> Option<Claim> {
    let spread = evidence.spread(USUAL, |o| measure::first_out_s(o, 2))?;
    Some(Claim::number(
        ("III-C, Fig. 12", "truck 2 is blocked until"),
        ("49 s", Agreement::when((BLOCKED_S - 2.0..=BLOCKED_S + 3.0).contains(&spread.median))),
        (spread, 1, "s"),
        "Ours is when its centre of gravity is 1 m out of its lane, behind obstacle 2.",
    ))
}

fn deviation(evidence: &Evidence<'_>) -> Option<Claim> {
    let standing = |o: &Outcome| {
        let mean = |truck| measure::mean_after(o, truck, 90.0, |m| m.leader_error_m).abs();
        (1..4).map(mean).fold(0.0, f64::max)
    };
    let spread = evidence.spread(USUAL, standing)?;
    Some(Claim::number(
        ("III-C, Fig. 13", "deviation from the leader at the end, with delay"),
        ("there is one", Agreement::when(spread.median > 0.05)),
        (spread, 3, "m"),
        "As in platooning: Eq. 4 as printed leaves none.",
    ))
}

fn converged(evidence: &Evidence<'_>, situation: Situation, what: &str) -> Option<Claim> {
    let spread = evidence.spread(situation, measure::settled_speed_s)?;
    Some(Claim::number(
        ("III-C, Fig. 14", what),
        ("after 75 s", Agreement::of_number(75.0, &spread)),
        (spread, 1, "s"),
        "Set by how long obstacle 2 blocks truck 2, which the paper does not print. 12 m further \
         back fits its text best.",
    ))
}

fn fluctuation(evidence: &Evidence<'_>) -> Option<Claim> {
    let swing = |truck: usize| {
        move |o: &Outcome| {
            let span_s = (BLOCKED_S - 5.0, BLOCKED_S + 15.0);
            let speeds = measure::between(o, truck, span_s, |m| m.speed_mps);
            let most = speeds.iter().copied().fold(f64::MIN, f64::max);
            most - speeds.iter().copied().fold(f64::MAX, f64::min)
        }
    };
    let (two, leader) = (evidence.spread(USUAL, swing(2))?, evidence.spread(USUAL, swing(0))?);
    let ours = format!("truck 2 by {} m/s, the leader by {} m/s", two.text(1), leader.text(1));
    Some(Claim::statement(
        ("III-C, Fig. 14", "speed about 49 s"),
        "truck 2 fluctuates",
        (&ours, Agreement::when(two.min > leader.max + 1.0)),
        "",
    ))
}

fn brakes_first(evidence: &Evidence<'_>) -> Option<Claim> {
    let slowest = |o: &Outcome| {
        let out_s = measure::first_out_s(o, 2);
        let before = measure::between(o, 2, (out_s - 15.0, out_s), |m| m.speed_mps);
        before.into_iter().fold(f64::MAX, f64::min)
    };
    let drives = |o: &Outcome| {
        let out_s = measure::first_out_s(o, 2);
        let after = measure::between(o, 2, (out_s - 3.0, out_s + 15.0), |m| 1e-3 * m.force_n);
        after.into_iter().fold(f64::MIN, f64::max)
    };
    let (low, high) = (evidence.spread(USUAL, slowest)?, evidence.spread(USUAL, drives)?);
    let ours =
        format!("truck 2 slows to {} m/s, then drives with {} kN", low.text(1), high.text(1));
    Some(Claim::statement(
        ("III-C, Fig. 15", "commands at obstacle 1"),
        "first decelerate, then accelerate to change lane",
        (&ours, Agreement::when(low.max < 17.5 && high.min > 2.0)),
        "From 18 m/s; resistance does most of the slowing. 20 kN is the limit.",
    ))
}

/// How far Q_ref of truck 2 is below its largest value before, while it is blocked.
fn weight(evidence: &Evidence<'_>) -> Option<Claim> {
    let fall = |o: &Outcome| {
        let span_s = (BLOCKED_S - 9.0, BLOCKED_S + 6.0);
        let weights = measure::between(o, 2, span_s, |m| m.q_ref);
        let most = weights.iter().copied().fold(f64::MIN, f64::max);
        100.0 * (1.0 - weights.iter().copied().fold(f64::MAX, f64::min) / most)
    };
    let spread = evidence.spread(USUAL, fall)?;
    Some(Claim::number(
        ("III-C, Fig. 16", "Q_ref of truck 2 about 49 s, U in units of 1000"),
        ("decreases", Agreement::when(spread.min > 10.0)),
        (spread, 0, "% lower"),
        "The unit is ours. Even so every obstacle that comes into sight adds up to Q₀/4 first.",
    ))
}

fn printed_weight(evidence: &Evidence<'_>) -> Option<Claim> {
    let fall = |o: &Outcome| {
        let weights = measure::between(o, 2, (0.0, f64::INFINITY), |m| m.q_ref);
        let heard = || weights.iter().copied().filter(|weight| weight.is_finite());
        let most = heard().fold(f64::MIN, f64::max);
        100.0 * (1.0 - heard().fold(f64::MAX, f64::min) / most)
    };
    let spread = evidence.spread(Situation::AvoidancePrintedWeight, fall)?;
    Some(Claim::number(
        ("III-C, Fig. 16", "the same, Eq. 22 as printed"),
        ("decreases", Agreement::when(spread.min > 10.0)),
        (spread, 2, "% at most"),
        "With a = 10000, U is 4 or less only beyond a normalised distance of 580, so a potential \
         as printed moves the weight by less than 1 %. Ours fades beside the own path, and the \
         printed equation then steps by Q₀/4 for every obstacle that is out of the way.",
    ))
}

fn safe(evidence: &Evidence<'_>) -> Option<Claim> {
    let clearance = evidence.spread(USUAL, measure::clearance_m)?;
    let gap = evidence.spread(USUAL, measure::gap_m)?;
    let ours = Spread { min: clearance.min.min(gap.min), ..clearance };
    Some(Claim::number(
        ("III-C", "safe decisions: least distance of a truck to an obstacle"),
        ("no contact", Agreement::when(ours.min > 0.0)),
        (clearance, 2, "m"),
        "Trucks keep more than 30 m from each other.",
    ))
}
