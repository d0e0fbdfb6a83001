//! What a run is measured by, per truck, from the noise-free truth at every base step.
//!
//! ```text
//! leader error       e_i = s_0 - s_i - i D          s: CG position along the road
//! predecessor error  σ_i = s_{i-1} - s_i - D        both 0 for the leader
//! ```
//!
//! - *Settled*: the last instant at which the error was outside its band; never settled when that
//!   is the end of the run. Position: e_i. Speed: forward speed minus the set speed, or minus the
//!   last speed of a scripted leader. Lateral: distance to the desired line.
//! - *Clearance*: least distance between the truck's box and the box of an obstacle that is present
//!   and must not be touched; negative is the depth of an overlap. *Gap*: the same to other trucks.
//! - *Lane crossing*: the CG passes the line between the lanes and gets 0.2 m beyond it.
//! - *Off centre*: lateral distance to the desired line from 10 s after the truck has come back
//!   from passing until it leaves its lane again.
//! - *Passed*: the truck was behind the obstacle when that appeared, and its rear is ahead of the
//!   obstacle's front at the end.
//! - Forces and steering: the larger of what the ECU asked for and what the actuators were told.

mod judge;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use crate::obstacle::{Kind, Obstacle};
use crate::rectangle::Rectangle;
use crate::scenario::{OBSTACLES_MAX, Scenario, TRUCKS_MAX};
use crate::truck::{Command, REAR_OVERHANG_M, Truck};
use crate::truck_node::CommandRange;

pub use judge::Criterion;
pub(crate) use judge::judge;

/// How far beyond the line between the lanes a crossing counts \[m\].
const CROSSING_MARGIN_M: f64 = 0.2;
/// How long a truck that has come back to its lane may take to find its centre \[ns\].
const CENTRING_NS: u64 = 10_000_000_000;

/// How one truck did.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TruckResult {
    /// Its place, 0 is the leader.
    pub index: usize,
    /// Largest |e_i| \[m\].
    pub max_abs_leader_error_m: f64,
    /// Largest |σ_i| \[m\].
    pub max_abs_predecessor_error_m: f64,
    /// σ_i at the end \[m\].
    pub final_predecessor_error_m: f64,
    /// When e_i settled \[s\]; `None` when it never did.
    pub settled_position_s: Option<f64>,
    /// When the lateral position settled \[s\]; `None` when it never did.
    pub settled_lateral_s: Option<f64>,
    /// When the speed settled \[s\]; `None` when it never did.
    pub settled_speed_s: Option<f64>,
    /// Least clearance to an obstacle \[m\]; `None` when there never was one.
    pub min_obstacle_clearance_m: Option<f64>,
    /// Least gap to another truck \[m\]; `None` for a truck alone.
    pub min_truck_gap_m: Option<f64>,
    /// Largest |road-wheel angle| \[rad\].
    pub max_abs_steer_rad: f64,
    /// Largest |lateral acceleration of the CG| \[m/s²\].
    pub max_abs_lateral_accel_mps2: f64,
    /// Strongest braking \[N\].
    pub min_force_n: f64,
    /// Strongest driving \[N\].
    pub max_force_n: f64,
    /// Fastest change of the force the ECU asked for \[N/s\].
    pub max_force_rate_nps: f64,
    /// Fastest change of the steering angle the ECU asked for \[rad/s\].
    pub max_steer_rate_radps: f64,
    /// Furthest right the CG went \[m\].
    pub min_y_m: f64,
    /// Furthest left the CG went \[m\].
    pub max_y_m: f64,
    /// Speed at the end \[m/s\].
    pub final_speed_mps: f64,
    /// How often the CG crossed the line between the lanes.
    pub lane_crossings: u32,
    /// Furthest from its desired line once it is back from passing \[m\]; `None` when it never was.
    pub max_abs_off_centre_m: Option<f64>,
    /// Numbers of the obstacles it was behind when they appeared.
    pub met_obstacles: Vec<usize>,
    /// Numbers of those it passed.
    pub passed_obstacles: Vec<usize>,
    /// How often it lost its ECU's commands.
    pub lost_commands: u32,
}

/// Where the trucks stand to one another, at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Errors {
    pub(crate) leader_m: f64,
    pub(crate) predecessor_m: f64,
}

/// The errors of truck `index`.
pub(crate) fn errors(trucks: &[Truck], index: usize, spacing_m: f64) -> Errors {
    let x_m = |i: usize| trucks[i].state().x_m;
    match index {
        0 => Errors::default(),
        _ => Errors {
            leader_m: x_m(0) - x_m(index) - index as f64 * spacing_m,
            predecessor_m: x_m(index - 1) - x_m(index) - spacing_m,
        },
    }
}

