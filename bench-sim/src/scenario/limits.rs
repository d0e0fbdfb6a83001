//! What a scenario's numbers may be: a table of keys and ranges, and the rules between keys.
//!
//! The ranges are what the bench can represent and simulate, not what is sensible to drive.

use super::load::ScenarioError;
use super::{Course, Event, Model, Plant, Road, Scenario};
use crate::obstacle::Obstacle;
use crate::roster::Roster;
use crate::transition::PEAK_RATE;
use crate::truck::scripted::PHASES_MAX;
use crate::truck::two_track::FRICTION_PATCHES_MAX;

/// Most trucks of a platoon: what a recording has room for.
pub const TRUCKS_MAX: usize = 16;

/// Most obstacles of a scenario: as many as `platoon.dbc` has pages.
pub const OBSTACLES_MAX: usize = 8;

/// Fastest anything may go \[m/s\]; the messages carry up to 52 m/s.
const SPEED_MAX_MPS: f64 = 40.0;

/// Hardest any obstacle may brake or speed up \[m/s²\].
const ACCEL_MAX_MPS2: f64 = 10.0;

/// Furthest to the side anything may be \[m\].
const SIDE_MAX_M: f64 = 100.0;

/// Shortest V2V period \[s\]: how often an ECU broadcasts.
const V2V_PERIOD_MIN_S: f64 = 0.02;

/// Shortest distance between neighbours' CGs that can be asked for \[m\]: a truck is 7.7 m long.
const SPACING_MIN_M: f64 = 8.0;

/// Longest distance between neighbours' CGs that can be asked for \[m\].
const SPACING_MAX_M: f64 = 1000.0;

/// Fastest change of a distance that is asked for \[m/s\]: what the speed reference may exceed the
/// leader's by.
const SPACING_RATE_MAX_MPS: f64 = 4.0;

/// Least time for a change of distance or lane \[s\].
const CHANGE_MIN_S: f64 = 1.0;

/// Finds what is wrong with one scenario, naming the file, the key, the value and what is allowed.
pub(super) struct Checker<'a> {
    file: &'a str,
}

impl<'a> Checker<'a> {
    /// Checks a scenario read from `file` (a path, or a built-in's name).
    pub(super) fn new(file: &'a str) -> Self {
        Self { file }
    }

    /// Every rule, in the order of the file.
    pub(super) fn check(&self, s: &Scenario) -> Result<(), ScenarioError> {
        self.within("duration_s", s.duration_s, 0.1, 3600.0)?;
        self.check_platoon(s)?;
        self.check_leader(s)?;
        self.check_road(s)?;
        self.check_v2v(s)?;
        self.check_plant(s)?;
        self.within("sensors.noise", s.sensors.noise, 0.0, 100.0)?;
        self.within("sensors.range_m", s.sensors.range_m, 1.0, 500.0)?;
        self.within("sensors.behind_m", s.sensors.behind_m, 0.0, 500.0)?;
        self.check_trucks(s)?;
        self.check_obstacles(s)?;
        self.check_events(s)?;
        self.check_criteria(s)
    }

    fn check_platoon(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let p = &s.platoon;
        if !(1..=TRUCKS_MAX).contains(&p.trucks) {
            let allowed = format!("1 to {TRUCKS_MAX}");
            return Err(self.impossible("platoon.trucks", p.trucks, allowed));
        }
        self.within("platoon.spacing_m", p.spacing_m, SPACING_MIN_M, SPACING_MAX_M)?;
        self.within("platoon.speed_mps", p.speed_mps, 0.0, SPEED_MAX_MPS)?;
        self.within("platoon.desired_y_m", p.desired_y_m, -SIDE_MAX_M, SIDE_MAX_M)
    }

