//! How an obstacle changes lane and speed.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use toml::Value;

use crate::transition::Transition;

/// One smooth change of lateral position: a quintic with zero lateral speed and acceleration at
/// both ends, the usual lane change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneChange {
    /// Where it ends, across the road \[m\].
    pub to_y_m: f64,
    /// When it starts \[s\].
    pub from_s: f64,
    /// When it is done \[s\].
    pub until_s: f64,
}

/// One change of speed, at a constant acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedChange {
    /// The speed it ends with, along the road \[m/s\].
    pub to_speed_mps: f64,
    /// When it starts \[s\].
    pub from_s: f64,
    /// When it is done \[s\].
    pub until_s: f64,
}

impl LaneChange {
    /// Lateral position \[m\] and speed \[m/s\].
    fn position(&self, from_y_m: f64, time_s: f64) -> (f64, f64) {
        let Self { to_y_m: to, from_s, until_s } = *self;
        let change = Transition { from: from_y_m, to, from_s, until_s };
        (change.value(time_s), change.rate(time_s))
    }
}

/// Lateral position \[m\] and speed \[m/s\] at a time, after changes in their order.
pub(super) fn across(from_y_m: f64, changes: &[LaneChange], time_s: f64) -> (f64, f64) {
    changes.iter().fold((from_y_m, 0.0), |(y_m, y_mps), change| {
        let (after_m, after_mps) = change.position(y_m, time_s);
        // Changes do not overlap: of two speeds one is zero.
        (after_m, y_mps + after_mps)
    })
}

impl SpeedChange {
    /// Acceleration from a speed \[m/s²\].
    fn accel_mps2(&self, from_mps: f64) -> f64 {
        (self.to_speed_mps - from_mps) / (self.until_s - self.from_s)
    }
}

/// Distance \[m\] since t = 0 at the first speed, and speed \[m/s\], after changes in their order.
pub(super) fn along(from_mps: f64, changes: &[SpeedChange], time_s: f64) -> (f64, f64) {
    let (mut x_m, mut speed_mps) = (from_mps * time_s, from_mps);
    for change in changes.iter().filter(|change| time_s > change.from_s) {
        let accel_mps2 = change.accel_mps2(speed_mps);
        let under_s = time_s.min(change.until_s) - change.from_s;
        let after_s = (time_s - change.until_s).max(0.0);
        // What it adds to the distance that the speed before it would have given.
        x_m += accel_mps2 * under_s * (0.5 * under_s + after_s);
        // Exactly the speed asked for, once it is reached.
        let is_done = time_s >= change.until_s;
        speed_mps = if is_done { change.to_speed_mps } else { speed_mps + accel_mps2 * under_s };
    }
    (x_m, speed_mps)
}

/// Reads one table or a list of tables.
pub(super) fn one_or_more<'de, D, T>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: serde::de::DeserializeOwned,
{
    let read = |value: Value| value.try_into().map_err(D::Error::custom);
    match Value::deserialize(deserializer)? {
        Value::Array(values) => values.into_iter().map(read).collect(),
        value => read(value).map(|one| vec![one]),
    }
}