/// The world at one base step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample<'a> {
    pub(crate) time_ns: u64,
    pub(crate) trucks: &'a [Truck],
    pub(crate) commands: &'a [Command],
    pub(crate) obstacles: &'a [Obstacle],
}

/// The measurements of a run, growing with every sample.
#[derive(Debug, Clone)]
pub(crate) struct Metrics {
    spacing_m: f64,
    set_speed_mps: f64,
    lane_line_m: f64,
    desired_y_m: f64,
    position_band_m: f64,
    speed_band_mps: f64,
    lateral_band_m: f64,
    gauges: Vec<Gauge>,
    last_ns: u64,
}

/// The measurements of one truck.
#[derive(Debug, Clone)]
struct Gauge {
    result: TruckResult,
    outside_position_ns: Option<u64>,
    outside_speed_ns: Option<u64>,
    outside_lateral_ns: Option<u64>,
    clearance_m: f64,
    gap_m: f64,
    left_of_line: Option<bool>,
    /// When it last came back to the side of the line it should be on.
    returned_ns: Option<u64>,
    /// Per obstacle: whether the truck was behind it when it appeared, and is ahead of it now.
    was_behind: [Option<bool>; OBSTACLES_MAX],
    is_ahead: [bool; OBSTACLES_MAX],
}

impl Metrics {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        Self {
            spacing_m: scenario.platoon.spacing_m,
            set_speed_mps: scenario.final_speed_mps(),
            lane_line_m: 0.5 * scenario.road.lane_width_m,
            desired_y_m: scenario.platoon.desired_y_m,
            position_band_m: scenario.criteria.settled_position_band_m,
            speed_band_mps: scenario.criteria.settled_speed_band_mps,
            lateral_band_m: scenario.criteria.settled_lateral_band_m,
            gauges: (0..scenario.platoon.trucks).map(Gauge::new).collect(),
            last_ns: 0,
        }
    }

    /// Takes in the world at one base step.
    pub(crate) fn sample(&mut self, seen: &Sample) {
        self.last_ns = seen.time_ns;
        let mut boxes = [Rectangle::new(0.0, 0.0, 0.0, 0.0, 0.0); TRUCKS_MAX];
        for (rectangle, truck) in boxes.iter_mut().zip(seen.trucks) {
            *rectangle = truck.rectangle();
        }
        let boxes = &boxes[..seen.trucks.len()];
        for index in 0..seen.trucks.len() {
            self.sample_motion(seen, index);
            self.gauges[index].sample_obstacles(seen, &seen.trucks[index], &boxes[index]);
            for other in 0..index {
                self.sample_gap(index, other, boxes);
            }
        }
    }

    /// Every truck's result, given what its ECU asked for and how often it fell silent.
    pub(crate) fn results<'a>(
        &self,
        asked: impl Iterator<Item = (&'a CommandRange, u32)>,
    ) -> Vec<TruckResult> {
        self.gauges
            .iter()
            .zip(asked)
            .map(|(gauge, asked)| gauge.finish(self.last_ns, asked))
            .collect()
    }

    fn sample_motion(&mut self, seen: &Sample, index: usize) {
        let Errors { leader_m, predecessor_m } = errors(seen.trucks, index, self.spacing_m);
        let (state, command) = (seen.trucks[index].state(), &seen.commands[index]);
        let gauge = &mut self.gauges[index];
        if leader_m.abs() > self.position_band_m {
            gauge.outside_position_ns = Some(seen.time_ns);
        }
        if (state.forward_mps - self.set_speed_mps).abs() > self.speed_band_mps {
            gauge.outside_speed_ns = Some(seen.time_ns);
        }
        let (beyond_m, own_m) = (state.y_m - self.lane_line_m, self.desired_y_m - self.lane_line_m);
        gauge.sample_line(seen.time_ns, beyond_m, own_m);
        if (state.y_m - self.desired_y_m).abs() > self.lateral_band_m {
            gauge.outside_lateral_ns = Some(seen.time_ns);
        }
        gauge.sample_centring(seen.time_ns, state.y_m - self.desired_y_m);
        let r = &mut gauge.result;
        r.max_abs_leader_error_m = r.max_abs_leader_error_m.max(leader_m.abs());
        r.max_abs_predecessor_error_m = r.max_abs_predecessor_error_m.max(predecessor_m.abs());
        r.final_predecessor_error_m = predecessor_m;
        r.max_abs_steer_rad =
            r.max_abs_steer_rad.max(state.steer_rad.abs()).max(command.steer_rad.abs());
        let lateral_mps2 = seen.trucks[index].acceleration().lateral_mps2.abs();
        r.max_abs_lateral_accel_mps2 = r.max_abs_lateral_accel_mps2.max(lateral_mps2);
        r.min_force_n = r.min_force_n.min(command.force_n);
        r.max_force_n = r.max_force_n.max(command.force_n);
        r.min_y_m = r.min_y_m.min(state.y_m);
        r.max_y_m = r.max_y_m.max(state.y_m);
        r.final_speed_mps = state.forward_mps;
    }

    fn sample_gap(&mut self, index: usize, other: usize, boxes: &[Rectangle]) {
        let known_m = self.gauges[index].gap_m.max(self.gauges[other].gap_m);
        if boxes[index].clearance_floor_m(&boxes[other]) < known_m {
            let gap_m = boxes[index].clearance_m(&boxes[other]);
            for truck in [index, other] {
                self.gauges[truck].gap_m = self.gauges[truck].gap_m.min(gap_m);
            }
        }
    }
}

