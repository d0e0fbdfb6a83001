//! What we hold ourselves to, and whether it holds, on both plants and for every seed.

mod limits;

use serde::{Deserialize, Serialize};

use Bound::{AtLeast, AtMost};
use limits::Row;

use super::arm::{Contender, PLACEMENTS_M, Plant, Situation};
use super::design::Evidence;
use super::improvement::Improvement;
use super::measure;
use super::spread::{Spread, fixed};
use super::uniformity::{BAND_M, Uniformity};

/// One thing we hold ourselves to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Requirement {
    /// The situation.
    pub situation: String,
    /// What must hold.
    pub what: String,
    /// Unit of the number.
    pub unit: String,
    /// Digits worth printing.
    pub digits: usize,
    /// On the single-track plant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub single_track: Option<Judged>,
    /// On the two-track plant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_track: Option<Judged>,
}

/// A number and its limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// The number over the seeds; infinite when a run never got there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<Spread>,
    /// The limit.
    pub bound: Bound,
    /// Who must keep it.
    pub who: Who,
    /// Whether they do.
    pub holds: bool,
}

/// Who must keep a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// Every seed.
    Every,
    /// The median of the seeds.
    Median,
}

/// A limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// Not above this.
    AtMost(f64),
    /// Not below this.
    AtLeast(f64),
    /// From the one to the other.
    Between(f64, f64),
    /// This alone.
    Exactly(f64),
}

impl Bound {
    /// Whether who must keep it keeps it.
    pub fn holds(self, spread: &Spread, who: Who) -> bool {
        let (least, most) = match who {
            Who::Every => (spread.min, spread.max),
            Who::Median => (spread.median, spread.median),
        };
        match self {
            Self::AtMost(limit) => most <= limit,
            Self::AtLeast(limit) => least >= limit,
            Self::Between(low, high) => least >= low && most <= high,
            Self::Exactly(value) => least == value && most == value,
        }
    }

    /// In signs.
    pub fn text(self) -> String {
        match self {
            Self::AtMost(limit) => format!("≤ {limit}"),
            Self::AtLeast(limit) => format!("≥ {limit}"),
            Self::Between(low, high) => format!("{low} to {high}"),
            Self::Exactly(value) => format!("= {value}"),
        }
    }
}

impl Judged {
    fn new(bound: Bound, spread: Spread, who: Who) -> Self {
        // JSON has no infinity; a number that never came is none.
        let is_known = [spread.min, spread.max].iter().all(|value| value.is_finite());
        let holds = bound.holds(&spread, who);
        Self { spread: is_known.then_some(spread), bound, who, holds }
    }

    /// The least and the largest of all seeds in words, or the median.
    pub fn text(&self, digits: usize) -> String {
        let Some(spread) = self.spread else {
            return "never".into();
        };
        if self.who == Who::Median {
            return spread.text(digits);
        }
        let [min, max] = [spread.min, spread.max].map(|value| fixed(value, digits));
        if min == max { min } else { format!("{min} to {max}") }
    }
}

impl Requirement {
    /// The limit in signs, or one for either plant.
    pub fn limits(&self) -> String {
        let text = |judged: &Option<Judged>| judged.map(|judged| judged.bound.text());
        match (text(&self.single_track), text(&self.two_track)) {
            (Some(single), Some(two)) if single != two => format!("{single}; {two}"),
            (Some(one), _) | (None, Some(one)) => one,
            (None, None) => "-".into(),
        }
    }

    /// Whether it holds wherever it was tried.
    pub fn holds(&self) -> bool {
        [self.single_track, self.two_track].iter().flatten().all(|judged| judged.holds)
    }
}

/// Everything we hold ourselves to whose runs were made.
pub fn requirements(
    evidence: &Evidence<'_>,
    improvements: &[Improvement],
    uniformity: Option<&Uniformity>,
) -> Vec<Requirement> {
    let rows = limits::ALL.iter().flat_map(|(situation, name, rows)| {
        rows.iter().map(move |row| judged(evidence, *situation, name, row))
    });
    let mut all: Vec<Requirement> = rows.flatten().collect();
    all.extend(sweep(evidence));
    all.extend(earlier(evidence));
    all.extend(improvements.iter().filter_map(improved));
    all.extend(uniformity.map(uniform));
    all
}

