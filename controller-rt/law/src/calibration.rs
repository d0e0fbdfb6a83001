//! The law's numbers: those the paper prints (its Table II) and those it leaves out.
//!
//! A calibration is immutable while the law runs. `docs/paper-map.md` lists every value with its
//! origin; the ones marked *ours* are not printed in the paper.

use serde::{Deserialize, Serialize};

use crate::dmpc::DmpcCalibration;

/// How coordination and motion planning are put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Structure {
    /// The paper's framework: a coordination law sets the speed, the MPC plans the motion.
    #[default]
    Mcf,
    /// The paper's baseline: one MPC that tracks its slot in the platoon itself.
    SingleMpc,
    /// Distributed MPC, every truck listening to the one ahead.
    DmpcPf,
    /// Distributed MPC, every truck listening to the one ahead and to the leader.
    DmpcPlf,
}

impl Structure {
    /// Whether trucks announce their plans to each other.
    pub fn announces(self) -> bool {
        matches!(self, Self::DmpcPf | Self::DmpcPlf)
    }
}

/// All numbers of the law. `Default` is the published set, completed by ours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Calibration {
    /// How the layers are put together.
    pub structure: Structure,
    /// What the controller believes about its truck.
    pub truck: TruckBelief,
    /// Coordination layer.
    pub ucl: UclCalibration,
    /// Motion layer.
    pub lml: LmlCalibration,
    /// The baseline without a coordination layer.
    pub single_mpc: SingleMpcCalibration,
    /// The baseline whose trucks tell each other their plans.
    pub dmpc: DmpcCalibration,
    /// The motion layer solves once every this many ticks; between solves its command is held.
    pub lml_every_ticks: u32,
}

/// The prediction model's parameters [MCF, Table II], and the truck's outline.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TruckBelief {
    /// Mass m \[kg\].
    pub mass_kg: f64,
    /// CG to front axle l_f \[m\].
    pub cg_to_front_m: f64,
    /// CG to rear axle l_r \[m\].
    pub cg_to_rear_m: f64,
    /// Yaw moment of inertia I_z \[kg m²\].
    pub yaw_inertia_kgm2: f64,
    /// Front axle cornering stiffness C_αf \[N/rad\].
    pub front_stiffness_n_per_rad: f64,
    /// Rear axle cornering stiffness C_αr \[N/rad\].
    pub rear_stiffness_n_per_rad: f64,
    /// Aerodynamic drag per squared speed \[N s²/m²\]; ours.
    pub drag_n_per_mps2: f64,
    /// Rolling resistance coefficient, dimensionless; ours.
    pub rolling_resistance: f64,
    /// Half the truck's width \[m\]; ours.
    pub half_width_m: f64,
}

/// Which reading of Eq. 4 the coordination layer uses for delayed states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum DelayReading {
    /// Both ends of every difference at the same, delayed instant: Eq. 4 as printed.
    #[default]
    Eq4,
    /// Own state current, leader's position as old as its message.
    LeaderStale,
    /// As `LeaderStale`, but positions in a frame moving at the set speed.
    FrameStale,
    /// Own state current, received states extrapolated to now at constant acceleration.
    Compensated,
}

/// The coordination law in the slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum CoordinationLaw {
    /// The paper's H-infinity law with its own gain, [`UclCalibration::PUBLISHED_K1`] and
    /// [`UclCalibration::PUBLISHED_K2`] [MCF, Eq. 4].
    Published,
    /// The same, with the leader's acceleration fed forward.
    Feedforward,
    /// The paper's law with a gain designed for what it drives here.
    #[default]
    Synthesised,
    /// The constant-spacing law of the PATH platoons.
    CaccPath,
    /// Ploeg's constant time gap law.
    Ploeg,
    /// A known command instead of coordination, to measure what the truck makes of it.
    Excitation,
    /// No coordination: every truck holds the set speed.
    None,
}

