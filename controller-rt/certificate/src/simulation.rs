//! A platoon in the time domain, under delays that no matrix inequality was told about.
//!
//! The followers are lags, a_i' = (u_i - a_i)/tau; every one sees its own delay. The step is short
//! enough that holding the command over it does not show.

use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::gain::Gain;

/// Step \[s\].
const STEP_S: f64 = 2e-3;

/// How a delay moves between 0 and its bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// It stays at this fraction of the bound.
    Constant(f64),
    /// A message of the bound's age less one period is held until the next one comes.
    Sawtooth {
        /// Time between messages \[s\].
        period_s: f64,
    },
    /// Jumps between none and the bound at random times.
    BangBang,
    /// Straight lines between random values, half a second apart.
    Wander,
}

/// What the leader does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leader {
    /// 2 m/s² from 1 s to 2 s: the paper's platooning scenario.
    Ramp,
    /// A smooth push of this length, sin², of 2 m/s².
    Push {
        /// Its length \[s\].
        length_s: f64,
    },
    /// A tone that swells and fades.
    Tone {
        /// Its frequency \[rad/s\].
        w_radps: f64,
    },
}

impl Leader {
    /// Acceleration \[m/s²\].
    fn accel_mps2(self, t_s: f64) -> f64 {
        match self {
            Self::Ramp => f64::from(u8::from(t_s > 1.0 && t_s <= 2.0)) * 2.0,
            Self::Push { length_s } => {
                let phase = (t_s - 1.0) / length_s;
                if (0.0..1.0).contains(&phase) { 2.0 * (PI * phase).sin().powi(2) } else { 0.0 }
            }
            Self::Tone { w_radps } => {
                let phase = (t_s - 1.0) / 12.0;
                if (0.0..1.0).contains(&phase) {
                    (PI * phase).sin().powi(2) * (w_radps * t_s).sin()
                } else {
                    0.0
                }
            }
        }
    }

    /// Rate of the acceleration \[m/s³\]; meaningless for the ramp, which jumps.
    fn jerk_mps3(self, t_s: f64) -> f64 {
        let dt = 1e-5;
        (self.accel_mps2(t_s + dt) - self.accel_mps2(t_s - dt)) / (2.0 * dt)
    }
}

/// A run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// The gain.
    pub gain: Gain,
    /// Lag of each follower \[s\].
    pub lags_s: Vec<f64>,
    /// Bound of the delays \[s\].
    pub longest_s: f64,
    /// How they move.
    pub course: Course,
    /// What the leader does.
    pub leader: Leader,
    /// Length of the run \[s\].
    pub duration_s: f64,
    /// Seed of the delays.
    pub seed: u64,
}

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Outcome {
    /// Largest position error of any follower \[m\].
    pub error_max_m: f64,
    /// Largest position error in the last second \[m\].
    pub error_end_m: f64,
    /// Largest command \[m/s²\].
    pub command_max_mps2: f64,
    /// Energy of the first follower's position error over that of w, square root.
    pub first_gain: f64,
    /// Energy of all position errors over that of every follower's w, square root.
    pub platoon_gain: f64,
}

impl Run {
    /// One follower in the paper's platooning scenario, under the constant delay of its comparison
    /// of gains.
    #[must_use]
    pub fn ramp(gain: Gain, lag_s: f64) -> Self {
        Self {
            gain,
            lags_s: vec![lag_s],
            longest_s: 0.1,
            course: Course::Constant(1.0),
            leader: Leader::Ramp,
            duration_s: 8.0,
            seed: 0,
        }
    }

