//! What is compared with what: a situation, who controls it, on which plant, at which loop rate.

use bench_sim::Scenario;
use clap::ValueEnum;

use crate::campaign::{Cell, Sampling};
use crate::cli::{ControllerKind, Word};
use crate::failure::Failure;

/// Where obstacle 2 of obstacle avoidance is placed against its usual place \[m\]. At +12 m it
/// would appear on top of a truck that lags.
pub const PLACEMENTS_M: [i8; 6] = [-12, -8, -4, 0, 4, 8];
/// The placement that suits the paper's text best: trucks 2 and 3 wait behind obstacle 2.
pub const PLACEMENT_OF_THE_TEXT_M: i8 = -12;
/// When the leader's manoeuvre begins \[s\] later than usual, to see whether it matters.
pub const START_DELAYS_S: [u8; 5] = [0, 3, 7, 13, 29];
/// How long the errors are followed from the manoeuvre's usual start on \[s\].
pub const MANOEUVRE_S: f64 = 12.0;
/// Weight of the slot in the single-structure MPC on extrapolated states beyond which the errors
/// hardly fall: the result of `platoon compare --tune`, seeds 1 to 20.
pub const TUNED_POSITION_WEIGHT: f64 = 10_240.0;

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Situation {
    /// The leader goes from 20 to 22 m/s with an overshoot.
    Platooning,
    /// The same without V2V delay.
    PlatooningWithoutDelay,
    /// The same with the old position of the leader taken for its present one.
    PlatooningLeaderStale,
    /// The same in a frame that moves at the set speed.
    PlatooningFrameStale,
    /// The leader of Zheng et al.
    PlatooningZ,
    /// The leader with the overshoot read literally.
    PlatooningO,
    /// Platooning, the manoeuvre so many seconds later.
    PlatooningLater(u8),
    /// A van merges between the trucks.
    Merging,
    /// Two vans, the second so many metres away from its usual place.
    Avoidance(i8),
    /// Obstacle avoidance with Eq. 22 as printed.
    AvoidancePrintedWeight,
    /// Obstacle avoidance without V2V delay, as on the HIL rig.
    Hil,
    /// A scenario that comes with the bench, by its place in the list.
    BuiltIn(usize),
}

/// Who controls the trucks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contender {
    /// The controller.
    pub kind: ControllerKind,
    /// How its free numbers are chosen.
    pub tuning: Tuning,
}

/// How a controller's free numbers are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tuning {
    /// As they come.
    Plain,
    /// The single-structure MPC on states extrapolated to now.
    Compensated,
    /// The same, with the weight that `--tune` found best.
    Tuned,
}

/// Which plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Plant {
    /// As the scenario has it, one track.
    SingleTrack,
    /// Four wheels, suspension, drive line, air brakes.
    TwoTrack,
}

/// One row of runs that differ in their seed only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Arm {
    /// What happens.
    pub situation: Situation,
    /// Who controls.
    pub contender: Contender,
    /// Which plant.
    pub plant: Plant,
    /// Loop rate \[Hz\].
    pub rate_hz: u32,
}

impl Contender {
    /// The paper's framework.
    pub const MCF: Self = Self { kind: ControllerKind::Mcf, tuning: Tuning::Plain };
    /// The paper's baseline on raw delayed states.
    pub const SINGLE: Self = Self { kind: ControllerKind::SingleMpc, tuning: Tuning::Plain };
    /// The baseline on extrapolated states.
    pub const COMPENSATED: Self =
        Self { kind: ControllerKind::SingleMpc, tuning: Tuning::Compensated };

    /// Every controller there is, the baseline three times.
    pub fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for &kind in ControllerKind::value_variants() {
            let tunings = match kind {
                ControllerKind::SingleMpc => {
                    &[Tuning::Plain, Tuning::Compensated, Tuning::Tuned][..]
                }
                _ => &[Tuning::Plain],
            };
            all.extend(tunings.iter().map(|&tuning| Self { kind, tuning }));
        }
        all
    }

    /// What to call it in a table.
    pub fn name(self) -> String {
        match self.tuning {
            Tuning::Plain if self.kind == ControllerKind::SingleMpc => "single-mpc, raw".into(),
            Tuning::Plain => self.kind.word(),
            Tuning::Compensated => "single-mpc, compensated".into(),
            Tuning::Tuned => "single-mpc, tuned".into(),
        }
    }

    /// What it says about the law's numbers.
    fn sets(self) -> Vec<(&'static str, String)> {
        let compensated = ("law.single_mpc.compensated", "true".to_owned());
        let weight = ("law.single_mpc.position_weight", format!("{TUNED_POSITION_WEIGHT:?}"));
        match self.tuning {
            Tuning::Plain => Vec::new(),
            Tuning::Compensated => vec![compensated],
            Tuning::Tuned => vec![compensated, weight],
        }
    }
}

