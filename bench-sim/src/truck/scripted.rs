//! A leader that follows a script instead of a controller: the manoeuvre the others answer to.
//!
//! Straight along the road; the speed is the start's plus the integral of the script's
//! accelerations, never below zero.

use super::{BodyAcceleration, TruckState};

/// Phases a script can have.
pub const PHASES_MAX: usize = 16;
/// Integration steps from one point of a preview to the next.
const PREVIEW_STEPS: u32 = 20;
/// Mass for who asks \[kg\]: the paper's truck; the motion does not depend on it.
const MASS_KG: f64 = 5760.0;

/// Course of the acceleration within a phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// The same throughout, but for a straight rise from zero and a fall back to it.
    Constant {
        /// Time of the rise, and of the fall \[s\].
        rise_s: f64,
    },
    /// Half a sine wave, zero at both ends.
    HalfSine,
    /// A sine wave of this many whole periods.
    Sine {
        /// Periods within the phase.
        periods: u32,
    },
}

impl Default for Shape {
    fn default() -> Self {
        Self::Constant { rise_s: 0.0 }
    }
}

/// One stretch of acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Phase {
    /// When it begins \[s\].
    pub from_s: f64,
    /// When it ends \[s\].
    pub until_s: f64,
    /// Acceleration, or the amplitude of the wave \[m/s²\].
    pub accel_mps2: f64,
    /// Its course.
    pub shape: Shape,
}

impl Phase {
    /// The acceleration at an instant \[m/s²\]; zero outside the phase.
    fn accel_mps2(&self, time_s: f64) -> f64 {
        if !(self.from_s..self.until_s).contains(&time_s) {
            return 0.0;
        }
        let share = (time_s - self.from_s) / (self.until_s - self.from_s);
        let half_turns = match self.shape {
            Shape::Constant { rise_s } if rise_s > 0.0 => {
                let nearest_end_s = (time_s - self.from_s).min(self.until_s - time_s);
                return self.accel_mps2 * (nearest_end_s / rise_s).min(1.0);
            }
            Shape::Constant { .. } => return self.accel_mps2,
            Shape::HalfSine => share,
            Shape::Sine { periods } => 2.0 * f64::from(periods) * share,
        };
        self.accel_mps2 * libm::sin(core::f64::consts::PI * half_turns)
    }
}

/// A truck that follows a script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scripted {
    phases: [Phase; PHASES_MAX],
    time_s: f64,
    state: TruckState,
    acceleration: BodyAcceleration,
}

impl Scripted {
    /// A truck that rolls as `start` says and then follows the phases, which add up where they
    /// overlap.
    pub fn new(phases: &[Phase; PHASES_MAX], start: TruckState) -> Self {
        Self {
            phases: *phases,
            time_s: 0.0,
            state: start,
            acceleration: BodyAcceleration::default(),
        }
    }

    /// Advances by `dt_s` seconds.
    pub fn step(&mut self, dt_s: f64) {
        let accel_mps2 =
            |time_s: f64| -> f64 { self.phases.iter().map(|phase| phase.accel_mps2(time_s)).sum() };
        let before_mps = self.state.forward_mps;
        // The middle of the step: exact for what is constant over it, of second order otherwise.
        let after_mps = before_mps + accel_mps2(self.time_s + 0.5 * dt_s) * dt_s;
        self.state.forward_mps = after_mps.max(0.0);
        self.state.x_m += 0.5 * (before_mps + self.state.forward_mps) * dt_s;
        self.acceleration.forward_mps2 = (self.state.forward_mps - before_mps) / dt_s;
        self.time_s += dt_s;
    }

    /// Its speeds from now on, at N points `step_s` apart \[m/s\].
    pub fn speeds<const N: usize>(&self, step_s: f64) -> [f64; N] {
        let mut ahead = *self;
        core::array::from_fn(|k| {
            for _ in 0..if k == 0 { 0 } else { PREVIEW_STEPS } {
                ahead.step(step_s / f64::from(PREVIEW_STEPS));
            }
            ahead.state.forward_mps
        })
    }

    /// The state.
    pub fn state(&self) -> &TruckState {
        &self.state
    }

    /// The acceleration over the last step.
    pub fn acceleration(&self) -> &BodyAcceleration {
        &self.acceleration
    }

    /// Mass \[kg\].
    pub fn mass_kg(&self) -> f64 {
        MASS_KG
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(phase: Phase, duration_s: f64) -> Scripted {
        let mut phases = [Phase::default(); PHASES_MAX];
        phases[0] = phase;
        let start = TruckState { forward_mps: 20.0, ..TruckState::default() };
        let mut truck = Scripted::new(&phases, start);
        for _ in 0..(duration_s * 1e3).round() as u32 {
            truck.step(1e-3);
        }
        truck
    }

    #[test]
    fn speed_and_distance_are_the_integrals_of_the_script() {
        // Zheng's profile: 2 m/s² from 1 s to 2 s; 20 to 22 m/s.
        let phase = Phase { from_s: 1.0, until_s: 2.0, accel_mps2: 2.0, ..Phase::default() };
        let truck = drive(phase, 3.0);
        assert!((truck.state().forward_mps - 22.0).abs() < 1e-9);
        assert!((truck.state().x_m - (20.0 + 21.0 + 22.0)).abs() < 1e-6);
        assert_eq!(truck.acceleration().forward_mps2, 0.0);
    }

    #[test]
    fn the_speeds_it_foresees_are_those_it_will_have() {
        let phase = Phase { from_s: 1.0, until_s: 2.5, accel_mps2: 2.0, shape: Shape::HalfSine };
        let foreseen: [f64; 21] = drive(phase, 0.95).speeds(0.1);
        for (k, speed_mps) in foreseen.into_iter().enumerate() {
            let real_mps = drive(phase, 0.95 + 0.1 * k as f64).state().forward_mps;
            assert!((speed_mps - real_mps).abs() < 1e-4, "{k}: {speed_mps} {real_mps}");
        }
    }

    #[test]
    fn shapes_gain_what_their_integral_says() {
        let shapes = [
            (Shape::default(), 1.0),
            (Shape::Constant { rise_s: 0.6 }, 0.7),
            (Shape::HalfSine, core::f64::consts::FRAC_2_PI),
            (Shape::Sine { periods: 3 }, 0.0),
        ];
        for (shape, share) in shapes {
            let phase = Phase { from_s: 0.5, until_s: 2.5, accel_mps2: 1.5, shape };
            let gained_mps = drive(phase, 4.0).state().forward_mps - 20.0;
            assert!((gained_mps - 3.0 * share).abs() < 1e-5, "{shape:?}: {gained_mps}");
        }
    }

    #[test]
    fn a_scripted_truck_stops_and_does_not_reverse() {
        let brake = Phase { until_s: 10.0, accel_mps2: -5.0, ..Phase::default() };
        let truck = drive(brake, 10.0);
        assert_eq!(truck.state().forward_mps, 0.0);
        assert!((truck.state().x_m - 40.0).abs() < 0.05, "{}", truck.state().x_m);
    }
}
