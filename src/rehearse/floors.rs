//! The machine's floor around a run, and its histogram in cyclictest's form.

use serde_json::{Map, Value, json};
use vcan_setup::floor::{CpuFloor, Floor};
use vcan_setup::realtime::environment;

/// Nanoseconds in a bin of the histogram.
const BIN_NS: u64 = 1_000;

/// How late the machine woke a thread that did nothing else.
#[derive(Debug, Clone)]
pub struct Floors {
    /// Before the run, on a machine without it.
    pub before: Floor,
    /// Beside it, at a higher priority than anything of it.
    pub beside: Floor,
    /// After it.
    pub after: Floor,
}

/// The histograms as `cyclictest --json` of rt-tests 2.40 writes them, one thread per CPU, so that
/// what reads those reads these.
pub fn cyclictest_json(floor: &Floor) -> Value {
    let host = environment();
    let threads: Map<String, Value> = floor
        .cpus
        .iter()
        .enumerate()
        .map(|(thread, cpu)| (thread.to_string(), one_thread(cpu)))
        .collect();
    json!({
        "file_version": 1,
        // The colons are part of these two names in rt-tests too.
        "cmdline:": "platoon",
        "rt_test_version:": env!("CARGO_PKG_VERSION"),
        "return_code": 0,
        "sysinfo": {
            "sysname": "Linux",
            "release": host.kernel,
            "machine": std::env::consts::ARCH,
            "realtime": u8::from(host.preempt_rt),
        },
        "num_threads": floor.cpus.len(),
        "resolution_in_ns": 0,
        "thread": threads,
    })
}

fn one_thread(cpu: &CpuFloor) -> Value {
    let lateness_ns = &cpu.lateness_ns;
    let mut bins: Vec<(u64, u64)> = Vec::new();
    for recorded in lateness_ns.iter_recorded() {
        let (bin, count) = (recorded.value_iterated_to() / BIN_NS, recorded.count_at_value());
        match bins.last_mut() {
            Some((last, total)) if *last == bin => *total += count,
            _ => bins.push((bin, count)),
        }
    }
    let histogram: Map<String, Value> =
        bins.into_iter().map(|(bin, count)| (bin.to_string(), count.into())).collect();
    json!({
        "histogram": histogram,
        "cycles": lateness_ns.len(),
        "min": lateness_ns.min() / BIN_NS,
        "max": lateness_ns.max() / BIN_NS,
        "avg": lateness_ns.mean() / BIN_NS as f64,
        "cpu": cpu.cpu,
        "node": 0,
    })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use vcan_setup::floor::{FloorOptions, measure};

    use super::*;

    #[test]
    fn every_sample_is_in_a_bin_and_the_names_are_cyclictests() {
        let options = FloorOptions { cpus: vec![0], period_ns: 1_000_000, priority: None };
        let floor = measure(&options, Duration::from_millis(30)).expect("one thread can start");
        let written = cyclictest_json(&floor);
        let thread = &written["thread"]["0"];
        let bins = thread["histogram"].as_object().expect("bins by microsecond");
        let counted: u64 = bins.values().filter_map(Value::as_u64).sum();
        assert_eq!(Some(counted), thread["cycles"].as_u64());
        assert!(bins.keys().all(|bin| bin.parse::<u64>().is_ok()));
        for name in ["file_version", "sysinfo", "num_threads", "resolution_in_ns"] {
            assert!(!written[name].is_null(), "{name}");
        }
        for name in ["min", "max", "avg", "cpu", "node"] {
            assert!(thread[name].is_number(), "{name}");
        }
    }
}
