//! The delay of one link as a function of time, and what is measured of it.
//!
//! ```text
//! λ(t) linear between knots every 0.5 s,  knot ~ U[min, max] clipped to ± rate · 0.5 s of the last
//! ```
//!
//! Messages can only be handed over at a base step, so λ is rounded to whole base steps, inside
//! its bounds. A message generated on the step grid is therefore delivered exactly λ later, and the
//! bounds hold for the delays measured from the messages. Rounding moves each end of a measured
//! slope by up to half a step; the drawn rate is lowered by that much over the measuring window, so
//! that the measured rate keeps the bound too.

use crate::noise::Dice;
use crate::scenario::V2v;

/// Time between knots \[ns\].
const KNOT_NS: u64 = 500_000_000;

/// Shortest time between two messages whose delays are compared for the rate \[ns\].
const RATE_WINDOW_NS: u64 = 250_000_000;

/// Messages remembered to find one a window ago; a window holds at most 25 at the fastest radio.
const REMEMBERED: usize = 32;

/// λ(t) of one link.
#[derive(Debug, Clone)]
pub(super) struct Delay {
    dice: Dice,
    bounds_s: (f64, f64),
    knot_step_max_s: f64,
    base_step_ns: u64,
    segment: u64,
    knots_s: (f64, f64),
}

impl Delay {
    /// A delay within the channel's bounds, rounded to whole base steps.
    pub(super) fn new(settings: &V2v, base_step_ns: u64, mut dice: Dice) -> Self {
        let step_s = base_step_ns as f64 * 1e-9;
        let rounding = step_s / (RATE_WINDOW_NS as f64 * 1e-9);
        let rate = (settings.delay_rate_max - rounding).max(0.0);
        let bounds_s = inward(settings.delay_min_s, settings.delay_max_s, step_s);
        let first_s = dice.between(bounds_s.0, bounds_s.1);
        let mut delay = Self {
            dice,
            bounds_s,
            knot_step_max_s: rate * KNOT_NS as f64 * 1e-9,
            base_step_ns,
            segment: 0,
            knots_s: (first_s, first_s),
        };
        delay.knots_s.1 = delay.next_knot_s();
        delay
    }

    /// The delay of a message generated at `time_ns` \[ns\]; times must not run backwards by more
    /// than a knot.
    pub(super) fn at(&mut self, time_ns: u64) -> u64 {
        while time_ns / KNOT_NS > self.segment {
            self.segment += 1;
            self.knots_s.0 = self.knots_s.1;
            self.knots_s.1 = self.next_knot_s();
        }
        let since_ns = time_ns.saturating_sub(self.segment * KNOT_NS);
        let share = since_ns as f64 / KNOT_NS as f64;
        let delay_s = self.knots_s.0 + share * (self.knots_s.1 - self.knots_s.0);
        let steps = libm::round(delay_s * 1e9 / self.base_step_ns as f64);
        steps as u64 * self.base_step_ns
    }

    fn next_knot_s(&mut self) -> f64 {
        let (low_s, high_s) = self.bounds_s;
        let last_s = self.knots_s.1;
        let drawn_s = self.dice.between(low_s, high_s);
        drawn_s.clamp(last_s - self.knot_step_max_s, last_s + self.knot_step_max_s)
    }
}

/// The bounds moved inwards to whole steps; both the nearest step when no step lies between them.
fn inward(low_s: f64, high_s: f64, step_s: f64) -> (f64, f64) {
    // A bound written in decimal is not exactly a multiple of the step; a millionth of a step is.
    let low = libm::ceil(low_s / step_s - 1e-6);
    let high = libm::floor(high_s / step_s + 1e-6);
    if low <= high {
        return (low * step_s, high * step_s);
    }
    let nearest_s = libm::round(0.5 * (low_s + high_s) / step_s) * step_s;
    (nearest_s, nearest_s)
}

/// The delays a link really produced, measured from its messages.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Shortest and longest delay \[ns\].
    pub(super) range_ns: Option<(u64, u64)>,
    /// Largest slope of the delay over at least a window of generation time \[s/s\].
    pub(super) rate_max: Option<f64>,
    /// Delay of the newest message \[ns\].
    pub(super) newest_ns: Option<u64>,
    history: [(u64, u64); REMEMBERED],
    count: usize,
}

impl Measured {
    pub(super) fn new() -> Self {
        let history = [(0, 0); REMEMBERED];
        Self { range_ns: None, rate_max: None, newest_ns: None, history, count: 0 }
    }

    /// Takes in one delivered message.
    pub(super) fn take(&mut self, generated_ns: u64, delivered_ns: u64) {
        let delay_ns = delivered_ns.saturating_sub(generated_ns);
        let (low, high) = self.range_ns.unwrap_or((delay_ns, delay_ns));
        self.range_ns = Some((low.min(delay_ns), high.max(delay_ns)));
        self.newest_ns = Some(delay_ns);
        if let Some((then_ns, then_delay_ns)) = self.a_window_before(generated_ns) {
            let rate = delay_ns.abs_diff(then_delay_ns) as f64 / (generated_ns - then_ns) as f64;
            self.rate_max = Some(self.rate_max.unwrap_or(0.0).max(rate));
        }
        self.history[self.count % REMEMBERED] = (generated_ns, delay_ns);
        self.count += 1;
    }

    /// The newest remembered message generated at least a window earlier.
    fn a_window_before(&self, generated_ns: u64) -> Option<(u64, u64)> {
        let known = &self.history[..self.count.min(REMEMBERED)];
        known
            .iter()
            .filter(|(then_ns, _)| then_ns + RATE_WINDOW_NS <= generated_ns)
            .max_by_key(|(then_ns, _)| *then_ns)
            .copied()
    }
}
