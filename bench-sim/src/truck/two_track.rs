//! The two-track truck: four wheels on a plane road, a sprung mass that heaves, pitches and rolls.
//!
//! Planar motion of the whole truck with roll of the sprung mass, about a roll axis that lies h
//! below the sprung CG and along the road (q = m_s h, x_s: sprung CG ahead of the whole's):
//!
//! ```text
//! m (u' - v r) = Σ Fx                         Σ F: tyres, air, gravity along the plane
//! m (v' + u r) - q ϕ''              = Σ Fy
//! I_z r' - q x_s ϕ''                = Σ M_z
//! (I_x + q h) ϕ'' - q (v' + u r) - q x_s r' = M_roll - q g_y
//! J ω' = T - R Fx                             T: engine, brake, rolling resistance
//! σx κ' = ω R - V_x - |V_x| κ                 σy (tan α)' = -V_y - |V_x| tan α
//! ```
//!
//! The three equations in v', r', ϕ'' are solved in closed form. Terms of second order in roll are
//! left out, and so are the products of inertia of the sprung mass about its own CG. Slips behind
//! their relaxation lengths feed the magic formula of `tyre`; near standstill they are damped, or
//! the tyre would be a spring without loss (Pacejka, section 8.6). Loads come from `suspension`,
//! torques from `actuators`, slope, friction and wind from `road`.
//!
//! Integrated by one classical Runge-Kutta step (RK4) per base step, without substeps: the fastest
//! motion is a wheel's slip against its spin, about 150 rad/s, where RK4 is stable up to 2800 rad/s
//! at 1 ms. No state decides on a load by way of an acceleration, so there is no algebraic loop.
//!
//! A truck that has come to rest is held exactly where it is while brakes, rolling resistance and
//! hill holder can hold it, by `hold`.

mod actuators;
mod hold;
mod parameters;
mod road;
mod state;
mod suspension;
#[cfg(test)]
mod tests;
mod tyre;

pub use parameters::{DrivenAxles, TwoTrackParameters};
pub use road::{FRICTION_PATCHES_MAX, FrictionPatch, Surroundings};
pub use tyre::TyreParameters;

use actuators::{Torques, Turning, slip_control};
use state::{AXLES, State, WHEELS};
use suspension::Loading;

use super::integration::rk4_step;
use super::{Attitude, BodyAcceleration, Command, TruckState};

/// Speed below which slip is damped \[m/s\].
const SLIP_DAMPING_SPEED_MPS: f64 = 3.0;
/// Slip per sliding speed that this damping adds at standstill, along the wheel \[s/m\].
const SLIP_DAMPING_S_PER_M: f64 = 0.03;
/// The same across the wheel \[s/m\].
const TAN_SLIP_DAMPING_S_PER_M: f64 = 0.1;
/// Slips kept behind the relaxation lengths stay within this.
const SLIP_MAX: f64 = 1.5;
/// The hill holder's largest torque over what the tyre can put on the road.
const HOLDING_SHARE: f64 = 1.2;

/// One two-track truck: its calibration, its state, and the acceleration it last had.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoTrack {
    parameters: TwoTrackParameters,
    state: State,
    acceleration: BodyAcceleration,
    turning: [Turning; WHEELS],
    held: bool,
}

/// One wheel at one instant, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Wheel {
    /// Vertical load \[N\].
    load_n: f64,
    /// Largest force its tyres can give \[N\].
    peak_n: f64,
    /// Force of the road along and across it \[N\].
    along_n: f64,
    across_n: f64,
    /// Speed of its contact point along and across it \[m/s\].
    along_mps: f64,
    across_mps: f64,
    /// Torques of engine, brake, rolling resistance and hill holder.
    torques: Torques,
    /// Relaxation lengths of its slips \[m\].
    relaxation_x_m: f64,
    relaxation_y_m: f64,
}

