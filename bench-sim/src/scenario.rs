//! Scenarios: what the bench is to do, one TOML file each, units in every key.
//!
//! A scenario is a built-in name or a path. Overrides (`--set key=value`) go onto the parsed TOML
//! before it becomes a [`Scenario`], so they are typed and checked exactly as the file is.
//! Obstacles count from 1, trucks from 0 (the leader). Unknown keys are refused everywhere except
//! below `law`, which is the ECU's own and passes through untouched.

mod criteria;
mod event;
mod leader;
mod limits;
mod load;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::obstacle::Obstacle;
use crate::roster;
use crate::truck::two_track::{DrivenAxles, FrictionPatch, Surroundings, TyreParameters};
use crate::truck::{
    NOMINAL_MASS_KG, PredictionParameters, Specification, TruckParameters, TwoTrackParameters,
};

pub use criteria::Criteria;
pub use event::Event;
pub use leader::{Acceleration, Course, Leader, Wave};
pub use limits::{OBSTACLES_MAX, TRUCKS_MAX};
pub use load::{ScenarioError, Summary};

/// A whole scenario, checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// What happens, in a line.
    #[serde(default)]
    pub description: String,
    /// How long it runs \[s\] of bench time.
    pub duration_s: f64,
    /// The trucks as a group.
    pub platoon: Platoon,
    /// The leader's script, when it is not driven by an ECU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leader: Option<Leader>,
    /// The road.
    #[serde(default)]
    pub road: Road,
    /// The radio between the trucks.
    #[serde(default)]
    pub v2v: V2v,
    /// What the trucks are.
    #[serde(default)]
    pub plant: Plant,
    /// What the trucks perceive.
    #[serde(default)]
    pub sensors: Sensors,
    /// Deviations of single trucks from the nominal one, by truck number.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub trucks: BTreeMap<String, TruckOverride>,
    /// Scripted obstacles, the first one is number 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// What changes on the way, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
    /// What the run is judged by.
    #[serde(default)]
    pub criteria: Criteria,
    /// Passed to the ECUs untouched.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub law: toml::Table,
}

/// The trucks as a group.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Platoon {
    /// How many trucks, the leader included.
    pub trucks: usize,
    /// Desired distance D between neighbours' CGs \[m\]; also the distance at the start. Events
    /// change it, and so the next two.
    pub spacing_m: f64,
    /// Set speed of the leader \[m/s\]; also everybody's speed at the start.
    pub speed_mps: f64,
    /// Desired lateral position Y_des \[m\]; also everybody's position at the start.
    #[serde(default)]
    pub desired_y_m: f64,
}

/// The road: straight, two lanes, lane 1 about Y = 0.
///
/// Slope, wind and friction patches act on trucks of `plant.model = "two-track"` only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Road {
    /// Width of a lane \[m\]; the line between lane 1 and 2 is at half of it.
    pub lane_width_m: f64,
    /// Y of the right edge \[m\].
    pub right_edge_y_m: f64,
    /// Y of the left edge \[m\].
    pub left_edge_y_m: f64,
    /// Rise along the road \[m per 100 m\], positive uphill.
    pub grade_percent: f64,
    /// Rise across the road \[m per 100 m\], positive with the left side high.
    pub banking_percent: f64,
    /// Wind along the road \[m/s\], positive from behind.
    pub wind_x_mps: f64,
    /// Wind across the road \[m/s\], positive towards the left.
    pub wind_y_mps: f64,
    /// Stretches with a friction of their own, over the whole width.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub friction_patches: Vec<FrictionPatch>,
}

impl Default for Road {
    fn default() -> Self {
        Self {
            lane_width_m: 3.75,
            right_edge_y_m: -1.875,
            left_edge_y_m: 5.625,
            grade_percent: 0.0,
            banking_percent: 0.0,
            wind_x_mps: 0.0,
            wind_y_mps: 0.0,
            friction_patches: Vec::new(),
        }
    }
}

/// The radio between the trucks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct V2v {
    /// Shortest transport delay λ \[s\].
    pub delay_min_s: f64,
    /// Longest transport delay \[s\].
    pub delay_max_s: f64,
    /// Fastest change of the delay |dλ/dt| \[s/s\].
    pub delay_rate_max: f64,
    /// Time between a truck's broadcasts \[s\].
    pub period_s: f64,
    /// Share of messages that never arrive, per link.
    pub loss: f64,
}

impl Default for V2v {
    fn default() -> Self {
        Self { delay_min_s: 0.0, delay_max_s: 0.0, delay_rate_max: 0.2, period_s: 0.02, loss: 0.0 }
    }
}

/// Which equations a truck obeys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// One track, nonlinear tyres.
    #[default]
    SingleTrack,
    /// Four wheels, suspension, drive line, air brakes, slope and wind.
    TwoTrack,
    /// One track, linear tyres: what the controller believes.
    Prediction,
}

impl std::fmt::Display for Model {
    /// As `plant.model` names it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::SingleTrack => "single-track",
            Self::TwoTrack => "two-track",
            Self::Prediction => "prediction",
        })
    }
}

/// What the trucks are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plant {
    /// The equations of motion.
    pub model: Model,
    /// Friction coefficient between tyre and road; the prediction model knows none.
    pub friction: f64,
    /// Most power at the wheels \[W\]; two-track only.
    pub power_max_w: f64,
    /// Which axles are driven; two-track only.
    pub driven_axles: DrivenAxles,
    /// Whether every ECU is told its truck's mass; one that is not believes the nominal truck.
    pub mass_told: bool,
    /// Factor on the cornering stiffness of the rear tyres; two-track only. 3.09 makes the rear
    /// axle's that of the paper's Table II.
    pub rear_cornering_scale: f64,
}

