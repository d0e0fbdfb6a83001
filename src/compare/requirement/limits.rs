//! The limits: what the framework must do in each situation.

use super::super::arm::{PLACEMENT_OF_THE_TEXT_M, Situation};
use super::super::measure;
use super::Bound::{self, AtLeast, AtMost, Between, Exactly};
use super::Who;
use crate::campaign::Outcome;

/// One number and its limit on either plant; none where it is not judged.
pub struct Row {
    /// What it is.
    pub what: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Digits worth printing.
    pub digits: usize,
    /// The number.
    pub measure: fn(&Outcome) -> f64,
    /// Who must keep the limit.
    pub who: Who,
    /// Limit on the single-track plant.
    pub single_track: Option<Bound>,
    /// Limit on the two-track plant.
    pub two_track: Option<Bound>,
}

/// Every situation, its name, and what is asked of it.
pub const ALL: [(Situation, &str, &[Row]); 6] = [
    (Situation::Platooning, "platooning", &PLATOONING),
    (Situation::PlatooningWithoutDelay, "platooning without delay", &UNDELAYED),
    (Situation::PlatooningLeaderStale, "platooning, leader's old position as present", &STALE),
    (Situation::Merging, "merging", &MERGING),
    (Situation::Avoidance(0), "obstacle avoidance", &AVOIDANCE),
    (
        Situation::Avoidance(PLACEMENT_OF_THE_TEXT_M),
        "obstacle avoidance, obstacle 2 12 m back",
        &BACK,
    ),
];

const PLATOONING: [Row; 6] = [
    row(
        "largest error to the truck ahead",
        ("m", 2),
        measure::largest_predecessor_error_m,
        both(AtMost(0.80)),
    ),
    row(
        "in slot, within 0.5 m, after",
        ("s", 1),
        measure::settled_position_s,
        each(AtMost(3.5), AtMost(6.0)),
    ),
    row(
        "at speed, within 0.2 m/s, after",
        ("s", 1),
        measure::settled_speed_s,
        each(AtMost(5.0), AtMost(6.0)),
    ),
    median(row("s̄₂ / s̄₁", ("", 2), |o| measure::ratio(o, 2), both(AtMost(0.25)))),
    median(row("s̄₃", ("m", 2), |o| measure::predecessor_error_m(o, 3), both(AtMost(0.15)))),
    row("least gap between trucks", ("m", 1), measure::gap_m, both(AtLeast(11.5))),
];

const UNDELAYED: [Row; 1] = [row(
    "largest error to the leader",
    ("m", 2),
    measure::largest_leader_error_m,
    single(AtMost(0.60)),
)];

const STALE: [Row; 1] =
    [row("standing error it must show", ("m", 2), standing_error_m, single(Between(1.1, 3.3)))];

const MERGING: [Row; 8] = [
    row(
        "largest error to the truck ahead",
        ("m", 2),
        measure::largest_predecessor_error_m,
        both(AtMost(0.75)),
    ),
    row(
        "truck 1 is 1 m out of its lane at",
        ("s", 2),
        |o| measure::first_out_s(o, 1),
        single(Between(1.6, 2.4)),
    ),
    row("every truck back in lane after", ("s", 1), measure::settled_lateral_s, both(AtMost(33.0))),
    row("least clearance", ("m", 2), measure::clearance_m, both(AtLeast(1.0))),
    row("lateral acceleration", ("m/s²", 2), measure::lateral_accel_mps2, both(AtMost(1.5))),
    row("trucks that never pass the van", ("", 0), measure::not_passed, both(Exactly(0.0))),
    row("emergency brakings", ("", 0), |o| o.emergency_brakings() as f64, both(Exactly(0.0))),
    row("off centre 10 s after passing", ("m", 2), measure::off_centre_m, both(AtMost(0.15))),
];

const AVOIDANCE: [Row; 11] = [
    row(
        "largest error to the truck ahead",
        ("m", 2),
        measure::largest_predecessor_error_m,
        both(AtMost(10.0)),
    ),
    row("in slot, within 0.5 m, after", ("s", 1), measure::settled_position_s, both(AtMost(68.0))),
    row("at speed, within 0.2 m/s, after", ("s", 1), measure::settled_speed_s, both(AtMost(69.0))),
    row("least clearance", ("m", 2), measure::clearance_m, both(AtLeast(1.0))),
    row("steering angle", ("rad", 3), measure::steering_rad, both(AtMost(0.10))),
    row("lateral acceleration", ("m/s²", 2), measure::lateral_accel_mps2, both(AtMost(2.8))),
    row("lane crossings of every truck", ("", 0), measure::crossings, both(Exactly(2.0))),
    row("trucks that never pass obstacle 1", ("", 0), measure::not_passed, both(Exactly(0.0))),
    row("off centre 10 s after passing", ("m", 2), measure::off_centre_m, both(AtMost(0.15))),
    row("QPs that failed", ("", 0), |o| o.qp_failures() as f64, both(Exactly(0.0))),
    row("emergency brakings", ("", 0), |o| o.emergency_brakings() as f64, both(Exactly(0.0))),
];

const BACK: [Row; 4] = [
    row(
        "largest error to the truck ahead",
        ("m", 1),
        measure::largest_predecessor_error_m,
        both(AtMost(32.0)),
    ),
    row("in slot, within 0.5 m, after", ("s", 1), measure::settled_position_s, both(AtMost(79.0))),
    row("at speed, within 0.2 m/s, after", ("s", 1), measure::settled_speed_s, both(AtMost(79.0))),
    row("least clearance", ("m", 2), measure::clearance_m, both(AtLeast(1.0))),
];

/// The limits on the single-track and the two-track plant.
type Limits = [Option<Bound>; 2];

const fn row(
    what: &'static str,
    (unit, digits): (&'static str, usize),
    measure: fn(&Outcome) -> f64,
    [single_track, two_track]: Limits,
) -> Row {
    Row { what, unit, digits, measure, who: Who::Every, single_track, two_track }
}

/// A number that is judged by its median: with delays of its own for every truck it is a draw of
/// their difference, a few centimetres, and no property of the controller.
const fn median(row: Row) -> Row {
    Row { who: Who::Median, ..row }
}

const fn both(bound: Bound) -> Limits {
    [Some(bound), Some(bound)]
}

const fn each(single_track: Bound, two_track: Bound) -> Limits {
    [Some(single_track), Some(two_track)]
}

const fn single(bound: Bound) -> Limits {
    [Some(bound), None]
}

/// What a truck that takes the leader's old position for its present one is off in the end \[m\]:
/// 22 m/s times a delay of 50 to 150 ms.
fn standing_error_m(outcome: &Outcome) -> f64 {
    measure::mean_after(outcome, 1, 12.0, |moment| moment.leader_error_m.abs())
}
