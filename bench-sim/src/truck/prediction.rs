//! The linear bicycle: the prediction model of the MCF paper (Eqs. 13 to 17) as a plant.
//!
//! ```text
//! m (u' - v r) = F - c u² - f m g             F' = (F_cmd - F) / τ_drive
//! m (v' + u r) = Fyf + Fyr                    δ' = clamp((δ_cmd - δ) / τ_steer, ± rate)
//! I_z r' = l_f Fyf - l_r Fyr                  φ' = r
//! X' = u cos φ - v sin φ                      Y' = u sin φ + v cos φ
//! Fyf = C_f (δ - (v + l_f r) / u)             Fyr = -C_r (v - l_r r) / u
//! ```
//!
//! Written out here again on purpose: with this plant the controller's belief is right up to the
//! actuators' lags and integration, so the other models against it show what plant mismatch costs.
//! Its resistances are the believed ones, which the paper's Eq. 13 leaves out. It knows no friction
//! limit: it corners and brakes as hard as it is asked to.
//!
//! Below 3 m/s slip is the sideways speed of the contact point over 3 m/s, so that a standing wheel
//! is a damper. The truck never rolls backwards: brake and rolling resistance hold it.

#[cfg(test)]
mod tests;

use super::integration::rk4_step;
use super::{BodyAcceleration, Command, GRAVITY_MPS2, TruckState};

/// Below this speed slip angles are taken over this speed \[m/s\]; ours.
const SLIP_SPEED_MIN_MPS: f64 = 3.0;

/// Calibration of one linear bicycle; defaults are the paper's Table II unless marked as ours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionParameters {
    /// Mass m \[kg\].
    pub mass_kg: f64,
    /// Yaw inertia I_z \[kg m²\].
    pub yaw_inertia_kgm2: f64,
    /// CG to front axle l_f \[m\].
    pub front_axle_m: f64,
    /// CG to rear axle l_r \[m\].
    pub rear_axle_m: f64,
    /// Cornering stiffness of the front axle C_f \[N/rad\].
    pub front_stiffness_n_per_rad: f64,
    /// Cornering stiffness of the rear axle C_r \[N/rad\].
    pub rear_stiffness_n_per_rad: f64,
    /// Air drag over speed squared c \[N s²/m²\]; ours, the value the controller believes in.
    pub drag_n_s2_per_m2: f64,
    /// Rolling resistance over weight f; ours, the value the controller believes in.
    pub rolling: f64,
    /// Time constant of drive and brake force \[s\]; ours.
    pub drive_lag_s: f64,
    /// Time constant of the steering \[s\]; ours.
    pub steer_lag_s: f64,
    /// Fastest the road wheels turn \[rad/s\]; ours.
    pub steer_rate_max_radps: f64,
}

impl PredictionParameters {
    /// The nominal truck at another mass and drive lag; the yaw inertia follows the mass.
    pub fn new(mass_kg: f64, drive_lag_s: f64) -> Self {
        let nominal = Self::default();
        Self {
            mass_kg,
            yaw_inertia_kgm2: nominal.yaw_inertia_kgm2 * mass_kg / nominal.mass_kg,
            drive_lag_s,
            ..nominal
        }
    }

    /// Air drag plus rolling resistance at a forward speed \[N\], positive against the motion.
    pub fn resistance_n(&self, forward_mps: f64) -> f64 {
        self.drag_n_s2_per_m2 * forward_mps * forward_mps
            + self.rolling * self.mass_kg * GRAVITY_MPS2
    }
}

impl Default for PredictionParameters {
    fn default() -> Self {
        Self {
            mass_kg: 5760.0,
            yaw_inertia_kgm2: 34_802.6,
            front_axle_m: 1.11,
            rear_axle_m: 3.89,
            front_stiffness_n_per_rad: 259_752.0,
            rear_stiffness_n_per_rad: 260_000.0,
            drag_n_s2_per_m2: 2.2,
            rolling: 0.006,
            drive_lag_s: 0.25,
            steer_lag_s: 0.1,
            steer_rate_max_radps: 0.6,
        }
    }
}

/// One linear bicycle: its calibration, its state, and the acceleration it last had.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    parameters: PredictionParameters,
    state: TruckState,
    acceleration: BodyAcceleration,
}

impl Prediction {
    /// A truck in the state given, with nothing asked of it.
    pub fn new(parameters: PredictionParameters, start: TruckState) -> Self {
        let mut truck =
            Self { parameters, state: start, acceleration: BodyAcceleration::default() };
        truck.accelerate(&Command::default());
        truck
    }

    /// Advances the truck by one classical Runge-Kutta step (RK4) under a constant command.
    pub fn step(&mut self, command: &Command, dt_s: f64) {
        self.state = rk4_step(self.state, dt_s, |state| self.rate(state, command));
        self.state.come_to_rest();
        self.accelerate(command);
    }

    /// The truck's calibration.
    pub fn parameters(&self) -> &PredictionParameters {
        &self.parameters
    }

    /// The truck's state.
    pub fn state(&self) -> &TruckState {
        &self.state
    }

    /// Acceleration of the CG at the current state.
    pub fn acceleration(&self) -> &BodyAcceleration {
        &self.acceleration
    }

    fn accelerate(&mut self, command: &Command) {
        self.acceleration = BodyAcceleration::of(&self.state, &self.rate(&self.state, command));
    }

    /// The equations of motion at the top of this file.
    fn rate(&self, state: &TruckState, command: &Command) -> TruckState {
        let p = &self.parameters;
        let (u, v, r) = (state.forward_mps.max(0.0), state.lateral_mps, state.yaw_radps);
        let slip_speed_mps = u.max(SLIP_SPEED_MIN_MPS);
        let front_n = p.front_stiffness_n_per_rad
            * (u * state.steer_rad - (v + p.front_axle_m * r))
            / slip_speed_mps;
        let rear_n = -p.rear_stiffness_n_per_rad * (v - p.rear_axle_m * r) / slip_speed_mps;
        let mut forward_mps2 = (state.force_n - p.resistance_n(u)) / p.mass_kg + v * r;
        if u <= 0.0 {
            forward_mps2 = forward_mps2.max(0.0);
        }
        let moving = TruckState { forward_mps: u, ..*state };
        let (x_mps, y_mps) = moving.road_velocity_mps();
        TruckState {
            forward_mps: forward_mps2,
            lateral_mps: (front_n + rear_n) / p.mass_kg - u * r,
            yaw_radps: (p.front_axle_m * front_n - p.rear_axle_m * rear_n) / p.yaw_inertia_kgm2,
            heading_rad: r,
            x_m: x_mps,
            y_m: y_mps,
            force_n: (command.force_n - state.force_n) / p.drive_lag_s,
            steer_rad: ((command.steer_rad - state.steer_rad) / p.steer_lag_s)
                .clamp(-p.steer_rate_max_radps, p.steer_rate_max_radps),
        }
    }
}
