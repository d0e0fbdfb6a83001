//! The guard: a second opinion on every command, with its own limits and its own constants.
//!
//! It knows nothing of the law's calibration, so a wrong number there cannot raise a limit here.
//! Its limits lie a little outside those the law plans with: in a healthy run it changes nothing.
//! It also decides what is sent when there is nothing to trust. In the order of severity:
//! 1. Range of force and steering, lateral acceleration at the present speed, rates over the true
//!    elapsed time: the command is limited.
//! 2. No usable command (not a number, or the truck does not know where it is): the last trusted
//!    command is held for [`HOLD_NS`], then straight and coasting until [`COAST_END_NS`], then
//!    straight and braking, as the rig does with a truck whose ECU fell silent.
//! 3. No solved plan for [`NO_PLAN_NS`]: brake, on the steering of the shifted plan. Straightening
//!    in the middle of a lane change would leave the lane; the truck still knows where it is.
//! 4. An object ahead that only hard braking avoids: [`emergency`] braking, on the plan's steering.

pub mod emergency;
mod track;

use emergency::{Emergency, PAGES};
pub use track::Object;

use serde::{Deserialize, Serialize};

/// Least force \[N\]: 0.64 g of 5760 kg, what dry brakes give; the law plans with -34 kN.
pub const FORCE_MIN_N: f64 = -36_000.0;
/// Largest force \[N\]; the law plans with 20 kN.
pub const FORCE_MAX_N: f64 = 22_000.0;
/// Fastest change of force \[N/s\]; the law plans with 57.6 kN/s.
pub const FORCE_RATE_NPS: f64 = 62_000.0;
/// Largest steering angle \[rad\], a little over 10°; the law plans with 10°.
pub const STEERING_MAX_RAD: f64 = 0.18;
/// Fastest change of steering \[rad/s\]; the law plans with 0.30.
pub const STEERING_RATE_RADPS: f64 = 0.33;
/// Largest lateral acceleration a steering angle may lead to \[m/s²\]: about 0.4 g, the static
/// rollover threshold of a loaded truck (Winkler and Ervin, UMTRI-99-19). The law plans with 3.
pub const LATERAL_ACCEL_MAX_MPS2: f64 = 4.0;
/// Wheelbase \[m\]: the paper's l_f + l_r.
const WHEELBASE_M: f64 = 5.0;
/// Understeer gradient \[rad s²/m\] of the paper's truck, from its Table II:
/// m (l_r C_r - l_f C_f) / (C_f C_r L).
const UNDERSTEER_RADPS2PM: f64 = 0.012_3;
/// Mass that turns a deceleration into a braking force \[kg\].
const MASS_KG: f64 = 5760.0;
/// Deceleration of the last resort \[m/s²\].
pub const BRAKE_MPS2: f64 = 4.0;
/// Below this speed \[m/s\] braking fades out, so that a standing truck is not pushed backwards.
const STANDSTILL_MPS: f64 = 0.5;

/// How long the last trusted command is held \[ns\]: a few lost messages at 100 Hz.
pub const HOLD_NS: u64 = 100_000_000;
/// When coasting ends and braking begins, counted from the last trusted command \[ns\].
pub const COAST_END_NS: u64 = 300_000_000;
/// How long shifted plans may be driven without one being solved \[ns\]: two blocks of the horizon.
pub const NO_PLAN_NS: u64 = 200_000_000;
/// And how many solves in a row must have failed by then, so that a pause alone is not a failure.
pub const NO_PLAN_TICKS: u32 = 3;
/// Rates count at most this much elapsed time \[ns\]: after longer gaps the actuators have already
/// left the last command.
const ELAPSED_MAX_NS: u64 = 100_000_000;

/// What the controller proposes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proposal {
    /// Longitudinal force \[N\], positive forward.
    pub force_n: f64,
    /// Front-wheel steering angle \[rad\], positive to the left.
    pub steering_rad: f64,
    /// What stands behind it.
    pub plan: Plan,
}

/// What stands behind a proposal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plan {
    /// A plan solved at this tick.
    Solved,
    /// No solve was due at this tick.
    Held,
    /// The solve failed; a shifted older plan.
    Shifted,
}

