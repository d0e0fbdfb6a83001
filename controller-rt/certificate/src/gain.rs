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

    /// What this gain amounts to behind a plant of that gain: the loop with it has gain 1.
    #[must_use]
    pub fn through(&self, plant_gain: f64) -> Self {
        let times = |k: [f64; 3]| k.map(|k| k * plant_gain);
        Self { k1: times(self.k1), k2: times(self.k2), ..*self }
    }
}

/// What a gain drives: a first-order lag that answers a commanded acceleration with a gain of its
/// own, tau a' + a = g u. A range of both, ends included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plants {
    /// Smallest lag tau \[s\].
    pub lag_min_s: f64,
    /// Largest lag tau \[s\].
    pub lag_max_s: f64,
    /// Smallest gain g, acceleration per commanded acceleration; 1 is Theorem 1's.
    #[serde(default = "unity", skip_serializing_if = "is_unity")]
    pub gain_min: f64,
    /// Largest gain g.
    #[serde(default = "unity", skip_serializing_if = "is_unity")]
    pub gain_max: f64,
}

const fn unity() -> f64 {
    1.0
}

fn is_unity(gain: &f64) -> bool {
    *gain == 1.0
}

/// One plant of such a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Lag tau \[s\].
    pub lag_s: f64,
    /// Gain g.
    pub gain: f64,
}

impl Corner {
    /// A lag with the gain 1, as in Theorem 1.
    #[must_use]
    pub const fn lag(lag_s: f64) -> Self {
        Self { lag_s, gain: 1.0 }
    }
}

impl Plants {
    /// One lag, with the gain 1.
    #[must_use]
    pub const fn only(lag_s: f64) -> Self {
        Self { lag_min_s: lag_s, lag_max_s: lag_s, gain_min: 1.0, gain_max: 1.0 }
    }

    /// Whether every plant of `other` is among these.
    #[must_use]
    pub fn cover(&self, other: &Self) -> bool {
        self.lag_min_s <= other.lag_min_s
            && other.lag_max_s <= self.lag_max_s
            && self.gain_min <= other.gain_min
            && other.gain_max <= self.gain_max
    }

    /// The corners of the range: one where it is a point, two or four otherwise.
    ///
    /// They stand for all plants between them: the loop is affine in 1/tau and g/tau, and every
    /// (1/tau, g/tau) of the range lies between those of the corners.
    #[must_use]
    pub fn corners(&self) -> Vec<Corner> {
        let ends = |low: f64, high: f64| if low == high { vec![low] } else { vec![low, high] };
        let gains = ends(self.gain_min, self.gain_max);
        let with = |lag_s| gains.iter().map(move |&gain| Corner { lag_s, gain });
        ends(self.lag_min_s, self.lag_max_s).into_iter().flat_map(with).collect()
    }

    /// Whether all numbers are positive and in order.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let in_order = |low: f64, high: f64| low > 0.0 && low <= high && high.is_finite();
        in_order(self.lag_min_s, self.lag_max_s) && in_order(self.gain_min, self.gain_max)
    }
}

impl From<Corner> for Plants {
    fn from(Corner { lag_s, gain }: Corner) -> Self {
        Self { lag_min_s: lag_s, lag_max_s: lag_s, gain_min: gain, gain_max: gain }
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
