//! What changes during a run: who follows whom, at what distance, where and how fast.

use serde::{Deserialize, Serialize};

/// One change of one truck's mission; what it does not name stays as it is.
///
/// Events at 0 s say how the run starts: a truck that is to join later begins with `leads = true`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// When \[s\].
    pub at_s: f64,
    /// Which truck, from 0.
    pub truck: usize,
    /// The truck it follows from then on, by number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub follows: Option<usize>,
    /// It follows nobody from then on: it drives alone, or leads those who follow it.
    #[serde(default, skip_serializing_if = "is_false")]
    pub leads: bool,
    /// Desired distance from its CG to that of the truck it follows \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_m: Option<f64>,
    /// Set speed \[m/s\]; it counts for a truck that leads.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    /// Desired lateral position \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub desired_y_m: Option<f64>,
    /// How long distance, speed and lateral position take to get there, along a smooth curve
    /// \[s\].
    #[serde(default)]
    pub over_s: f64,
}

impl Event {
    /// Whether it changes the distance to the truck ahead.
    pub fn changes_distance(&self) -> bool {
        self.follows.is_some() || self.spacing_m.is_some()
    }

    /// When everything it changes has got there \[s\].
    pub fn until_s(&self) -> f64 {
        self.at_s + self.over_s
    }
}

fn is_false(value: &bool) -> bool {
    !value
}
