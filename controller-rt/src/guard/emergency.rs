//! The emergency layer: brakes when an object ahead asks for more deceleration than is left to the
//! law, whatever the law plans.
//!
//! ```text
//! closing speed c = u - v, object ahead at speed v braking with a, brakes that take t to bite
//! room d = gap - 2 m - max(c, 0) t
//!
//! it stops before the truck is there (2 d a >= v c):  a_req = u² / (2 (d + v² / 2a))
//! it still moves then:                                a_req = a + c² / (2 d)
//! ```
//!
//! The two agree where they meet. They are the cases of the CAMP project's crash alert (Kiefer et
//! al., *Development and Validation of Functional Definitions and Evaluation Procedures for
//! Collision Warning/Avoidance Systems*, DOT HS 808 964, 1999). Above [`TRIGGER_MPS2`], with paths
//! that overlap, the truck brakes with [`SURPLUS`] times a_req on the law's steering, until a_req
//! has fallen below [`RELEASE_MPS2`] or the paths have parted. Then it waits until there is
//! [`WAITING_M`] of room to drive into: it must not be pushed into what it stopped for.
//!
//! Whether an object is in the way is judged by how the truck really moves across the road, not by
//! what the law intends: a truck that is swerving has the yaw rate for it.

use serde::{Deserialize, Serialize};

use super::track::{Object, Track};
use super::{MASS_KG, OwnMotion, STANDSTILL_MPS};

/// Required deceleration from which the layer brakes \[m/s²\]: about 60 % of what dry brakes give.
pub const TRIGGER_MPS2: f64 = 3.5;
/// Required deceleration below which it lets go \[m/s²\].
pub const RELEASE_MPS2: f64 = 0.3;
/// Braking in proportion to what is required: what the brakes' lag loses is made up.
pub const SURPLUS: f64 = 1.2;
/// Hardest braking \[m/s²\]: what the law's least force gives the nominal truck.
pub const BRAKING_MAX_MPS2: f64 = 5.9;
/// Distance to be left when both stand \[m\].
pub const STANDOFF_M: f64 = 2.0;
/// Least room that required deceleration is computed with, as a share of the gap: a truck that is
/// nearer than [`STANDOFF_M`] may still move up, the slower the nearer.
const ROOM_SHARE_MIN: f64 = 0.1;
/// A truck that braked waits until what is in its way is this far ahead \[m\]: nearer, there is no
/// room to drive round it.
pub const WAITING_M: f64 = 4.0;
/// Braking of a truck that waits \[m/s²\], until it stands.
const WAITING_BRAKING_MPS2: f64 = 1.0;
/// What the brakes take to bite \[s\]: half the ramp to 4 m/s² at the guard's rate, and their lag.
const BITE_S: f64 = 0.4;
/// Space beside an object that still counts as its path \[m\]; more once the layer brakes, so that
/// it does not let go on the edge.
const BESIDE_M: f64 = 0.2;
/// As [`BESIDE_M`], while the layer brakes.
const BESIDE_BRAKING_M: f64 = 0.5;
/// For how long the truck's present lateral acceleration is believed to last \[s\]: the first half
/// of a lane change.
const SWERVE_S: f64 = 0.8;
/// For how long an object's present lateral speed is believed to last \[s\]: lane changes end.
const DRIFT_S: f64 = 1.0;
/// Furthest ahead paths are compared \[s\].
const LOOK_AHEAD_S: f64 = 4.0;
/// From the CG to the front bumper \[m\].
const FRONT_M: f64 = 2.31;
/// Half the truck's width \[m\].
const HALF_WIDTH_M: f64 = 1.25;
/// Objects kept track of: as many as `platoon.dbc` has pages.
pub const PAGES: usize = 8;

/// The layer's memory.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Emergency {
    tracks: [Option<Track>; PAGES],
    /// Deceleration asked for while it brakes \[m/s²\].
    asked_mps2: Option<f64>,
    triggers: u32,
    is_off: bool,
}

impl Emergency {
    /// A layer that never brakes, to see what the law does alone.
    pub(super) fn off() -> Self {
        Self { is_off: true, ..Self::default() }
    }

    /// How often it began to brake.
    pub(super) const fn triggers(&self) -> u32 {
        self.triggers
    }

    /// Whether it brakes.
    pub(super) const fn is_braking(&self) -> bool {
        self.asked_mps2.is_some()
    }

    /// The force it asks for \[N\], if it brakes, given what is seen on each page at `now_ns`.
    ///
    /// A truck that has lost its place goes on braking as it did.
    pub(super) fn force_n(
        &mut self,
        now_ns: u64,
        own: &OwnMotion,
        objects: &[Option<Object>; PAGES],
    ) -> Option<f64> {
        if self.is_off {
            return None;
        }
        self.watch(objects);
        if own.trusted {
            self.assess(now_ns, own);
        }
        let fade = (own.forward_mps / STANDSTILL_MPS).clamp(0.0, 1.0);
        self.asked_mps2.map(|asked_mps2| -MASS_KG * asked_mps2 * fade)
    }