/// Coordination layer: law, gain and interface to the motion layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UclCalibration {
    /// Which law coordinates.
    pub law: CoordinationLaw,
    /// K̄₁ \[1/s², 1/s, 1\] on the own error state [MCF, Eq. 4].
    pub k1: [f64; 3],
    /// K̄₂ \[1/s², 1/s, 1\] on the predecessor's error state [MCF, Eq. 4].
    pub k2: [f64; 3],
    /// Lag tau \[s\] of what the gain drives, motion layer and truck together, as `platoon
    /// identify` finds it; the gain's certificate must be for it. Ours: the paper does not print
    /// one, and 0.45 s fits its figures and its gain.
    pub lag_s: f64,
    /// Acceleration per commanded acceleration and second of lead time \[1/s\] of what the gain
    /// drives, as `platoon identify` finds it; the gain's certificate must be for it, too; ours.
    pub gain_per_lead_s: f64,
    /// How delayed states are read.
    pub delay_reading: DelayReading,
    /// Longest delay the gain is designed for, h₁ \[s\] [MCF, Table II]; extrapolation stops there.
    pub delay_bound_s: f64,
    /// Time over which the commanded acceleration builds the reference speed \[s\]; ours. The truck
    /// answers with `gain_per_lead_s` times as much.
    pub lead_time_s: f64,
    /// Smallest commanded acceleration \[m/s²\]; ours.
    pub accel_min_mps2: f64,
    /// Largest commanded acceleration \[m/s²\]; ours.
    pub accel_max_mps2: f64,
    /// How far the reference speed may exceed the leader's \[m/s\]; ours.
    pub speed_margin_mps: f64,
    /// What the law `excitation` commands; no other law reads it.
    pub excitation: Excitation,
}

impl UclCalibration {
    /// The paper's K̄₁ \[1/s², 1/s, 1\] [MCF, Table II].
    pub const PUBLISHED_K1: [f64; 3] = [2.156, 3.175, 0.998];
    /// The paper's K̄₂ \[1/s², 1/s, 1\] [MCF, Table II].
    pub const PUBLISHED_K2: [f64; 3] = [0.306, 0.239, 0.065];
    /// How far from `lag_s` the lag of any plant and loop rate from 50 Hz to 500 Hz lies, relative:
    /// `docs/identification.md` has the table.
    pub const LAG_SPREAD: f64 = 0.08;
    /// How far from `gain_per_lead_s` that of any of them lies, relative.
    pub const GAIN_SPREAD: f64 = 0.03;

    /// Lags of what the gain drives, least and largest \[s\].
    pub fn lags_s(&self) -> [f64; 2] {
        [self.lag_s * (1.0 - Self::LAG_SPREAD), self.lag_s * (1.0 + Self::LAG_SPREAD)]
    }

    /// Gains from commanded to driven acceleration, least and largest, dimensionless.
    pub fn driven_gains(&self) -> [f64; 2] {
        let gain = self.gain_per_lead_s * self.lead_time_s;
        [gain * (1.0 - Self::GAIN_SPREAD), gain * (1.0 + Self::GAIN_SPREAD)]
    }
}

/// A command known beforehand: a sine wave, or a step when the frequency is zero.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Excitation {
    /// Amplitude of the wave, or height of the step \[m/s²\].
    pub amplitude_mps2: f64,
    /// Frequency of the wave \[Hz\].
    pub frequency_hz: f64,
    /// When it begins \[s\] of bench time; nothing is commanded before.
    pub from_s: f64,
}

impl Excitation {
    /// The command at an instant of bench time \[m/s²\].
    pub fn accel_mps2(&self, time_s: f64) -> f64 {
        let since_s = time_s - self.from_s;
        match since_s >= 0.0 {
            false => 0.0,
            true if self.frequency_hz == 0.0 => self.amplitude_mps2,
            true => {
                let turns = self.frequency_hz * since_s;
                self.amplitude_mps2 * libm::sin(core::f64::consts::TAU * turns)
            }
        }
    }
}

/// The single-structure MPC: what it has in place of the coordination layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SingleMpcCalibration {
    /// Weight Q_X of the distance to the slot \[1/m²\]; the paper does not print it; ours.
    pub position_weight: f64,
    /// Whether received states are extrapolated to now, instead of taken as they come; ours.
    pub compensated: bool,
}