/// What the truck knows about its own motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OwnMotion {
    /// Whether the navigation solution is recent and declared usable.
    pub trusted: bool,
    /// When the newest navigation solution was valid \[ns\].
    pub time_ns: u64,
    /// CG position along the road \[m\].
    pub x_m: f64,
    /// CG position across the road \[m\].
    pub y_m: f64,
    /// Newest forward speed \[m/s\].
    pub forward_mps: f64,
    /// Speed across the road \[m/s\], positive to the left.
    pub left_mps: f64,
    /// Acceleration across the truck \[m/s²\], positive to the left.
    pub left_mps2: f64,
}

/// Why the guard changed a command, most severe last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Reason {
    /// It passed unchanged.
    #[default]
    Passed,
    /// It changed faster than the actuators may.
    Rate,
    /// The force left its range.
    Force,
    /// The steering left its range.
    Steering,
    /// The steering would lead to too much lateral acceleration at this speed.
    LateralAccel,
    /// An object ahead requires harder braking than was asked for.
    Emergency,
    /// Too long without a solved plan.
    NoPlan,
    /// It was not a number.
    NotFinite,
    /// The truck's own navigation solution is stale or lost.
    EgoStale,
}

impl Reason {
    /// All reasons, in the order of their numbers.
    pub const ALL: [Self; 9] = [
        Self::Passed,
        Self::Rate,
        Self::Force,
        Self::Steering,
        Self::LateralAccel,
        Self::Emergency,
        Self::NoPlan,
        Self::NotFinite,
        Self::EgoStale,
    ];

    /// Its name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Rate => "rate",
            Self::Force => "force",
            Self::Steering => "steering",
            Self::LateralAccel => "lateral_accel",
            Self::Emergency => "emergency",
            Self::NoPlan => "no_plan",
            Self::NotFinite => "not_finite",
            Self::EgoStale => "ego_stale",
        }
    }

    /// Whether the command sent is the guard's own and not a limited proposal.
    #[must_use]
    pub fn replaces(self) -> bool {
        self >= Self::Emergency
    }
}

/// What may be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Admitted {
    /// Longitudinal force \[N\].
    pub force_n: f64,
    /// Front-wheel steering angle \[rad\].
    pub steering_rad: f64,
    /// What was changed.
    pub reason: Reason,
}

/// The guard's memory.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Guard {
    force_n: f64,
    steering_rad: f64,
    /// The last trusted command, held for a while when nothing can be trusted.
    trusted_force_n: f64,
    trusted_steering_rad: f64,
    admitted_ns: Option<u64>,
    trusted_ns: Option<u64>,
    solved_ns: Option<u64>,
    unsolved_ticks: u32,
    emergency: Emergency,
}

impl Guard {
    /// A guard that has sent nothing yet: its first command counts as following zero.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The same guard without its emergency layer.
    #[must_use]
    pub fn without_emergency_braking(self) -> Self {
        Self { emergency: Emergency::off(), ..self }
    }

    /// How often the emergency layer began to brake.
    #[must_use]
    pub const fn emergency_brakings(&self) -> u32 {
        self.emergency.triggers()
    }

    /// Turns a proposal into what may be sent at bench time `now_ns`, given the objects seen, by
    /// page.
    ///
    /// No proposal stands for a tick at which the controller could not be asked.
    pub fn admit(
        &mut self,
        now_ns: u64,
        proposal: Option<Proposal>,
        own: OwnMotion,
        objects: &[Option<Object>; PAGES],
    ) -> Admitted {
        let forward_mps = if own.forward_mps.is_finite() { own.forward_mps } else { 0.0 };
        let usable = match proposal {
            _ if !own.trusted => Err(Reason::EgoStale),
            None => Err(Reason::EgoStale),
            Some(p) if !(p.force_n.is_finite() && p.steering_rad.is_finite()) => {
                Err(Reason::NotFinite)
            }
            Some(p) => Ok(p),
        };
        let (wish, replaced) = match usable {
            Ok(p) if self.plan_is_missing(now_ns, p.plan) => {
                ((brake_force_n(forward_mps), p.steering_rad), Reason::NoPlan)
            }
            Ok(p) => ((p.force_n, p.steering_rad), Reason::Passed),
            Err(reason) => (self.safe_wish(now_ns, own.trusted.then_some(forward_mps)), reason),
        };
        let (wish, replaced) = match self.emergency.force_n(now_ns, &own, objects) {
            Some(force_n) if force_n < wish.0 => {
                ((force_n, wish.1), replaced.max(Reason::Emergency))
            }
            _ => (wish, replaced),
        };
        let admitted = self.limit(now_ns, wish, forward_mps, replaced);
        if usable.is_ok() {
            self.trusted_ns = Some(now_ns);
            (self.trusted_force_n, self.trusted_steering_rad) =
                (admitted.force_n, admitted.steering_rad);
        }
        admitted
    }

