//! The upper-level coordination layer: delayed V2V states in, reference speed out [MCF, Eqs. 1-7].
//!
//! ```text
//! x_Hi = [ s0 - si - D_i0,  v0 - vi,  a0 - ai ],   D_i0 = i D at equal spacings      (Eq. 2)
//! u_i  = what the coordination law makes of x_Hi(t - lambda) and x_H(i-1)(t - lambda)
//! V_ref = min(speed + lead_time * u_i, v0 + margin)                                 (ours)
//! ```
//!
//! V_ref is a way to ask the motion layer for an acceleration, so it may be negative: cut off at 0
//! it would ask for less and less braking below 9 m/s, and a truck would stop metres too late.
//!
//! The law is a slot: the paper's gain ([`h_infinity`], Eq. 4), or one it is compared with.
//! Each is a file with one function from a [`Situation`] to an acceleration; adding one is adding a
//! file and a word. The leader has no error of its own: its reference is the mission's set speed.

mod cacc_path;
mod excitation;
mod feedforward;
mod h_infinity;
mod ploeg;

use nalgebra::Vector3;

use crate::calibration::{CoordinationLaw, DelayReading, UclCalibration};
use crate::decision::UclReport;
use crate::history::{Motion, seconds_between};
use crate::memory::Memory;
use crate::observation::Observation;

/// What a coordination law may know: delayed errors, and what the trucks ahead are doing.
#[derive(Debug, Clone, Copy)]
struct Situation {
    /// x_Hi: this truck's error state against the leader \[m, m/s, m/s²\].
    own: Vector3<f64>,
    /// x_H(i-1): the predecessor's; zero for truck 1 and when it is not heard.
    predecessor: Vector3<f64>,
    /// Acceleration of the leader \[m/s²\].
    leader_accel_mps2: f64,
    /// Acceleration that the truck ahead says it intends \[m/s²\].
    intended_ahead_mps2: f64,
    /// This truck's speed \[m/s\].
    speed_mps: f64,
    /// Its acceleration \[m/s²\].
    accel_mps2: f64,
    /// Speed of the platoon \[m/s\].
    set_speed_mps: f64,
    /// What the law asked for at the tick before \[m/s²\], and how long ago that was \[s\].
    asked_mps2: f64,
    elapsed_s: f64,
    /// Bench time now \[s\].
    time_s: f64,
}

impl Situation {
    /// The error state against the truck ahead: x_Hi - x_H(i-1).
    fn predecessor_error(&self) -> Vector3<f64> {
        self.own - self.predecessor
    }
}

/// The coordination layer's answer for this tick, `elapsed_s` after the one before.
///
/// Without a message of the leader there is nothing to coordinate with: the truck holds the
/// mission's set speed and the motion layer keeps it off whatever is ahead. Without one of the
/// predecessor, its error counts as zero.
pub fn coordinate(
    cal: &UclCalibration,
    memory: &Memory,
    seen: &Observation,
    elapsed_s: f64,
) -> UclReport {
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
    if mission.truck == 0 || cal.law == CoordinationLaw::None {
        return report;
    }

    report.x_own = error_state(&pair.leader, &pair.own, mission.leader_distance_m);
    if mission.truck > 1
        && let Some((leader, predecessor)) = pair.ahead
    {
        let slot_m = mission.leader_distance_m - mission.spacing_m;
        report.x_predecessor = error_state(&leader, &predecessor, slot_m);
    }

    let situation = Situation {
        own: report.x_own,
        predecessor: report.x_predecessor,
        leader_accel_mps2: pair.leader.accel_mps2,
        intended_ahead_mps2: seen.predecessor.map_or(0.0, |ahead| ahead.intended_accel_mps2),
        speed_mps: seen.ego.forward_mps,
        accel_mps2: seen.ego.accel_mps2,
        set_speed_mps: mission.set_speed_mps,
        asked_mps2: memory.asked_mps2,
        elapsed_s,
        time_s: 1e-9 * seen.time_ns as f64,
    };
    let u = match cal.law {
        CoordinationLaw::Published | CoordinationLaw::Synthesised => {
            h_infinity::accel_mps2(cal, &situation)
        }
        CoordinationLaw::Feedforward => feedforward::accel_mps2(cal, &situation),
        CoordinationLaw::CaccPath => cacc_path::accel_mps2(&situation),
        CoordinationLaw::Ploeg => ploeg::accel_mps2(&situation),
        CoordinationLaw::Excitation => excitation::accel_mps2(cal, &situation),
        CoordinationLaw::None => 0.0,
    };
    report.accel_mps2 = u.clamp(cal.accel_min_mps2, cal.accel_max_mps2);
    report.v_ref_mps = (seen.ego.forward_mps + cal.lead_time_s * report.accel_mps2)
        .min(pair.leader.speed_mps + cal.speed_margin_mps);
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