    /// Simulates it.
    #[must_use]
    pub fn simulate(&self) -> Outcome {
        let n = self.lags_s.len();
        let mut trucks: Vec<Truck> = vec![Truck::default(); n];
        let depth = (self.longest_s / STEP_S).ceil() as usize + 2;
        let mut past = vec![vec![[0.0; 3]; n]; depth];
        let mut delays: Vec<Delay> =
            (0..n).map(|i| Delay::new(self.course, self.longest_s, self.seed + i as u64)).collect();
        let (mut outcome, mut first, mut all, mut pushed) = (Outcome::default(), 0.0, 0.0, 0.0);
        let steps = (self.duration_s / STEP_S) as usize;
        for step in 0..steps {
            let t_s = step as f64 * STEP_S;
            let accel = self.leader.accel_mps2(t_s);
            past.rotate_right(1);
            for (truck, newest) in trucks.iter().zip(past[0].iter_mut()) {
                *newest = truck.error(accel);
            }
            for i in 0..n {
                let delay_s = delays[i].at(t_s);
                let ahead = if i > 0 { at(&past, i - 1, delay_s) } else { [0.0; 3] };
                let mut u = dot(&self.gain.k1, &at(&past, i, delay_s)) + dot(&self.gain.k2, &ahead);
                if self.gain.leader_feedforward {
                    u += self.leader.accel_mps2(t_s - delay_s);
                }
                trucks[i].advance(u, accel, self.lags_s[i]);
                outcome.command_max_mps2 = outcome.command_max_mps2.max(u.abs());
                let error = trucks[i].position_m.abs();
                outcome.error_max_m = outcome.error_max_m.max(error);
                if t_s > self.duration_s - 1.0 {
                    outcome.error_end_m = outcome.error_end_m.max(error);
                }
                all += error * error;
                first += if i == 0 { error * error } else { 0.0 };
            }
            pushed += accel * accel + self.leader.jerk_mps3(t_s).powi(2);
        }
        outcome.first_gain = (first / pushed).sqrt();
        outcome.platoon_gain = (all / (pushed * n as f64)).sqrt();
        outcome
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A follower relative to the leader.
#[derive(Debug, Clone, Copy, Default)]
struct Truck {
    /// Position error \[m\].
    position_m: f64,
    /// Speed error \[m/s\].
    speed_mps: f64,
    /// Its own acceleration \[m/s²\].
    accel_mps2: f64,
}

impl Truck {
    fn error(&self, leader_accel_mps2: f64) -> [f64; 3] {
        [self.position_m, self.speed_mps, leader_accel_mps2 - self.accel_mps2]
    }

    fn advance(&mut self, u: f64, leader_accel_mps2: f64, lag_s: f64) {
        let accel = u + (self.accel_mps2 - u) * (-STEP_S / lag_s).exp();
        let error = leader_accel_mps2 - 0.5 * (accel + self.accel_mps2);
        let speed = self.speed_mps + error * STEP_S;
        self.position_m += 0.5 * (self.speed_mps + speed) * STEP_S;
        (self.speed_mps, self.accel_mps2) = (speed, accel);
    }
}

/// The error state of a truck some time ago, between two recorded ones.
fn at(past: &[Vec<[f64; 3]>], truck: usize, delay_s: f64) -> [f64; 3] {
    let steps = delay_s / STEP_S;
    let newer = (steps.floor() as usize).min(past.len() - 2);
    let share = (steps - newer as f64).clamp(0.0, 1.0);
    let (new, old) = (past[newer][truck], past[newer + 1][truck]);
    [0, 1, 2].map(|state| new[state] * (1.0 - share) + old[state] * share)
}

/// One follower's delay.
struct Delay {
    course: Course,
    longest_s: f64,
    random: ChaCha8Rng,
    from: (f64, f64),
    to: (f64, f64),
}

impl Delay {
    fn new(course: Course, longest_s: f64, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let start = uniform(&mut random) * longest_s;
        Self { course, longest_s, random, from: (0.0, start), to: (0.0, start) }
    }

    /// The delay at a time that never goes back \[s\].
    fn at(&mut self, t_s: f64) -> f64 {
        match self.course {
            Course::Constant(share) => share * self.longest_s,
            Course::Sawtooth { period_s } => {
                let period_s = period_s.min(self.longest_s);
                self.longest_s - period_s + t_s % period_s
            }
            Course::BangBang => {
                if t_s >= self.to.0 {
                    let far = if self.to.1 > 0.0 { 0.0 } else { self.longest_s };
                    self.to = (t_s + 0.02 + 0.6 * uniform(&mut self.random), far);
                }
                self.to.1
            }
            Course::Wander => {
                if t_s >= self.to.0 {
                    self.from = self.to;
                    self.to = (t_s + 0.5, uniform(&mut self.random) * self.longest_s);
                }
                let share = ((t_s - self.from.0) / (self.to.0 - self.from.0)).clamp(0.0, 1.0);
                self.from.1 * (1.0 - share) + self.to.1 * share
            }
        }
    }
}

/// Uniform in [0, 1).
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}
