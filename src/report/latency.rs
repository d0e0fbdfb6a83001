//! How long the phases of a tick take: percentiles, and a histogram over the logarithm of time.

use serde::Serialize;

/// Bins per factor of ten.
const PER_DECADE: f64 = 20.0;
/// Where the first bin begins \[ns\].
const FIRST_NS: f64 = 10.0;

/// The durations of one phase of one ECU.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Latency {
    /// The truck whose ECU it is.
    pub ecu: u8,
    /// The phase, in the words of `summary.json`.
    pub phase: &'static str,
    /// Percentiles \[µs\]: 50, 90, 99, 99.9, 100.
    pub percentiles_us: [f64; 5],
    /// Bin of the shortest duration.
    first: usize,
    /// Durations in that bin and the following ones.
    counts: Vec<u32>,
}

/// How bins are laid out, for the page.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Bins {
    first_us: f64,
    per_decade: f64,
}

impl Bins {
    /// The bins of every [`Latency`].
    pub const ALL: Self = Self { first_us: 1e-3 * FIRST_NS, per_decade: PER_DECADE };
}

impl Latency {
    /// What these durations \[ns\] amount to; none when there are none, or all are zero, as in
    /// virtual time.
    pub fn of(ecu: u8, phase: &'static str, mut durations_ns: Vec<u32>) -> Option<Self> {
        durations_ns.sort_unstable();
        let longest = durations_ns.last().filter(|longest| **longest > 0)?;
        let bin = |ns: u32| (PER_DECADE * (f64::from(ns) / FIRST_NS).log10()).max(0.0) as usize;
        let first = bin(durations_ns[0]);
        let mut counts = vec![0u32; bin(*longest) - first + 1];
        for ns in &durations_ns {
            counts[bin(*ns) - first] += 1;
        }
        // The least duration that this share does not exceed.
        let percentile = |share: f64| {
            let rank = (share * durations_ns.len() as f64).ceil() as usize;
            1e-3 * f64::from(durations_ns[rank.clamp(1, durations_ns.len()) - 1])
        };
        let percentiles_us = [0.5, 0.9, 0.99, 0.999, 1.0].map(percentile);
        Some(Self { ecu, phase, percentiles_us, first, counts })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_durations_that_occurred() {
        let latency = Latency::of(0, "qp", (1..=1000).map(|us| 1000 * us).collect());
        let latency = latency.expect("durations");
        assert_eq!(latency.percentiles_us, [500.0, 900.0, 990.0, 999.0, 1000.0]);
        assert_eq!(latency.counts.iter().sum::<u32>(), 1000);
    }

    #[test]
    fn virtual_time_has_no_latency() {
        assert_eq!(Latency::of(0, "qp", vec![0; 10]), None);
        assert_eq!(Latency::of(0, "qp", Vec::new()), None);
    }

    #[test]
    fn bins_are_as_wide_as_the_page_is_told() {
        let latency = Latency::of(0, "qp", vec![1_000, 10_000]).expect("durations");
        assert_eq!((latency.first, latency.counts.len()), (40, 21));
    }
}
