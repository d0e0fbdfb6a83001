//! The gain file: what a design hands over, in TOML.

use serde::{Deserialize, Serialize};

use crate::gain::{DelayBound, Gain, Plants, Rate};
use crate::proof::{Jensen, Wirtinger};

/// The layout of the file that this program writes and reads.
pub const VERSION: u32 = 1;
/// Followers of a proof at most: checking exactly takes time that grows with the fourth power.
const FOLLOWERS_MAX: usize = 8;

/// A gain with its claims.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainFile {
    /// Layout of the file.
    pub version: u32,
    /// Its name in a library.
    pub name: String,
    /// Where it comes from, for people.
    pub about: String,
    /// The gain.
    pub gain: Gain,
    /// The plants it is for.
    pub plant: Plants,
    /// The delays it is for.
    pub delay: DelayBound,
    /// Proofs for one truck, which hold in a platoon of any length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<VehicleProofs>,
    /// Proofs for whole platoons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub platoon: Vec<PlatoonProof>,
}

/// Proofs for one truck, all for delays of any rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleProofs {
    /// From w = \[a_0, a_0'\] to the position error.
    pub disturbance_to_error: Wirtinger,
    /// What passes from truck to truck; absent when K2 is 0 and nothing does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coupling: Option<CouplingProofs>,
}

/// Proofs for what one truck makes of what another forwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingProofs {
    /// From w to K2 x.
    pub disturbance_to_forwarded: Wirtinger,
    /// From the forwarded signal to the position error.
    pub forwarded_to_error: Wirtinger,
    /// From the forwarded signal to K2 x.
    pub forwarded_to_forwarded: Wirtinger,
}

/// A proof for a platoon of trucks that are alike: |position errors| <= gamma |disturbances|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlatoonProof {
    /// How many follow.
    pub followers: usize,
    /// The proof.
    pub proof: Jensen,
}

/// Why a text is no gain file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileError {
    /// It is not TOML with these keys.
    #[error("{0}; `platoon gain synthesise` writes such files")]
    Unreadable(String),
    /// It is of another version.
    #[error("version {0} of the gain file is not known, only {VERSION}; design the gain anew")]
    Version(u32),
    /// A number makes no sense.
    #[error("{key}: allowed is {allowed}")]
    Nonsense {
        /// Which.
        key: &'static str,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl GainFile {
    /// Reads a file's text. The proofs are read, not checked.
    ///
    /// # Errors
    /// When it is no gain file.
    pub fn parse(text: &str) -> Result<Self, FileError> {
        let unreadable =
            |error: toml::de::Error| FileError::Unreadable(error.message().replace('\n', " "));
        let file: Self = toml::from_str(text).map_err(unreadable)?;
        if file.version != VERSION {
            return Err(FileError::Version(file.version));
        }
        match file.nonsense() {
            Some((key, allowed)) => Err(FileError::Nonsense { key, allowed }),
            None => Ok(file),
        }
    }

    /// The file's text.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("tables and lists of numbers, no cycles")
    }

    /// The first number that makes no sense, and what is allowed.
    fn nonsense(&self) -> Option<(&'static str, &'static str)> {
        let Plants { lag_min_s, lag_max_s, gain_min, gain_max } = self.plant;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let mut gains = self.gain.k1.iter().chain(&self.gain.k2);
        let has_rate = match self.delay.rate {
            Rate::Any => true,
            Rate::Below(mu) => (0.0..1.0).contains(&mu),
        };
        let counts = self.platoon.iter().all(|p| (1..=FOLLOWERS_MAX).contains(&p.followers));
        [
            (positive(lag_min_s), "plant.lag_min_s", "a number greater than 0"),
            (
                positive(lag_max_s) && lag_max_s >= lag_min_s,
                "plant.lag_max_s",
                "a number of at least lag_min_s",
            ),
            (positive(gain_min), "plant.gain_min", "a number greater than 0"),
            (
                positive(gain_max) && gain_max >= gain_min,
                "plant.gain_max",
                "a number of at least gain_min",
            ),
            (positive(self.delay.longest_s), "delay.longest_s", "a number greater than 0"),
            (has_rate, "delay.rate", "\"any\", or { below = a number from 0 up to less than 1 }"),
            (gains.all(|k| k.is_finite()), "gain", "finite gains"),
            (counts, "platoon.followers", "1 to 8"),
        ]
        .into_iter()
        .find_map(|(is_sound, key, allowed)| (!is_sound).then_some((key, allowed)))
    }

    /// How many trucks, leader included, a platoon may have for a gamma of this file to hold;
    /// `None` when any number may: one truck is proven with what it forwards, or forwards nothing.
    #[must_use]
    pub fn trucks_max(&self) -> Option<usize> {
        let is_any = self.vehicle.is_some() || !self.gain.is_coupled();
        let most = self.platoon.iter().map(|proof| proof.followers + 1).max();
        (!is_any).then_some(most.unwrap_or(0))
    }

    /// The least gamma proven for the first follower; `None` without such a proof.
    #[must_use]
    pub fn first_gamma(&self) -> Option<f64> {
        let alone = self.platoon.iter().filter(|p| p.followers == 1).map(|p| p.proof.gamma);
        let vehicle = self.vehicle.iter().map(|v| v.disturbance_to_error.gamma);
        alone.chain(vehicle).min_by(f64::total_cmp)
    }
}