/// Everything that acts at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Forces {
    wheels: [Wheel; WHEELS],
    /// Of the road on an axle, in body axes \[N\].
    axle_forward_n: [f64; AXLES],
    axle_left_n: [f64; AXLES],
    /// Of the air, in body axes \[N\].
    air_n: [f64; 2],
    /// Along the road plane in body axes, and into it \[m/s²\].
    gravity_mps2: [f64; 3],
    /// All yaw moments \[N m\].
    yaw_nm: f64,
}

impl TwoTrack {
    /// A truck that rolls as given, straight and settled on its suspension as on a level road.
    pub fn new(parameters: TwoTrackParameters, start: &TruckState) -> Self {
        let state = State {
            forward_mps: start.forward_mps,
            lateral_mps: start.lateral_mps,
            yaw_radps: start.yaw_radps,
            heading_rad: start.heading_rad,
            x_m: start.x_m,
            y_m: start.y_m,
            spin_radps: [start.forward_mps / parameters.wheel_radius_m; WHEELS],
            ..State::default()
        };
        let mut truck = Self {
            parameters,
            state,
            acceleration: BodyAcceleration::default(),
            turning: state.spin_radps.map(Turning::of),
            held: false,
        };
        truck.settle_or_hold();
        truck.accelerate(&Command::default());
        truck
    }

    /// Advances the truck by one Runge-Kutta step under a constant command.
    pub fn step(&mut self, command: &Command, dt_s: f64) {
        self.break_away();
        self.state = rk4_step(self.state, dt_s, |state| self.rate(state, command));
        self.state.slip = self.state.slip.map(|slip| slip.clamp(-SLIP_MAX, SLIP_MAX));
        self.state.tan_slip = self.state.tan_slip.map(|slip| slip.clamp(-SLIP_MAX, SLIP_MAX));
        self.lock_up();
        self.settle_or_hold();
        self.accelerate(command);
    }

    /// The truck's calibration.
    pub fn parameters(&self) -> &TwoTrackParameters {
        &self.parameters
    }

    /// The truck's state as the bench sees it.
    pub fn state(&self) -> TruckState {
        let s = &self.state;
        TruckState {
            forward_mps: s.forward_mps,
            lateral_mps: s.lateral_mps,
            yaw_radps: s.yaw_radps,
            heading_rad: s.heading_rad,
            x_m: s.x_m,
            y_m: s.y_m,
            force_n: self.parameters.engine_force_n(s) - s.brake_n[0] - s.brake_n[1],
            steer_rad: s.road_wheel_rad(),
        }
    }

    /// Acceleration of the CG at the current state.
    pub fn acceleration(&self) -> &BodyAcceleration {
        &self.acceleration
    }

    /// How the sprung mass stands.
    pub fn attitude(&self) -> Attitude {
        self.state.attitude()
    }

    /// Vertical loads of the wheels \[N\]: front left, front right, rear left, rear right.
    pub fn wheel_loads_n(&self) -> [f64; WHEELS] {
        let [_, _, into_mps2] = self.parameters.surroundings.gravity_mps2();
        suspension::wheel_loads_n(&self.parameters, &self.state, into_mps2)
    }

    /// Longitudinal slips of the wheels behind their relaxation lengths, in the same order.
    pub fn slips(&self) -> [f64; WHEELS] {
        self.state.slip
    }

    /// Lets locked wheels turn whose friction no longer holds them. Brakes and bearings are Coulomb
    /// friction, whose sense stays the same within a step (Karnopp, ASME J. Dyn. Sys. 107, 1985).
    fn break_away(&mut self) {
        if self.held || !self.turning.contains(&Turning::Locked) {
            return;
        }
        let forces = self.forces(&self.state);
        for (turning, wheel) in self.turning.iter_mut().zip(&forces.wheels) {
            if *turning == Turning::Locked {
                let road_nm = -self.parameters.wheel_radius_m * wheel.along_n;
                *turning = wheel.torques.breakaway(road_nm);
            }
        }
    }

    /// Locks the wheels that have just stopped turning.
    fn lock_up(&mut self) {
        for (turning, spin_radps) in self.turning.iter_mut().zip(&mut self.state.spin_radps) {
            if *turning != Turning::of(*spin_radps) {
                (*turning, *spin_radps) = (Turning::Locked, 0.0);
            }
        }
    }

