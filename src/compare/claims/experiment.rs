//! Section IV: the hardware-in-the-loop experiment, Figs. 19 and 20.

use super::super::arm::Situation;
use super::super::claim::{Agreement, Claim};
use super::super::design::Evidence;
use super::super::measure;
use crate::campaign::Outcome;

pub(super) fn claims(evidence: &Evidence<'_>) -> Vec<Claim> {
    let claims = [avoids(evidence), converges(evidence), in_time(evidence)];
    claims.into_iter().flatten().collect()
}

fn avoids(evidence: &Evidence<'_>) -> Option<Claim> {
    let passed = evidence.spread(Situation::Hil, measure::not_passed)?;
    let clearance = evidence.spread(Situation::Hil, measure::clearance_m)?;
    let ours = format!("all pass, {} m from the obstacles, reunited", clearance.text(2));
    Some(Claim::statement(
        ("IV, Fig. 19", "obstacle avoidance without added delay"),
        "every vehicle avoids the obstacles, reunited in the end",
        (&ours, Agreement::when(passed.max == 0.0 && clearance.min > 0.0)),
        "The frames cross CAN here, too; platoon rehearse hil-obstacle-avoidance --ecu 2 puts one \
         ECU under test as the paper does.",
    ))
}

fn converges(evidence: &Evidence<'_>) -> Option<Claim> {
    let last = |o: &Outcome| {
        let mean = |truck| measure::mean_after(o, truck, 90.0, |m| m.predecessor_error_m).abs();
        (1..4).map(mean).fold(0.0, f64::max)
    };
    let spread = evidence.spread(Situation::Hil, last)?;
    Some(Claim::number(
        ("IV, Fig. 20", "errors between followers at the end"),
        ("converge to 0", Agreement::when(spread.max < 0.1)),
        (spread, 3, "m"),
        "",
    ))
}

fn in_time(evidence: &Evidence<'_>) -> Option<Claim> {
    (!evidence.mcf(Situation::Hil).is_empty()).then(|| {
        Claim::statement(
            ("IV", "mean time of a step"),
            "1.1 ms on Speedgoat, Core i7 at 2.5 GHz",
            ("in every summary of platoon rehearse", Agreement::NotComparable),
            "Depends on the machine, and a mean says nothing about deadlines: a rehearsal in real \
             time gives the percentiles of every phase of every tick.",
        )
    })
}
