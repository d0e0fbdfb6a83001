//! The nonlinear bicycle: a single-track truck with saturating tyres.
//!
//! States are the body velocities and pose of the centre of gravity (CG), the drive force behind
//! its lag and the road-wheel angle behind its lag and rate limit. Frames: road frame X along the
//! road, Y to the left, heading counter-clockwise from X; body frame forward and left (ISO 8855).
//!
//! ```text
//! m (u' - v r) = Fxf cos δ - Fyf sin δ + Fxr - c u² - f m g
//! m (v' + u r) = Fxf sin δ + Fyf cos δ + Fyr
//! I_z r'       = l_f (Fxf sin δ + Fyf cos δ) - l_r Fyr
//! φ' = r,  X' = u cos φ - v sin φ,  Y' = u sin φ + v cos φ
//! F' = (F_cmd - F) / τ_drive,  δ' = clamp((δ_cmd - δ) / τ_steer, ± rate)
//! ```
//!
//! Newton and Euler in a rotating frame (Rajamani, *Vehicle Dynamics and Control*, 2nd ed.,
//! section 2.3, without its small angles). It shares no equation with `law::bicycle`: the tyres
//! saturate, the slip angles are exact, the axle loads follow the acceleration, and the
//! resistances are 15 % higher.
//!
//! The truck never rolls backwards: brake and rolling resistance hold it at standstill and cannot
//! push. Not modelled: roll, pitch dynamics, suspension, powertrain, road slope and curvature.

mod parameters;
#[cfg(test)]
mod tests;
mod tyre;

pub use parameters::{NOMINAL_MASS_KG, TruckParameters};

use tyre::{Axle, WheelForce};

use super::integration::rk4_step;
use super::{BodyAcceleration, Command, GRAVITY_MPS2, TruckState};

/// One single-track truck: its calibration, its state, and the acceleration it last had.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleTrack {
    parameters: TruckParameters,
    state: TruckState,
    acceleration: BodyAcceleration,
}

impl SingleTrack {
    /// A truck in the state given, with nothing asked of it.
    pub fn new(parameters: TruckParameters, start: TruckState) -> Self {
        let mut truck =
            Self { parameters, state: start, acceleration: BodyAcceleration::default() };
        truck.accelerate(&Command::default());
        truck
    }

    /// Advances the truck by `dt_s` seconds under a constant command, by one classical
    /// Runge-Kutta step (RK4).
    ///
    /// A stop inside the step is clipped to rest at the end of it, so standstill is exact.
    pub fn step(&mut self, command: &Command, dt_s: f64) {
        self.state = rk4_step(self.state, dt_s, |state| self.rate(state, command));
        self.state.come_to_rest();
        self.accelerate(command);
    }

    /// The truck's calibration.
    pub fn parameters(&self) -> &TruckParameters {
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
        let (sin, cos) = (libm::sin(state.steer_rad), libm::cos(state.steer_rad));
        let (front, rear) = self.axle_forces(state, sin, cos);
        let front_left_n = front.along_n * sin + front.across_n * cos;
        let driving_n = front.along_n * cos - front.across_n * sin + rear.along_n;
        let mut forward_mps2 = (driving_n - p.resistance_n(u)) / p.mass_kg + v * r;
        if state.forward_mps <= 0.0 {
            forward_mps2 = forward_mps2.max(0.0);
        }
        // The forward speed of a stage that overshot a stop counts as zero.
        let (x_mps, y_mps) = TruckState { forward_mps: u, ..*state }.road_velocity_mps();
        TruckState {
            forward_mps: forward_mps2,
            lateral_mps: (front_left_n + rear.across_n) / p.mass_kg - u * r,
            yaw_radps: (p.front_axle_m * front_left_n - p.rear_axle_m * rear.across_n)
                / p.yaw_inertia_kgm2,
            heading_rad: r,
            x_m: x_mps,
            y_m: y_mps,
            force_n: (command.force_n - state.force_n) / p.drive_lag_s,
            steer_rad: ((command.steer_rad - state.steer_rad) / p.steer_lag_s)
                .clamp(-p.steer_rate_max_radps, p.steer_rate_max_radps),
        }
    }

    /// Forces of the front and rear axle, each in its wheel's frame.
    ///
    /// `sin` and `cos` are those of the road-wheel angle. Drive and brake force are shared by the
    /// axles' loads, as brake-force distribution and all-wheel drive do. At standstill neither a
    /// brake nor a drive force below the rolling resistance pushes: the wheels are held.
    fn axle_forces(&self, state: &TruckState, sin: f64, cos: f64) -> (WheelForce, WheelForce) {
        let p = &self.parameters;
        let (u, v, r) = (state.forward_mps.max(0.0), state.lateral_mps, state.yaw_radps);
        let rolls = u > 0.0 || state.force_n > p.resistance_n(0.0);
        let force_n = if rolls { state.force_n } else { 0.0 };
        let (front_load_n, rear_load_n) = self.axle_loads(force_n, u);
        let front_share = front_load_n / (front_load_n + rear_load_n);
        let front_left_mps = v + p.front_axle_m * r;
        let front = Axle {
            stiffness_n_per_rad: p.front_stiffness_n_per_rad,
            friction: p.friction,
            load_n: front_load_n,
        }
        .force(
            force_n * front_share,
            u * cos + front_left_mps * sin,
            front_left_mps * cos - u * sin,
        );
        let rear = Axle {
            stiffness_n_per_rad: p.rear_stiffness_n_per_rad,
            friction: p.friction,
            load_n: rear_load_n,
        }
        .force(force_n * (1.0 - front_share), u, v - p.rear_axle_m * r);
        (front, rear)
    }

    /// Vertical loads of the front and rear axle \[N\].
    ///
    /// Static split plus the transfer m a h / L. The acceleration is that of the longitudinal
    /// forces alone, limited to what friction allows: no algebraic loop through the tyres.
    fn axle_loads(&self, force_n: f64, forward_mps: f64) -> (f64, f64) {
        let p = &self.parameters;
        let weight_n = p.mass_kg * GRAVITY_MPS2;
        let limit_mps2 = p.friction * GRAVITY_MPS2;
        let moving = if forward_mps > 0.0 { 1.0 } else { 0.0 };
        let accel_mps2 = ((force_n - moving * p.resistance_n(forward_mps)) / p.mass_kg)
            .clamp(-limit_mps2, limit_mps2);
        let transfer_n = p.mass_kg * accel_mps2 * p.cg_height_m / p.wheelbase_m();
        let front_n = weight_n * p.rear_axle_m / p.wheelbase_m() - transfer_n;
        let front_n = front_n.clamp(0.0, weight_n);
        (front_n, weight_n - front_n)
    }
}