    /// Takes note of the acceleration under a command.
    fn accelerate(&mut self, command: &Command) {
        self.acceleration = BodyAcceleration::default();
        if self.held {
            return;
        }
        let (s, p, rate) = (&self.state, &self.parameters, self.rate(&self.state, command));
        let rolled_mps2 = p.sprung_kg() / p.mass_kg * p.roll_arm_m() * rate.roll_radps;
        self.acceleration = BodyAcceleration {
            forward_mps2: rate.forward_mps - s.lateral_mps * s.yaw_radps,
            lateral_mps2: rate.lateral_mps + s.forward_mps * s.yaw_radps - rolled_mps2,
        };
    }

    /// The equations of motion at the top of this file.
    fn rate(&self, s: &State, command: &Command) -> State {
        let p = &self.parameters;
        let forces = if self.held { self.holding_forces(s) } else { self.forces(s) };
        let mut rate = State::default();
        if self.held {
            rate.roll_radps = self.held_roll_radps2(s, &forces);
        } else {
            self.add_planar_rates(s, &forces, &mut rate);
            self.add_wheel_rates(s, &forces, &mut rate);
        }
        suspension::add_rates(p, s, &self.loading(s, &forces, &rate), &mut rate);
        let cornering_n = forces.wheels[0].across_n + forces.wheels[1].across_n;
        (rate.engine_n, rate.valve_n, rate.brake_n) = p.force_rates(s, command);
        (rate.steer_rad, rate.twist_rad) = p.steer_rates(s, command, cornering_n);
        rate
    }

    /// Speeds, pose and roll.
    fn add_planar_rates(&self, s: &State, forces: &Forces, rate: &mut State) {
        let p = &self.parameters;
        let (u, v, r) = (s.forward_mps, s.lateral_mps, s.yaw_radps);
        let (m, inertia, ahead_m) = (p.mass_kg, p.yaw_inertia_kgm2, p.sprung_ahead_m());
        let q = p.sprung_kg() * p.roll_arm_m();
        let [gravity_x, gravity_y, _] = forces.gravity_mps2;
        let along_mps2 = forces.forward_n() / m + gravity_x;
        let across_mps2 = forces.left_n() / m + gravity_y;
        let turning_radps2 = forces.yaw_nm / inertia;

        let rolling_nm = self.roll_moment_nm(s, forces)
            + q * (across_mps2 - gravity_y + ahead_m * turning_radps2);
        let roll_kgm2 = p.roll_inertia_kgm2 + q * p.roll_arm_m()
            - q * q * (1.0 / m + ahead_m * ahead_m / inertia);
        rate.roll_radps = rolling_nm / roll_kgm2;
        rate.forward_mps = along_mps2 + v * r;
        rate.lateral_mps = across_mps2 + q / m * rate.roll_radps - u * r;
        rate.yaw_radps = turning_radps2 + q / inertia * ahead_m * rate.roll_radps;
        rate.heading_rad = r;
        (rate.x_m, rate.y_m) = s.road_velocity_mps();
    }

    /// Spin and slips.
    fn add_wheel_rates(&self, s: &State, forces: &Forces, rate: &mut State) {
        let p = &self.parameters;
        for (i, wheel) in forces.wheels.iter().enumerate() {
            let (speed_mps, rim_mps) = (wheel.along_mps.abs(), s.spin_radps[i] * p.wheel_radius_m);
            if self.turning[i] != Turning::Locked {
                let torque_nm = wheel.torques.on(self.turning[i]);
                rate.spin_radps[i] =
                    (torque_nm - p.wheel_radius_m * wheel.along_n) / p.wheel_inertia_kgm2[i / 2];
            }
            rate.slip[i] =
                (rim_mps - wheel.along_mps - speed_mps * s.slip[i]) / wheel.relaxation_x_m;
            rate.tan_slip[i] =
                (-wheel.across_mps - speed_mps * s.tan_slip[i]) / wheel.relaxation_y_m;
        }
    }

