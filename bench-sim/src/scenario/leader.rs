//! A scripted leader, as a scenario file states it.

use serde::{Deserialize, Serialize};

use crate::truck::scripted::{PHASES_MAX, Phase, Shape};

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

    /// What the whole script adds to the speed \[m/s\].
    pub fn gain_mps(&self) -> f64 {
        self.accelerations.iter().map(|a| a.phase().gain_mps()).sum()
    }
}

impl Acceleration {
    fn phase(&self) -> Phase {
        let shape = match self.shape {
            Course::Constant => Shape::Constant,
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
