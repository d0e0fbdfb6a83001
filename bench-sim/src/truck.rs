//! The plant: what a truck is on the road, by one of three models.
//!
//! | `plant.model` | what it is |
//! |---|---|
//! | `single-track` | [`SingleTrack`]: nonlinear bicycle, saturating tyres; the default |
//! | `two-track` | [`TwoTrack`]: four wheels, suspension, drive line, air brakes, road and wind |
//! | `prediction` | [`Prediction`]: the linear bicycle the controller believes in, built again |
//!
//! A leader may instead follow a script ([`Scripted`]) that no command moves.
//!
//! All take the same [`Command`] and show the same [`TruckState`]. Frames: road frame X along the
//! road, Y to the left, heading counter-clockwise from X; body frame forward and left (ISO 8855).
//! None shares an equation or a parameter with the control law; `docs/plant.md` has the equations,
//! the parameters with their sources, and what each is verified against.

mod integration;
mod prediction;
pub mod scripted;
mod single_track;
pub mod two_track;

pub use prediction::{Prediction, PredictionParameters};
pub use scripted::Scripted;
pub use single_track::{NOMINAL_MASS_KG, SingleTrack, TruckParameters};
pub use two_track::{TwoTrack, TwoTrackParameters};

use integration::Integrable;

use crate::rectangle::Rectangle;

/// Standard gravity \[m/s²\].
pub(crate) const GRAVITY_MPS2: f64 = 9.81;

/// Distance from the CG to the front bumper \[m\]; ours.
pub const FRONT_OVERHANG_M: f64 = 2.31;

/// Distance from the CG to the rear bumper \[m\]; ours.
pub const REAR_OVERHANG_M: f64 = 5.4;

/// Width of the truck's box \[m\]; ours.
pub const WIDTH_M: f64 = 2.5;

/// Sideways and yaw motion of a standing truck below this is rounded to rest \[m/s, rad/s\].
const REST_SPEED: f64 = 1e-6;

/// What the bench sees of a truck's motion, whatever the model.
///
/// For the two bicycles it is also the whole of their state, and serves as its own time derivative
/// with every unit divided by a second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TruckState {
    /// Forward speed u of the CG in body axes \[m/s\]. Negative only for a truck of the two-track
    /// model that slides back where nothing can hold it.
    pub forward_mps: f64,
    /// Lateral speed v of the CG in body axes \[m/s\], positive to the left.
    pub lateral_mps: f64,
    /// Yaw rate r \[rad/s\], counter-clockwise.
    pub yaw_radps: f64,
    /// Heading φ from the road's direction \[rad\], counter-clockwise.
    pub heading_rad: f64,
    /// CG position along the road X \[m\].
    pub x_m: f64,
    /// CG position across the road Y \[m\].
    pub y_m: f64,
    /// Drive (positive) or brake (negative) force at the wheels, behind its lag \[N\].
    pub force_n: f64,
    /// Road-wheel angle of the front axle, behind its lag \[rad\], positive to the left.
    pub steer_rad: f64,
}

impl TruckState {
    /// A truck rolling straight along the road at `forward_mps`.
    fn rolling(x_m: f64, y_m: f64, forward_mps: f64) -> Self {
        Self { forward_mps, x_m, y_m, ..Self::default() }
    }

    /// Clips what a passing stop left over: no backward speed, no endless decay at rest.
    fn come_to_rest(&mut self) {
        if self.forward_mps > 0.0 {
            return;
        }
        self.forward_mps = 0.0;
        if self.lateral_mps.abs() < REST_SPEED && self.yaw_radps.abs() < REST_SPEED {
            (self.lateral_mps, self.yaw_radps) = (0.0, 0.0);
        }
    }