    /// Everything that acts on a truck that is not held.
    fn forces(&self, s: &State) -> Forces {
        let p = &self.parameters;
        let mut forces = self.body_forces(s);
        let loads_n = suspension::wheel_loads_n(p, s, forces.gravity_mps2[2]);
        let [left_rad, right_rad] = p.ackermann_rad(s.road_wheel_rad());
        let steer_rad = [left_rad, right_rad, 0.0, 0.0];
        let heading = libm::sincos(s.heading_rad);
        let (mut forward_n, mut left_n) = ([0.0; WHEELS], [0.0; WHEELS]);
        for i in 0..WHEELS {
            let (sin, cos) = libm::sincos(steer_rad[i]);
            let wheel = self.wheel(s, i, loads_n[i], (sin, cos), heading);
            forward_n[i] = wheel.along_n * cos - wheel.across_n * sin;
            left_n[i] = wheel.along_n * sin + wheel.across_n * cos;
            forces.wheels[i] = wheel;
        }
        // Left and right are added first, so that mirror images stay exact.
        for axle in 0..AXLES {
            let (left, right) = (2 * axle, 2 * axle + 1);
            forces.axle_forward_n[axle] = forward_n[left] + forward_n[right];
            forces.axle_left_n[axle] = left_n[left] + left_n[right];
            forces.yaw_nm += p.axle_ahead_m(axle) * forces.axle_left_n[axle]
                + 0.5 * p.track_m[axle] * (forward_n[right] - forward_n[left]);
        }
        forces
    }

    /// Air and gravity.
    fn body_forces(&self, s: &State) -> Forces {
        let (p, road) = (&self.parameters, &self.parameters.surroundings);
        let (sin, cos) = libm::sincos(s.heading_rad);
        let forward_mps = s.forward_mps - (road.wind_x_mps * cos + road.wind_y_mps * sin);
        let left_mps = s.lateral_mps - (road.wind_y_mps * cos - road.wind_x_mps * sin);
        let airspeed_mps = libm::hypot(forward_mps, left_mps);
        let [along_mps2, across_mps2, into_mps2] = road.gravity_mps2();
        let air_n = [
            -p.drag_n_s2_per_m2 * airspeed_mps * forward_mps,
            -p.side_drag_n_s2_per_m2 * airspeed_mps * left_mps,
        ];
        Forces {
            air_n,
            gravity_mps2: [
                along_mps2 * cos + across_mps2 * sin,
                across_mps2 * cos - along_mps2 * sin,
                into_mps2,
            ],
            yaw_nm: p.pressure_ahead_m * air_n[1],
            ..Forces::default()
        }
    }

    /// One wheel, steered and headed by angles given as sine and cosine.
    fn wheel(
        &self,
        s: &State,
        i: usize,
        load_n: f64,
        (steer_sin, steer_cos): (f64, f64),
        (heading_sin, heading_cos): (f64, f64),
    ) -> Wheel {
        let (p, axle) = (&self.parameters, i / 2);
        let (ahead_m, aside_m) = (p.axle_ahead_m(axle), p.wheel_aside_m(i));
        let forward_mps = s.forward_mps - s.yaw_radps * aside_m;
        let left_mps = s.lateral_mps + s.yaw_radps * ahead_m;
        let along_mps = forward_mps * steer_cos + left_mps * steer_sin;
        let across_mps = left_mps * steer_cos - forward_mps * steer_sin;
        let rim_mps = s.spin_radps[i] * p.wheel_radius_m;

        let x_m = s.x_m + ahead_m * heading_cos - aside_m * heading_sin;
        let tyres = p.tyres_per_wheel[axle];
        let tyre = p.tyres(axle).under(load_n / tyres, p.surroundings.friction_at(x_m));
        let damping = slip_damping(along_mps);
        let (along_n, across_n) = tyre.force_n(
            s.slip[i] + damping * SLIP_DAMPING_S_PER_M * (rim_mps - along_mps),
            s.tan_slip[i] - damping * TAN_SLIP_DAMPING_S_PER_M * across_mps,
        );
        let peak_n = tyres * tyre.peak_n;
        Wheel {
            load_n,
            peak_n,
            along_n: tyres * along_n,
            across_n: tyres * across_n,
            along_mps,
            across_mps,
            torques: self.torques(s, axle, (load_n, peak_n), slip_control(rim_mps, along_mps)),
            relaxation_x_m: tyre.relaxation_x_m,
            relaxation_y_m: tyre.relaxation_y_m,
        }
    }

