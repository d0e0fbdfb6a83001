//! Curves of any length in a bounded number of points that keep every extreme.
//!
//! Time is cut into buckets of equal width; of each, a curve keeps its least and its largest value
//! in the order in which they came. A bucket is drawn as two points, half a width apart, so a curve
//! whose samples come two per bucket is kept as it is. When a run outgrows the buckets, their
//! width doubles.

/// Most buckets of a curve: two points each are more than any screen is wide.
const BUCKETS_MAX: usize = 8000;

/// What a curve keeps of one bucket; empty while `low > high`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bucket {
    low: f32,
    high: f32,
    /// Whether the least value came before the largest.
    rises: bool,
}

impl Bucket {
    const EMPTY: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY, rises: true };

    fn is_empty(self) -> bool {
        self.low > self.high
    }

    fn add(&mut self, value: f32) {
        if value < self.low {
            (self.low, self.rises) = (value, false);
        }
        if value > self.high {
            (self.high, self.rises) = (value, true);
        }
    }

    /// This bucket and the one after it as one.
    fn joined(self, later: Self) -> Self {
        if self.is_empty() || later.is_empty() {
            return if self.is_empty() { later } else { self };
        }
        let mut both = self;
        let (first, last) = later.points();
        both.add(first);
        both.add(last);
        both
    }

    /// Its two points; not numbers when it is empty.
    fn points(self) -> (f32, f32) {
        match (self.is_empty(), self.rises) {
            (true, _) => (f32::NAN, f32::NAN),
            (false, true) => (self.low, self.high),
            (false, false) => (self.high, self.low),
        }
    }
}

/// Curves over one axis of time.
#[derive(Debug, Clone)]
pub struct Envelopes {
    width_ns: u64,
    curves: Vec<Vec<Bucket>>,
}

impl Envelopes {
    /// `count` curves of samples that come every `period_ns`.
    pub fn new(count: usize, period_ns: u64) -> Self {
        Self { width_ns: 2 * period_ns.max(1), curves: vec![Vec::new(); count] }
    }

    /// Adds a value; what is no finite number leaves a gap.
    pub fn add(&mut self, curve: usize, time_ns: u64, value: f64) {
        while time_ns / self.width_ns >= BUCKETS_MAX as u64 {
            self.coarsen();
        }
        let place = (time_ns / self.width_ns) as usize;
        let value = value as f32;
        if let Some(curve) = self.curves.get_mut(curve).filter(|_| value.is_finite()) {
            if curve.len() <= place {
                curve.resize(place + 1, Bucket::EMPTY);
            }
            curve[place].add(value);
        }
    }

    fn coarsen(&mut self) {
        self.width_ns *= 2;
        for curve in &mut self.curves {
            let joined = |pair: &[Bucket]| pair.iter().skip(1).fold(pair[0], |a, b| a.joined(*b));
            *curve = curve.chunks(2).map(joined).collect();
        }
    }

    /// Time between two points \[s\].
    pub fn step_s(&self) -> f64 {
        0.5e-9 * self.width_ns as f64
    }

    /// Points of every curve.
    pub fn points(&self) -> usize {
        2 * self.curves.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// The values of a curve, `points` of them, not numbers where there is none.
    pub fn values(&self, curve: usize) -> Vec<f32> {
        let pairs = self.curves[curve].iter().map(|bucket| bucket.points());
        let mut values: Vec<f32> = pairs.flat_map(|(first, last)| [first, last]).collect();
        values.resize(self.points(), f32::NAN);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_samples_per_bucket_are_kept_as_they_are() {
        let mut curves = Envelopes::new(1, 10);
        let samples = [3.0, 1.0, 4.0, 1.0, 5.0, 9.0];
        for (index, value) in samples.iter().enumerate() {
            curves.add(0, 10 * index as u64, *value);
        }
        assert_eq!(curves.values(0), samples.map(|value| value as f32));
        assert!((curves.step_s() - 10e-9).abs() < 1e-20);
    }

    #[test]
    fn no_length_of_run_loses_an_extreme() {
        let mut curves = Envelopes::new(2, 1);
        let last = 100 * BUCKETS_MAX as u64;
        for time_ns in 0..last {
            let spike = if time_ns == 54_321 { -7.0 } else { 0.0 };
            curves.add(0, time_ns, if time_ns == last / 3 { 8.0 } else { spike });
        }
        let values = curves.values(0);
        assert!(values.len() <= 2 * BUCKETS_MAX);
        let at = |wanted: f32| values.iter().position(|value| *value == wanted);
        let (spike, peak) = (at(-7.0).expect("kept"), at(8.0).expect("kept"));
        let time_ns = |point: usize| point as f64 * curves.step_s() * 1e9;
        assert!((time_ns(spike) - 54_321.0).abs() <= 1e9 * curves.step_s());
        assert!((time_ns(peak) - last as f64 / 3.0).abs() <= 2e9 * curves.step_s());
        assert!(curves.values(1).iter().all(|value| value.is_nan()), "a curve without samples");
    }

    #[test]
    fn what_is_no_number_leaves_a_gap() {
        let mut curves = Envelopes::new(1, 10);
        curves.add(0, 0, 1.0);
        curves.add(0, 20, f64::NAN);
        curves.add(0, 40, 2.0);
        let gaps: Vec<bool> = curves.values(0).iter().map(|value| value.is_nan()).collect();
        assert_eq!(gaps, [false, false, true, true, false, false]);
    }

    #[test]
    fn coarser_buckets_keep_the_order_of_extremes() {
        let mut curves = Envelopes::new(1, 10);
        for (index, value) in [5.0, 1.0, 0.0, 3.0].into_iter().enumerate() {
            curves.add(0, 10 * index as u64, value);
        }
        curves.coarsen();
        assert_eq!(curves.values(0), [5.0, 0.0]);
    }
}