impl Situation {
    /// What to call it in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Merging => "merging",
            Self::Avoidance(_) | Self::AvoidancePrintedWeight => "obstacle avoidance",
            other => other.scenario(),
        }
    }

    /// Name of the scenario.
    fn scenario(self) -> &'static str {
        match self {
            Self::Platooning
            | Self::PlatooningWithoutDelay
            | Self::PlatooningLeaderStale
            | Self::PlatooningFrameStale
            | Self::PlatooningLater(_) => "platooning",
            Self::PlatooningZ => "platooning-z",
            Self::PlatooningO => "platooning-o",
            Self::Merging => "merging",
            Self::Avoidance(_) | Self::AvoidancePrintedWeight => "obstacle-avoidance",
            Self::Hil => "hil-obstacle-avoidance",
            Self::BuiltIn(place) => Scenario::list()[place].name,
        }
    }

    /// What it says about the scenario's numbers.
    fn sets(self) -> Vec<(&'static str, String)> {
        let reading = |word: &str| vec![("law.ucl.delay_reading", word.to_owned())];
        match self {
            Self::PlatooningWithoutDelay => {
                ["v2v.delay_min_s", "v2v.delay_max_s"].map(|key| (key, "0.0".into())).into()
            }
            Self::PlatooningLeaderStale => reading("leader-stale"),
            Self::PlatooningFrameStale => reading("frame-stale"),
            Self::Avoidance(metres) => {
                // The usual place is X = 797 m at 49 s, 17 m/s.
                vec![("obstacles.2.x_m", format!("{:?}", -36.0 + f64::from(metres)))]
            }
            Self::AvoidancePrintedWeight => {
                [("law.lml.potential_unit", "1.0"), ("law.lml.cutoff", "inf")]
                    .map(|(key, value)| (key, value.into()))
                    .into()
            }
            _ => Vec::new(),
        }
    }

    /// How closely its trucks must be followed.
    fn sampling(self) -> Sampling {
        match self {
            Self::Merging => Sampling::every_ms(20),
            Self::Avoidance(0) | Self::Avoidance(PLACEMENT_OF_THE_TEXT_M) => {
                Sampling::every_ms(100)
            }
            Self::AvoidancePrintedWeight | Self::Hil => Sampling::every_ms(100),
            Self::Avoidance(_) | Self::BuiltIn(_) => Sampling::None,
            _ => Sampling::every_ms(20),
        }
    }
}

impl Arm {
    /// One of its runs, with seed 1.
    ///
    /// # Errors
    /// When the scenario makes no sense.
    pub fn cell(self) -> Result<Cell, Failure> {
        let mut sets = self.situation.sets();
        sets.extend(self.contender.sets());
        if self.plant == Plant::TwoTrack {
            sets.push(("plant.model", "two-track".into()));
        }
        let mut sets: Vec<(String, String)> =
            sets.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        let name = self.situation.scenario();
        if let Situation::PlatooningLater(seconds) = self.situation {
            sets.extend(later(name, f64::from(seconds))?);
        }
        // A scenario of the bench may have a controller of its own.
        let is_own = matches!(self.situation, Situation::BuiltIn(_));
        let controller = (!is_own).then_some(self.contender.kind);
        let mut cell = Cell::new(name, &sets, controller, self.rate_hz)?;
        if self.contender == Contender::MCF {
            cell.sampling = self.situation.sampling();
        }
        Ok(cell)
    }
}

/// The overrides that let a scripted leader do everything so many seconds later.
fn later(name: &str, seconds: f64) -> Result<Vec<(String, String)>, Failure> {
    let scenario = Scenario::load(name, &[]).map_err(Failure::usage)?;
    let mut sets = vec![("duration_s".to_owned(), format!("{:?}", MANOEUVRE_S + seconds))];
    let script = scenario.leader.iter().flat_map(|leader| &leader.accelerations);
    for (number, stretch) in (1..).zip(script) {
        let key = |end: &str| format!("leader.accelerations.{number}.{end}");
        sets.push((key("from_s"), format!("{:?}", stretch.from_s + seconds)));
        sets.push((key("until_s"), format!("{:?}", stretch.until_s + seconds)));
    }
    Ok(sets)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(situation: Situation, contender: Contender) -> Arm {
        Arm { situation, contender, plant: Plant::SingleTrack, rate_hz: 50 }
    }

    #[test]
    fn every_controller_of_the_command_line_is_a_contender() {
        let all = Contender::all();
        for kind in ControllerKind::value_variants() {
            assert!(all.iter().any(|contender| contender.kind == *kind), "{}", kind.word());
        }
        let tuned = Contender { tuning: Tuning::Tuned, ..Contender::SINGLE };
        for one in [Contender::MCF, Contender::SINGLE, Contender::COMPENSATED, tuned] {
            assert!(all.contains(&one), "{one:?}");
        }
    }

    #[test]
    fn the_text_of_the_paper_places_obstacle_2_at_785_m_after_49_s() {
        let cell = arm(Situation::Avoidance(PLACEMENT_OF_THE_TEXT_M), Contender::MCF).cell();
        let van = cell.expect("built in").scenario.obstacles[1].clone();
        assert!((van.x_m + 49.0 * van.speed_mps - 785.0).abs() < 1e-9);
    }

    #[test]
    fn a_later_manoeuvre_is_the_same_manoeuvre() {
        let usual = arm(Situation::Platooning, Contender::MCF).cell().expect("built in").scenario;
        let late = arm(Situation::PlatooningLater(7), Contender::MCF).cell().expect("built in");
        let script = |scenario: &Scenario| scenario.leader.clone().expect("scripted").accelerations;
        for (a, b) in script(&usual).iter().zip(&script(&late.scenario)) {
            assert!((b.from_s - a.from_s - 7.0).abs() < 1e-9);
            assert!((b.until_s - a.until_s - 7.0).abs() < 1e-9);
            assert_eq!(a.accel_mps2, b.accel_mps2);
        }
        assert_eq!(late.scenario.duration_s, 7.0 + MANOEUVRE_S);
    }

    #[test]
    fn a_tuned_baseline_has_its_weight_and_a_raw_one_the_default() {
        let law = |contender| {
            arm(Situation::Platooning, contender).cell().expect("built in").calibration.single_mpc
        };
        assert_eq!(law(Contender::SINGLE).position_weight, 80.0);
        assert!(!law(Contender::SINGLE).compensated);
        let tuned = law(Contender { tuning: Tuning::Tuned, ..Contender::SINGLE });
        assert_eq!(tuned.position_weight, TUNED_POSITION_WEIGHT);
        assert!(tuned.compensated);
    }
}