    fn check_leader(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let Some(leader) = &s.leader else { return Ok(()) };
        let count = leader.accelerations.len();
        if count > PHASES_MAX {
            let allowed = format!("at most {PHASES_MAX}");
            return Err(self.impossible("leader.accelerations", count, allowed));
        }
        for (index, stretch) in leader.accelerations.iter().enumerate() {
            let key = |field: &str| format!("leader.accelerations.{}.{field}", index + 1);
            self.within(&key("from_s"), stretch.from_s, 0.0, 3600.0)?;
            self.within(&key("until_s"), stretch.until_s, stretch.from_s + 1e-3, 3600.0)?;
            self.within(&key("accel_mps2"), stretch.accel_mps2, -10.0, 10.0)?;
            self.within(&key("periods"), f64::from(stretch.periods), 1.0, 1000.0)?;
            let flat = stretch.shape == Course::Constant;
            let longest_s = if flat { 0.5 * (stretch.until_s - stretch.from_s) } else { 0.0 };
            self.within(&key("rise_s"), stretch.rise_s, 0.0, longest_s)?;
        }
        Ok(())
    }

    fn check_road(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let r = &s.road;
        self.within("road.lane_width_m", r.lane_width_m, 2.0, 20.0)?;
        self.within("road.right_edge_y_m", r.right_edge_y_m, -SIDE_MAX_M, SIDE_MAX_M)?;
        let lowest_m = r.right_edge_y_m + r.lane_width_m;
        self.within("road.left_edge_y_m", r.left_edge_y_m, lowest_m, SIDE_MAX_M)
    }

    fn check_plant(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let (p, r) = (&s.plant, &s.road);
        self.within("plant.friction", p.friction, 0.05, 1.5)?;
        self.within("plant.power_max_w", p.power_max_w, 1e3, 1e7)?;
        self.within("plant.rear_cornering_scale", p.rear_cornering_scale, 0.2, 5.0)?;
        self.within("road.grade_percent", r.grade_percent, -30.0, 30.0)?;
        self.within("road.banking_percent", r.banking_percent, -30.0, 30.0)?;
        self.within("road.wind_x_mps", r.wind_x_mps, -40.0, 40.0)?;
        self.within("road.wind_y_mps", r.wind_y_mps, -40.0, 40.0)?;
        if r.friction_patches.len() > FRICTION_PATCHES_MAX {
            let allowed = format!("at most {FRICTION_PATCHES_MAX}");
            return Err(self.impossible(
                "road.friction_patches",
                r.friction_patches.len(),
                allowed,
            ));
        }
        for (index, patch) in r.friction_patches.iter().enumerate() {
            let key = |field: &str| format!("road.friction_patches.{}.{field}", index + 1);
            self.within(&key("from_x_m"), patch.from_x_m, -100_000.0, 100_000.0)?;
            self.within(&key("until_x_m"), patch.until_x_m, patch.from_x_m, 100_000.0)?;
            self.within(&key("friction"), patch.friction, 0.05, 1.5)?;
        }
        self.check_two_track_only(s)
    }

    /// Refuses what the plant chosen would silently ignore.
    fn check_two_track_only(&self, s: &Scenario) -> Result<(), ScenarioError> {
        if s.plant.model == Model::TwoTrack {
            return Ok(());
        }
        let plant = |p: &Plant| {
            [
                ("plant.power_max_w", p.power_max_w.to_string()),
                ("plant.driven_axles", format!("{:?}", p.driven_axles).to_lowercase()),
                ("plant.rear_cornering_scale", p.rear_cornering_scale.to_string()),
            ]
        };
        let road = |r: &Road| {
            [
                ("road.grade_percent", r.grade_percent.to_string()),
                ("road.banking_percent", r.banking_percent.to_string()),
                ("road.wind_x_mps", r.wind_x_mps.to_string()),
                ("road.wind_y_mps", r.wind_y_mps.to_string()),
                ("road.friction_patches", r.friction_patches.len().to_string()),
            ]
        };
        let set = plant(&s.plant).into_iter().chain(road(&s.road));
        let plain = plant(&Plant::default()).into_iter().chain(road(&Road::default()));
        match set.zip(plain).find(|((_, value), (_, plain))| value != plain) {
            None => Ok(()),
            Some(((key, value), (_, plain))) => {
                let allowed = format!("{plain}, unless plant.model is \"two-track\"");
                Err(self.impossible(key, value, allowed))
            }
        }
    }

