//! Which runs the comparison is made of, and what they came to.

use std::collections::BTreeMap;

use bench_sim::Scenario;

use super::arm::{
    Arm, Contender, PLACEMENT_OF_THE_TEXT_M, PLACEMENTS_M, Plant, START_DELAYS_S, Situation,
};
use super::spread::Spread;
use crate::campaign::{Cell, Outcome};
use crate::cli::{ControllerKind, Part};
use crate::failure::Failure;

/// Seed of the first run; 1 to 20 are for tuning.
pub const FIRST_SEED: u64 = 1001;
/// The loop rate of the real bench \[Hz\], which the others are held against.
pub const BENCH_RATE_HZ: u32 = 1000;
/// Loop rates \[Hz\] that are held against it.
const COMPARED_RATES_HZ: [u32; 2] = [50, 100];
/// Most seeds of a loop rate: those at 1000 Hz take long.
const RATE_SEEDS_MAX: usize = 3;
/// Most seeds of a scenario that is only held against its own criteria.
const BUILT_IN_SEEDS_MAX: usize = 2;

/// What to run.
#[derive(Debug, Clone)]
pub struct Design {
    /// How many seeds, from [`FIRST_SEED`] on.
    pub seeds: usize,
    /// Loop rate \[Hz\].
    pub rate_hz: u32,
    /// Which parts of the comparison; all when empty.
    pub parts: Vec<Part>,
}

impl Design {
    /// Every arm, with its number of seeds.
    pub fn arms(&self) -> BTreeMap<Arm, usize> {
        let mut arms = BTreeMap::new();
        self.platooning(&mut arms);
        self.later(&mut arms);
        self.merging(&mut arms);
        self.avoidance(&mut arms);
        self.rates(&mut arms);
        self.built_in(&mut arms);
        arms
    }

    /// An arm of this design's own rate.
    pub fn arm(&self, situation: Situation, contender: Contender, plant: Plant) -> Arm {
        Arm { situation, contender, plant, rate_hz: self.rate_hz }
    }

    /// The loop rates that are compared, ascending.
    pub fn rates_hz(&self) -> Vec<u32> {
        let mut rates: Vec<u32> =
            COMPARED_RATES_HZ.into_iter().chain([self.rate_hz, BENCH_RATE_HZ]).collect();
        rates.sort_unstable();
        rates.dedup();
        rates
    }

    fn has(&self, part: Part) -> bool {
        self.parts.is_empty() || self.parts.contains(&part)
    }

    /// Seeds where there are many arms.
    fn tenth(&self) -> usize {
        self.seeds.div_ceil(10)
    }

    fn add(&self, arms: &mut BTreeMap<Arm, usize>, arm: Arm, seeds: usize) {
        let known = arms.entry(arm).or_default();
        *known = seeds.max(*known);
    }

    fn mcf(&self, arms: &mut BTreeMap<Arm, usize>, situation: Situation, seeds: usize) {
        self.add(arms, self.arm(situation, Contender::MCF, Plant::SingleTrack), seeds);
    }

    fn platooning(&self, arms: &mut BTreeMap<Arm, usize>) {
        if !self.has(Part::Platooning) {
            return;
        }
        for contender in Contender::all() {
            let arm = self.arm(Situation::Platooning, contender, Plant::SingleTrack);
            self.add(arms, arm, self.seeds);
        }
        let two_track = self.arm(Situation::Platooning, Contender::MCF, Plant::TwoTrack);
        self.add(arms, two_track, self.seeds);
        // Nothing is random without delay.
        self.mcf(arms, Situation::PlatooningWithoutDelay, 1);
        for situation in [
            Situation::PlatooningLeaderStale,
            Situation::PlatooningFrameStale,
            Situation::PlatooningZ,
            Situation::PlatooningO,
        ] {
            self.mcf(arms, situation, self.tenth());
        }
    }

    fn later(&self, arms: &mut BTreeMap<Arm, usize>) {
        if self.has(Part::Uniformity) {
            for seconds in START_DELAYS_S {
                self.mcf(arms, Situation::PlatooningLater(seconds), self.seeds);
            }
        }
    }

    fn merging(&self, arms: &mut BTreeMap<Arm, usize>) {
        if !self.has(Part::Merging) {
            return;
        }
        for contender in drivers() {
            let arm = self.arm(Situation::Merging, contender, Plant::SingleTrack);
            self.add(arms, arm, self.seeds);
        }
        let two_track = self.arm(Situation::Merging, Contender::MCF, Plant::TwoTrack);
        self.add(arms, two_track, self.seeds);
    }

    fn avoidance(&self, arms: &mut BTreeMap<Arm, usize>) {
        if !self.has(Part::Avoidance) {
            return;
        }
        for plant in [Plant::SingleTrack, Plant::TwoTrack] {
            let usual = self.arm(Situation::Avoidance(0), Contender::MCF, plant);
            self.add(arms, usual, self.seeds);
            let text = Situation::Avoidance(PLACEMENT_OF_THE_TEXT_M);
            self.add(arms, self.arm(text, Contender::MCF, plant), self.tenth());
        }
        for (metres, contender) in
            PLACEMENTS_M.into_iter().flat_map(|m| drivers().into_iter().map(move |c| (m, c)))
        {
            let arm = self.arm(Situation::Avoidance(metres), contender, Plant::SingleTrack);
            self.add(arms, arm, self.tenth());
        }
        self.mcf(arms, Situation::AvoidancePrintedWeight, 1);
        self.mcf(arms, Situation::Hil, 1);
    }

