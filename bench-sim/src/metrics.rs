//! What a run is measured by, per truck, from the noise-free truth at every base step.
//!
//! ```text
//! leader error       e_i = s_0 - s_i - i D          s: CG position along the road
//! predecessor error  σ_i = s_{i-1} - s_i - D        both 0 for the leader
//! ```
//!
//! Leader, predecessor and the distances asked for are those of the roster at that instant.
//!
//! - *Settled*: the last instant at which the error was outside its band; never settled when that
//!   is the end of the run. Position: e_i. Speed: forward speed minus the leader's set speed, or
//!   minus the last speed of a scripted leader. Lateral: distance to the desired line.
//! - *Settled after a change*: see [`change`]. *Amplification*: see [`oscillation`].
//! - *Clearance*: least distance between the truck's box and the box of an obstacle that is present
//!   and must not be touched; negative is the depth of an overlap. *Gap*: the same to other trucks;
//!   *standstill gap*: while this truck stands still.
//! - *Lane crossing*: the CG passes the line between the lanes and gets 0.2 m beyond it.
//! - *Off centre*: lateral distance to the desired line from 10 s after the truck has come back
//!   from passing until it leaves its lane again.
//! - *Passed*: the truck was behind the obstacle when that appeared, and its rear is ahead of the
//!   obstacle's front at the end.
//! - Forces and steering: the larger of what the ECU asked for and what the actuators were told.

mod change;
mod judge;
mod oscillation;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use crate::obstacle::{Kind, Obstacle};
use crate::rectangle::Rectangle;
use crate::roster::Place;
use crate::scenario::{OBSTACLES_MAX, Scenario, TRUCKS_MAX, Wave};
use crate::truck::{Command, REAR_OVERHANG_M, Truck};
use crate::truck_node::CommandRange;

use change::{Changes, Phase, Settling};
pub use judge::Criterion;
pub(crate) use judge::judge;
pub use oscillation::Amplification;
use oscillation::Oscillation;

/// How far beyond the line between the lanes a crossing counts \[m\].
const CROSSING_MARGIN_M: f64 = 0.2;
/// How long a truck that has come back to its lane may take to find its centre \[ns\].
const CENTRING_NS: u64 = 10_000_000_000;
/// Slower than this a truck stands still \[m/s\].
const STANDSTILL_MPS: f64 = 0.05;

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
    /// The longest it took to settle after a change of the roster \[s\]; `None` when it did not
    /// before the next one.
    pub settled_after_change_s: Option<f64>,
    /// Its answer to every wave of a scripted leader.
    pub amplifications: Vec<Amplification>,
    /// Least gap to another truck \[m\]; `None` for a truck alone.
    pub min_truck_gap_m: Option<f64>,
    /// Least gap to another truck while this one stands still \[m\]; `None` when it never does.
    pub min_standstill_gap_m: Option<f64>,
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

/// The errors of truck `index`, which has this place.
pub(crate) fn errors(trucks: &[Truck], index: usize, place: &Place) -> Errors {
    let x_m = |i: usize| trucks[i].state().x_m;
    match place.place {
        0 => Errors::default(),
        _ => Errors {
            leader_m: x_m(place.leader) - x_m(index) - place.leader_distance_m,
            predecessor_m: x_m(place.predecessor) - x_m(index) - place.spacing_m,
        },
    }
}

/// The world at one base step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample<'a> {
    pub(crate) time_ns: u64,
    pub(crate) trucks: &'a [Truck],
    pub(crate) places: &'a [Place],
    pub(crate) commands: &'a [Command],
    pub(crate) obstacles: &'a [Obstacle],
}

/// The measurements of a run, growing with every sample.
#[derive(Debug, Clone)]
pub(crate) struct Metrics {
    /// The last speed of a scripted leader \[m/s\].
    scripted_mps: Option<f64>,
    changes: Changes,
    lane_line_m: f64,
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
    /// Whom it follows now, and who leads it; itself when it leads.
    predecessor: usize,
    leader: usize,
    settling: Settling,
    oscillations: Vec<Oscillation>,
    outside_position_ns: Option<u64>,
    outside_speed_ns: Option<u64>,
    outside_lateral_ns: Option<u64>,
    clearance_m: f64,
    gap_m: f64,
    standstill_gap_m: f64,
    left_of_line: Option<bool>,
    /// When it last came back to the side of the line it should be on.
    returned_ns: Option<u64>,
    /// Per obstacle: whether the truck was behind it when it appeared, and is ahead of it now.
    was_behind: [Option<bool>; OBSTACLES_MAX],
    is_ahead: [bool; OBSTACLES_MAX],
}

