//! A scripted leader, as a scenario file states it.

use serde::{Deserialize, Serialize};

use crate::truck::TruckState;
use crate::truck::scripted::{PHASES_MAX, Phase, Scripted, Shape};

/// Step of the integral over a script \[s\].
const STEP_S: f64 = 1e-3;

/// The leader drives by this script and has no ECU.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leader {
    /// Its accelerations, one after the other.
    pub accelerations: Vec<Acceleration>,
}

/// One stretch of acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acceleration {
    /// When it begins \[s\].
    pub from_s: f64,
    /// When it ends \[s\].
    pub until_s: f64,
    /// Acceleration, or amplitude of the wave \[m/s²\]; negative brakes.
    pub accel_mps2: f64,
    /// Course of the acceleration.
    #[serde(default)]
    pub shape: Course,
    /// Whole periods of a sine within the stretch.
    #[serde(default = "one")]
    pub periods: u32,
    /// How long a constant acceleration takes to build up, and at the end to fade \[s\].
    #[serde(default)]
    pub rise_s: f64,
}

/// Waves within a stretch of acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// When they begin \[s\].
    pub from_s: f64,
    /// When they end \[s\].
    pub until_s: f64,
    /// How many whole periods there are.
    pub periods: u32,
}

/// Course of an acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Course {
    /// The same throughout.
    #[default]
    Constant,
    /// Half a sine wave.
    HalfSine,
    /// Whole sine waves.
    Sine,
}

impl Leader {
    /// The script for the plant; the check of a scenario keeps it within [`PHASES_MAX`].
    pub fn phases(&self) -> [Phase; PHASES_MAX] {
        let mut phases = [Phase::default(); PHASES_MAX];
        for (phase, acceleration) in phases.iter_mut().zip(&self.accelerations) {
            *phase = acceleration.phase();
        }
        phases
    }

    /// Its sine waves, in the order of the script.
    pub fn waves(&self) -> impl Iterator<Item = Wave> {
        let sines = self.accelerations.iter().filter(|a| a.shape == Course::Sine);
        sines.map(|a| Wave { from_s: a.from_s, until_s: a.until_s, periods: a.periods })
    }

    /// The speed the script ends with, when it begins with this one \[m/s\].
    pub fn final_speed_mps(&self, forward_mps: f64) -> f64 {
        let mut truck =
            Scripted::new(&self.phases(), TruckState { forward_mps, ..TruckState::default() });
        let end_s = self.accelerations.iter().map(|a| a.until_s).fold(0.0, f64::max);
        for _ in 0..libm::ceil(end_s / STEP_S) as u64 {
            truck.step(STEP_S);
        }
        truck.state().forward_mps
    }
}

impl Acceleration {
    fn phase(&self) -> Phase {
        let shape = match self.shape {
            Course::Constant => Shape::Constant { rise_s: self.rise_s },
            Course::HalfSine => Shape::HalfSine,
            Course::Sine => Shape::Sine { periods: self.periods },
        };
        let Self { from_s, until_s, accel_mps2, .. } = *self;
        Phase { from_s, until_s, accel_mps2, shape }
    }
}

fn one() -> u32 {
    1
}
