//! Drive line, engine brake, air brakes and steering: from commands to what reaches the wheels.
//!
//! ```text
//! engine:  Fe' = (clamp(F_cmd, -B(u), P/u) - Fe) / τ,   B(u) = min(B_max, P_B/u) fade(u)
//! brakes:  V_i' = (s_i (Fe_cmd - F_cmd) - V_i) / 0.2 τ,   B_i' = (V_i - B_i) / 0.8 τ
//! steer:   δa' = clamp((δ_cmd - δa) / τ_s, ± rate),   δt' = (-t Fyf / k - δt) / τ_t
//! ```
//!
//! A command is the force all wheels together shall give at constant speed. Driving, the engine
//! gives it up to its power, whatever the gear. Braking, the engine brake gives what it can and the
//! air brakes the rest; their shares s_i are those of the axle loads at the deceleration asked for
//! (the ideal distribution of Gillespie, *Fundamentals of Vehicle Dynamics*, chapter 3), as a
//! load-sensing electronic brake system does it. Valve and chamber together take 0.33 s to 75 % of
//! the force at τ = 0.25 s; UN R13, Annex 6 allows 0.6 s.
//!
//! Anti-lock and traction control are ideal: torque fades out between two slips without delay.
//! At standstill a hill holder keeps the truck from rolling back; only brakes and rolling
//! resistance keep it from rolling forward.

use super::super::Command;
use super::parameters::{DrivenAxles, TwoTrackParameters};
use super::state::{AXLES, State};

/// Share of the brakes' lag that the valves take; the chambers take the rest. Ours.
const VALVE_SHARE: f64 = 0.2;
/// Speeds between which the engine brake fades out, because the clutch opens \[m/s\]. Ours.
const CLUTCH_MPS: [f64; 2] = [1.5, 4.0];
/// Slips between which anti-lock brakes and traction control take the torque away. Ours.
const SLIP_CONTROL: [f64; 2] = [0.12, 0.30];
/// Slip for that control is taken over at least this speed \[m/s\]. Ours.
const SLIP_CONTROL_SPEED_MIN_MPS: f64 = 3.0;
/// Power is taken over at least this speed \[m/s\], so that it limits nothing at standstill.
const POWER_SPEED_MIN_MPS: f64 = 0.1;
/// Time constant of the steering's compliance \[s\]. Ours.
const TWIST_LAG_S: f64 = 0.02;

impl TwoTrackParameters {
    /// Force the engine gives at the wheels \[N\]: never more than its power or its brake allow.
    pub(super) fn engine_force_n(&self, state: &State) -> f64 {
        let speed_mps = state.forward_mps.abs();
        let drive_n = self.power_max_w / speed_mps.max(POWER_SPEED_MIN_MPS);
        state.engine_n.clamp(-self.engine_brake_n(speed_mps), drive_n)
    }

    /// Most the engine brake gives at a speed \[N\].
    fn engine_brake_n(&self, speed_mps: f64) -> f64 {
        let [opens_mps, closed_mps] = CLUTCH_MPS;
        let closed = ((speed_mps - opens_mps) / (closed_mps - opens_mps)).clamp(0.0, 1.0);
        let by_power_n = self.engine_brake_power_w / speed_mps.max(POWER_SPEED_MIN_MPS);
        closed * by_power_n.min(self.engine_brake_max_n)
    }

    /// Share of an axle in the engine's force.
    pub(super) fn driven_share(&self, axle: usize) -> f64 {
        match self.driven {
            DrivenAxles::All => self.static_share(axle),
            DrivenAxles::Rear => [0.0, 1.0][axle],
        }
    }

    /// Rates of the engine's force, the valves and the brake chambers \[N/s\].
    pub(super) fn force_rates(
        &self,
        state: &State,
        command: &Command,
    ) -> (f64, [f64; AXLES], [f64; AXLES]) {
        let speed_mps = state.forward_mps.abs();
        let drive_n = self.power_max_w / speed_mps.max(POWER_SPEED_MIN_MPS);
        let engine_n = command.force_n.clamp(-self.engine_brake_n(speed_mps), drive_n);
        let braked_n = (engine_n - command.force_n).max(0.0);
        let braked_n = if command.force_n < 0.0 { braked_n } else { 0.0 };
        let front = self.brake_share_front(command.force_n);
        let asked_n = [braked_n * front, braked_n * (1.0 - front)];
        let (valve_s, chamber_s) =
            (VALVE_SHARE * self.drive_lag_s, (1.0 - VALVE_SHARE) * self.drive_lag_s);
        (
            (engine_n - state.engine_n) / self.drive_lag_s,
            core::array::from_fn(|axle| (asked_n[axle] - state.valve_n[axle]) / valve_s),
            core::array::from_fn(|axle| (state.valve_n[axle] - state.brake_n[axle]) / chamber_s),
        )
    }

