//! What the two-track truck is made of, with the sources of its numbers.
//!
//! - \[MCF\]: Table II of the paper. Mass, yaw inertia, axle positions, front cornering stiffness.
//! - \[TS\]: the two-axle truck of TruckSim, which the paper's numbers belong to, as public code
//!   reproduces it: GOPS (Intelligent Driving Laboratory, Tsinghua University, class
//!   `VehicleDynamicsData_2A`) and the model of Y. Chen et al., *Enhancing the Performance of a
//!   Safe Controller via Supervised Learning for Truck Lateral Control*, ASME J. Dyn. Sys. 141(10),
//!   2019.
//! - \[UMTRI\]: typical of P. S. Fancher et al., *A Factbook of the Mechanical Properties of the
//!   Components for Single-Unit and Articulated Heavy Trucks*, UMTRI-86-12, 1986.
//! - ours: chosen here, in the range of the textbooks.

use serde::{Deserialize, Serialize};

use super::super::GRAVITY_MPS2;
use super::road::Surroundings;
use super::tyre::TyreParameters;

/// Mass of the nominal truck \[kg\]; \[MCF\].
const NOMINAL_MASS_KG: f64 = 5760.0;

/// Which axles the engine drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DrivenAxles {
    /// Both, in proportion to their static loads.
    #[default]
    All,
    /// The rear axle.
    Rear,
}

/// Calibration of one two-track truck. Pairs are front and rear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoTrackParameters {
    /// Mass of the whole truck m \[kg\]; \[MCF\].
    pub mass_kg: f64,
    /// Yaw inertia of the whole truck I_z \[kg m²\]; \[MCF\].
    pub yaw_inertia_kgm2: f64,
    /// CG of the whole truck to front axle l_f \[m\]; \[MCF\].
    pub front_axle_m: f64,
    /// CG of the whole truck to rear axle l_r \[m\]; \[MCF\].
    pub rear_axle_m: f64,
    /// Lateral distance of the wheels \[m\]; front \[TS\], rear between the middles of the dual
    /// tyres, \[UMTRI\].
    pub track_m: [f64; 2],
    /// Mass of the axles with their wheels \[kg\]; \[TS\].
    pub unsprung_kg: [f64; 2],
    /// Height of the sprung mass's CG \[m\]; \[TS\].
    pub sprung_height_m: f64,
    /// Roll inertia of the sprung mass about its CG \[kg m²\]; \[TS\].
    pub roll_inertia_kgm2: f64,
    /// Pitch inertia of the sprung mass about its CG \[kg m²\]; \[TS\].
    pub pitch_inertia_kgm2: f64,
    /// Height of the roll centres \[m\]; \[UMTRI\].
    pub roll_centre_m: [f64; 2],
    /// Vertical stiffness of an axle's springs \[N/m\]; \[TS\].
    pub spring_n_per_m: [f64; 2],
    /// Vertical damping of an axle's dampers \[N s/m\]; \[TS\].
    pub damper_ns_per_m: [f64; 2],
    /// Roll stiffness of an axle's springs and stabiliser \[N m/rad\]; \[TS\]: springs of 250 and
    /// 700 kN/m, 0.89 and 1.0 m apart, and auxiliary stiffnesses of 500 and 1500 N m/deg.
    pub roll_stiffness_nm_per_rad: [f64; 2],
    /// Roll damping of an axle's dampers \[N m s/rad\]; \[TS\]: dampers of 15 and 30 kN s/m, 1.1
    /// and 1.0 m apart.
    pub roll_damping_nms_per_rad: [f64; 2],
    /// Time constant of an axle rolling on its tyres \[s\]; ours, the inverse of the axle's roll
    /// frequency on tyres of 0.9 MN/m.
    pub axle_roll_lag_s: f64,
    /// Rolling radius R of the tyres, and height of the axles' CGs \[m\]; \[TS\].
    pub wheel_radius_m: f64,
    /// Spin inertia of a wheel J, both tyres of a dual together \[kg m²\]; ours.
    pub wheel_inertia_kgm2: [f64; 2],
    /// Tyres of a wheel: single in front, dual behind.
    pub tyres_per_wheel: [f64; 2],
    /// The front tyres.
    pub tyre: TyreParameters,
    /// The rear tyres.
    pub rear_tyre: TyreParameters,
    /// Rolling resistance over load; \[TS\].
    pub rolling: f64,
    /// Air drag over speed squared \[N s²/m²\]; \[TS\]: 6.8 m² and 0.69 in air of 1.206 kg/m³.
    pub drag_n_s2_per_m2: f64,
    /// Side force of the air over speed times cross speed \[N s²/m²\]; ours: 20 m² times 1.2.
    pub side_drag_n_s2_per_m2: f64,
    /// Height at which the air acts \[m\]; ours.
    pub pressure_height_m: f64,
    /// Where the air's side force acts, ahead of the CG \[m\]; ours.
    pub pressure_ahead_m: f64,
    /// Time constant of the drive line and, valve and chamber together, of the brakes \[s\]; ours.
    pub drive_lag_s: f64,
    /// Which axles are driven; ours.
    pub driven: DrivenAxles,
    /// Most power at the wheels \[W\]; ours: the 20 kN a controller may ask for, at the 22.4 m/s of
    /// the paper's leader. A truck of this size has a third of it.
    pub power_max_w: f64,
    /// Most power the engine brake takes \[W\]; ours.
    pub engine_brake_power_w: f64,
    /// Most force the engine brake gives \[N\]; ours.
    pub engine_brake_max_n: f64,
    /// Time constant of the steering actuator \[s\]; ours.
    pub steer_lag_s: f64,
    /// Fastest the steering actuator turns the road wheels \[rad/s\]; ours.
    pub steer_rate_max_radps: f64,
    /// Stiffness between steering actuator and road wheels \[N m/rad\]; ours, twice the \[UMTRI\]
    /// figure of a steering system held at the hand wheel.
    pub steer_stiffness_nm_per_rad: f64,
    /// Mechanical plus pneumatic trail of the front wheels \[m\]; ours.
    pub steer_trail_m: f64,
    /// Road, friction and wind.
    pub surroundings: Surroundings,
}