impl Gauge {
    fn new(index: usize) -> Self {
        let result = TruckResult {
            index,
            min_y_m: f64::INFINITY,
            max_y_m: f64::NEG_INFINITY,
            ..TruckResult::default()
        };
        Self {
            result,
            outside_position_ns: None,
            outside_speed_ns: None,
            outside_lateral_ns: None,
            clearance_m: f64::INFINITY,
            gap_m: f64::INFINITY,
            left_of_line: None,
            returned_ns: None,
            was_behind: [None; OBSTACLES_MAX],
            is_ahead: [false; OBSTACLES_MAX],
        }
    }

    /// Counts crossings; `beyond_m` is how far left of the line the CG is, `own_m` where it should
    /// be.
    fn sample_line(&mut self, time_ns: u64, beyond_m: f64, own_m: f64) {
        match self.left_of_line {
            None => self.left_of_line = Some(beyond_m > 0.0),
            Some(left) => {
                let margin_m = if left { -beyond_m } else { beyond_m };
                if margin_m > CROSSING_MARGIN_M {
                    self.left_of_line = Some(!left);
                    self.result.lane_crossings += 1;
                    self.returned_ns = (beyond_m * own_m > 0.0).then_some(time_ns);
                }
            }
        }
    }

    /// `off_m` is how far left of its desired line the CG is.
    fn sample_centring(&mut self, time_ns: u64, off_m: f64) {
        if self.returned_ns.is_some_and(|returned_ns| time_ns > returned_ns + CENTRING_NS) {
            let worst = &mut self.result.max_abs_off_centre_m;
            *worst = Some(worst.unwrap_or(0.0).max(off_m.abs()));
        }
    }

    fn sample_obstacles(&mut self, seen: &Sample, truck: &Truck, own: &Rectangle) {
        let time_s = seen.time_ns as f64 * 1e-9;
        let x_m = truck.state().x_m;
        for (index, obstacle) in seen.obstacles.iter().enumerate() {
            if !obstacle.present(time_s) {
                continue;
            }
            let motion = obstacle.motion(time_s);
            self.was_behind[index].get_or_insert(x_m < motion.x_m);
            self.is_ahead[index] = x_m - REAR_OVERHANG_M > motion.x_m + 0.5 * obstacle.length_m;
            let rectangle = obstacle.rectangle(&motion);
            if obstacle.kind != Kind::Bump && own.clearance_floor_m(&rectangle) < self.clearance_m {
                self.clearance_m = self.clearance_m.min(own.clearance_m(&rectangle));
            }
        }
    }

    fn finish(&self, end_ns: u64, (asked, lost_commands): (&CommandRange, u32)) -> TruckResult {
        let mut result = self.result.clone();
        result.settled_position_s = settled_s(self.outside_position_ns, end_ns);
        result.settled_speed_s = settled_s(self.outside_speed_ns, end_ns);
        result.settled_lateral_s = settled_s(self.outside_lateral_ns, end_ns);
        result.min_obstacle_clearance_m = finite(self.clearance_m);
        result.min_truck_gap_m = finite(self.gap_m);
        if let Some((low_n, high_n)) = asked.force_n {
            result.min_force_n = result.min_force_n.min(low_n);
            result.max_force_n = result.max_force_n.max(high_n);
        }
        result.max_abs_steer_rad = result.max_abs_steer_rad.max(asked.steer_rad);
        result.max_force_rate_nps = asked.force_rate_nps;
        result.max_steer_rate_radps = asked.steer_rate_radps;
        result.lost_commands = lost_commands;
        let met = |&number: &usize| self.was_behind[number - 1] == Some(true);
        result.met_obstacles = (1..=OBSTACLES_MAX).filter(met).collect();
        let passed = |number: &usize| self.is_ahead[number - 1];
        result.passed_obstacles = result.met_obstacles.iter().copied().filter(passed).collect();
        result
    }
}

/// When something settled that was last outside its band at `outside_ns`.
fn settled_s(outside_ns: Option<u64>, end_ns: u64) -> Option<f64> {
    match outside_ns {
        None => Some(0.0),
        Some(outside_ns) if outside_ns < end_ns => Some(outside_ns as f64 * 1e-9),
        Some(_) => None,
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
