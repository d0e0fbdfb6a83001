//! From measurements to a verdict: one line per criterion, each judged on the worst truck.

use serde::{Deserialize, Serialize};

use super::TruckResult;
use crate::scenario::Criteria;

/// One criterion and how the run stands to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Criterion {
    /// Its key in the scenario.
    pub name: String,
    /// The limit.
    pub limit: f64,
    /// The worst value of any truck; `None` when there is none (never settled, no obstacle met).
    pub value: Option<f64>,
    /// Whether the limit holds.
    pub passed: bool,
}

impl Criterion {
    /// A criterion that holds while the value is not above the limit; without a value it fails.
    pub fn at_most(name: &str, limit: f64, value: Option<f64>) -> Self {
        let passed = value.is_some_and(|value| value <= limit);
        Self { name: name.to_owned(), limit, value, passed }
    }

    /// A criterion that holds while the value is not below the limit; without a value it holds.
    pub fn at_least(name: &str, limit: f64, value: Option<f64>) -> Self {
        let passed = value.is_none_or(|value| value >= limit);
        Self { name: name.to_owned(), limit, value, passed }
    }

    /// A criterion that holds while the value is the limit.
    pub fn exactly(name: &str, limit: f64, value: f64) -> Self {
        Self { name: name.to_owned(), limit, value: Some(value), passed: value == limit }
    }

    /// Whether larger values are better, as the keys of the scenario's `criteria` say it.
    #[must_use]
    pub fn is_lower_limit(&self) -> bool {
        self.name.starts_with("min_")
    }
}

/// The criteria the rig can judge, in the scenario's order.
///
/// `max_qp_failures` and `max_emergency_brakings` are not among them: only the ECUs know.
pub(crate) fn judge(limits: &Criteria, trucks: &[TruckResult]) -> Vec<Criterion> {
    let mut judged = Vec::new();
    judge_upper_limits(limits, trucks, &mut judged);
    judge_lower_limits(limits, trucks, &mut judged);
    judge_settling(limits, trucks, &mut judged);
    if let Some(limit) = limits.lane_crossings {
        let off = trucks.iter().map(|t| t.lane_crossings).find(|&count| count != limit);
        let value = f64::from(off.unwrap_or(limit));
        judged.push(Criterion::exactly("lane_crossings", f64::from(limit), value));
    }
    for number in &limits.passed_obstacles {
        // Who was never behind it has nothing to pass.
        let met = trucks.iter().filter(|t| t.met_obstacles.contains(number)).count();
        let passed = trucks.iter().filter(|t| t.passed_obstacles.contains(number)).count();
        let name = format!("passed_obstacle_{number}");
        judged.push(Criterion::exactly(&name, met as f64, passed as f64));
    }
    judged
}

type Measure = fn(&TruckResult) -> f64;
type MaybeMeasure = fn(&TruckResult) -> Option<f64>;

fn judge_upper_limits(limits: &Criteria, trucks: &[TruckResult], judged: &mut Vec<Criterion>) {
    let lost = limits.max_lost_commands.map(f64::from);
    let table: [(&str, Option<f64>, Measure); 8] = [
        ("max_predecessor_error_m", limits.max_predecessor_error_m, |t| {
            t.max_abs_predecessor_error_m
        }),
        ("max_steer_rad", limits.max_steer_rad, |t| t.max_abs_steer_rad),
        ("max_lateral_accel_mps2", limits.max_lateral_accel_mps2, |t| t.max_abs_lateral_accel_mps2),
        ("max_y_m", limits.max_y_m, |t| t.max_y_m),
        ("max_force_n", limits.max_force_n, |t| t.max_force_n),
        ("max_force_rate_nps", limits.max_force_rate_nps, |t| t.max_force_rate_nps),
        ("max_steer_rate_radps", limits.max_steer_rate_radps, |t| t.max_steer_rate_radps),
        ("max_lost_commands", lost, |t| f64::from(t.lost_commands)),
    ];
    for (name, limit, measure) in table {
        if let Some(limit) = limit {
            let worst = trucks.iter().map(measure).max_by(f64::total_cmp);
            judged.push(Criterion::at_most(name, limit, worst));
        }
    }
    let waves = || trucks.iter().flat_map(|truck| &truck.amplifications);
    if let Some(limit) = limits.max_leader_amplification {
        let worst = waves().filter_map(|wave| wave.leader_ratio).max_by(f64::total_cmp);
        judged.push(Criterion::at_most("max_leader_amplification", limit, worst));
    }
    if let Some(limit) = limits.max_amplification {
        // With a single follower there is nobody to make a wave larger.
        let worst = waves().filter_map(|wave| wave.ratio).max_by(f64::total_cmp).unwrap_or(0.0);
        judged.push(Criterion::at_most("max_amplification", limit, Some(worst)));
    }
    if let Some(limit) = limits.max_off_centre_m {
        let off = trucks.iter().filter_map(|t| t.max_abs_off_centre_m);
        // A truck that never passed anything cannot be off centre after passing.
        let worst = off.max_by(f64::total_cmp).unwrap_or(0.0);
        judged.push(Criterion::at_most("max_off_centre_m", limit, Some(worst)));
    }
}

fn judge_lower_limits(limits: &Criteria, trucks: &[TruckResult], judged: &mut Vec<Criterion>) {
    let table: [(&str, Option<f64>, MaybeMeasure); 5] = [
        ("min_clearance_m", limits.min_clearance_m, |t| t.min_obstacle_clearance_m),
        ("min_truck_gap_m", limits.min_truck_gap_m, |t| t.min_truck_gap_m),
        ("min_standstill_gap_m", limits.min_standstill_gap_m, |t| t.min_standstill_gap_m),
        ("min_y_m", limits.min_y_m, |t| Some(t.min_y_m)),
        ("min_force_n", limits.min_force_n, |t| Some(t.min_force_n)),
    ];
    for (name, limit, measure) in table {
        if let Some(limit) = limit {
            let worst = trucks.iter().filter_map(measure).min_by(f64::total_cmp);
            judged.push(Criterion::at_least(name, limit, worst));
        }
    }
}

fn judge_settling(limits: &Criteria, trucks: &[TruckResult], judged: &mut Vec<Criterion>) {
    let table: [(&str, Option<f64>, MaybeMeasure); 4] = [
        ("settled_position_s", limits.settled_position_s, |t| t.settled_position_s),
        ("settled_speed_s", limits.settled_speed_s, |t| t.settled_speed_s),
        ("settled_lateral_s", limits.settled_lateral_s, |t| t.settled_lateral_s),
        ("settled_after_change_s", limits.settled_after_change_s, |t| t.settled_after_change_s),
    ];
    for (name, limit, measure) in table {
        if let Some(limit) = limit {
            // One truck that never settles decides: a missing value makes the whole missing.
            let times: Option<Vec<f64>> = trucks.iter().map(measure).collect();
            let worst = times.and_then(|times| times.into_iter().max_by(f64::total_cmp));
            judged.push(Criterion::at_most(name, limit, worst));
        }
    }
}