    fn check_v2v(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let v = &s.v2v;
        self.within("v2v.delay_min_s", v.delay_min_s, 0.0, 5.0)?;
        self.within("v2v.delay_max_s", v.delay_max_s, v.delay_min_s, 5.0)?;
        // Below 1, so that no message overtakes an older one.
        self.within("v2v.delay_rate_max", v.delay_rate_max, 0.0, 0.95)?;
        self.within("v2v.period_s", v.period_s, V2V_PERIOD_MIN_S, 10.0)?;
        self.within("v2v.loss", v.loss, 0.0, 1.0)
    }

    fn check_trucks(&self, s: &Scenario) -> Result<(), ScenarioError> {
        for (name, truck) in &s.trucks {
            let known = name.parse().is_ok_and(|n: usize| n < s.platoon.trucks)
                && (name == "0" || !name.starts_with(['0', '+']));
            if !known {
                let allowed = format!("trucks.0 (the leader) to trucks.{}", s.platoon.trucks - 1);
                return Err(self.impossible("trucks", name, allowed));
            }
            if let Some(mass_kg) = truck.mass_kg {
                self.within(&format!("trucks.{name}.mass_kg"), mass_kg, 1000.0, 60_000.0)?;
            }
            if let Some(lag_s) = truck.drive_lag_s {
                self.within(&format!("trucks.{name}.drive_lag_s"), lag_s, 0.01, 5.0)?;
            }
            let starts = [
                ("start_x_m", truck.start_x_m, -100_000.0, 100_000.0),
                ("start_y_m", truck.start_y_m, -SIDE_MAX_M, SIDE_MAX_M),
                ("start_speed_mps", truck.start_speed_mps, 0.0, SPEED_MAX_MPS),
            ];
            for (field, value, low, high) in starts {
                if let Some(value) = value {
                    self.within(&format!("trucks.{name}.{field}"), value, low, high)?;
                }
            }
        }
        Ok(())
    }

    fn check_obstacles(&self, s: &Scenario) -> Result<(), ScenarioError> {
        if s.obstacles.len() > OBSTACLES_MAX {
            let allowed = format!("at most {OBSTACLES_MAX}");
            return Err(self.impossible("obstacles", s.obstacles.len(), allowed));
        }
        for (index, o) in s.obstacles.iter().enumerate() {
            let key = |field: &str| format!("obstacles.{}.{field}", index + 1);
            self.within(&key("x_m"), o.x_m, -100_000.0, 100_000.0)?;
            self.within(&key("y_m"), o.y_m, -SIDE_MAX_M, SIDE_MAX_M)?;
            self.within(&key("speed_mps"), o.speed_mps, -SPEED_MAX_MPS, SPEED_MAX_MPS)?;
            self.within(&key("appears_s"), o.appears_s, 0.0, 3600.0)?;
            self.within(&key("length_m"), o.length_m, 0.1, 30.0)?;
            self.within(&key("width_m"), o.width_m, 0.1, 10.0)?;
            self.check_lane_changes(o, key)?;
            self.check_speed_changes(o, key)?;
        }
        Ok(())
    }

    fn check_lane_changes(
        &self,
        obstacle: &Obstacle,
        key: impl Fn(&str) -> String,
    ) -> Result<(), ScenarioError> {
        let (mut y_m, mut free_s) = (obstacle.y_m, -3600.0);
        for (index, change) in obstacle.lane_change.iter().enumerate() {
            let key = |field: &str| key(&format!("lane_change.{}.{field}", index + 1));
            self.within(&key("to_y_m"), change.to_y_m, -SIDE_MAX_M, SIDE_MAX_M)?;
            self.within(&key("from_s"), change.from_s, free_s, 3600.0)?;
            // The messages carry up to 52 m/s.
            let shortest_s = PEAK_RATE * (change.to_y_m - y_m).abs() / SPEED_MAX_MPS;
            let earliest_s = change.from_s + shortest_s.max(0.1);
            self.within(&key("until_s"), change.until_s, earliest_s, 7200.0)?;
            (y_m, free_s) = (change.to_y_m, change.until_s);
        }
        Ok(())
    }

