//! What a trace tells, in the amounts a page can hold.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use traces::{Record, TRUCKS_MAX, TickRecord, Topic, TruckTruth, TruthRecord};

use super::bus_load::BusLoad;
use super::envelope::Envelopes;
use super::latency::Spread;
use super::timing_events::TickTimes;
use crate::failure::Failure;
use crate::process;
use crate::run_folder::FLOOR;
use crate::trace::Trace;

/// Time between two truths of a trace \[ns\].
const TRUTH_PERIOD_NS: u64 = 10_000_000;

/// A curve of every truck that the rig knows: its name, and its value.
type WorldCurve = (&'static str, fn(&TruckTruth) -> f64);
/// A curve of every ECU, likewise.
type EcuCurve = (&'static str, fn(&TickRecord) -> f64);

/// What the world shows of a truck.
pub const WORLD: [WorldCurve; 14] = [
    ("x_m", |truck| truck.x_m),
    ("y_m", |truck| truck.y_m),
    ("heading_rad", |truck| truck.heading_rad),
    ("speed_mps", |truck| truck.forward_mps),
    ("accel_mps2", |truck| truck.accel_forward_mps2),
    ("force_command_n", |truck| truck.force_command_n),
    ("force_n", |truck| truck.force_n),
    ("steering_command_rad", |truck| truck.steering_command_rad),
    ("steering_rad", |truck| truck.steering_rad),
    ("leader_error_m", |truck| truck.leader_error_m),
    ("predecessor_error_m", |truck| truck.predecessor_error_m),
    ("obstacle_clearance_m", |truck| truck.obstacle_clearance_m),
    ("leader_delay_s", |truck| truck.leader_delay_s),
    ("predecessor_delay_s", |truck| truck.predecessor_delay_s),
];

/// What an ECU shows of its ticks.
pub const ECU: [EcuCurve; 5] = [
    ("adaptive_weight", |tick| tick.adaptive_weight.into()),
    ("potential", |tick| tick.potential.into()),
    ("reference_mps", |tick| tick.reference_mps),
    ("qp_iterations", |tick| tick.qp_iterations.into()),
    ("total_us", |tick| 1e-3 * f64::from(tick.total_ns)),
];

/// The box of a truck around its centre of gravity \[m\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TruckBox {
    front_m: f64,
    rear_m: f64,
    width_m: f64,
}

/// An obstacle and, while it is on the road, where it is.
#[derive(Debug, Clone)]
pub struct Obstacle {
    /// Number in the scenario.
    pub number: u8,
    /// vehicle, pedestrian or bump.
    pub kind: String,
    /// Length of its box \[m\].
    pub length_m: f64,
    /// Width of its box \[m\].
    pub width_m: f64,
}

/// Curves of an obstacle, in the order in which they are kept.
pub const OBSTACLE: [&str; 3] = ["x_m", "y_m", "heading_rad"];

/// What a page tells of one run.
#[derive(Debug, Clone, Default)]
pub struct Story {
    /// What the run is called where there are two.
    pub name: String,
    /// `summary.json`; null when there is none.
    pub summary: Value,
    /// Metadata records of the trace.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// The scenario as run; null when it is not attached.
    pub scenario: Value,
    /// Wall clock of bench time 0 \[ns since 1970\]; 0 in virtual time.
    pub start_wall_ns: u64,
    /// Bench time of the last truth or tick \[s\].
    pub end_s: f64,
    /// The trucks' boxes.
    pub trucks: Vec<TruckBox>,
    /// The obstacles.
    pub obstacles: Vec<Obstacle>,
    /// [`WORLD`] of every truck, then [`OBSTACLE`] of every obstacle; none without a truth.
    pub world: Option<Envelopes>,
    /// [`ECU`] of every truck; none without a tick.
    pub ecus: Option<Envelopes>,
    /// [`BUS_LOAD`](super::bus_load::BUS_LOAD) of every bus; none without a trace.
    pub buses: Option<Envelopes>,
    /// Timing of every tick.
    pub times: Vec<TickTimes>,
    /// How late the machine woke a thread that did nothing else, beside the run; none in virtual
    /// time.
    pub floor: Option<Spread>,
    /// What could not be read, in words.
    pub loss: Option<String>,
}

impl Story {
    /// Reads a trace.
    ///
    /// # Errors
    /// When it cannot be read at all; damage further on is told in the story.
    pub fn read(trace: &Trace) -> Result<Self, Failure> {
        let mut story = Self {
            name: trace.path().display().to_string(),
            metadata: trace.metadata().clone(),
            scenario: scenario(trace),
            start_wall_ns: trace.start_wall_ns(),
            floor: floor(trace),
            ..Self::default()
        };
        let mut load = BusLoad::new(trace.profile().timing());
        let is_told = |topic| matches!(topic, Topic::Truth | Topic::Tick(_) | Topic::Frames(_));
        let mut events = trace.events(is_told, 0..u64::MAX)?;
        for event in &mut events {
            match event.record {
                Record::Truth(truth) => story.add_truth(&truth),
                Record::Tick(tick) => story.add_tick(&tick),
                Record::Frame(record) => load.add(record.bus, record.time_ns, &record.frame),
                _ => {}
            }
        }
        story.buses = Some(load.into_curves());
        story.loss = events.damage().map(|damage| format!("The trace is damaged: {damage}."));
        Ok(story)
    }

    fn add_truth(&mut self, truth: &TruthRecord) {
        if self.world.is_none() {
            self.set_stage(truth);
        }
        let Some(world) = &mut self.world else { return };
        let time_ns = truth.time_ns;
        self.end_s = self.end_s.max(1e-9 * time_ns as f64);
        for (index, truck) in truth.trucks.iter().take(self.trucks.len()).enumerate() {
            for (place, (_, value)) in WORLD.iter().enumerate() {
                world.add(index * WORLD.len() + place, time_ns, value(truck));
            }
        }
        let first = self.trucks.len() * WORLD.len();
        for (index, obstacle) in truth.obstacles.iter().enumerate().filter(|(_, o)| o.present) {
            let values = [obstacle.x_m, obstacle.y_m, obstacle.heading_rad];
            for (place, value) in values.into_iter().enumerate() {
                world.add(first + index * OBSTACLE.len() + place, time_ns, value);
            }
        }
    }

    /// Takes over who is there from the first truth.
    fn set_stage(&mut self, truth: &TruthRecord) {
        let shape = |truck: &TruckTruth| TruckBox {
            front_m: truck.front_m,
            rear_m: truck.rear_m,
            width_m: truck.width_m,
        };
        self.trucks = truth.trucks.iter().map(shape).collect();
        let obstacles = truth.obstacles.iter().map(|obstacle| Obstacle {
            number: obstacle.number,
            kind: format!("{:?}", obstacle.kind).to_lowercase(),
            length_m: obstacle.length_m,
            width_m: obstacle.width_m,
        });
        self.obstacles = obstacles.collect();
        let curves = self.trucks.len() * WORLD.len() + self.obstacles.len() * OBSTACLE.len();
        self.world = Some(Envelopes::new(curves, TRUTH_PERIOD_NS));
    }

    fn add_tick(&mut self, tick: &TickRecord) {
        let ecu = usize::from(tick.ecu);
        if ecu >= TRUCKS_MAX {
            return;
        }
        if self.times.len() <= ecu {
            self.times.resize(ecu + 1, TickTimes::default());
        }
        self.times[ecu].add(tick);
        self.end_s = self.end_s.max(1e-9 * tick.time_ns as f64);
        let rate_hz: Option<u64> =
            self.metadata.get("platoon.run").and_then(|run| run.get("rate_hz")?.parse().ok());
        let period_ns = 1_000_000_000 / rate_hz.unwrap_or(100).max(1);
        let curves = TRUCKS_MAX * ECU.len();
        let envelopes = self.ecus.get_or_insert_with(|| Envelopes::new(curves, period_ns));
        for (place, (_, value)) in ECU.iter().enumerate() {
            envelopes.add(ecu * ECU.len() + place, tick.time_ns, value(tick));
        }
    }
}

/// The machine's floor: attached, or, as with traces of older versions, beside the trace.
fn floor(trace: &Trace) -> Option<Spread> {
    let attached = trace.attached_text(FLOOR).and_then(|text| serde_json::from_str(text).ok());
    let beside = || process::read_json(&trace.path().with_file_name(FLOOR));
    Spread::of_cyclictest(&attached.or_else(beside)?)
}

/// The attached scenario, numbers and all.
fn scenario(trace: &Trace) -> Value {
    let text = trace.attached_text("scenario.toml");
    text.and_then(|text| toml::from_str(text).ok()).unwrap_or(Value::Null)
}