impl TwoTrackParameters {
    /// The nominal truck at another mass, built for it: inertias, springs and dampers grow with the
    /// mass, so that the suspension keeps its frequencies. Tyres, engine and brakes stay.
    pub fn new(mass_kg: f64) -> Self {
        let nominal = Self::default();
        let ratio = mass_kg / nominal.mass_kg;
        let grown = |pair: [f64; 2]| pair.map(|value| value * ratio);
        Self {
            mass_kg,
            yaw_inertia_kgm2: nominal.yaw_inertia_kgm2 * ratio,
            unsprung_kg: grown(nominal.unsprung_kg),
            roll_inertia_kgm2: nominal.roll_inertia_kgm2 * ratio,
            pitch_inertia_kgm2: nominal.pitch_inertia_kgm2 * ratio,
            spring_n_per_m: grown(nominal.spring_n_per_m),
            damper_ns_per_m: grown(nominal.damper_ns_per_m),
            roll_stiffness_nm_per_rad: grown(nominal.roll_stiffness_nm_per_rad),
            roll_damping_nms_per_rad: grown(nominal.roll_damping_nms_per_rad),
            ..nominal
        }
    }

    /// Distance between the axles L \[m\].
    pub fn wheelbase_m(&self) -> f64 {
        self.front_axle_m + self.rear_axle_m
    }

    /// Position of an axle ahead of the CG \[m\].
    pub(super) fn axle_ahead_m(&self, axle: usize) -> f64 {
        [self.front_axle_m, -self.rear_axle_m][axle]
    }

    /// Position of a wheel to the left of the truck's middle \[m\].
    pub(super) fn wheel_aside_m(&self, wheel: usize) -> f64 {
        let half_m = 0.5 * self.track_m[wheel / 2];
        if wheel.is_multiple_of(2) { half_m } else { -half_m }
    }

    /// The tyres of an axle.
    pub(super) fn tyres(&self, axle: usize) -> &TyreParameters {
        [&self.tyre, &self.rear_tyre][axle]
    }

    /// Sprung mass \[kg\].
    pub(super) fn sprung_kg(&self) -> f64 {
        self.mass_kg - self.unsprung_kg[0] - self.unsprung_kg[1]
    }

    /// Position of the sprung mass's CG ahead of the whole truck's \[m\].
    pub(super) fn sprung_ahead_m(&self) -> f64 {
        let axles =
            self.unsprung_kg[0] * self.front_axle_m - self.unsprung_kg[1] * self.rear_axle_m;
        -axles / self.sprung_kg()
    }

    /// Height of the sprung mass's CG above the roll axis \[m\].
    pub(super) fn roll_arm_m(&self) -> f64 {
        let [front_m, rear_m] = self.roll_centre_m;
        let behind = (self.front_axle_m - self.sprung_ahead_m()) / self.wheelbase_m();
        self.sprung_height_m - front_m - (rear_m - front_m) * behind
    }