impl Metrics {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let leader = scenario.leader.as_ref();
        let waves: Vec<Wave> = leader.map_or(Vec::new(), |leader| leader.waves().collect());
        Self {
            scripted_mps: leader.map(|leader| leader.final_speed_mps(scenario.start(0).speed_mps)),
            changes: Changes::new(&scenario.events),
            lane_line_m: 0.5 * scenario.road.lane_width_m,
            position_band_m: scenario.criteria.settled_position_band_m,
            speed_band_mps: scenario.criteria.settled_speed_band_mps,
            lateral_band_m: scenario.criteria.settled_lateral_band_m,
            gauges: (0..scenario.platoon.trucks).map(|truck| Gauge::new(truck, &waves)).collect(),
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
        let phase = self.changes.phase(seen.time_ns);
        for index in 0..seen.trucks.len() {
            self.sample_motion(seen, index, phase);
            self.gauges[index].sample_obstacles(seen, &seen.trucks[index], &boxes[index]);
            for other in 0..index {
                self.sample_gap(seen.trucks, (index, other), boxes);
            }
        }
    }

    /// Every truck's result, given what its ECU asked for and how often it fell silent.
    pub(crate) fn results<'a>(
        &self,
        asked: impl Iterator<Item = (&'a CommandRange, u32)>,
    ) -> Vec<TruckResult> {
        let results = self.gauges.iter().zip(asked);
        let mut results: Vec<TruckResult> =
            results.map(|(gauge, asked)| gauge.finish(self.last_ns, asked)).collect();
        for (index, gauge) in self.gauges.iter().enumerate() {
            for wave in 0..gauge.oscillations.len() {
                let speed_mps = |truck: usize| results[truck].amplifications[wave].speed_mps;
                let over =
                    |truck: usize| (truck != index).then(|| speed_mps(index) / speed_mps(truck));
                let leader_ratio = over(gauge.leader);
                let ratio = over(gauge.predecessor).filter(|_| gauge.predecessor != gauge.leader);
                let own = &mut results[index].amplifications[wave];
                (own.leader_ratio, own.ratio) = (leader_ratio, ratio);
            }
        }
        results
    }

    fn sample_motion(&mut self, seen: &Sample, index: usize, phase: Phase) {
        let place = &seen.places[index];
        let Errors { leader_m, predecessor_m } = errors(seen.trucks, index, place);
        let (state, command) = (seen.trucks[index].state(), &seen.commands[index]);
        let scripted_mps = self.scripted_mps.filter(|_| place.leader == 0);
        let off_mps = state.forward_mps - scripted_mps.unwrap_or(place.speed_mps);
        let off_m = state.y_m - place.desired_y_m;
        let gauge = &mut self.gauges[index];
        let outside = [
            (&mut gauge.outside_position_ns, leader_m.abs() > self.position_band_m),
            (&mut gauge.outside_speed_ns, off_mps.abs() > self.speed_band_mps),
            (&mut gauge.outside_lateral_ns, off_m.abs() > self.lateral_band_m),
        ];
        let is_outside = outside.iter().any(|(_, is)| *is);
        for (last_ns, _) in outside.into_iter().filter(|(_, is)| *is) {
            *last_ns = Some(seen.time_ns);
        }
        (gauge.predecessor, gauge.leader) = (place.predecessor, place.leader);
        gauge.settling.sample(phase, is_outside);
        for oscillation in &mut gauge.oscillations {
            oscillation.sample(seen.time_ns as f64 * 1e-9, state.forward_mps);
        }
        let beyond_m = state.y_m - self.lane_line_m;
        gauge.sample_line(seen.time_ns, beyond_m, place.desired_y_m - self.lane_line_m);
        gauge.sample_centring(seen.time_ns, off_m);
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

    fn sample_gap(&mut self, trucks: &[Truck], pair: (usize, usize), boxes: &[Rectangle]) {
        let (one, other) = pair;
        let stands = |truck: usize| trucks[truck].state().forward_mps < STANDSTILL_MPS;
        let known_m = |gauge: &Gauge, truck| match stands(truck) {
            true => gauge.gap_m.max(gauge.standstill_gap_m),
            false => gauge.gap_m,
        };
        let known_m = known_m(&self.gauges[one], one).max(known_m(&self.gauges[other], other));
        if boxes[one].clearance_floor_m(&boxes[other]) >= known_m {
            return;
        }
        let gap_m = boxes[one].clearance_m(&boxes[other]);
        for truck in [one, other] {
            let gauge = &mut self.gauges[truck];
            gauge.gap_m = gauge.gap_m.min(gap_m);
            if stands(truck) {
                gauge.standstill_gap_m = gauge.standstill_gap_m.min(gap_m);
            }
        }
    }
}

impl Gauge {
    fn new(index: usize, waves: &[Wave]) -> Self {
        let result = TruckResult {
            index,
            min_y_m: f64::INFINITY,
            max_y_m: f64::NEG_INFINITY,
            ..TruckResult::default()
        };
        Self {
            result,
            predecessor: index,
            leader: index,
            settling: Settling::default(),
            oscillations: waves.iter().map(Oscillation::new).collect(),
            outside_position_ns: None,
            outside_speed_ns: None,
            outside_lateral_ns: None,
            clearance_m: f64::INFINITY,
            gap_m: f64::INFINITY,
            standstill_gap_m: f64::INFINITY,
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
        result.settled_after_change_s = self.settling.finish_s();
        result.amplifications = self.oscillations.iter().map(Oscillation::finish).collect();
        result.min_truck_gap_m = finite(self.gap_m);
        result.min_standstill_gap_m = finite(self.standstill_gap_m);
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
