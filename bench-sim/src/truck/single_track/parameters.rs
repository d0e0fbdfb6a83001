//! What the single-track truck is made of, with the sources of its numbers.
//!
//! The nominal chassis numbers are the paper's (Table I of the MCF paper). They stand in
//! `law::bicycle` too, on purpose and separately: the controller's belief and the plant share no
//! parameter struct. Everything the paper does not print is ours and says so.

use super::GRAVITY_MPS2;

/// Mass the paper prints \[kg\].
pub const NOMINAL_MASS_KG: f64 = 5760.0;

/// Yaw inertia the paper prints, of the truck at its nominal mass \[kg m²\].
const NOMINAL_YAW_INERTIA_KGM2: f64 = 34802.6;

/// Air drag the controller believes in \[N s²/m²\]; ours.
const BELIEVED_DRAG_N_S2_PER_M2: f64 = 2.2;

/// Rolling resistance coefficient the controller believes in; ours.
const BELIEVED_ROLLING: f64 = 0.006;

/// How far the plant's resistances stand above the believed ones; ours, so that the controller is
/// never right by construction.
const RESISTANCE_MISMATCH: f64 = 1.15;

/// Calibration of one single-track truck.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruckParameters {
    /// Mass m \[kg\].
    pub mass_kg: f64,
    /// CG to front axle l_f \[m\].
    pub front_axle_m: f64,
    /// CG to rear axle l_r \[m\].
    pub rear_axle_m: f64,
    /// Yaw inertia I_z \[kg m²\].
    pub yaw_inertia_kgm2: f64,
    /// CG height above the road \[m\]; ours.
    pub cg_height_m: f64,
    /// Cornering stiffness of the front axle at small slip \[N/rad\].
    pub front_stiffness_n_per_rad: f64,
    /// Cornering stiffness of the rear axle at small slip \[N/rad\].
    pub rear_stiffness_n_per_rad: f64,
    /// Friction coefficient µ between tyre and road.
    pub friction: f64,
    /// Air drag over speed squared \[N s²/m²\].
    pub drag_n_s2_per_m2: f64,
    /// Rolling resistance over weight.
    pub rolling: f64,
    /// Time constant of the drive and brake force \[s\].
    pub drive_lag_s: f64,
    /// Time constant of the steering \[s\].
    pub steer_lag_s: f64,
    /// Fastest the road wheels turn \[rad/s\].
    pub steer_rate_max_radps: f64,
}

impl TruckParameters {
    /// The nominal truck at another mass, drive lag and road friction.
    ///
    /// The yaw inertia follows the mass (same radius of gyration); the cornering stiffness does
    /// not, so a heavier truck also corners worse.
    pub fn new(mass_kg: f64, drive_lag_s: f64, friction: f64) -> Self {
        Self {
            mass_kg,
            yaw_inertia_kgm2: NOMINAL_YAW_INERTIA_KGM2 * mass_kg / NOMINAL_MASS_KG,
            drive_lag_s,
            friction,
            ..Self::default()
        }
    }

    /// Distance between the axles L \[m\].
    pub fn wheelbase_m(&self) -> f64 {
        self.front_axle_m + self.rear_axle_m
    }

    /// Air drag plus rolling resistance at a forward speed \[N\], positive against the motion.
    pub fn resistance_n(&self, forward_mps: f64) -> f64 {
        self.drag_n_s2_per_m2 * forward_mps * forward_mps
            + self.rolling * self.mass_kg * GRAVITY_MPS2
    }
}

impl Default for TruckParameters {
    fn default() -> Self {
        Self {
            mass_kg: NOMINAL_MASS_KG,
            front_axle_m: 1.11,
            rear_axle_m: 3.89,
            yaw_inertia_kgm2: NOMINAL_YAW_INERTIA_KGM2,
            cg_height_m: 1.0,
            front_stiffness_n_per_rad: 259_752.0,
            rear_stiffness_n_per_rad: 260_000.0,
            friction: 0.85,
            drag_n_s2_per_m2: BELIEVED_DRAG_N_S2_PER_M2 * RESISTANCE_MISMATCH,
            rolling: BELIEVED_ROLLING * RESISTANCE_MISMATCH,
            drive_lag_s: 0.25,
            steer_lag_s: 0.1,
            steer_rate_max_radps: 0.6,
        }
    }
}
