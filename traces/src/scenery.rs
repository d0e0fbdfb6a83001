//! What a scene shows besides trucks and obstacles. The caller knows the road and the law.

use core::fmt;
use std::sync::Arc;

use crate::truth::{ObstacleTruth, TruckTruth};

/// The surroundings of a run's scenes; nothing of it by default.
#[derive(Debug, Clone, Default)]
pub struct Scenery {
    /// Y of the road's right and left edge \[m\].
    pub edges_m: Option<[f64; 2]>,
    /// Y of the lines between lanes \[m\].
    pub lane_lines_m: Vec<f64>,
    /// How far the potential fields of obstacles reach.
    pub reach: Option<Reach>,
}

/// Half axes \[m\], along and across the road, that a law gives an obstacle's field for a truck.
type HalfAxes = dyn Fn(&TruckTruth, &ObstacleTruth) -> [f64; 2] + Send + Sync;

/// Half axes of an obstacle's potential field \[m\], along and across the road, for a truck.
#[derive(Clone)]
pub struct Reach(Arc<HalfAxes>);

impl Reach {
    /// Half axes as a law has them.
    pub fn new(
        half_m: impl Fn(&TruckTruth, &ObstacleTruth) -> [f64; 2] + Send + Sync + 'static,
    ) -> Self {
        Self(Arc::new(half_m))
    }

    pub(crate) fn of(&self, truck: &TruckTruth, obstacle: &ObstacleTruth) -> [f64; 2] {
        (self.0)(truck, obstacle)
    }
}

impl fmt::Debug for Reach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Reach")
    }
}
