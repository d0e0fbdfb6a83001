//! How a wave of the leader's script travels down the platoon.
//!
//! ```text
//! c = 2/T ∫ v cos ωt dt,   s = 2/T ∫ v sin ωt dt,   amplitude = √(c² + s²)
//! ```
//!
//! over whole periods of the wave, so that a constant speed counts for nothing; the first period
//! is left to the transient when there are others. Two ratios say what becomes of the wave: to the
//! leader's amplitude, and to that of the truck ahead. String stability is that the first one stays
//! below a bound that does not depend on the truck (D. Swaroop and J. K. Hedrick, *String stability
//! of interconnected systems*, IEEE Trans. Automatic Control 41(3), 1996). No truck that keeps a
//! constant distance by feedback alone has it below 1 at every frequency: with two integrators in
//! the loop, the logarithm of |T(jω)| over ω² integrates to at least 0 (R. H. Middleton,
//! *Trade-offs in linear control system design*, Automatica 27(2), 1991).

use core::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::scenario::Wave;

/// One truck's answer to one wave.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Amplification {
    /// Period of the wave \[s\].
    pub period_s: f64,
    /// Amplitude of the truck's speed at that period \[m/s\].
    pub speed_mps: f64,
    /// That amplitude over the leader's; `None` for a truck that leads.
    pub leader_ratio: Option<f64>,
    /// That amplitude over that of the truck ahead, when that is not the leader.
    pub ratio: Option<f64>,
}

/// One truck's oscillation at one wave, growing with every sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Oscillation {
    from_s: f64,
    until_s: f64,
    radps: f64,
    cosine: f64,
    sine: f64,
    samples: u32,
}

impl Oscillation {
    pub(super) fn new(wave: &Wave) -> Self {
        let period_s = (wave.until_s - wave.from_s) / f64::from(wave.periods);
        let transient_s = if wave.periods > 1 { period_s } else { 0.0 };
        Self {
            from_s: wave.from_s + transient_s,
            until_s: wave.until_s,
            radps: TAU / period_s,
            cosine: 0.0,
            sine: 0.0,
            samples: 0,
        }
    }

    pub(super) fn sample(&mut self, time_s: f64, speed_mps: f64) {
        if time_s >= self.from_s && time_s < self.until_s {
            let (sine, cosine) = libm::sincos(self.radps * (time_s - self.from_s));
            self.cosine += speed_mps * cosine;
            self.sine += speed_mps * sine;
            self.samples += 1;
        }
    }

    /// The answer so far, without its ratios.
    pub(super) fn finish(&self) -> Amplification {
        let scale = 2.0 / f64::from(self.samples.max(1));
        let speed_mps = scale * libm::hypot(self.cosine, self.sine);
        Amplification { period_s: TAU / self.radps, speed_mps, leader_ratio: None, ratio: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_amplitude_is_that_of_the_wave_whatever_its_phase_and_the_speed_it_rides_on() {
        let wave = Wave { from_s: 3.0, until_s: 15.0, periods: 3 };
        let mut oscillation = Oscillation::new(&wave);
        for step in 0..20_000 {
            let time_s = 1e-3 * f64::from(step);
            // Before the second period anything may happen.
            let transient_mps = if time_s < 7.0 { 3.0 * time_s } else { 0.0 };
            let swing_mps = 0.4 * libm::sin(TAU * time_s / 4.0 + 0.7);
            oscillation.sample(time_s, 20.0 + transient_mps + swing_mps);
        }
        let found = oscillation.finish();
        assert!((found.speed_mps - 0.4).abs() < 1e-3, "{found:?}");
        assert!((found.period_s - 4.0).abs() < 1e-12, "{found:?}");
    }
}
