//! A gain, and what it is for.

use serde::{Deserialize, Serialize};

/// The gain of Eq. 4: u_i = K1 x_i(t - lambda) + K2 x_(i-1)(t - lambda), and whether the leader's
/// acceleration is added.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gain {
    /// K1 \[1/s², 1/s, 1\] on the truck's own error.
    pub k1: [f64; 3],
    /// K2 \[1/s², 1/s, 1\] on the error of the truck ahead.
    pub k2: [f64; 3],
    /// Whether the leader's acceleration is fed forward. It changes no eigenvalue.
    #[serde(default)]
    pub leader_feedforward: bool,
}

impl Gain {
    /// Whether the truck ahead matters.
    #[must_use]
    pub fn is_coupled(&self) -> bool {
        self.k2 != [0.0; 3]
    }
}

/// Lags tau of a truck's longitudinal motion that a gain is for, ends included \[s\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lags {
    /// Smallest.
    pub lag_min_s: f64,
    /// Largest.
    pub lag_max_s: f64,
}

impl Lags {
    /// One lag.
    #[must_use]
    pub const fn only(lag_s: f64) -> Self {
        Self { lag_min_s: lag_s, lag_max_s: lag_s }
    }

    /// Whether every lag of `other` is among these.
    #[must_use]
    pub fn cover(&self, other: &Self) -> bool {
        self.lag_min_s <= other.lag_min_s && other.lag_max_s <= self.lag_max_s
    }

    /// The ends: one value when they are the same.
    #[must_use]
    pub fn ends(&self) -> Vec<f64> {
        if self.lag_min_s == self.lag_max_s {
            vec![self.lag_min_s]
        } else {
            vec![self.lag_min_s, self.lag_max_s]
        }
    }
}

/// How fast a delay may grow.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rate {
    /// At any rate: jumps, and the sawtooth of a message that is held until the next.
    #[default]
    Any,
    /// Its derivative stays below this, mu of Eq. 4.
    Below(f64),
}

/// The delays a gain is for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DelayBound {
    /// The longest, h1 of Eq. 4 \[s\].
    pub longest_s: f64,
    /// How fast it may grow.
    #[serde(default)]
    pub rate: Rate,
}

impl DelayBound {
    /// Delays up to this, at any rate.
    #[must_use]
    pub const fn any_rate(longest_s: f64) -> Self {
        Self { longest_s, rate: Rate::Any }
    }
}
