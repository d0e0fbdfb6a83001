//! What a run is judged by.

use serde::{Deserialize, Serialize};

/// Limits on the behaviour of the run; one that is absent is not judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Criteria {
    /// Largest |distance error to the truck ahead| of any truck \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_predecessor_error_m: Option<f64>,
    /// When every truck must have settled in its slot behind the leader \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_position_s: Option<f64>,
    /// Half-width of the band that counts as settled \[m\].
    pub settled_position_band_m: f64,
    /// When every truck must have settled at the set speed \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_speed_s: Option<f64>,
    /// Half-width of the band that counts as settled \[m/s\].
    pub settled_speed_band_mps: f64,
    /// When every truck must have settled on its desired line \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_lateral_s: Option<f64>,
    /// Half-width of the band that counts as settled \[m\].
    pub settled_lateral_band_m: f64,
    /// How long after a change of the roster every truck may take to settle within all three bands
    /// \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_after_change_s: Option<f64>,
    /// Largest ratio of a truck's speed amplitude to the leader's, at any wave of its script.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_leader_amplification: Option<f64>,
    /// Largest ratio of a truck's speed amplitude to that of the truck ahead, when that is not the
    /// leader, at any wave of the leader's script.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_amplification: Option<f64>,
    /// Least distance between a truck's box and an obstacle's \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_clearance_m: Option<f64>,
    /// Least distance between two trucks' boxes \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_truck_gap_m: Option<f64>,
    /// Least distance between the boxes of a truck that stands still and another \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_standstill_gap_m: Option<f64>,
    /// Largest |road-wheel angle|, asked for or reached \[rad\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steer_rad: Option<f64>,
    /// Largest |lateral acceleration| of a CG \[m/s²\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_lateral_accel_mps2: Option<f64>,
    /// How often every truck must have crossed the line between the lanes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lane_crossings: Option<u32>,
    /// Numbers of the obstacles that every truck behind them must have passed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub passed_obstacles: Vec<usize>,
    /// Furthest from its desired line that a CG may be, from 10 s after it came back from passing
    /// \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_off_centre_m: Option<f64>,
    /// Furthest right a CG may go \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_y_m: Option<f64>,
    /// Furthest left a CG may go \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_y_m: Option<f64>,
    /// Strongest braking command \[N\], negative.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_force_n: Option<f64>,
    /// Strongest driving command \[N\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_force_n: Option<f64>,
    /// Fastest change of the force command \[N/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_force_rate_nps: Option<f64>,
    /// Fastest change of the steering command \[rad/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steer_rate_radps: Option<f64>,
    /// How often a truck may lose its ECU's commands.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_lost_commands: Option<u32>,
    /// How many QPs may fail; the rig cannot see this, whoever reads the ECUs' records judges it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_qp_failures: Option<u32>,
    /// How often the guards of all ECUs together may begin an emergency braking; judged likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_emergency_brakings: Option<u32>,
}

impl Default for Criteria {
    fn default() -> Self {
        Self {
            max_predecessor_error_m: None,
            settled_position_s: None,
            settled_position_band_m: 0.5,
            settled_speed_s: None,
            settled_speed_band_mps: 0.2,
            settled_lateral_s: None,
            settled_lateral_band_m: 0.3,
            settled_after_change_s: None,
            max_leader_amplification: None,
            max_amplification: None,
            min_clearance_m: None,
            min_truck_gap_m: None,
            min_standstill_gap_m: None,
            max_steer_rad: None,
            max_lateral_accel_mps2: None,
            lane_crossings: None,
            passed_obstacles: Vec::new(),
            max_off_centre_m: None,
            min_y_m: None,
            max_y_m: None,
            min_force_n: None,
            max_force_n: None,
            max_force_rate_nps: None,
            max_steer_rate_radps: None,
            max_lost_commands: None,
            max_qp_failures: None,
            max_emergency_brakings: None,
        }
    }
}
