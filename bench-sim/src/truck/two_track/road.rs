//! What the two-track truck drives on and in: slope, friction and wind.
//!
//! The road is a plane: `grade` rises along X, `banking` rises along Y, so positions and headings
//! are measured in that plane. Wind is steady and the same everywhere.

use serde::{Deserialize, Serialize};

use super::super::GRAVITY_MPS2;

/// Most friction patches of a road.
pub const FRICTION_PATCHES_MAX: usize = 8;

/// A stretch of road, over its whole width, with a friction of its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrictionPatch {
    /// Where it begins \[m\] along the road.
    pub from_x_m: f64,
    /// Where it ends \[m\] along the road.
    pub until_x_m: f64,
    /// Friction coefficient on it.
    pub friction: f64,
}

impl FrictionPatch {
    /// No patch at all: it begins nowhere.
    const NONE: Self = Self { from_x_m: f64::INFINITY, until_x_m: f64::INFINITY, friction: 1.0 };
}

/// The road and the air over it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// Friction coefficient outside the patches: the peak of a tyre at its rated load.
    pub friction: f64,
    /// Rise along the road over distance, positive uphill.
    pub grade: f64,
    /// Rise across the road over distance, positive with the left side high.
    pub banking: f64,
    /// Wind along the road \[m/s\], positive from behind.
    pub wind_x_mps: f64,
    /// Wind across the road \[m/s\], positive towards the left.
    pub wind_y_mps: f64,
    patches: [FrictionPatch; FRICTION_PATCHES_MAX],
}

impl Surroundings {
    /// A level road of one friction, without wind.
    pub fn level(friction: f64) -> Self {
        Self {
            friction,
            grade: 0.0,
            banking: 0.0,
            wind_x_mps: 0.0,
            wind_y_mps: 0.0,
            patches: [FrictionPatch::NONE; FRICTION_PATCHES_MAX],
        }
    }

    /// The same surroundings with friction patches; where two overlap the first one counts.
    /// Patches beyond [`FRICTION_PATCHES_MAX`] are left out, which a scenario never has.
    pub fn with_patches(mut self, patches: impl IntoIterator<Item = FrictionPatch>) -> Self {
        self.patches = [FrictionPatch::NONE; FRICTION_PATCHES_MAX];
        for (place, patch) in self.patches.iter_mut().zip(patches) {
            *place = patch;
        }
        self
    }

    /// Friction coefficient at a place along the road.
    pub(super) fn friction_at(&self, x_m: f64) -> f64 {
        self.patches
            .iter()
            .find(|patch| (patch.from_x_m..patch.until_x_m).contains(&x_m))
            .map_or(self.friction, |patch| patch.friction)
    }

    /// Gravity along the road, across it and into it \[m/s²\].
    pub(super) fn gravity_mps2(&self) -> [f64; 3] {
        let steepness = (1.0 + self.grade * self.grade + self.banking * self.banking).sqrt();
        let normal_mps2 = GRAVITY_MPS2 / steepness;
        [-self.grade * normal_mps2, -self.banking * normal_mps2, normal_mps2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_keeps_its_length_on_any_slope() {
        let road = Surroundings { grade: 0.1, banking: -0.05, ..Surroundings::level(0.85) };
        let [x, y, z] = road.gravity_mps2();
        assert!((libm::sqrt(x * x + y * y + z * z) - GRAVITY_MPS2).abs() < 1e-12);
        assert!(x < 0.0 && y > 0.0, "uphill slows, a high right side pulls to the left");
    }

    #[test]
    fn a_patch_covers_its_stretch_and_nothing_else() {
        let ice = FrictionPatch { from_x_m: 50.0, until_x_m: 80.0, friction: 0.15 };
        let road = Surroundings::level(0.85).with_patches([ice]);
        let found = [49.9, 50.0, 79.9, 80.0].map(|x_m| road.friction_at(x_m));
        assert_eq!(found, [0.85, 0.15, 0.15, 0.85]);
    }
}
