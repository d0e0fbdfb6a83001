//! Seeded randomness: uniform draws, and first-order correlated Gaussian noise.
//!
//! Every source of chance has a generator of its own, on its own stream of the run's seed, so that
//! adding one never shifts the draws of another. ChaCha8 gives the same draws on every machine,
//! and so does `libm`.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Correlation time of the sensor noise \[s\].
const CORRELATION_S: f64 = 0.5;

/// A stream of the run's seed.
#[derive(Debug, Clone)]
pub(crate) struct Dice {
    generator: ChaCha8Rng,
}

/// What a stream of randomness belongs to; keeps the streams of a run apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stream {
    /// Delay of the V2V link between two trucks.
    Delay { from: usize, to: usize },
    /// Loss on the V2V link between two trucks.
    Loss { from: usize, to: usize },
    /// Navigation solution of a truck.
    Navigation { truck: usize },
    /// A truck's measurement of a target in one page of its sensor.
    Target { truck: usize, page: usize },
}

impl Stream {
    fn number(self) -> u64 {
        let (kind, a, b) = match self {
            Self::Delay { from, to } => (1, from, to),
            Self::Loss { from, to } => (2, from, to),
            Self::Navigation { truck } => (3, truck, 0),
            Self::Target { truck, page } => (4, truck, page),
        };
        (kind << 32) | ((a as u64) << 16) | b as u64
    }
}

impl Dice {
    /// The given stream of a run's seed.
    pub(crate) fn new(seed: u64, stream: Stream) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream.number());
        Self { generator }
    }

    /// Uniform in \[0, 1), on a grid of 2⁻⁵³.
    pub(crate) fn uniform(&mut self) -> f64 {
        const GRID: f64 = 1.0 / (1_u64 << 53) as f64;
        (self.generator.next_u64() >> 11) as f64 * GRID
    }

    /// Uniform between two bounds.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Standard normal (Box and Muller, 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        radius * libm::cos(core::f64::consts::TAU * self.uniform())
    }
}

/// `N` channels of first-order Gauss-Markov noise:
///
/// ```text
/// n(t + dt) = a n(t) + sigma sqrt(1 - a²) w,   a = exp(-dt / 0.5 s),  w ~ N(0, 1)
/// ```
///
/// Stationary from the first sample on. With every sigma 0 it draws nothing and stays 0.
#[derive(Debug, Clone)]
pub(crate) struct Correlated<const N: usize> {
    dice: Dice,
    sigma: [f64; N],
    value: [f64; N],
    silent: bool,
}

impl<const N: usize> Correlated<N> {
    /// Noise with the given standard deviation per channel.
    pub(crate) fn new(dice: Dice, sigma: [f64; N]) -> Self {
        let silent = sigma.iter().all(|&s| s == 0.0);
        let mut noise = Self { dice, sigma, value: [0.0; N], silent };
        noise.restart();
        noise
    }

    /// Draws a fresh, independent sample.
    pub(crate) fn restart(&mut self) {
        if !self.silent {
            self.value = self.sigma.map(|sigma| sigma * self.dice.normal());
        }
    }

    /// Lets `dt_s` seconds pass.
    pub(crate) fn advance(&mut self, dt_s: f64) {
        if self.silent {
            return;
        }
        let keep = libm::exp(-dt_s / CORRELATION_S);
        let fresh = (1.0 - keep * keep).sqrt();
        for (value, sigma) in self.value.iter_mut().zip(self.sigma) {
            *value = keep * *value + fresh * sigma * self.dice.normal();
        }
    }

    /// The noise now.
    pub(crate) fn value(&self) -> &[f64; N] {
        &self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlated_noise_has_its_sigma_and_its_time_constant() {
        let dice = Dice::new(7, Stream::Navigation { truck: 0 });
        let mut noise = Correlated::new(dice, [0.01]);
        let (mut power, mut lagged) = (0.0, 0.0);
        let samples = 400_000;
        let mut history = [0.0; 50];
        for k in 0..samples {
            noise.advance(0.01);
            let value = noise.value()[0];
            power += value * value;
            lagged += value * history[k % 50];
            history[k % 50] = value;
        }
        let sigma = (power / samples as f64).sqrt();
        assert!((sigma / 0.01 - 1.0).abs() < 0.05, "sigma {sigma}");
        // Half a second back the correlation is 1/e.
        assert!((lagged / power - libm::exp(-1.0)).abs() < 0.05, "{}", lagged / power);
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let draw = |seed, stream| Dice::new(seed, stream).uniform();
        let a = Stream::Delay { from: 0, to: 1 };
        assert_eq!(draw(1, a), draw(1, a));
        assert_ne!(draw(1, a), draw(2, a));
        assert_ne!(draw(1, a), draw(1, Stream::Loss { from: 0, to: 1 }));
        assert_ne!(draw(1, a), draw(1, Stream::Delay { from: 1, to: 2 }));
    }

    #[test]
    fn no_sigma_means_exactly_no_noise() {
        let mut noise = Correlated::new(Dice::new(1, Stream::Navigation { truck: 0 }), [0.0; 3]);
        noise.advance(0.1);
        assert_eq!(noise.value(), &[0.0; 3]);
    }
}
