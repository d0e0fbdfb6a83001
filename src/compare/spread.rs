//! Medians and bands over seeds.

use serde::{Deserialize, Serialize};

/// How a number varies over the seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// 5 % of the runs are below.
    pub p5: f64,
    /// Half of them are.
    pub median: f64,
    /// 95 % of them are.
    pub p95: f64,
    /// The least.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// How many runs there are.
    pub runs: usize,
}

impl Spread {
    /// The spread of some numbers; `None` when there are none or one is not a number.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        if sorted.is_empty() || sorted.iter().any(|value| value.is_nan()) {
            return None;
        }
        sorted.sort_by(f64::total_cmp);
        Some(Self {
            p5: quantile(&sorted, 0.05),
            median: quantile(&sorted, 0.5),
            p95: quantile(&sorted, 0.95),
            min: sorted[0],
            max: sorted[sorted.len() - 1],
            runs: sorted.len(),
        })
    }

    /// In words: the median, and the 5-95 % band if there is one at these digits.
    pub fn text(&self, digits: usize) -> String {
        let [low, median, high] =
            [self.p5, self.median, self.p95].map(|value| fixed(value, digits));
        if low == high { median } else { format!("{median} [{low}, {high}]") }
    }
}

/// A number with so many digits behind the point, and never a negative zero.
pub fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|byte| matches!(byte, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}

/// The value below which a share of the sorted numbers lies, between two of them by the straight
/// line (type 7 of Hyndman and Fan 1996, the default of R and NumPy).
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let below = place as usize;
    let above = (below + 1).min(sorted.len() - 1);
    let part = place - below as f64;
    // Infinite values, such as a time that never came, must not become NaN.
    if part == 0.0 || sorted[below] == sorted[above] {
        return sorted[below];
    }
    sorted[below] + part * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile([1, 2, 4, 8, 16], [0.05, 0.5, 0.95])
        let spread = Spread::of([8.0, 1.0, 16.0, 2.0, 4.0]).expect("numbers");
        assert!((spread.p5 - 1.2).abs() < 1e-12);
        assert_eq!(spread.median, 4.0);
        assert!((spread.p95 - 14.4).abs() < 1e-12);
        assert_eq!((spread.min, spread.max, spread.runs), (1.0, 16.0, 5));
    }

    #[test]
    fn nothing_has_no_spread_and_what_never_came_is_the_largest() {
        assert_eq!(Spread::of([]), None);
        assert_eq!(Spread::of([1.0, f64::NAN]), None);
        let spread = Spread::of([1.0, f64::INFINITY]).expect("numbers");
        assert_eq!((spread.min, spread.max), (1.0, f64::INFINITY));
    }

    #[test]
    fn a_band_is_told_only_where_it_shows() {
        let spread = Spread::of([0.60, 0.64, 0.70]).expect("numbers");
        assert_eq!(spread.text(2), "0.64 [0.60, 0.69]");
        assert_eq!(Spread::of([0.601, 0.602]).expect("numbers").text(2), "0.60");
        assert_eq!(fixed(-0.0001, 2), "0.00");
    }
}