/// Motion layer: weights, potentials, limits.
///
/// Inputs enter the cost in kN and degrees: with those units the paper's weights work as printed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LmlCalibration {
    /// Weight Q_Y of lateral position \[1/m²\] [MCF, Table II].
    pub q_y: f64,
    /// Weight Q₀ of the reference speed \[s²/m²\] [MCF, Table II].
    pub q_0: f64,
    /// Adjustment σ₀ of Eq. 22 [MCF, Table II].
    pub sigma_0: f64,
    /// Adjustment σ_j of Eq. 22 [MCF, Table II].
    pub sigma_j: f64,
    /// Potential that counts as one unit in Eq. 22; 1 is the equation as printed; ours.
    pub potential_unit: f64,
    /// Weights S of the inputs \[1/kN², 1/deg²\] [MCF, Table II].
    pub s: [f64; 2],
    /// Weights R of input changes \[1/kN², 1/deg²\] [MCF, Table II].
    pub r: [f64; 2],
    /// Weight Q_obs of the potential; ours.
    pub q_obs: f64,
    /// Density a of the non-crossable potential [MCF, Table II].
    pub potential_a: f64,
    /// Shape b of the non-crossable potential [MCF, Table II].
    pub potential_b: f64,
    /// Density a_c of the crossable potential; ours.
    pub crossable_a: f64,
    /// Shape b_c of the crossable potential; ours.
    pub crossable_b: f64,
    /// Least longitudinal distance X₀ \[m\]; ours.
    pub x_0_m: f64,
    /// Least lateral distance Y₀ \[m\]; ours.
    pub y_0_m: f64,
    /// Safe time gap T₀ \[s\]; ours.
    pub time_gap_s: f64,
    /// Comfortable acceleration a_n \[m/s²\]; ours.
    pub comfort_accel_mps2: f64,
    /// Normalised distance beyond which an obstacle has no potential; infinite in the paper; ours.
    pub cutoff: f64,
    /// Density a_R of the road-edge potential \[1/m²\]; ours.
    pub road_a: f64,
    /// Distance D_a from the limit at which the road-edge potential begins \[m\]; ours.
    pub road_distance_m: f64,
    /// Clearance kept between the truck's side and the road's edge \[m\]; ours.
    pub edge_margin_m: f64,
    /// Least total force \[kN\]; ours.
    pub force_min_kn: f64,
    /// Largest total force \[kN\]; ours.
    pub force_max_kn: f64,
    /// Fastest change of force \[kN/s\]; ours.
    pub force_rate_kn_per_s: f64,
    /// Largest steering angle \[rad\]; ours.
    pub steering_max_rad: f64,
    /// Fastest change of steering \[rad/s\]; ours.
    pub steering_rate_radps: f64,
    /// Largest lateral acceleration \[m/s²\]; ours.
    pub lateral_accel_max_mps2: f64,
    /// Least distance from the CG to the centre of a blocking obstacle ahead \[m\]; ours.
    pub gap_m: f64,
    /// Lateral distance to an obstacle's centre at which it is passed \[m\]; ours.
    pub passing_distance_m: f64,
    /// Whether a truck behind an obstacle is told on which side to pass; ours. Without it the
    /// potential is symmetric and a truck straight behind a van stays there.
    pub passing_side_rule: bool,
    /// Whether obstacles are predicted over the horizon [MCF, Algorithm 1, line 18]; false keeps
    /// them where they are now.
    pub obstacles_predicted: bool,
    /// Quadratic slack weights H of lateral position, gap, lateral acceleration; ours.
    pub slack_quadratic: [f64; 3],
    /// Exact (linear) slack weights of the same; ours.
    pub slack_linear: [f64; 3],
}

impl Default for Calibration {
    fn default() -> Self {
        Self {
            structure: Structure::Mcf,
            truck: TruckBelief::default(),
            ucl: UclCalibration::default(),
            lml: LmlCalibration::default(),
            single_mpc: SingleMpcCalibration::default(),
            dmpc: DmpcCalibration::default(),
            lml_every_ticks: 1,
        }
    }
}

impl Default for TruckBelief {
    fn default() -> Self {
        Self {
            mass_kg: 5760.0,
            cg_to_front_m: 1.11,
            cg_to_rear_m: 3.89,
            yaw_inertia_kgm2: 34_802.6,
            front_stiffness_n_per_rad: 259_752.0,
            rear_stiffness_n_per_rad: 260_000.0,
            drag_n_per_mps2: 2.2,
            rolling_resistance: 0.006,
            half_width_m: 1.25,
        }
    }
}

