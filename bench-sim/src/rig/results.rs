//! What a run came to, for the summary.

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
}

impl Results {
    /// Whether every criterion holds.
    pub fn passed(&self) -> bool {
        self.criteria.iter().all(|criterion| criterion.passed)
    }
}

impl Rig {
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
            trucks,
            criteria,
        }
    }
}