    /// Keeps account of solves; true once shifted plans have been driven for too long.
    fn plan_is_missing(&mut self, now_ns: u64, plan: Plan) -> bool {
        match plan {
            Plan::Solved => {
                (self.unsolved_ticks, self.solved_ns) = (0, Some(now_ns));
            }
            Plan::Held => {}
            Plan::Shifted => self.unsolved_ticks = self.unsolved_ticks.saturating_add(1),
        }
        let since_ns = now_ns.saturating_sub(*self.solved_ns.get_or_insert(now_ns));
        self.unsolved_ticks >= NO_PLAN_TICKS && since_ns >= NO_PLAN_NS
    }

    /// Hold, then straight and coast, then straight and brake. No speed means it is not known.
    fn safe_wish(&mut self, now_ns: u64, forward_mps: Option<f64>) -> (f64, f64) {
        match now_ns.saturating_sub(*self.trusted_ns.get_or_insert(now_ns)) {
            age_ns if age_ns <= HOLD_NS => (self.trusted_force_n, self.trusted_steering_rad),
            age_ns if age_ns <= COAST_END_NS => (0.0, 0.0),
            _ => (forward_mps.map_or(-MASS_KG * BRAKE_MPS2, brake_force_n), 0.0),
        }
    }

    /// Limits a finite wish to range, lateral acceleration and rate; names the severest change.
    fn limit(
        &mut self,
        now_ns: u64,
        (wish_n, wish_rad): (f64, f64),
        forward_mps: f64,
        replaced: Reason,
    ) -> Admitted {
        let elapsed_ns =
            self.admitted_ns.map_or(ELAPSED_MAX_NS, |last| now_ns.saturating_sub(last));
        let elapsed_s = elapsed_ns.min(ELAPSED_MAX_NS) as f64 * 1e-9;
        let mut reason = replaced;
        let mut within = |value: f64, low: f64, high: f64, why: Reason| {
            let limited = value.clamp(low, high);
            if limited != value {
                reason = reason.max(why);
            }
            limited
        };
        let cornering_rad = steering_bound_rad(forward_mps);
        let force_n = within(wish_n, FORCE_MIN_N, FORCE_MAX_N, Reason::Force);
        let ranged = within(wish_rad, -STEERING_MAX_RAD, STEERING_MAX_RAD, Reason::Steering);
        let steering_rad = within(ranged, -cornering_rad, cornering_rad, Reason::LateralAccel);

        let (step_n, step_rad) = (FORCE_RATE_NPS * elapsed_s, STEERING_RATE_RADPS * elapsed_s);
        self.force_n = within(force_n, self.force_n - step_n, self.force_n + step_n, Reason::Rate);
        self.steering_rad = within(
            steering_rad,
            self.steering_rad - step_rad,
            self.steering_rad + step_rad,
            Reason::Rate,
        );
        self.admitted_ns = Some(now_ns);
        Admitted { force_n: self.force_n, steering_rad: self.steering_rad, reason }
    }
}

/// Largest steering angle whose steady cornering stays within the lateral limit \[rad\].
///
/// ```text
/// a_y = u² δ / (L + K u²)      steady-state cornering with understeer gradient K
/// ```
/// (Rajamani, *Vehicle Dynamics and Control*, chapter 3).
#[must_use]
pub fn steering_bound_rad(forward_mps: f64) -> f64 {
    let u2 = (forward_mps * forward_mps).max(1.0);
    LATERAL_ACCEL_MAX_MPS2 * (WHEELBASE_M + UNDERSTEER_RADPS2PM * u2) / u2
}

/// Braking force of the last resort at this speed \[N\].
fn brake_force_n(forward_mps: f64) -> f64 {
    -MASS_KG * BRAKE_MPS2 * (forward_mps / STANDSTILL_MPS).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests;
