//! How long the phases of a tick take, and how late the machine is by itself: percentiles, and a
//! histogram over the logarithm of time.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;

/// Bins per factor of ten.
const PER_DECADE: f64 = 20.0;
/// Where the first bin begins \[ns\].
const FIRST_NS: f64 = 10.0;
/// The shares of [`Spread::percentiles_us`].
const SHARES: [f64; 5] = [0.5, 0.9, 0.99, 0.999, 1.0];

/// The durations of one phase of one ECU.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Latency {
    /// The truck whose ECU it is.
    pub ecu: u8,
    /// The phase, in the words of `summary.json`.
    pub phase: &'static str,
    /// The durations.
    #[serde(flatten)]
    pub spread: Spread,
}

/// How many durations were how long.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spread {
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
    /// The bins of every [`Spread`].
    pub const ALL: Self = Self { first_us: 1e-3 * FIRST_NS, per_decade: PER_DECADE };
}

impl Latency {
    /// What these durations \[ns\] amount to; none when there are none, or all are zero, as in
    /// virtual time.
    pub fn of(ecu: u8, phase: &'static str, mut durations_ns: Vec<u32>) -> Option<Self> {
        durations_ns.sort_unstable();
        let longest = durations_ns.last().filter(|longest| **longest > 0)?;
        let first = bin(durations_ns[0].into());
        let mut counts = vec![0u32; bin((*longest).into()) - first + 1];
        for ns in &durations_ns {
            counts[bin((*ns).into()) - first] += 1;
        }
        // The least duration that this share does not exceed.
        let percentile = |share: f64| {
            let rank = (share * durations_ns.len() as f64).ceil() as usize;
            1e-3 * f64::from(durations_ns[rank.clamp(1, durations_ns.len()) - 1])
        };
        let spread = Spread { percentiles_us: SHARES.map(percentile), first, counts };
        Some(Self { ecu, phase, spread })
    }
}

impl Spread {
    /// What `cyclictest --json` says of all its threads together; none when it says nothing.
    pub fn of_cyclictest(told: &Value) -> Option<Self> {
        let mut by_us: BTreeMap<u32, u64> = BTreeMap::new();
        for thread in told.get("thread")?.as_object()?.values() {
            for (us, count) in thread.get("histogram")?.as_object()? {
                let counted = by_us.entry(us.parse().ok()?).or_default();
                *counted = counted.saturating_add(count.as_u64()?);
            }
        }
        let (shortest, longest) = (*by_us.first_key_value()?.0, *by_us.last_key_value()?.0);
        let edges = |us: u32| (1e3 * f64::from(us), 1e3 * (f64::from(us) + 1.0));
        let first = bin(edges(shortest).0);
        let mut shares = vec![0.0; bin(edges(longest).1) - first + 1];
        for (us, count) in &by_us {
            // What lies within one microsecond is spread evenly over the bins it covers.
            let (from_ns, to_ns) = edges(*us);
            for place in bin(from_ns)..=bin(to_ns) {
                let inside_ns = to_ns.min(edge_ns(place + 1)) - from_ns.max(edge_ns(place));
                let share = if place == 0 { 1.0 } else { inside_ns.max(0.0) / (to_ns - from_ns) };
                shares[place - first] += share * *count as f64;
            }
        }
        let counts = shares.iter().map(|share| share.ceil() as u32).collect();
        Some(Self { percentiles_us: SHARES.map(|share| percentile(&by_us, share)), first, counts })
    }
}

/// The least whole microsecond that this share of the durations does not exceed.
fn percentile(by_us: &BTreeMap<u32, u64>, share: f64) -> f64 {
    let total: u64 = by_us.values().sum();
    let rank = (share * total as f64).ceil() as u64;
    let mut below = 0;
    let found = by_us.iter().find(|(_, count)| {
        below += **count;
        below >= rank
    });
    found.map_or(0.0, |(us, _)| f64::from(*us))
}

/// The bin of a duration \[ns\].
fn bin(ns: f64) -> usize {
    (PER_DECADE * (ns / FIRST_NS).log10()).max(0.0) as usize
}

/// Where a bin begins \[ns\].
fn edge_ns(bin: usize) -> f64 {
    FIRST_NS * 10f64.powf(bin as f64 / PER_DECADE)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn percentiles_are_durations_that_occurred() {
        let latency = Latency::of(0, "qp", (1..=1000).map(|us| 1000 * us).collect());
        let latency = latency.expect("durations");
        assert_eq!(latency.spread.percentiles_us, [500.0, 900.0, 990.0, 999.0, 1000.0]);
        assert_eq!(latency.spread.counts.iter().sum::<u32>(), 1000);
    }

    #[test]
    fn virtual_time_has_no_latency() {
        assert_eq!(Latency::of(0, "qp", vec![0; 10]), None);
        assert_eq!(Latency::of(0, "qp", Vec::new()), None);
    }

    #[test]
    fn bins_are_as_wide_as_the_page_is_told() {
        let latency = Latency::of(0, "qp", vec![1_000, 10_000]).expect("durations");
        assert_eq!((latency.spread.first, latency.spread.counts.len()), (40, 21));
    }

    #[test]
    fn a_floor_is_read_over_all_its_threads() {
        let told = json!({ "thread": {
            "0": { "histogram": { "20": 500, "30": 400 } },
            "1": { "histogram": { "30": 90, "200": 9, "5000": 1 } },
        }});
        let floor = Spread::of_cyclictest(&told).expect("has wake-ups");
        assert_eq!(floor.percentiles_us, [20.0, 30.0, 30.0, 200.0, 5000.0]);
        // 20 µs is 3.3 decades above the first bin's begin, 5 ms is 5.7.
        assert_eq!((floor.first, floor.counts.len()), (66, 114 - 66));
        let counted: u32 = floor.counts.iter().sum();
        assert!((1000..1010).contains(&counted), "{counted}");
    }

    #[test]
    fn a_microsecond_of_a_quick_machine_is_spread_over_its_bins() {
        let told = json!({ "thread": { "0": { "histogram": { "0": 100, "1": 1000 } } } });
        let floor = Spread::of_cyclictest(&told).expect("has wake-ups");
        assert!(floor.counts.iter().all(|count| *count > 0), "{:?}", floor.counts);
    }

    #[test]
    fn what_is_no_floor_is_none() {
        let backwards = json!({ "thread": { "0": { "histogram": { "-1": 2 } } } });
        for told in [Value::Null, json!({}), json!({ "thread": {} }), backwards] {
            assert_eq!(Spread::of_cyclictest(&told), None);
        }
    }
}
