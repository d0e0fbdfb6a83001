//! Shares of slots and how sure they are.

/// Two-sided 95 % quantile of the normal distribution.
const Z_95: f64 = 1.96;

/// How often something happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Share {
    /// Times it happened.
    pub events: u64,
    /// Times it could have.
    pub trials: u64,
}

impl Share {
    /// The share seen; 0 of nothing.
    pub fn share(self) -> f64 {
        self.events as f64 / self.trials.max(1) as f64
    }

    /// Wilson's 95 % interval of the underlying probability
    /// [E. B. Wilson, J. Am. Stat. Assoc. 22 (1927)].
    pub fn interval(self) -> (f64, f64) {
        if self.trials == 0 {
            return (0.0, 1.0);
        }
        let n = self.trials as f64;
        let p = self.events as f64 / n;
        let z2 = Z_95 * Z_95;
        let centre = p + z2 / (2.0 * n);
        let reach = Z_95 * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z2 / n;
        (((centre - reach) / scale).max(0.0), ((centre + reach) / scale).min(1.0))
    }
}

/// Slots lost, and in how many runs of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Slots lost, of all.
    pub slots: Share,
    /// Runs of lost slots without a good one between.
    pub lapses: u64,
}

impl Losses {
    /// Lower end of the interval of the share lost: slots of one lapse are not independent, so the
    /// interval is that of lapses, times the slots that one costs on average.
    pub fn least(self) -> f64 {
        if self.lapses == 0 {
            return 0.0;
        }
        let lapses = Share { events: self.lapses, trials: self.slots.trials };
        lapses.interval().0 * self.slots.events as f64 / self.lapses as f64
    }

    /// These losses if no pause of the machine can have been taken for them, else none.
    ///
    /// A sentinel sees no pause up to `unseen_ns`. Who loses n slots at a time was busy for more
    /// than n - 1/2 periods, because a slot can begin half a period late. One lost slot alone is
    /// never beyond doubt.
    pub fn beyond_doubt(self, period_ns: u64, unseen_ns: u64) -> Self {
        let (n, lapses) = (self.slots.events, self.lapses);
        let is_many = n >= 2 * lapses;
        let is_long = (2 * n).saturating_sub(lapses) * period_ns > 2 * lapses * unseen_ns;
        match is_many && is_long {
            true => self,
            false => Self { slots: Share { events: 0, ..self.slots }, lapses: 0 },
        }
    }

    /// Both.
    pub fn and(self, other: Self) -> Self {
        let slots = Share {
            events: self.slots.events + other.slots.events,
            trials: self.slots.trials + other.slots.trials,
        };
        Self { slots, lapses: self.lapses + other.lapses }
    }
}