fn judged(
    evidence: &Evidence<'_>,
    situation: Situation,
    name: &str,
    row: &Row,
) -> Option<Requirement> {
    let side = |plant, bound: Option<Bound>| {
        let outcomes = evidence.of(situation, Contender::MCF, plant);
        Some(Judged::new(bound?, Spread::of(outcomes.iter().map(row.measure))?, row.who))
    };
    let single_track = side(Plant::SingleTrack, row.single_track);
    let two_track = side(Plant::TwoTrack, row.two_track);
    (single_track.is_some() || two_track.is_some()).then(|| Requirement {
        situation: name.into(),
        what: row.what.into(),
        unit: row.unit.into(),
        digits: row.digits,
        single_track,
        two_track,
    })
}

fn of_one_plant(
    (situation, what): (&str, &str),
    (unit, digits): (&str, usize),
    judged: Judged,
) -> Requirement {
    Requirement {
        situation: situation.into(),
        what: what.into(),
        unit: unit.into(),
        digits,
        single_track: Some(judged),
        two_track: None,
    }
}

/// No collision wherever obstacle 2 is, and it never appears on top of a truck.
fn sweep(evidence: &Evidence<'_>) -> Vec<Requirement> {
    const NAME: &str = "obstacle avoidance, obstacle 2 12 m back to 8 m ahead";
    let all = || PLACEMENTS_M.iter().flat_map(|&metres| evidence.mcf(Situation::Avoidance(metres)));
    let clearance = Spread::of(all().map(measure::clearance_m));
    let spawn = Spread::of(all().filter_map(|outcome| outcome.spawn_clearance_m));
    let row = |what, limit_m, spread: Option<Spread>| {
        let judged = Judged::new(AtLeast(limit_m), spread?, Who::Every);
        Some(of_one_plant((NAME, what), ("m", 2), judged))
    };
    let clearance = row("least clearance", 1.0, clearance);
    let spawn = row("distance of obstacle 2 from any truck when it appears", 2.0, spawn);
    clearance.into_iter().chain(spawn).collect()
}

/// The speeds settle earlier than with the raw baseline, which may never settle.
fn earlier(evidence: &Evidence<'_>) -> Option<Requirement> {
    let settled_s = |contender| {
        let outcomes = evidence.of(Situation::Avoidance(0), contender, Plant::SingleTrack);
        outcomes.iter().map(|o| measure::settled_speed_s(o).min(o.results.duration_s))
    };
    let pairs = settled_s(Contender::MCF).zip(settled_s(Contender::SINGLE));
    let spread = Spread::of(pairs.map(|(mcf_s, single_s)| single_s - mcf_s))?;
    let what = ("obstacle avoidance", "speeds settle earlier than the raw baseline's, at least by");
    Some(of_one_plant(what, ("s", 1), Judged::new(AtLeast(10.0), spread, Who::Every)))
}

/// MCF against the baseline on raw delayed states, position weight 80.
fn improved(improvement: &Improvement) -> Option<Requirement> {
    let least = match improvement.situation.as_str() {
        "platooning" => 60.0,
        "merging" => 50.0,
        _ => return None,
    };
    if improvement.baseline != Contender::SINGLE.name() {
        return None;
    }
    // Controllers are compared here, not single draws of the delays.
    let judged = Judged::new(AtLeast(least), improvement.percent, Who::Median);
    let what = "largest error to the truck ahead lower than the raw baseline's";
    Some(of_one_plant((&improvement.situation, what), ("%", 0), judged))
}

fn uniform(uniformity: &Uniformity) -> Requirement {
    let spread = Spread::of(uniformity.beginnings.iter().skip(1).map(|b| b.difference_m));
    let (bound, who, holds) = (AtMost(BAND_M), Who::Every, uniformity.holds);
    let judged = Judged { spread, bound, who, holds };
    let what = ("platooning at other times (Lemma 1)", "distance between the envelopes");
    of_one_plant(what, ("m", 3), judged)
}

#[cfg(test)]
mod tests {
    use super::Bound::{Between, Exactly};
    use super::*;

    #[test]
    fn a_bound_must_be_kept_by_every_seed() {
        let spread = Spread::of([1.0, 2.0, 3.0]).expect("numbers");
        let every = |bound: Bound| bound.holds(&spread, Who::Every);
        assert!(every(AtMost(3.0)) && !every(AtMost(2.9)));
        assert!(every(AtLeast(1.0)) && !every(AtLeast(1.1)));
        assert!(every(Between(1.0, 3.0)) && !every(Between(1.0, 2.0)));
        assert!(!every(Exactly(2.0)) && Exactly(2.0).holds(&spread, Who::Median));
        let never = Spread::of([1.0, f64::INFINITY]).expect("numbers");
        let judged = Judged::new(AtMost(5.0), never, Who::Every);
        assert!(!judged.holds);
        assert_eq!(judged.text(1), "never");
    }
}