impl Default for Plant {
    fn default() -> Self {
        let nominal = TwoTrackParameters::default();
        Self {
            model: Model::SingleTrack,
            friction: TruckParameters::default().friction,
            power_max_w: nominal.power_max_w,
            driven_axles: nominal.driven,
            mass_told: false,
            rear_cornering_scale: nominal.rear_tyre.cornering_scale,
        }
    }
}

/// What the trucks perceive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Scale of the sensor noise: 0 none, 1 as a fused navigation solution has it.
    pub noise: f64,
    /// How far ahead an obstacle is seen, CG to centre \[m\].
    pub range_m: f64,
    /// How far behind it is still reported, CG to centre \[m\].
    pub behind_m: f64,
}

impl Default for Sensors {
    fn default() -> Self {
        Self { noise: 0.0, range_m: 80.0, behind_m: 30.0 }
    }
}

/// How one truck differs from the nominal one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TruckOverride {
    /// Mass \[kg\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Time constant of drive and brake force \[s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drive_lag_s: Option<f64>,
    /// Where its CG starts along the road \[m\]; its slot behind truck 0, which starts at 0, when
    /// not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_x_m: Option<f64>,
    /// Where it starts across the road \[m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_y_m: Option<f64>,
    /// Its speed at the start \[m/s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_speed_mps: Option<f64>,
}

/// Where a truck starts, and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// CG along the road \[m\].
    pub x_m: f64,
    /// CG across the road \[m\].
    pub y_m: f64,
    /// Forward speed \[m/s\].
    pub speed_mps: f64,
}

impl Scenario {
    /// What one truck is, its overrides applied.
    pub fn truck(&self, truck: usize) -> Specification {
        if let Some(leader) = self.leader.as_ref().filter(|_| truck == 0) {
            return Specification::Scripted(leader.phases());
        }
        let p = self.truck_parameters(truck);
        match self.plant.model {
            Model::SingleTrack => p.into(),
            Model::TwoTrack => self.two_track(&p).into(),
            Model::Prediction => PredictionParameters::new(p.mass_kg, p.drive_lag_s).into(),
        }
    }

    /// How this truck differs from the nominal one.
    fn of_truck(&self, truck: usize) -> TruckOverride {
        self.trucks.get(&truck.to_string()).copied().unwrap_or_default()
    }

    /// Where a truck starts: in its slot, unless its overrides say otherwise.
    pub fn start(&self, truck: usize) -> Start {
        let (own, platoon) = (self.of_truck(truck), &self.platoon);
        Start {
            x_m: own.start_x_m.unwrap_or(-(truck as f64) * platoon.spacing_m),
            y_m: own.start_y_m.unwrap_or(platoon.desired_y_m),
            speed_mps: own.start_speed_mps.unwrap_or(platoon.speed_mps),
        }
    }

    /// The mass \[kg\] that the ECU of a truck is told; `None` when it is to believe the nominal
    /// one.
    pub fn told_mass_kg(&self, truck: usize) -> Option<f64> {
        self.of_truck(truck).mass_kg.filter(|_| self.plant.mass_told)
    }

    /// For every truck, by number, the trucks whose broadcasts reach its ECU: those that it follows
    /// or that lead it at any time.
    pub fn v2v_sources(&self) -> Vec<Vec<usize>> {
        roster::sources(self)
    }

    /// The single-track calibration of one truck, its overrides applied.
    pub fn truck_parameters(&self, truck: usize) -> TruckParameters {
        let nominal = TruckParameters::default();
        let own = self.of_truck(truck);
        TruckParameters::new(
            own.mass_kg.unwrap_or(NOMINAL_MASS_KG),
            own.drive_lag_s.unwrap_or(nominal.drive_lag_s),
            self.plant.friction,
        )
    }

    /// The two-track calibration of a truck of a mass and a drive lag, on this road.
    fn two_track(&self, truck: &TruckParameters) -> TwoTrackParameters {
        let (nominal, road) = (TwoTrackParameters::new(truck.mass_kg), &self.road);
        let mut surroundings = Surroundings::level(self.plant.friction)
            .with_patches(road.friction_patches.iter().copied());
        surroundings.grade = 0.01 * road.grade_percent;
        surroundings.banking = 0.01 * road.banking_percent;
        (surroundings.wind_x_mps, surroundings.wind_y_mps) = (road.wind_x_mps, road.wind_y_mps);
        TwoTrackParameters {
            drive_lag_s: truck.drive_lag_s,
            driven: self.plant.driven_axles,
            power_max_w: self.plant.power_max_w,
            rear_tyre: TyreParameters {
                cornering_scale: self.plant.rear_cornering_scale,
                ..nominal.rear_tyre
            },
            surroundings,
            ..nominal
        }
    }

    /// Whether an ECU drives this truck; a scripted leader has none.
    pub fn has_ecu(&self, truck: usize) -> bool {
        truck > 0 || self.leader.is_none()
    }

    /// How long it runs \[ns\] of bench time.
    pub fn duration_ns(&self) -> u64 {
        libm::round(self.duration_s * 1e9) as u64
    }

    /// The scenario as TOML, every default and override written out; what a recording attaches.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a loaded scenario holds only values TOML can write")
    }
}