    fn check_speed_changes(
        &self,
        obstacle: &Obstacle,
        key: impl Fn(&str) -> String,
    ) -> Result<(), ScenarioError> {
        let (mut speed_mps, mut free_s) = (obstacle.speed_mps, 0.0);
        for (index, change) in obstacle.speed_change.iter().enumerate() {
            let key = |field: &str| key(&format!("speed_change.{}.{field}", index + 1));
            let to_mps = change.to_speed_mps;
            self.within(&key("to_speed_mps"), to_mps, -SPEED_MAX_MPS, SPEED_MAX_MPS)?;
            self.within(&key("from_s"), change.from_s, free_s, 3600.0)?;
            // Nothing on wheels brakes or accelerates harder than its tyres.
            let shortest_s = (to_mps - speed_mps).abs() / ACCEL_MAX_MPS2;
            let earliest_s = change.from_s + shortest_s.max(1e-3);
            self.within(&key("until_s"), change.until_s, earliest_s, 7200.0)?;
            (speed_mps, free_s) = (to_mps, change.until_s);
        }
        Ok(())
    }

    fn check_events(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let mut before_s = 0.0;
        for (index, event) in s.events.iter().enumerate() {
            let key = |field: &str| format!("events.{}.{field}", index + 1);
            // One after the end does nothing: a run may be shortened.
            self.within(&key("at_s"), event.at_s, before_s, 3600.0)?;
            before_s = event.at_s;
            self.check_event(s, event, key)?;
        }
        self.check_rosters(s)
    }

    fn check_event(
        &self,
        s: &Scenario,
        event: &Event,
        key: impl Fn(&str) -> String,
    ) -> Result<(), ScenarioError> {
        let last = s.platoon.trucks - 1;
        let first = usize::from(!s.has_ecu(0));
        if !(first..=last).contains(&event.truck) {
            let allowed = format!("{first} to {last}: the trucks that an ECU drives");
            return Err(self.impossible(&key("truck"), event.truck, allowed));
        }
        if let Some(ahead) = event.follows.filter(|&f| f > last || f == event.truck || event.leads)
        {
            let allowed = format!("another truck, 0 to {last}; none for a truck that leads");
            return Err(self.impossible(&key("follows"), ahead, allowed));
        }
        let numbers = [
            ("spacing_m", event.spacing_m, SPACING_MIN_M, SPACING_MAX_M),
            ("speed_mps", event.speed_mps, 0.0, SPEED_MAX_MPS),
            ("desired_y_m", event.desired_y_m, -SIDE_MAX_M, SIDE_MAX_M),
        ];
        for (field, value, low, high) in numbers {
            if let Some(value) = value {
                self.within(&key(field), value, low, high)?;
            }
        }
        // A truck cannot jump to another distance or lane; a set speed may.
        let jumps = event.at_s > 0.0 && (event.changes_distance() || event.desired_y_m.is_some());
        let least_s = if jumps { CHANGE_MIN_S } else { 0.0 };
        self.within(&key("over_s"), event.over_s, least_s, 3600.0)
    }

    /// Plays the events and refuses what no road can show.
    fn check_rosters(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let mut roster = Roster::new(s);
        for (index, event) in s.events.iter().enumerate() {
            let key = |field: &str| format!("events.{}.{field}", index + 1);
            let followed = roster.follows(event.truck);
            let asked_m = roster.place(event.truck, event.at_s).spacing_m;
            roster.apply(event, |_| 0.0);
            let follows = roster.follows(event.truck);
            if let Some(spacing_m) = event.spacing_m {
                if follows.is_none() {
                    let allowed = "none for a truck that follows nobody".to_owned();
                    return Err(self.impossible(&key("spacing_m"), spacing_m, allowed));
                }
                if follows == followed && event.at_s > 0.0 {
                    let change_m = (spacing_m - asked_m).abs();
                    let shortest_s = PEAK_RATE * change_m / SPACING_RATE_MAX_MPS;
                    self.within(&key("over_s"), event.over_s, shortest_s, 3600.0)?;
                }
            }
            // Trucks that change places do so by several events of one instant.
            if s.events.get(index + 1).is_none_or(|next| next.at_s > event.at_s) {
                self.check_roster(s.platoon.trucks, &roster, &key("follows"))?;
            }
        }
        Ok(())
    }

