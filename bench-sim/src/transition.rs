//! A number that moves smoothly from one value to another over a span of time.
//!
//! The quintic `10 p³ - 15 p⁴ + 6 p⁵` has no rate and no acceleration at either end, the usual
//! shape of a smooth lane change; its fastest rate is 15/8 of the mean.

/// Fastest rate over mean rate.
pub(crate) const PEAK_RATE: f64 = 1.875;

/// One move of one number; a span of zero is a jump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Transition {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) from_s: f64,
    pub(crate) until_s: f64,
}

impl Transition {
    /// A number that stays as it is.
    pub(crate) fn at_rest(value: f64) -> Self {
        Self { from: value, to: value, from_s: 0.0, until_s: 0.0 }
    }

    /// The value at an instant.
    pub(crate) fn value(&self, time_s: f64) -> f64 {
        let p = self.share(time_s);
        self.from + (self.to - self.from) * p * p * p * (10.0 + p * (6.0 * p - 15.0))
    }

    /// How fast it changes then \[per s\].
    pub(crate) fn rate(&self, time_s: f64) -> f64 {
        let p = self.share(time_s);
        if p <= 0.0 || p >= 1.0 {
            return 0.0;
        }
        (self.to - self.from) * 30.0 * p * p * (1.0 - p) * (1.0 - p) / (self.until_s - self.from_s)
    }

    /// Whether it still moves at an instant.
    pub(crate) fn is_moving(&self, time_s: f64) -> bool {
        self.from != self.to && self.share(time_s) < 1.0
    }

    fn share(&self, time_s: f64) -> f64 {
        let span_s = self.until_s - self.from_s;
        if span_s > 0.0 {
            ((time_s - self.from_s) / span_s).clamp(0.0, 1.0)
        } else {
            f64::from(u8::from(time_s >= self.from_s))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_starts_and_ends_at_rest_and_is_fastest_halfway() {
        let move_ = Transition { from: 2.0, to: -2.0, from_s: 1.0, until_s: 5.0 };
        assert_eq!((move_.value(0.0), move_.value(1.0), move_.value(5.0)), (2.0, 2.0, -2.0));
        assert_eq!((move_.rate(1.0), move_.rate(5.0)), (0.0, 0.0));
        assert!((move_.rate(3.0) + PEAK_RATE).abs() < 1e-12);
        for k in 1..400 {
            let t_s = 1.0 + f64::from(k) * 0.01;
            let slope = (move_.value(t_s + 1e-5) - move_.value(t_s - 1e-5)) / 2e-5;
            assert!((slope - move_.rate(t_s)).abs() < 1e-6);
        }
        assert!(move_.is_moving(0.0) && move_.is_moving(4.999) && !move_.is_moving(5.0));
    }

    #[test]
    fn no_span_is_a_jump() {
        let jump = Transition { from: 1.0, to: 3.0, from_s: 2.0, until_s: 2.0 };
        assert_eq!((jump.value(1.999), jump.value(2.0)), (1.0, 3.0));
        assert_eq!(jump.rate(2.0), 0.0);
        assert!(!Transition::at_rest(4.0).is_moving(0.0));
    }
}
