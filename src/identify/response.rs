//! What an acceleration says about the command that drove it.

use std::f64::consts::TAU;

use law::Excitation;
use serde::Serialize;

/// Acceleration of a truck at successive instants: time \[s\], acceleration \[m/s²\].
pub(super) type Course = Vec<(f64, f64)>;

/// Share of its last value at which a first-order lag has risen for one time constant.
const RISEN: f64 = 0.632;
/// How long before its end a step's last value is taken over \[s\].
const LAST_S: f64 = 1.0;

/// The answer to a wave of one frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WaveResponse {
    /// Frequency \[Hz\].
    pub frequency_hz: f64,
    /// Amplitude of the acceleration over that of the command.
    pub gain: f64,
    /// How far the acceleration is behind the command \[rad\].
    pub behind_rad: f64,
    /// Lag of first order that would be as far behind \[s\].
    pub lag_s: f64,
}

/// The answer to a step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepResponse {
    /// Last acceleration over the height of the step.
    pub gain: f64,
    /// Time to 63.2 % of the last acceleration: the time constant, were it a lag \[s\].
    pub rise_s: f64,
    /// How far the acceleration exceeds its last value, as a share of it.
    pub overshoot: f64,
}

/// The lag of first order nearest to a frequency response.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fit {
    /// Acceleration per commanded acceleration.
    pub gain: f64,
    /// Time constant \[s\].
    pub lag_s: f64,
    /// Largest distance of the response from the lag's, as a share of the gain.
    pub error: f64,
}

impl WaveResponse {
    /// Correlates an acceleration over whole periods with the wave that was commanded.
    pub(super) fn of(course: &Course, wave: &Excitation) -> Self {
        let (mut in_phase, mut ahead) = (0.0, 0.0);
        for (time_s, accel_mps2) in course {
            let (sin, cos) = (TAU * wave.frequency_hz * (time_s - wave.from_s)).sin_cos();
            in_phase += accel_mps2 * sin;
            ahead += accel_mps2 * cos;
        }
        let scale = 2.0 / (course.len() as f64 * wave.amplitude_mps2);
        let behind_rad = (-ahead).atan2(in_phase);
        Self {
            frequency_hz: wave.frequency_hz,
            gain: scale * in_phase.hypot(ahead),
            behind_rad,
            lag_s: behind_rad.tan() / (TAU * wave.frequency_hz),
        }
    }

    /// Real and imaginary part.
    fn parts(&self) -> (f64, f64) {
        (self.gain * self.behind_rad.cos(), -self.gain * self.behind_rad.sin())
    }
}

impl StepResponse {
    /// Reads gain, rise and overshoot off the answer to `step`.
    pub(super) fn of(course: &Course, step: &Excitation) -> Self {
        let end_s = course.last().map_or(0.0, |last| last.0);
        let (mut sum, mut count) = (0.0, 0.0);
        for (_, accel_mps2) in course.iter().filter(|(time_s, _)| *time_s > end_s - LAST_S) {
            sum += accel_mps2;
            count += 1.0;
        }
        let last_mps2: f64 = sum / count;
        let peak_mps2 = course.iter().map(|(_, accel_mps2)| *accel_mps2).fold(0.0, f64::max);
        let risen = course.iter().find(|(_, accel_mps2)| *accel_mps2 >= RISEN * last_mps2);
        Self {
            gain: last_mps2 / step.amplitude_mps2,
            rise_s: risen.map_or(f64::NAN, |(time_s, _)| time_s - step.from_s),
            overshoot: peak_mps2 / last_mps2 - 1.0,
        }
    }
}

impl Fit {
    /// The gain g and time constant τ that make `H (1 + jωτ) = g` hold best, in least squares.
    pub(super) fn of(waves: &[WaveResponse]) -> Self {
        // Real part: g + ω Im(H) τ = Re(H); imaginary part: -ω Re(H) τ = Im(H).
        let (mut gg, mut gt, mut tt, mut rg, mut rt) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for wave in waves {
            let ((real, imaginary), w) = (wave.parts(), TAU * wave.frequency_hz);
            gg += 1.0;
            gt += w * imaginary;
            tt += w * w * (real * real + imaginary * imaginary);
            rg += real;
            rt += w * imaginary * real - w * real * imaginary;
        }
        let determinant = gg * tt - gt * gt;
        let gain = (rg * tt - rt * gt) / determinant;
        let lag_s = (gg * rt - gt * rg) / determinant;
        let distance = |wave: &WaveResponse| {
            let ((real, imaginary), wt) = (wave.parts(), TAU * wave.frequency_hz * lag_s);
            let model = gain / (1.0 + wt * wt);
            (real - model).hypot(imaginary + wt * model) / gain
        };
        Self { gain, lag_s, error: waves.iter().map(distance).fold(0.0, f64::max) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAIN: f64 = 1.2;
    const LAG_S: f64 = 0.15;

    /// A lag of first order, driven for `duration_s` and seen over its last `seen_s`.
    fn lag(command: &Excitation, duration_s: f64, seen_s: f64) -> Course {
        let (dt_s, mut accel_mps2, mut course) = (1e-3, 0.0, Vec::new());
        let steps = (duration_s / dt_s).round() as u32;
        for k in 0..steps {
            let time_s = dt_s * f64::from(k);
            if time_s >= duration_s - seen_s - 0.5 * dt_s {
                course.push((time_s, accel_mps2));
            }
            let target_mps2 = GAIN * command.accel_mps2(time_s + 0.5 * dt_s);
            accel_mps2 = target_mps2 + (accel_mps2 - target_mps2) * (-dt_s / LAG_S).exp();
        }
        course
    }

    #[test]
    fn a_known_lag_is_found_from_waves() {
        let waves: Vec<WaveResponse> = [0.1, 0.2, 0.5, 1.0]
            .map(|frequency_hz| Excitation { amplitude_mps2: 0.3, frequency_hz, from_s: 0.0 })
            .iter()
            .map(|wave| WaveResponse::of(&lag(wave, 20.0, 10.0), wave))
            .collect();
        for wave in &waves {
            assert!((wave.lag_s - LAG_S).abs() < 1e-3, "{wave:?}");
        }
        let fit = Fit::of(&waves);
        assert!((fit.gain - GAIN).abs() < 1e-3 && (fit.lag_s - LAG_S).abs() < 1e-3, "{fit:?}");
        assert!(fit.error < 1e-3, "{fit:?}");
    }

    #[test]
    fn a_known_lag_is_found_from_a_step() {
        let step = Excitation { amplitude_mps2: 0.5, frequency_hz: 0.0, from_s: 1.0 };
        let found = StepResponse::of(&lag(&step, 5.0, 5.0), &step);
        assert!((found.gain - GAIN).abs() < 1e-6 && found.overshoot.abs() < 1e-6, "{found:?}");
        assert!((found.rise_s - LAG_S).abs() < 2e-3, "{found:?}");
    }
}
