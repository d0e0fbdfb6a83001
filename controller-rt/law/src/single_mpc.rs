//! The paper's baseline: one MPC without a coordination layer, leader-predecessor following.
//!
//! ```text
//! X_target = mean of the slots behind leader and predecessor,   V_target = mean of their speeds
//! cost: Eq. 21 with V_target, and Q_X (X_k - X_target(k))^2
//! ```
//!
//! Received states are taken as if they were of now, as the paper's baseline must, for it "doesn't
//! consider the robustness against time-varying communication delay"; extrapolating them is an
//! option. The paper prints neither Q_X nor the target; both are ours.

use crate::calibration::Calibration;
use crate::decision::UclReport;
use crate::history::{Motion, seconds_between};
use crate::memory::Memory;
use crate::observation::Observation;

/// The slot a truck of the baseline steers for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slot {
    /// Where it is now, along the road \[m\].
    pub x_m: f64,
    /// How fast it moves \[m/s\].
    pub speed_mps: f64,
    /// Weight Q_X \[1/m²\].
    pub weight: f64,
}

/// The slot, and a report in the words of the coordination layer; no slot for the leader and for a
/// truck that hears no leader, which hold the set speed.
pub fn aim(cal: &Calibration, memory: &Memory, seen: &Observation) -> (UclReport, Option<Slot>) {
    let mission = &seen.mission;
    let age = |message: Option<Motion>| {
        message.map_or(f64::NAN, |m| seconds_between(m.time_ns, seen.time_ns))
    };
    let (leader, predecessor) = (memory.leader.newest(), memory.predecessor.newest());
    let mut report = UclReport {
        v_ref_mps: mission.set_speed_mps,
        leader_age_s: age(leader),
        predecessor_age_s: age(predecessor),
        ..UclReport::default()
    };
    let Some(leader) = leader.filter(|_| mission.truck > 0) else {
        return (report, None);
    };
    let as_used = |m: Motion| match cal.single_mpc.compensated {
        true => m.extrapolated(seen.time_ns, cal.ucl.delay_bound_s),
        false => m,
    };
    let behind = |m: Motion, distance_m: f64| (m.x_m - distance_m, m.speed_mps);
    let of_leader = behind(as_used(leader), mission.leader_distance_m);
    let of_predecessor = predecessor.map_or(of_leader, |m| behind(as_used(m), mission.spacing_m));
    let slot = Slot {
        x_m: 0.5 * (of_leader.0 + of_predecessor.0),
        speed_mps: 0.5 * (of_leader.1 + of_predecessor.1),
        weight: cal.single_mpc.position_weight,
    };
    report.x_own.x = of_leader.0 - seen.ego.x_m;
    report.x_own.y = of_leader.1 - seen.ego.forward_mps;
    report.v_ref_mps = slot.speed_mps;
    (report, Some(slot))
}
