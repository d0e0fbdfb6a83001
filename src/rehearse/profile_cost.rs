//! What a profile's rates and resolutions cost: the run against its twin on CAN FD.
//!
//! The twin has the same scenario, seed, law and loop rate, and runs in virtual time with ideal
//! buses. What differs is the profile, the time that an emulated bus takes, and, for a run in real
//! time, what the machine added.

use bench_sim::TruckResult;
use platoon_dbc::Profile;
use serde::{Deserialize, Serialize};
use traces::{Reader, Record, Topic, TruthRecord};

use super::{Plan, virtual_time};
use crate::failure::Failure;
use crate::run_folder::RunFolder;

/// What a profile costs against CAN FD.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProfileCost {
    /// The profile compared with: fd.
    pub against: String,
    /// Every truck, leader first.
    pub trucks: Vec<TruckCost>,
}

/// What it costs one truck. Positive is worse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruckCost {
    /// Its place, 0 is the leader.
    pub index: usize,
    /// Furthest it was from where it would have been at the same time \[m\].
    pub max_distance_m: f64,
    /// How much larger its largest |distance error to the leader| is \[m\].
    pub leader_error_m: f64,
    /// How much larger its largest |distance error to the truck ahead| is \[m\].
    pub predecessor_error_m: f64,
    /// How much smaller its least clearance to an obstacle is \[m\]; `None` without obstacles.
    pub clearance_m: Option<f64>,
}

/// Runs the twin and compares; `None` for a run on CAN FD itself.
///
/// # Errors
/// When the twin cannot run or the run's trace cannot be read.
pub(super) fn measure(
    plan: &Plan<'_>,
    folder: &RunFolder,
    trucks: &[TruckResult],
) -> Result<Option<ProfileCost>, Failure> {
    if plan.args.run.profile == Profile::Fd || trucks.is_empty() {
        return Ok(None);
    }
    let twin = virtual_time::twin(plan)?;
    let distances_m = distances(folder, &twin.truth)?;
    let cost = |(ours, fd): (&TruckResult, &TruckResult)| TruckCost {
        index: ours.index,
        max_distance_m: distances_m.get(ours.index).copied().unwrap_or_default(),
        leader_error_m: ours.max_abs_leader_error_m - fd.max_abs_leader_error_m,
        predecessor_error_m: ours.max_abs_predecessor_error_m - fd.max_abs_predecessor_error_m,
        clearance_m: fd
            .min_obstacle_clearance_m
            .zip(ours.min_obstacle_clearance_m)
            .map(|(fd_m, ours_m)| fd_m - ours_m),
    };
    let trucks = trucks.iter().zip(&twin.results.trucks).map(cost).collect();
    Ok(Some(ProfileCost { against: Profile::Fd.word().into(), trucks }))
}

/// The largest distance of each truck, in the recorded run, from where it was in the twin \[m\].
fn distances(folder: &RunFolder, twin: &[TruthRecord]) -> Result<Vec<f64>, Failure> {
    let reader = Reader::open(&folder.trace()).map_err(Failure::cannot_start)?;
    let mut largest_m = Vec::new();
    // Both are in the order of time; a record of the one that the other lacks is passed over.
    let mut twin = twin.iter().peekable();
    for message in reader.with_topics([Topic::Truth.to_string()]) {
        let Ok(Record::Truth(ours)) = message.record() else {
            continue;
        };
        while twin.next_if(|other| other.time_ns < ours.time_ns).is_some() {}
        let Some(other) = twin.next_if(|other| other.time_ns == ours.time_ns) else {
            continue;
        };
        largest_m.resize(ours.trucks.len(), 0.0);
        let pairs = ours.trucks.iter().zip(other.trucks.iter());
        for (largest_m, (a, b)) in largest_m.iter_mut().zip(pairs) {
            *largest_m = f64::max(*largest_m, f64::hypot(a.x_m - b.x_m, a.y_m - b.y_m));
        }
    }
    Ok(largest_m)
}