impl Default for UclCalibration {
    fn default() -> Self {
        Self {
            law: CoordinationLaw::Synthesised,
            k1: [2.8, 3.8, 0.9],
            k2: [0.0; 3],
            lag_s: 0.27,
            gain_per_lead_s: 0.805,
            delay_reading: DelayReading::Eq4,
            delay_bound_s: 0.25,
            // Unity gain: the truck does what the law commands, and the limits are the actuators'.
            lead_time_s: 1.22,
            accel_min_mps2: -7.0,
            accel_max_mps2: 3.5,
            speed_margin_mps: 4.0,
            excitation: Excitation::default(),
        }
    }
}

impl Default for SingleMpcCalibration {
    fn default() -> Self {
        Self { position_weight: 80.0, compensated: false }
    }
}

impl Default for LmlCalibration {
    fn default() -> Self {
        Self {
            q_y: 300.0,
            q_0: 375.0,
            sigma_0: 2.0,
            sigma_j: 4.0,
            potential_unit: 1000.0,
            s: [0.001, 1.0],
            r: [100.0, 2000.0],
            q_obs: 1.2,
            potential_a: 10_000.0,
            potential_b: 1.23,
            crossable_a: 2_000.0,
            crossable_b: 2.0,
            x_0_m: 8.0,
            y_0_m: 2.75,
            time_gap_s: 0.5,
            comfort_accel_mps2: 2.0,
            cutoff: 3.0,
            road_a: 500.0,
            road_distance_m: 0.3,
            edge_margin_m: 0.025,
            force_min_kn: -34.0,
            force_max_kn: 20.0,
            force_rate_kn_per_s: 57.6,
            steering_max_rad: 0.1745,
            steering_rate_radps: 0.30,
            lateral_accel_max_mps2: 3.0,
            gap_m: 9.0,
            passing_distance_m: 2.75,
            passing_side_rule: true,
            obstacles_predicted: true,
            slack_quadratic: [1e5, 1e5, 1e4],
            slack_linear: [3e4, 3e4, 3e3],
        }
    }
}