    /// Speed along the road X' and across it Y' \[m/s\].
    fn road_velocity_mps(&self) -> (f64, f64) {
        let (sin, cos) = (libm::sin(self.heading_rad), libm::cos(self.heading_rad));
        let (u, v) = (self.forward_mps, self.lateral_mps);
        (u * cos - v * sin, u * sin + v * cos)
    }
}

impl Integrable for TruckState {
    fn plus(&self, rate: &Self, dt_s: f64) -> Self {
        Self {
            forward_mps: self.forward_mps + dt_s * rate.forward_mps,
            lateral_mps: self.lateral_mps + dt_s * rate.lateral_mps,
            yaw_radps: self.yaw_radps + dt_s * rate.yaw_radps,
            heading_rad: self.heading_rad + dt_s * rate.heading_rad,
            x_m: self.x_m + dt_s * rate.x_m,
            y_m: self.y_m + dt_s * rate.y_m,
            force_n: self.force_n + dt_s * rate.force_n,
            steer_rad: self.steer_rad + dt_s * rate.steer_rad,
        }
    }
}

/// What the actuators are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// Longitudinal force at the wheels \[N\], negative brakes.
    pub force_n: f64,
    /// Road-wheel angle of the front axle \[rad\], positive to the left.
    pub steer_rad: f64,
}

/// Acceleration of the CG in body axes, against the inertial frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyAcceleration {
    /// Forward, u' - v r \[m/s²\].
    pub forward_mps2: f64,
    /// To the left, v' + u r \[m/s²\].
    pub lateral_mps2: f64,
}

impl BodyAcceleration {
    /// Of a truck in a state that changes at `rate`.
    fn of(state: &TruckState, rate: &TruckState) -> Self {
        Self {
            forward_mps2: rate.forward_mps - state.lateral_mps * state.yaw_radps,
            lateral_mps2: rate.lateral_mps + state.forward_mps * state.yaw_radps,
        }
    }
}

/// How the sprung mass stands on its suspension, against a truck standing level (ISO 8855 signs).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Attitude {
    /// Roll \[rad\], positive with the right side down.
    pub roll_rad: f64,
    /// Pitch \[rad\], positive with the nose down.
    pub pitch_rad: f64,
    /// Heave of the sprung mass's CG \[m\], positive up.
    pub heave_m: f64,
}

/// Calibration of a truck, which also says by which model it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Specification {
    /// The nonlinear bicycle.
    SingleTrack(TruckParameters),
    /// Four wheels.
    TwoTrack(TwoTrackParameters),
    /// The linear bicycle.
    Prediction(PredictionParameters),
    /// A script instead of a plant.
    Scripted([scripted::Phase; scripted::PHASES_MAX]),
}

impl From<TruckParameters> for Specification {
    fn from(parameters: TruckParameters) -> Self {
        Self::SingleTrack(parameters)
    }
}

impl From<TwoTrackParameters> for Specification {
    fn from(parameters: TwoTrackParameters) -> Self {
        Self::TwoTrack(parameters)
    }
}

impl From<PredictionParameters> for Specification {
    fn from(parameters: PredictionParameters) -> Self {
        Self::Prediction(parameters)
    }
}

/// The model a truck moves by, with its memory.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one per truck, made once; a box would not be Copy")]
enum Model {
    SingleTrack(SingleTrack),
    TwoTrack(TwoTrack),
    Prediction(Prediction),
    Scripted(Scripted),
}

/// One truck: its model, and what the bench sees of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truck {
    model: Model,
    state: TruckState,
    acceleration: BodyAcceleration,
}

impl Truck {
    /// A truck rolling straight ahead at `forward_mps`, without drive force.
    pub fn new(
        specification: impl Into<Specification>,
        x_m: f64,
        y_m: f64,
        forward_mps: f64,
    ) -> Self {
        let start = TruckState::rolling(x_m, y_m, forward_mps);
        let model = match specification.into() {
            Specification::SingleTrack(p) => Model::SingleTrack(SingleTrack::new(p, start)),
            Specification::TwoTrack(p) => Model::TwoTrack(TwoTrack::new(p, &start)),
            Specification::Prediction(p) => Model::Prediction(Prediction::new(p, start)),
            Specification::Scripted(phases) => Model::Scripted(Scripted::new(&phases, start)),
        };
        let mut truck = Self { model, state: start, acceleration: BodyAcceleration::default() };
        truck.observe();
        truck
    }