    /// The same runs at other loop rates, for as many of the parts as are made.
    fn rates(&self, arms: &mut BTreeMap<Arm, usize>) {
        if !self.has(Part::Rates) {
            return;
        }
        for situation in RATE_SITUATIONS {
            for rate_hz in self.rates_hz() {
                let seeds = match situation {
                    Situation::Platooning => self.seeds.min(RATE_SEEDS_MAX),
                    _ => 1,
                };
                let (contender, plant) = (Contender::MCF, Plant::SingleTrack);
                self.add(arms, Arm { situation, contender, plant, rate_hz }, seeds);
            }
        }
    }

    fn built_in(&self, arms: &mut BTreeMap<Arm, usize>) {
        if self.has(Part::Scenarios) {
            for place in 0..Scenario::list().len() {
                let seeds = self.seeds.min(BUILT_IN_SEEDS_MAX);
                self.mcf(arms, Situation::BuiltIn(place), seeds);
            }
        }
    }
}

/// What is held against 1000 Hz.
pub const RATE_SITUATIONS: [Situation; 3] =
    [Situation::Platooning, Situation::Merging, Situation::Avoidance(0)];

/// The contenders that steer, too.
pub fn drivers() -> Vec<Contender> {
    let steers = |contender: &Contender| {
        matches!(contender.kind, ControllerKind::Mcf | ControllerKind::SingleMpc)
    };
    Contender::all().into_iter().filter(steers).collect()
}

/// The cells of some arms, one after the other.
///
/// # Errors
/// When a scenario makes no sense.
pub fn cells(arms: &BTreeMap<Arm, usize>) -> Result<Vec<Cell>, Failure> {
    let mut cells = Vec::new();
    for (arm, &seeds) in arms {
        let cell = arm.cell()?;
        cells.extend((0..seeds as u64).map(|n| Cell { seed: FIRST_SEED + n, ..cell.clone() }));
    }
    Ok(cells)
}

/// What every arm came to; the outcomes are in the order of the seeds.
#[derive(Debug, Default)]
pub struct Runs(BTreeMap<Arm, Vec<Outcome>>);

impl Runs {
    /// Puts the outcomes of the arms' cells where they belong.
    pub fn new(arms: &BTreeMap<Arm, usize>, outcomes: Vec<Outcome>) -> Self {
        let mut outcomes = outcomes.into_iter();
        let take = |(&arm, &seeds): (&Arm, &usize)| (arm, outcomes.by_ref().take(seeds).collect());
        Self(arms.iter().map(take).collect())
    }

    /// The outcomes of an arm; none when it was not run.
    pub fn of(&self, arm: Arm) -> &[Outcome] {
        self.0.get(&arm).map_or(&[], Vec::as_slice)
    }

    /// How a number varies over the seeds of an arm; `None` when it was not run or has no such
    /// number.
    pub fn spread(&self, arm: Arm, measure: impl Fn(&Outcome) -> f64) -> Option<Spread> {
        Spread::of(self.of(arm).iter().map(measure))
    }

    /// How many runs there are.
    pub fn len(&self) -> usize {
        self.0.values().map(Vec::len).sum()
    }
}

/// The runs and what they were made for: what every table is made of.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// What was run.
    pub design: &'a Design,
    /// What it came to.
    pub runs: &'a Runs,
}

impl Evidence<'_> {
    /// The outcomes of one arm.
    pub fn of(&self, situation: Situation, contender: Contender, plant: Plant) -> &[Outcome] {
        self.runs.of(self.design.arm(situation, contender, plant))
    }

    /// The paper's framework on the single-track plant.
    pub fn mcf(&self, situation: Situation) -> &[Outcome] {
        self.of(situation, Contender::MCF, Plant::SingleTrack)
    }

    /// A number of the paper's framework on the single-track plant.
    pub fn spread(
        &self,
        situation: Situation,
        measure: impl Fn(&Outcome) -> f64,
    ) -> Option<Spread> {
        Spread::of(self.mcf(situation).iter().map(measure))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn design(parts: &[Part]) -> Design {
        Design { seeds: 8, rate_hz: 50, parts: parts.to_vec() }
    }

    #[test]
    fn every_arm_can_be_run() {
        let arms = design(&[]).arms();
        let cells = cells(&arms).expect("every scenario is known");
        assert_eq!(cells.len(), arms.values().sum::<usize>());
        assert!(cells.iter().all(|cell| cell.seed >= FIRST_SEED), "a seed for tuning");
    }

    #[test]
    fn a_part_alone_runs_only_its_own() {
        let arms = design(&[Part::Platooning]).arms();
        let (least, most) = (Situation::Platooning, Situation::PlatooningO);
        assert!(arms.keys().all(|arm| (least..=most).contains(&arm.situation)), "{arms:?}");
        let all = design(&[]).arms();
        assert!(arms.iter().all(|(arm, seeds)| all.get(arm) == Some(seeds)));
    }
}