    /// Share of the front axle in the brake force: its share in the load under this braking.
    fn brake_share_front(&self, force_n: f64) -> f64 {
        let weight_n = self.mass_kg * super::super::GRAVITY_MPS2;
        let transfer = -force_n / weight_n * self.cg_height_m() / self.wheelbase_m();
        (self.static_share(0) + transfer).clamp(0.0, 1.0)
    }

    /// Rates of the steering actuator and of its compliance \[rad/s\], under a cornering force of
    /// the front axle in its wheels' frames.
    pub(super) fn steer_rates(
        &self,
        state: &State,
        command: &Command,
        cornering_n: f64,
    ) -> (f64, f64) {
        let rate_radps = ((command.steer_rad - state.steer_rad) / self.steer_lag_s)
            .clamp(-self.steer_rate_max_radps, self.steer_rate_max_radps);
        let twist_rad = -self.steer_compliance_rad_per_n() * cornering_n;
        (rate_radps, (twist_rad - state.twist_rad) / TWIST_LAG_S)
    }

    /// Angles of the left and right front wheel \[rad\] for the same centre of turn (Ackermann).
    pub(super) fn ackermann_rad(&self, road_wheel_rad: f64) -> [f64; 2] {
        let tan = libm::tan(road_wheel_rad);
        let half = 0.5 * self.track_m[0] / self.wheelbase_m();
        [libm::atan(tan / (1.0 - half * tan)), libm::atan(tan / (1.0 + half * tan))]
    }
}

/// Which way a wheel turns: the sense in which Coulomb friction works against it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turning {
    /// Forward.
    Forward,
    /// Not at all: friction takes up whatever torque there is.
    Locked,
    /// Backward.
    Backward,
}

impl Turning {
    /// The sense of a spin.
    pub(super) fn of(spin_radps: f64) -> Self {
        if spin_radps > 0.0 {
            Self::Forward
        } else if spin_radps < 0.0 {
            Self::Backward
        } else {
            Self::Locked
        }
    }
}

/// A wheel's torques, as slip control lets them through.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Torques {
    /// Of the engine \[N m\], negative when it brakes.
    pub(super) engine_nm: f64,
    /// Coulomb friction of brake and bearings against turning forward \[N m\], not negative.
    pub(super) forward_nm: f64,
    /// The same against turning backward, with the hill holder \[N m\].
    pub(super) backward_nm: f64,
}

impl Torques {
    /// Torque on a wheel that turns \[N m\]; a locked one has none to speak of.
    pub(super) fn on(&self, turning: Turning) -> f64 {
        match turning {
            Turning::Forward => self.engine_nm - self.forward_nm,
            Turning::Backward => self.engine_nm + self.backward_nm,
            Turning::Locked => 0.0,
        }
    }

    /// Which way a locked wheel breaks away under the road's torque on it, if at all.
    pub(super) fn breakaway(&self, road_nm: f64) -> Turning {
        let pushed_nm = self.engine_nm + road_nm;
        if pushed_nm > self.forward_nm {
            Turning::Forward
        } else if pushed_nm < -self.backward_nm {
            Turning::Backward
        } else {
            Turning::Locked
        }
    }
}

/// Shares of torque that traction control and anti-lock brakes let through, for a wheel whose rim
/// runs at `rim_mps` while its hub moves at `along_mps`.
pub(super) fn slip_control(rim_mps: f64, along_mps: f64) -> (f64, f64) {
    let over_mps = along_mps.max(SLIP_CONTROL_SPEED_MIN_MPS);
    let slip = (rim_mps - along_mps) / over_mps;
    (permitted(slip), permitted(-slip))
}

