//! Everything of the two-track truck that its equations of motion change.

use crate::truck::integration::Integrable;

/// Axles, front first.
pub(super) const AXLES: usize = 2;
/// Wheels: front left, front right, rear left, rear right.
pub(super) const WHEELS: usize = 4;

/// The state; also its own time derivative, with every unit divided by a second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct State {
    /// Forward speed u of the CG in body axes \[m/s\].
    pub(super) forward_mps: f64,
    /// Lateral speed v of the CG in body axes \[m/s\].
    pub(super) lateral_mps: f64,
    /// Yaw rate r \[rad/s\].
    pub(super) yaw_radps: f64,
    /// Heading \[rad\].
    pub(super) heading_rad: f64,
    /// CG along the road \[m\].
    pub(super) x_m: f64,
    /// CG across the road \[m\].
    pub(super) y_m: f64,
    /// Heave z of the sprung CG \[m\], up.
    pub(super) heave_m: f64,
    /// Its speed \[m/s\].
    pub(super) heave_mps: f64,
    /// Pitch θ of the sprung mass \[rad\], nose down.
    pub(super) pitch_rad: f64,
    /// Its rate \[rad/s\].
    pub(super) pitch_radps: f64,
    /// Roll ϕ of the sprung mass \[rad\], right side down.
    pub(super) roll_rad: f64,
    /// Its rate p \[rad/s\].
    pub(super) roll_radps: f64,
    /// Load an axle moves from its left to its right wheel by its links and its own mass \[N\].
    pub(super) links_n: [f64; AXLES],
    /// Spin of the wheels ω \[rad/s\], positive forward.
    pub(super) spin_radps: [f64; WHEELS],
    /// Longitudinal slip κ behind its relaxation length.
    pub(super) slip: [f64; WHEELS],
    /// Tangent of the slip angle behind its relaxation length, positive pushes left.
    pub(super) tan_slip: [f64; WHEELS],
    /// Force of the engine at the driven wheels together \[N\], negative when it brakes.
    pub(super) engine_n: f64,
    /// Brake force of an axle behind the valves \[N\], not negative.
    pub(super) valve_n: [f64; AXLES],
    /// Brake force of an axle behind the brake chambers \[N\], not negative.
    pub(super) brake_n: [f64; AXLES],
    /// Angle the steering actuator gives the road wheels \[rad\].
    pub(super) steer_rad: f64,
    /// Angle the road wheels give way by \[rad\].
    pub(super) twist_rad: f64,
}

impl Integrable for State {
    fn plus(&self, rate: &Self, dt_s: f64) -> Self {
        Self {
            forward_mps: self.forward_mps + dt_s * rate.forward_mps,
            lateral_mps: self.lateral_mps + dt_s * rate.lateral_mps,
            yaw_radps: self.yaw_radps + dt_s * rate.yaw_radps,
            heading_rad: self.heading_rad + dt_s * rate.heading_rad,
            x_m: self.x_m + dt_s * rate.x_m,
            y_m: self.y_m + dt_s * rate.y_m,
            heave_m: self.heave_m + dt_s * rate.heave_m,
            heave_mps: self.heave_mps + dt_s * rate.heave_mps,
            pitch_rad: self.pitch_rad + dt_s * rate.pitch_rad,
            pitch_radps: self.pitch_radps + dt_s * rate.pitch_radps,
            roll_rad: self.roll_rad + dt_s * rate.roll_rad,
            roll_radps: self.roll_radps + dt_s * rate.roll_radps,
            links_n: plus(self.links_n, rate.links_n, dt_s),
            spin_radps: plus(self.spin_radps, rate.spin_radps, dt_s),
            slip: plus(self.slip, rate.slip, dt_s),
            tan_slip: plus(self.tan_slip, rate.tan_slip, dt_s),
            engine_n: self.engine_n + dt_s * rate.engine_n,
            valve_n: plus(self.valve_n, rate.valve_n, dt_s),
            brake_n: plus(self.brake_n, rate.brake_n, dt_s),
            steer_rad: self.steer_rad + dt_s * rate.steer_rad,
            twist_rad: self.twist_rad + dt_s * rate.twist_rad,
        }
    }
}

impl State {
    /// Speed along the road X' and across it Y' \[m/s\].
    pub(super) fn road_velocity_mps(&self) -> (f64, f64) {
        let (sin, cos) = libm::sincos(self.heading_rad);
        let (u, v) = (self.forward_mps, self.lateral_mps);
        (u * cos - v * sin, u * sin + v * cos)
    }

    /// Angle of the road wheels about which left and right are steered \[rad\].
    pub(super) fn road_wheel_rad(&self) -> f64 {
        self.steer_rad + self.twist_rad
    }
}

fn plus<const N: usize>(start: [f64; N], rate: [f64; N], dt_s: f64) -> [f64; N] {
    core::array::from_fn(|i| start[i] + dt_s * rate[i])
}