impl Calibration {
    /// The first number that makes no sense, as (key, what is allowed); `None` when all do.
    ///
    /// Keys are the ones a scenario's `law` table uses.
    pub fn defect(&self) -> Option<(&'static str, &'static str)> {
        let (truck, ucl, lml, dmpc) = (&self.truck, &self.ucl, &self.lml, &self.dmpc);
        let positive = [
            ("truck.mass_kg", truck.mass_kg),
            ("truck.cg_to_front_m", truck.cg_to_front_m),
            ("truck.cg_to_rear_m", truck.cg_to_rear_m),
            ("truck.yaw_inertia_kgm2", truck.yaw_inertia_kgm2),
            ("truck.front_stiffness_n_per_rad", truck.front_stiffness_n_per_rad),
            ("truck.rear_stiffness_n_per_rad", truck.rear_stiffness_n_per_rad),
            ("truck.half_width_m", truck.half_width_m),
            ("ucl.lag_s", ucl.lag_s),
            ("ucl.gain_per_lead_s", ucl.gain_per_lead_s),
            ("ucl.delay_bound_s", ucl.delay_bound_s),
            ("ucl.lead_time_s", ucl.lead_time_s),
            ("lml.sigma_0", lml.sigma_0),
            ("lml.sigma_j", lml.sigma_j),
            ("lml.potential_unit", lml.potential_unit),
            ("lml.potential_b", lml.potential_b),
            ("lml.crossable_b", lml.crossable_b),
            ("lml.x_0_m", lml.x_0_m),
            ("lml.y_0_m", lml.y_0_m),
            ("lml.comfort_accel_mps2", lml.comfort_accel_mps2),
            ("lml.cutoff", lml.cutoff),
            ("lml.force_max_kn", lml.force_max_kn),
            ("lml.force_rate_kn_per_s", lml.force_rate_kn_per_s),
            ("lml.steering_max_rad", lml.steering_max_rad),
            ("lml.steering_rate_radps", lml.steering_rate_radps),
            ("lml.lateral_accel_max_mps2", lml.lateral_accel_max_mps2),
            ("lml.passing_distance_m", lml.passing_distance_m),
            ("lml.slack_quadratic.0", lml.slack_quadratic[0]),
            ("lml.slack_quadratic.1", lml.slack_quadratic[1]),
            ("lml.slack_quadratic.2", lml.slack_quadratic[2]),
            ("dmpc.input_weight", dmpc.input_weight),
            ("dmpc.wheel_radius_m", dmpc.wheel_radius_m),
            ("dmpc.efficiency", dmpc.efficiency),
            ("dmpc.lag_s", dmpc.lag_s),
            ("dmpc.approach_mps", dmpc.approach_mps),
            ("dmpc.force_weight", dmpc.force_weight),
        ];
        let not_negative = [
            ("truck.drag_n_per_mps2", truck.drag_n_per_mps2),
            ("truck.rolling_resistance", truck.rolling_resistance),
            ("ucl.accel_max_mps2", ucl.accel_max_mps2),
            ("ucl.speed_margin_mps", ucl.speed_margin_mps),
            ("lml.q_y", lml.q_y),
            ("lml.q_0", lml.q_0),
            ("lml.s.0", lml.s[0]),
            ("lml.s.1", lml.s[1]),
            ("lml.r.0", lml.r[0]),
            ("lml.r.1", lml.r[1]),
            ("lml.q_obs", lml.q_obs),
            ("lml.potential_a", lml.potential_a),
            ("lml.crossable_a", lml.crossable_a),
            ("lml.time_gap_s", lml.time_gap_s),
            ("lml.road_a", lml.road_a),
            ("lml.road_distance_m", lml.road_distance_m),
            ("lml.edge_margin_m", lml.edge_margin_m),
            ("lml.gap_m", lml.gap_m),
            ("lml.slack_linear.0", lml.slack_linear[0]),
            ("lml.slack_linear.1", lml.slack_linear[1]),
            ("lml.slack_linear.2", lml.slack_linear[2]),
            ("single_mpc.position_weight", self.single_mpc.position_weight),
            ("dmpc.leader_weight.0", dmpc.leader_weight[0]),
            ("dmpc.leader_weight.1", dmpc.leader_weight[1]),
            ("dmpc.own_weight.0", dmpc.own_weight[0]),
            ("dmpc.own_weight.1", dmpc.own_weight[1]),
            ("dmpc.neighbour_weight.0", dmpc.neighbour_weight[0]),
            ("dmpc.neighbour_weight.1", dmpc.neighbour_weight[1]),
            ("ucl.excitation.amplitude_mps2", ucl.excitation.amplitude_mps2),
            ("ucl.excitation.frequency_hz", ucl.excitation.frequency_hz),
            ("ucl.excitation.from_s", ucl.excitation.from_s),
        ];
        let negative =
            [("ucl.accel_min_mps2", ucl.accel_min_mps2), ("lml.force_min_kn", lml.force_min_kn)];
        let gains = ucl.k1.iter().chain(&ucl.k2);
        // F >= G over all who listen, which is one truck: the condition of Zheng's stability proof.
        let contractive = dmpc.own_weight.iter().zip(&dmpc.neighbour_weight).all(|(f, g)| f >= g);

        // `cutoff` alone may be infinite: that is the paper's untruncated potential.
        let sound = |x: f64, key: &str| x.is_finite() || (key == "lml.cutoff" && x > 0.0);
        let bad = |set: &[(&'static str, f64)], ok: fn(f64) -> bool, allowed: &'static str| {
            set.iter().find(|&&(key, x)| !sound(x, key) || !ok(x)).map(|&(key, _)| (key, allowed))
        };
        bad(&positive, |x| x > 0.0, "a number greater than 0")
            .or_else(|| bad(&not_negative, |x| x >= 0.0, "a number of at least 0"))
            .or_else(|| bad(&negative, |x| x < 0.0, "a number less than 0"))
            .or_else(|| {
                gains.into_iter().any(|k| !k.is_finite()).then_some(("ucl.k1/k2", "finite gains"))
            })
            .or_else(|| (!contractive).then_some(("dmpc.own_weight", "at least neighbour_weight")))
            .or_else(|| (self.lml_every_ticks == 0).then_some(("lml_every_ticks", "at least 1")))
    }
}
