//! The upper-level coordination layer: delayed V2V states in, reference speed out [MCF, Eqs. 1-7].
//!
//! ```text
//! x_Hi = [ s0 - si - i D,  v0 - vi,  a0 - ai ]                                      (Eq. 2)
//! u_i  = K1 x_Hi(t - lambda) + K2 x_H(i-1)(t - lambda)                              (Eq. 4)
//! V_ref = clip(speed + lead_time * u_i, 0, v0 + margin)                             (ours)
//! ```
//!
//! The gain is a table entry found offline; this file only applies it. The leader has no error of
//! its own: its reference is the mission's set speed.

use nalgebra::{RowVector3, Vector3};

use crate::calibration::{DelayReading, UclCalibration};
use crate::decision::UclReport;
use crate::history::{Motion, seconds_between};
use crate::memory::Memory;
use crate::observation::Observation;

/// The coordination layer's answer for this tick.
///
/// Without a message of the leader there is nothing to coordinate with: the truck holds the
/// mission's set speed and the motion layer keeps it off whatever is ahead. Without one of the
/// predecessor, K̄₂'s term is left out.
pub fn coordinate(cal: &UclCalibration, memory: &Memory, seen: &Observation) -> UclReport {
    let mission = &seen.mission;
    let age = |message: Option<Motion>| {
        message.map_or(f64::NAN, |m| seconds_between(m.time_ns, seen.time_ns))
    };
    let mut report = UclReport {
        v_ref_mps: mission.set_speed_mps,
        leader_age_s: age(memory.leader.newest()),
        predecessor_age_s: age(memory.predecessor.newest()),
        ..UclReport::default()
    };
    let Some(pair) = delayed_pair(cal, memory, seen) else {
        return report;
    };
    if mission.truck == 0 {
        return report;
    }

    let place = f64::from(mission.truck);
    report.x_own = error_state(&pair.leader, &pair.own, place * mission.spacing_m);
    if mission.truck > 1
        && let Some((leader, predecessor)) = pair.ahead
    {
        let slot = (place - 1.0) * mission.spacing_m;
        report.x_predecessor = error_state(&leader, &predecessor, slot);
    }

    let k1 = RowVector3::from(cal.k1);
    let k2 = RowVector3::from(cal.k2);
    let u = (k1 * report.x_own + k2 * report.x_predecessor).x;
    report.accel_mps2 = u.clamp(cal.accel_min_mps2, cal.accel_max_mps2);
    report.v_ref_mps = (seen.ego.forward_mps + cal.lead_time_s * report.accel_mps2)
        .clamp(0.0, (pair.leader.speed_mps + cal.speed_margin_mps).max(0.0));
    report
}

/// x_H of Eq. 2: the errors against the leader of a truck `distance_m` behind it.
fn error_state(leader: &Motion, truck: &Motion, distance_m: f64) -> Vector3<f64> {
    Vector3::new(
        leader.x_m - truck.x_m - distance_m,
        leader.speed_mps - truck.speed_mps,
        leader.accel_mps2 - truck.accel_mps2,
    )
}

/// The motions whose differences Eq. 4 forms, under one reading of its delays.
struct DelayedPair {
    own: Motion,
    leader: Motion,
    /// Leader and predecessor for the predecessor's error, when a predecessor is heard.
    ahead: Option<(Motion, Motion)>,
}

fn delayed_pair(cal: &UclCalibration, memory: &Memory, seen: &Observation) -> Option<DelayedPair> {
    let limit_s = cal.delay_bound_s;
    let now_ns = seen.time_ns;
    let leader = memory.leader.newest()?;
    let predecessor = memory.predecessor.newest();
    let own_now = memory.own.at(now_ns, limit_s)?;
    Some(match cal.delay_reading {
        // Both ends of each difference at the instant of the older message.
        DelayReading::Eq4 => DelayedPair {
            own: memory.own.at(leader.time_ns, limit_s)?,
            leader,
            ahead: predecessor.and_then(|predecessor| {
                let instant = leader.time_ns.min(predecessor.time_ns);
                Some((
                    memory.leader.at(instant, limit_s)?,
                    memory.predecessor.at(instant, limit_s)?,
                ))
            }),
        },
        DelayReading::LeaderStale => DelayedPair {
            own: own_now,
            leader,
            ahead: predecessor.map(|predecessor| (leader, predecessor)),
        },
        DelayReading::FrameStale => {
            // Positions relative to a frame at the set speed: a stale one lags only by the
            // difference from that speed.
            let carried = |m: Motion| Motion {
                x_m: m.x_m + seen.mission.set_speed_mps * seconds_between(m.time_ns, now_ns),
                ..m
            };
            DelayedPair {
                own: own_now,
                leader: carried(leader),
                ahead: predecessor.map(|p| (carried(leader), carried(p))),
            }
        }
        DelayReading::Compensated => {
            let now = |m: Motion| m.extrapolated(now_ns, limit_s);
            DelayedPair {
                own: own_now,
                leader: now(leader),
                ahead: predecessor.map(|p| (now(leader), now(p))),
            }
        }
    })
}

#[cfg(test)]
#[path = "ucl/tests.rs"]
mod tests;