    /// Height of the whole truck's CG \[m\].
    pub fn cg_height_m(&self) -> f64 {
        let axles_kg = self.unsprung_kg[0] + self.unsprung_kg[1];
        (self.sprung_kg() * self.sprung_height_m + axles_kg * self.wheel_radius_m) / self.mass_kg
    }

    /// Mass that has to be accelerated, the wheels' spin included \[kg\].
    pub fn effective_mass_kg(&self) -> f64 {
        let spin_kgm2 = 2.0 * (self.wheel_inertia_kgm2[0] + self.wheel_inertia_kgm2[1]);
        self.mass_kg + spin_kgm2 / (self.wheel_radius_m * self.wheel_radius_m)
    }

    /// Air drag plus rolling resistance at a forward speed \[N\], on a level road without wind.
    pub fn resistance_n(&self, forward_mps: f64) -> f64 {
        self.drag_n_s2_per_m2 * forward_mps * forward_mps
            + self.rolling * self.mass_kg * GRAVITY_MPS2
    }

    /// Share of an axle in the weight on a level road.
    pub(super) fn static_share(&self, axle: usize) -> f64 {
        [self.rear_axle_m, self.front_axle_m][axle] / self.wheelbase_m()
    }

    /// Cornering stiffness of an axle at its static load on a level road \[N/rad\].
    pub fn static_cornering_n_per_rad(&self, axle: usize) -> f64 {
        let tyres = 2.0 * self.tyres_per_wheel[axle];
        let load_n = self.static_share(axle) * self.mass_kg * GRAVITY_MPS2 / tyres;
        tyres * self.tyres(axle).cornering_n_per_rad(load_n)
    }

    /// The angle the front wheels give way by, per cornering force of the axle \[rad/N\].
    pub fn steer_compliance_rad_per_n(&self) -> f64 {
        self.steer_trail_m / self.steer_stiffness_nm_per_rad
    }
}

impl Default for TwoTrackParameters {
    fn default() -> Self {
        let tyre = TyreParameters::default();
        Self {
            mass_kg: NOMINAL_MASS_KG,
            yaw_inertia_kgm2: 34_802.6,
            front_axle_m: 1.11,
            rear_axle_m: 3.89,
            track_m: [2.03, 1.83],
            unsprung_kg: [570.0, 735.0],
            sprung_height_m: 1.164,
            roll_inertia_kgm2: 2_283.9,
            pitch_inertia_kgm2: 35_402.8,
            roll_centre_m: [0.5, 0.7],
            spring_n_per_m: [500e3, 1_400e3],
            damper_ns_per_m: [30e3, 60e3],
            roll_stiffness_nm_per_rad: [127.7e3, 435.9e3],
            roll_damping_nms_per_rad: [9.1e3, 15.0e3],
            axle_roll_lag_s: 0.015,
            wheel_radius_m: 0.51,
            wheel_inertia_kgm2: [12.0, 24.0],
            tyres_per_wheel: [1.0, 2.0],
            tyre,
            rear_tyre: tyre,
            rolling: 0.0041,
            drag_n_s2_per_m2: 2.83,
            side_drag_n_s2_per_m2: 14.5,
            pressure_height_m: 1.6,
            pressure_ahead_m: -0.6,
            drive_lag_s: 0.25,
            driven: DrivenAxles::All,
            power_max_w: 450e3,
            engine_brake_power_w: 100e3,
            engine_brake_max_n: 8e3,
            steer_lag_s: 0.1,
            steer_rate_max_radps: 0.6,
            steer_stiffness_nm_per_rad: 140e3,
            steer_trail_m: 0.06,
            surroundings: Surroundings::level(0.85),
        }
    }
}

impl Default for TyreParameters {
    /// A radial truck tyre of 3000 kg rated load, as on \[TS\]. `cornering_peak_per_rad` makes the
    /// front axle's cornering stiffness at its static load that of Table II of the paper; the other
    /// numbers are ours.
    fn default() -> Self {
        Self {
            rated_load_n: 29_430.0,
            cornering_peak_per_rad: 6.732,
            cornering_peak_load: 2.0,
            cornering_scale: 1.0,
            slip_stiffness: 12.0,
            friction_load_slope: -0.08,
            shape: 1.4,
            curvature: -1.0,
            carcass_x_n_per_m: 700e3,
            carcass_y_n_per_m: 300e3,
            relaxation_min_m: 0.1,
        }
    }
}
