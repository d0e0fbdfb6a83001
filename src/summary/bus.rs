//! The bus of a run: what it was, what it pretended to be, and whether a real one would do.

use std::collections::BTreeMap;

use bench_sim::rig::WireResult;
use platoon_dbc::MessageInfo;
use serde::{Deserialize, Serialize};

use crate::bus_plan::{BusFit, BusPlan};
use crate::cli::BusTimingKind;

use super::Ingredients;

/// The bus of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BusSummary {
    /// socketcan, udp or loopback.
    pub backend: String,
    /// Why this one.
    pub reason: String,
    /// Each truck's.
    pub interfaces: Vec<String>,
    /// How it carried messages: fd or j1939.
    pub profile: String,
    /// Bit rate of arbitration it was planned for \[bit/s\].
    pub bit_rate_hz: u64,
    /// Bit rate of the data phase; none for a profile of classic frames \[bit/s\].
    pub data_bit_rate_hz: Option<u64>,
    /// Whether frames took their time.
    pub timing: BusTimingKind,
    /// Worst-case share of each bus's time at these bit rates.
    pub load_percent: Vec<f64>,
    /// Whether all of it would fit a real bus: at most 80 % load, and every message through before
    /// the next of its kind is due.
    pub fits: bool,
    /// The slowest common bit rates at which it would fit, such as 500k/2M; none when there are
    /// none.
    pub fitting_rate: Option<String>,
    /// For every message the longest time from queueing to arrival at these bit rates, over all
    /// buses \[µs\]; none when it may wait for ever.
    pub response_us: BTreeMap<String, Option<f64>>,
    /// How long messages really took on emulated buses, most urgent first; empty on ideal ones.
    #[serde(default)]
    pub observed: Vec<Observed>,
    /// Frames lost because a queue of an emulated bus was full.
    #[serde(default)]
    pub overflowed: u64,
}

/// How long the frames of one message took on emulated buses, from queueing to arrival.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Observed {
    /// The message.
    pub message: String,
    /// Its identifier, in hexadecimal.
    pub id: String,
    /// Frames carried, on all buses.
    pub frames: u64,
    /// What 99 % of them kept on the slowest bus \[µs\].
    pub p99_us: f64,
    /// The longest on any bus \[µs\].
    pub max_us: f64,
    /// The longest it can take \[µs\]; none when there is no bound.
    pub bound_us: Option<f64>,
}

impl BusSummary {
    /// What is known of the bus of a run.
    pub(super) fn new(run: &Ingredients<'_>, wires: &[WireResult]) -> Self {
        let timing = run.profile.timing();
        let plan = BusPlan::of(run.scenario, run.profile, run.rate_hz, run.announces);
        let fit = plan.at(timing);
        let (backend, reason, interfaces) = run.bus.clone();
        Self {
            backend,
            reason,
            interfaces,
            profile: run.profile.to_string(),
            bit_rate_hz: timing.nominal_hz,
            data_bit_rate_hz: Some(timing.data_hz).filter(|_| plan.is_fd()),
            timing: run.bus_timing,
            fits: fit.fits,
            fitting_rate: plan.fitting_rate().map(|rates| rates.to_string()),
            response_us: fit
                .responses
                .iter()
                .map(|&(m, ns)| (m.name.into(), bound_us(ns)))
                .collect(),
            observed: observed(&fit, wires),
            overflowed: wires.iter().map(|wire| wire.overflowed).sum(),
            load_percent: fit.load_percent,
        }
    }
}

/// What the buses did to the messages of the plan.
fn observed(fit: &BusFit, wires: &[WireResult]) -> Vec<Observed> {
    let of_message = |&(message, bound_ns): &(&MessageInfo, Option<u64>)| {
        let mut seen = Observed {
            message: message.name.into(),
            id: format!("{:08X}", message.id),
            frames: 0,
            p99_us: 0.0,
            max_us: 0.0,
            bound_us: bound_us(bound_ns),
        };
        let identifiers = wires.iter().flat_map(|wire| &wire.identifiers);
        for told in identifiers.filter(|told| told.id == message.id) {
            seen.frames += told.frames;
            seen.p99_us = seen.p99_us.max(microseconds(told.p99_ns));
            seen.max_us = seen.max_us.max(microseconds(told.max_ns));
        }
        (seen.frames > 0).then_some(seen)
    };
    fit.responses.iter().filter_map(of_message).collect()
}

fn bound_us(bound_ns: Option<u64>) -> Option<f64> {
    bound_ns.map(microseconds)
}

fn microseconds(time_ns: u64) -> f64 {
    time_ns as f64 * 1e-3
}