    fn watch(&mut self, objects: &[Option<Object>; PAGES]) {
        for (place, object) in self.tracks.iter_mut().zip(objects) {
            match (place.as_mut(), object) {
                (Some(track), Some(object)) => track.note(object),
                _ => *place = object.map(Track::new),
            }
        }
    }

    /// Finds what the objects in the way require, and begins, goes on or ends to brake.
    fn assess(&mut self, now_ns: u64, own: &OwnMotion) {
        let (was_braking, mut required_mps2, mut waits) = (self.is_braking(), 0.0_f64, false);
        let beside_m = if was_braking { BESIDE_BRAKING_M } else { BESIDE_M };
        for track in self.tracks.iter().flatten() {
            let Some(ahead) = Ahead::new(track, now_ns, own) else { continue };
            let reach_m = HALF_WIDTH_M + ahead.half_width_m + beside_m;
            if ahead.offset_m(own).abs() < reach_m {
                required_mps2 = required_mps2.max(ahead.required_mps2(own.forward_mps));
                waits |= was_braking && ahead.gap_m < WAITING_M;
            }
        }
        let threshold_mps2 = if was_braking { RELEASE_MPS2 } else { TRIGGER_MPS2 };
        let brakes = required_mps2 > threshold_mps2 || waits;
        self.triggers += u32::from(brakes && !was_braking);
        let least_mps2 = if waits { WAITING_BRAKING_MPS2 } else { 0.0 };
        let asked_mps2 = (SURPLUS * required_mps2).clamp(least_mps2, BRAKING_MAX_MPS2);
        self.asked_mps2 = brakes.then_some(asked_mps2);
    }
}

/// An object ahead of the front bumper, as it is now.
#[derive(Debug, Clone, Copy)]
struct Ahead {
    /// From the front bumper to its rear \[m\].
    gap_m: f64,
    /// Its centre to the left of the CG \[m\].
    left_m: f64,
    half_width_m: f64,
    forward_mps: f64,
    left_mps: f64,
    braking_mps2: f64,
}

impl Ahead {
    /// `None` when it is abreast or behind.
    fn new(track: &Track, now_ns: u64, own: &OwnMotion) -> Option<Self> {
        let seen = &track.seen;
        let age_s = now_ns.saturating_sub(seen.measured_ns) as f64 * 1e-9;
        let own_age_s = now_ns.saturating_sub(own.time_ns) as f64 * 1e-9;
        let front_m = own.x_m + own.forward_mps * own_age_s + FRONT_M;
        let gap_m = seen.x_m + seen.x_mps * age_s - seen.half_length_m - front_m;
        let left_m = seen.y_m + seen.y_mps * age_s - own.y_m - own.left_mps * own_age_s;
        (gap_m > 0.0).then_some(Self {
            gap_m,
            left_m,
            half_width_m: seen.half_width_m,
            forward_mps: seen.x_mps,
            left_mps: seen.y_mps,
            braking_mps2: track.braking_mps2(),
        })
    }

    /// The deceleration that stops the truck behind it \[m/s²\].
    fn required_mps2(&self, own_mps: f64) -> f64 {
        let (ahead_mps, braking_mps2) = (self.forward_mps, self.braking_mps2);
        let closing_mps = own_mps - ahead_mps;
        let bite_m = closing_mps.max(0.0) * BITE_S;
        let room_m = (self.gap_m - STANDOFF_M - bite_m).max(ROOM_SHARE_MIN * self.gap_m);
        if braking_mps2 > 0.0 && 2.0 * room_m * braking_mps2 >= ahead_mps * closing_mps {
            let stop_m = ahead_mps * ahead_mps / (2.0 * braking_mps2);
            own_mps * own_mps / (2.0 * (room_m + stop_m))
        } else {
            let closing_mps = closing_mps.max(0.0);
            braking_mps2 + closing_mps * closing_mps / (2.0 * room_m)
        }
    }

    /// How far to the truck's left its centre will be when the truck is there \[m\].
    fn offset_m(&self, own: &OwnMotion) -> f64 {
        let time_s = self.contact_s(own.forward_mps).min(LOOK_AHEAD_S);
        let swerve_s = time_s.min(SWERVE_S);
        let own_m = own.left_mps * time_s + own.left_mps2 * swerve_s * (time_s - 0.5 * swerve_s);
        self.left_m + self.left_mps * time_s.min(DRIFT_S) - own_m
    }

    /// When the truck would be at its rear if it did not brake \[s\]; infinite when never.
    fn contact_s(&self, own_mps: f64) -> f64 {
        let (closing_mps, braking_mps2) = (own_mps - self.forward_mps, self.braking_mps2);
        if braking_mps2 <= 0.0 {
            return if closing_mps > 0.0 { self.gap_m / closing_mps } else { f64::INFINITY };
        }
        let reached = (closing_mps * closing_mps + 2.0 * braking_mps2 * self.gap_m).sqrt();
        let moving_s = (reached - closing_mps) / braking_mps2;
        let stop_s = self.forward_mps / braking_mps2;
        if moving_s <= stop_s {
            return moving_s;
        }
        let stop_m = 0.5 * self.forward_mps * stop_s;
        if own_mps > 0.0 { (self.gap_m + stop_m) / own_mps } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests;