/// How much of a torque slip control lets through at a slip.
fn permitted(slip: f64) -> f64 {
    let [from, until] = SLIP_CONTROL;
    ((until - slip) / (until - from)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truck::integration::Integrable;

    /// Drives the force actuators for a while at a constant speed.
    fn after(seconds: f64, forward_mps: f64, force_n: f64) -> (TwoTrackParameters, State) {
        let p = TwoTrackParameters::default();
        let mut state = State { forward_mps, ..State::default() };
        for _ in 0..libm::round(seconds * 1e4) as usize {
            let command = Command { force_n, steer_rad: 0.0 };
            let (engine_n, valve_n, brake_n) = p.force_rates(&state, &command);
            state = state.plus(&State { engine_n, valve_n, brake_n, ..State::default() }, 1e-4);
        }
        (p, state)
    }

    #[test]
    fn every_command_within_the_engines_power_becomes_its_force() {
        for forward_mps in [0.0, 2.0, 8.0, 22.4] {
            for force_n in [-34_000.0, -12_000.0, -3_000.0, 0.0, 5_000.0, 20_000.0] {
                let (p, state) = after(5.0, forward_mps, force_n);
                let given_n = p.engine_force_n(&state) - state.brake_n[0] - state.brake_n[1];
                assert!((given_n - force_n).abs() < 1e-3, "{force_n} N: {given_n} N");
            }
        }
    }

    #[test]
    fn the_engine_never_gives_more_than_its_power() {
        for forward_mps in [10.0, 18.0, 25.0, 40.0] {
            let (p, state) = after(5.0, forward_mps, 60_000.0);
            let power_w = p.engine_force_n(&state) * forward_mps;
            assert!((power_w / p.power_max_w - 1.0).abs() < 1e-6, "{power_w} W");
            // Slowed down at once, or sped up at once, it keeps to the limit too.
            let faster = State { forward_mps: forward_mps + 5.0, ..state };
            assert!(p.engine_force_n(&faster) * faster.forward_mps <= p.power_max_w * (1.0 + 1e-9));
        }
    }

    #[test]
    fn the_brakes_are_as_quick_as_the_regulation_asks() {
        // UN R13, Annex 6: 75 % of the asymptotic pressure within 0.6 s.
        let reached = |seconds| {
            let (_, state) = after(seconds, 1.0, -30_000.0);
            (state.brake_n[0] + state.brake_n[1]) / 30_000.0
        };
        assert!(reached(0.6) > 0.75 && reached(0.1) < 0.25, "{} {}", reached(0.6), reached(0.1));
    }

    #[test]
    fn the_brakes_lag_as_long_as_drive_lag_says() {
        // The area above a unit step response is the sum of its time constants.
        let (dt_s, mut area_s) = (1e-4, 0.0);
        let p = TwoTrackParameters::default();
        let mut state = State { forward_mps: 1.0, ..State::default() };
        let command = Command { force_n: -10_000.0, steer_rad: 0.0 };
        for _ in 0..30_000 {
            let (engine_n, valve_n, brake_n) = p.force_rates(&state, &command);
            state = state.plus(&State { engine_n, valve_n, brake_n, ..State::default() }, dt_s);
            area_s += dt_s * (1.0 - (state.brake_n[0] + state.brake_n[1]) / 10_000.0);
        }
        assert!((area_s - p.drive_lag_s).abs() < 1e-3, "{area_s} s");
    }

    #[test]
    fn the_engine_brake_helps_at_speed_and_not_at_a_crawl() {
        let (p, fast) = after(5.0, 18.0, -20_000.0);
        assert!((p.engine_force_n(&fast) + p.engine_brake_power_w / 18.0).abs() < 1.0);
        let (_, slow) = after(5.0, 1.0, -20_000.0);
        assert_eq!(slow.engine_n, 0.0);
    }

    #[test]
    fn harder_braking_moves_brake_force_to_the_front() {
        let p = TwoTrackParameters::default();
        let shares = [0.0, -10e3, -34e3].map(|force_n| p.brake_share_front(force_n));
        assert!((shares[0] - 3.89 / 5.0).abs() < 1e-12 && shares[0] < shares[1]);
        assert!(shares[1] < shares[2] && shares[2] < 1.0, "{shares:?}");
    }

    #[test]
    fn the_inner_wheel_is_steered_more_and_mirrored() {
        let p = TwoTrackParameters::default();
        let ([left, right], [mirror_left, mirror_right]) =
            (p.ackermann_rad(0.1), p.ackermann_rad(-0.1));
        assert!(left > 0.1 && right < 0.1);
        assert_eq!((mirror_left, mirror_right), (-right, -left));
        // Both turn about the same point on the rear axle's line.
        let centre_m = |rad: f64, side: f64| p.wheelbase_m() / libm::tan(rad) + side * 1.015;
        assert!((centre_m(left, 1.0) - centre_m(right, -1.0)).abs() < 1e-9);
    }

    #[test]
    fn slip_control_takes_the_torque_away() {
        assert_eq!(slip_control(19.0, 20.0), (1.0, 1.0), "5 % slip is left alone");
        assert_eq!(slip_control(13.0, 20.0), (1.0, 0.0), "35 % slip releases the brake");
        assert_eq!(slip_control(7.0, 5.0), (0.0, 1.0), "a spinning wheel loses its drive");
        let (_, braked) = slip_control(15.8, 20.0);
        assert!((0.4..0.6).contains(&braked), "in between it fades: {braked}");
    }

    #[test]
    fn a_locked_wheel_breaks_away_when_the_push_exceeds_its_friction() {
        let torques = Torques { engine_nm: 500.0, forward_nm: 800.0, backward_nm: 5_000.0 };
        assert_eq!(torques.breakaway(200.0), Turning::Locked);
        assert_eq!(torques.breakaway(400.0), Turning::Forward);
        assert_eq!(torques.breakaway(-5_400.0), Turning::Locked);
        assert_eq!(torques.breakaway(-5_600.0), Turning::Backward);
    }
}
