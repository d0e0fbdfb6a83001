//! The sprung mass on its suspension: heave, pitch and roll, and the wheel loads they make.
//!
//! ```text
//! ΔS_i = -k_i (z - x_i θ) - c_i (z' - x_i θ')            x_i: axle ahead of the sprung CG
//! m_s z'' = ΔS_f + ΔS_r
//! I_y θ'' = M_pitch - x_f ΔS_f - x_r ΔS_r
//! Fz_i = share_i m g cos + ΔS_i
//! ΔF_i = (K_i ϕ + C_i p) / T_i + N_i,   left Fz_i / 2 - ΔF_i,   right Fz_i / 2 + ΔF_i
//! N_i' = ([h_i Fy_i + m_i a_i (R - h_i)] / T_i - N_i) / τ_N
//! ```
//!
//! Longitudinal load transfer is dynamic, by pitch and heave; in a steady state it is the moment of
//! all forces about the ground over the wheelbase, whatever the springs. Lateral load transfer has
//! the springs' part, by roll, and the part N that an axle's links (roll centre at h_i) and its own
//! mass m_i move at once, up to the axle's short roll on its tyres (Gillespie, chapter 6). The
//! springs are linear. Loads never fall below zero: a lifted wheel is unloaded and its axle's other
//! wheel carries all; the truck cannot tip over in this model.

use super::super::Attitude;
use super::parameters::TwoTrackParameters;
use super::state::{AXLES, State, WHEELS};

/// What acts on the sprung mass and the axles, from the planar motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Loading {
    /// Moment that pitches the sprung mass about its CG \[N m\], nose down.
    pub(super) pitch_nm: f64,
    /// Force of the road on an axle to the left \[N\].
    pub(super) across_n: [f64; AXLES],
    /// Acceleration of an axle to the left less gravity \[m/s²\].
    pub(super) across_mps2: [f64; AXLES],
}

/// Vertical loads of the wheels \[N\] on a road that gravity presses with `gravity_mps2`.
pub(super) fn wheel_loads_n(p: &TwoTrackParameters, s: &State, gravity_mps2: f64) -> [f64; WHEELS] {
    let springs_n = spring_forces_n(p, s);
    let mut loads_n = [0.0; WHEELS];
    for axle in 0..AXLES {
        let static_n = p.static_share(axle) * p.mass_kg * gravity_mps2;
        let half_n = 0.5 * (static_n + springs_n[axle]).max(0.0);
        let rolled_n = (p.roll_stiffness_nm_per_rad[axle] * s.roll_rad
            + p.roll_damping_nms_per_rad[axle] * s.roll_radps)
            / p.track_m[axle];
        let moved_n = (rolled_n + s.links_n[axle]).clamp(-half_n, half_n);
        loads_n[2 * axle] = half_n - moved_n;
        loads_n[2 * axle + 1] = half_n + moved_n;
    }
    loads_n
}

/// Change of the axles' spring and damper forces from a truck standing level \[N\].
fn spring_forces_n(p: &TwoTrackParameters, s: &State) -> [f64; AXLES] {
    core::array::from_fn(|axle| {
        let ahead_m = p.axle_ahead_m(axle) - p.sprung_ahead_m();
        -p.spring_n_per_m[axle] * (s.heave_m - ahead_m * s.pitch_rad)
            - p.damper_ns_per_m[axle] * (s.heave_mps - ahead_m * s.pitch_radps)
    })
}

/// Writes the rates of heave, pitch and the links' part of the lateral transfer. The rate of roll
/// belongs to the planar motion, with which it is coupled.
pub(super) fn add_rates(p: &TwoTrackParameters, s: &State, loading: &Loading, rate: &mut State) {
    let springs_n = spring_forces_n(p, s);
    let mut pitch_nm = loading.pitch_nm;
    for axle in 0..AXLES {
        pitch_nm -= (p.axle_ahead_m(axle) - p.sprung_ahead_m()) * springs_n[axle];
        let centre_m = p.roll_centre_m[axle];
        let own_nm =
            p.unsprung_kg[axle] * loading.across_mps2[axle] * (p.wheel_radius_m - centre_m);
        let moved_n = (centre_m * loading.across_n[axle] + own_nm) / p.track_m[axle];
        rate.links_n[axle] = (moved_n - s.links_n[axle]) / p.axle_roll_lag_s;
    }
    rate.heave_m = s.heave_mps;
    rate.heave_mps = (springs_n[0] + springs_n[1]) / p.sprung_kg();
    rate.pitch_rad = s.pitch_radps;
    rate.pitch_radps = pitch_nm / p.pitch_inertia_kgm2;
    rate.roll_rad = s.roll_radps;
}

/// Moment of springs, dampers and the leaning weight that rolls the sprung mass about the roll
/// axis \[N m\], right side down.
pub(super) fn roll_moment_nm(p: &TwoTrackParameters, s: &State, gravity_mps2: f64) -> f64 {
    let stiffness = p.roll_stiffness_nm_per_rad[0] + p.roll_stiffness_nm_per_rad[1];
    let damping = p.roll_damping_nms_per_rad[0] + p.roll_damping_nms_per_rad[1];
    let leaning = p.sprung_kg() * gravity_mps2 * p.roll_arm_m();
    (leaning - stiffness) * s.roll_rad - damping * s.roll_radps
}

impl State {
    /// How the sprung mass stands.
    pub(super) fn attitude(&self) -> Attitude {
        Attitude { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, heave_m: self.heave_m }
    }
}