    /// Advances the truck by `dt_s` seconds under a constant command.
    ///
    /// A stop inside the step is clipped to rest at the end of it, so standstill is exact.
    pub fn step(&mut self, command: &Command, dt_s: f64) {
        match &mut self.model {
            Model::SingleTrack(model) => model.step(command, dt_s),
            Model::TwoTrack(model) => model.step(command, dt_s),
            Model::Prediction(model) => model.step(command, dt_s),
            Model::Scripted(model) => model.step(dt_s),
        }
        self.observe();
    }

    /// The speeds a script has in store, at N points `step_s` apart \[m/s\]; `None` without script.
    pub fn scripted_speeds<const N: usize>(&self, step_s: f64) -> Option<[f64; N]> {
        match &self.model {
            Model::Scripted(model) => Some(model.speeds(step_s)),
            Model::SingleTrack(_) | Model::TwoTrack(_) | Model::Prediction(_) => None,
        }
    }

    /// The truck's state.
    pub fn state(&self) -> &TruckState {
        &self.state
    }

    /// Acceleration of the CG at the current state.
    pub fn acceleration(&self) -> &BodyAcceleration {
        &self.acceleration
    }

    /// Mass \[kg\].
    pub fn mass_kg(&self) -> f64 {
        match &self.model {
            Model::SingleTrack(model) => model.parameters().mass_kg,
            Model::TwoTrack(model) => model.parameters().mass_kg,
            Model::Prediction(model) => model.parameters().mass_kg,
            Model::Scripted(model) => model.mass_kg(),
        }
    }

    /// Air drag plus rolling resistance at a forward speed \[N\], on a level road without wind.
    pub fn resistance_n(&self, forward_mps: f64) -> f64 {
        match &self.model {
            Model::SingleTrack(model) => model.parameters().resistance_n(forward_mps),
            Model::TwoTrack(model) => model.parameters().resistance_n(forward_mps),
            Model::Prediction(model) => model.parameters().resistance_n(forward_mps),
            Model::Scripted(_) => 0.0,
        }
    }

    /// How the sprung mass stands; level for the models without suspension.
    pub fn attitude(&self) -> Attitude {
        match &self.model {
            Model::TwoTrack(model) => model.attitude(),
            Model::SingleTrack(_) | Model::Prediction(_) | Model::Scripted(_) => {
                Attitude::default()
            }
        }
    }

    /// Speed along the road X' and across it Y' \[m/s\].
    pub fn road_velocity_mps(&self) -> (f64, f64) {
        self.state.road_velocity_mps()
    }

    /// The truck's box on the road.
    pub fn rectangle(&self) -> Rectangle {
        let centre_m = 0.5 * (FRONT_OVERHANG_M - REAR_OVERHANG_M);
        Rectangle::new(
            self.state.x_m + centre_m * libm::cos(self.state.heading_rad),
            self.state.y_m + centre_m * libm::sin(self.state.heading_rad),
            self.state.heading_rad,
            FRONT_OVERHANG_M + REAR_OVERHANG_M,
            WIDTH_M,
        )
    }

    /// Takes over what the model shows.
    fn observe(&mut self) {
        (self.state, self.acceleration) = match &self.model {
            Model::SingleTrack(model) => (*model.state(), *model.acceleration()),
            Model::TwoTrack(model) => (model.state(), *model.acceleration()),
            Model::Prediction(model) => (*model.state(), *model.acceleration()),
            Model::Scripted(model) => (*model.state(), *model.acceleration()),
        };
    }
}
