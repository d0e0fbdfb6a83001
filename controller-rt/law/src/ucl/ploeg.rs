//! Cooperative adaptive cruise control with a constant time gap, after Ploeg.
//!
//! ```text
//! h u_i' = -u_i + k_p e + k_d e' + u_(i-1),      e = d_i - (r + h v_i)
//! ```
//!
//! d is the distance to the truck ahead and u_(i-1) the acceleration it intends. r is chosen so
//! that at the set speed the distance is the mission's; at another speed it is h times the
//! difference away from it, by design. J. Ploeg, B. T. M. Scheepers, E. van Nunen, N. van de Wouw,
//! H. Nijmeijer, *Design and experimental evaluation of cooperative adaptive cruise control*, IEEE
//! ITSC 2011.

use super::Situation;

/// Time gap h \[s\]: the one the authors drove with.
const TIME_GAP_S: f64 = 0.7;
/// k_p \[1/s²\], theirs.
const K_P: f64 = 0.2;
/// k_d \[1/s\], theirs.
const K_D: f64 = 0.7;

/// u_i \[m/s²\].
pub(super) fn accel_mps2(seen: &Situation) -> f64 {
    let distance = seen.predecessor_error();
    let error_m = distance.x - TIME_GAP_S * (seen.speed_mps - seen.set_speed_mps);
    let error_mps = distance.y - TIME_GAP_S * seen.accel_mps2;
    let target = K_P * error_m + K_D * error_mps + seen.intended_ahead_mps2;
    // Exact for a target that holds over the tick, so that the loop's rate does not matter.
    target + (seen.asked_mps2 - target) * libm::exp(-seen.elapsed_s / TIME_GAP_S)
}
