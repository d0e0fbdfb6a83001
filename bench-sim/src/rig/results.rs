//! What a run came to, for the summary.

use platoon_dbc::bus_time::Urgency;
use platoon_dbc::{Bus, Queueing};
use serde::{Deserialize, Serialize};

use super::Rig;
use crate::channel::ChannelReport;
use crate::metrics::{Criterion, TruckResult, judge};
use crate::truck_node::NodeCounts;

/// A run as the rig saw it. What only the ECUs know (QP failures, deadlines) is added by whoever
/// reads their records.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Results {
    /// The scenario's name.
    pub scenario: String,
    /// The seed.
    pub seed: u64,
    /// Bench time reached \[s\].
    pub duration_s: f64,
    /// Every truck, leader first.
    pub trucks: Vec<TruckResult>,
    /// The delays and losses the V2V channel really produced.
    pub v2v: ChannelReport,
    /// Every criterion the rig can judge.
    pub criteria: Vec<Criterion>,
    /// What happened on every truck's bus.
    pub nodes: Vec<NodeCounts>,
    /// How the traffic of every truck fared on its emulated bus; empty when none is emulated.
    #[serde(default)]
    pub wires: Vec<WireResult>,
}

/// What an emulated bus did to its traffic.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WireResult {
    /// Every identifier carried, most urgent first.
    pub identifiers: Vec<IdentifierResult>,
    /// Frames lost because a queue was full.
    pub overflowed: u64,
}

/// How long the frames of one identifier took on an emulated bus, from queueing to arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentifierResult {
    /// The identifier, without flags.
    pub id: u32,
    /// Frames carried.
    pub frames: u64,
    /// What 99 % of them kept \[ns\].
    pub p99_ns: u64,
    /// The longest \[ns\].
    pub max_ns: u64,
}

impl WireResult {
    fn of(bus: &dyn Bus) -> Self {
        let identifier = |queueing: &Queueing| IdentifierResult {
            id: queueing.id,
            frames: queueing.frames(),
            p99_ns: queueing.p99_ns(),
            max_ns: queueing.max_ns(),
        };
        let mut told: Vec<&Queueing> = bus.queueing().iter().collect();
        told.sort_by_key(|queueing| Urgency::of_id(queueing.id, queueing.is_extended));
        let counts = bus.counts();
        Self {
            identifiers: told.into_iter().map(identifier).collect(),
            overflowed: counts.send_full + counts.receive_overflow,
        }
    }
}

impl Results {
    /// Whether every criterion holds.
    pub fn passed(&self) -> bool {
        self.criteria.iter().all(|criterion| criterion.passed)
    }
}

impl Rig {
    fn wires(&self) -> Vec<WireResult> {
        let wires: Vec<WireResult> =
            self.nodes.iter().map(|node| WireResult::of(node.bus())).collect();
        let is_emulated = wires.iter().any(|wire| !wire.identifiers.is_empty());
        if is_emulated { wires } else { Vec::new() }
    }

    /// What the run came to so far. A run that has not reached its end fails the first criterion.
    pub fn results(&self) -> Results {
        let trucks = self
            .metrics
            .results(self.nodes.iter().map(|node| (node.watch.range(), node.counts.lost_commands)));
        let duration_s = self.time_ns() as f64 * 1e-9;
        let limit_s = self.scenario.duration_s;
        let complete = Criterion {
            name: "duration_s".to_owned(),
            limit: limit_s,
            value: Some(duration_s),
            passed: self.finished(),
        };
        let mut criteria = vec![complete];
        criteria.extend(judge(&self.scenario.criteria, &trucks));
        Results {
            scenario: self.scenario.name.clone(),
            seed: self.seed,
            duration_s,
            v2v: self.channel.report(),
            nodes: self.nodes.iter().map(|node| node.counts).collect(),
            wires: self.wires(),
            trucks,
            criteria,
        }
    }
}