    /// Torques of engine, brake, bearings and hill holder on a wheel of a load and a grip, as far
    /// as traction control and anti-lock brakes let them through.
    fn torques(
        &self,
        s: &State,
        axle: usize,
        (load_n, peak_n): (f64, f64),
        (spinning, locking): (f64, f64),
    ) -> Torques {
        let (p, radius_m) = (&self.parameters, self.parameters.wheel_radius_m);
        let engine_nm = 0.5 * p.driven_share(axle) * p.engine_force_n(s) * radius_m;
        let rolling_nm = p.rolling * load_n * radius_m;
        let brake_nm = 0.5 * s.brake_n[axle] * radius_m;
        Torques {
            engine_nm: engine_nm * if engine_nm > 0.0 { spinning } else { locking },
            forward_nm: rolling_nm + locking * brake_nm,
            backward_nm: rolling_nm + brake_nm + HOLDING_SHARE * peak_n * radius_m,
        }
    }

    /// What the suspension has to carry.
    fn loading(&self, s: &State, forces: &Forces, rate: &State) -> Loading {
        let p = &self.parameters;
        let [gravity_x, gravity_y, _] = forces.gravity_mps2;
        let along_mps2 = rate.forward_mps - s.lateral_mps * s.yaw_radps - gravity_x;
        let across_mps2 = rate.lateral_mps + s.forward_mps * s.yaw_radps - gravity_y;
        let unsprung_kg = p.unsprung_kg[0] + p.unsprung_kg[1];
        let spin_radps2 = rate.spin_radps;
        let spin_nm = p.wheel_inertia_kgm2[0] * (spin_radps2[0] + spin_radps2[1])
            + p.wheel_inertia_kgm2[1] * (spin_radps2[2] + spin_radps2[3]);
        Loading {
            pitch_nm: -p.sprung_height_m * (forces.axle_forward_n[0] + forces.axle_forward_n[1])
                + (p.sprung_height_m - p.wheel_radius_m) * unsprung_kg * along_mps2
                + (p.pressure_height_m - p.sprung_height_m) * forces.air_n[0]
                - spin_nm,
            across_n: forces.axle_left_n,
            across_mps2: core::array::from_fn(|axle| {
                across_mps2 + p.axle_ahead_m(axle) * rate.yaw_radps
            }),
        }
    }

    /// Moment of suspension, leaning weight and air about the roll axis \[N m\].
    fn roll_moment_nm(&self, s: &State, forces: &Forces) -> f64 {
        let p = &self.parameters;
        let axis_m = p.sprung_height_m - p.roll_arm_m();
        suspension::roll_moment_nm(p, s, forces.gravity_mps2[2])
            - (p.pressure_height_m - axis_m) * forces.air_n[1]
    }
}

impl Forces {
    /// Of road and air forward \[N\].
    fn forward_n(&self) -> f64 {
        self.axle_forward_n[0] + self.axle_forward_n[1] + self.air_n[0]
    }

    /// Of road and air to the left \[N\].
    fn left_n(&self) -> f64 {
        self.axle_left_n[0] + self.axle_left_n[1] + self.air_n[1]
    }
}

/// How much slip is damped at a speed along the wheel: 1 at standstill, 0 from some speed on.
fn slip_damping(along_mps: f64) -> f64 {
    let speed = along_mps.abs() / SLIP_DAMPING_SPEED_MPS;
    if speed >= 1.0 { 0.0 } else { 0.5 * (1.0 + libm::cos(core::f64::consts::PI * speed)) }
}