    /// Refuses circles, and two trucks in one slot.
    fn check_roster(&self, trucks: usize, roster: &Roster, key: &str) -> Result<(), ScenarioError> {
        for truck in 0..trucks {
            let Some(ahead) = roster.follows(truck) else { continue };
            let is_circle = (0..trucks).try_fold(truck, |at, _| roster.follows(at)).is_some();
            if is_circle {
                let allowed = format!("a truck that truck {truck} does not follow itself");
                return Err(self.impossible(key, ahead, allowed));
            }
            if (0..truck).any(|other| roster.follows(other) == Some(ahead)) {
                let allowed = "at most one truck behind each".to_owned();
                return Err(self.impossible(key, ahead, allowed));
            }
        }
        Ok(())
    }

    fn check_criteria(&self, s: &Scenario) -> Result<(), ScenarioError> {
        let c = &s.criteria;
        let limits = [
            ("max_predecessor_error_m", c.max_predecessor_error_m, 0.0),
            ("settled_position_s", c.settled_position_s, 0.0),
            ("settled_position_band_m", Some(c.settled_position_band_m), 0.0),
            ("settled_speed_s", c.settled_speed_s, 0.0),
            ("settled_speed_band_mps", Some(c.settled_speed_band_mps), 0.0),
            ("settled_lateral_s", c.settled_lateral_s, 0.0),
            ("settled_lateral_band_m", Some(c.settled_lateral_band_m), 0.0),
            ("settled_after_change_s", c.settled_after_change_s, 0.0),
            ("max_leader_amplification", c.max_leader_amplification, 0.0),
            ("max_amplification", c.max_amplification, 0.0),
            ("min_clearance_m", c.min_clearance_m, -1e6),
            ("min_truck_gap_m", c.min_truck_gap_m, -1e6),
            ("min_standstill_gap_m", c.min_standstill_gap_m, -1e6),
            ("max_steer_rad", c.max_steer_rad, 0.0),
            ("max_lateral_accel_mps2", c.max_lateral_accel_mps2, 0.0),
            ("min_y_m", c.min_y_m, -1e6),
            ("max_y_m", c.max_y_m, -1e6),
            ("max_off_centre_m", c.max_off_centre_m, 0.0),
            ("min_force_n", c.min_force_n, -1e6),
            ("max_force_n", c.max_force_n, -1e6),
            ("max_force_rate_nps", c.max_force_rate_nps, 0.0),
            ("max_steer_rate_radps", c.max_steer_rate_radps, 0.0),
        ];
        for (name, limit, lowest) in limits {
            if let Some(limit) = limit {
                self.within(&format!("criteria.{name}"), limit, lowest, 1e6)?;
            }
        }
        for &number in &c.passed_obstacles {
            if !(1..=s.obstacles.len()).contains(&number) {
                let allowed = format!("obstacles 1 to {}", s.obstacles.len());
                return Err(self.impossible("criteria.passed_obstacles", number, allowed));
            }
        }
        Ok(())
    }

    /// Refuses a number outside `[low, high]`, and anything that is not a number.
    fn within(&self, key: &str, value: f64, low: f64, high: f64) -> Result<(), ScenarioError> {
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(self.impossible(key, value, format!("{low} to {high}")))
    }

    fn impossible(&self, key: &str, value: impl ToString, allowed: String) -> ScenarioError {
        ScenarioError::Impossible {
            file: self.file.to_owned(),
            key: key.to_owned(),
            value: value.to_string(),
            allowed,
        }
    }
}
