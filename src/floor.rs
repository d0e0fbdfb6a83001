//! `platoon floor`: how late this machine wakes a thread that does nothing else.

use std::time::Duration;

use vcan_setup::floor::{FloorOptions, Percentiles, measure, percentiles};
use vcan_setup::realtime::environment;

use crate::cli::FloorArgs;
use crate::failure::Failure;
use crate::process;
use crate::rehearse::cyclictest_json;

/// Measures, prints, and writes the histograms.
///
/// # Errors
/// When it cannot be measured or written.
pub fn run(args: &FloorArgs) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let cpus = if args.cpus.is_empty() { environment().online_cpus } else { args.cpus.clone() };
    let options =
        FloorOptions { cpus, period_ns: 1_000 * args.period_us, priority: Some(args.priority) };
    // As a run holds it: otherwise the CPUs' idle states are what is measured.
    let _held = process::hold_still();
    let floor =
        measure(&options, Duration::from_secs(args.duration_s)).map_err(Failure::cannot_start)?;
    for cpu in &floor.cpus {
        let Percentiles { p50_us, p99_us, p999_us, max_us } = percentiles(&cpu.lateness_ns);
        anstream::println!(
            "CPU {}: {} wake-ups, late by p50 {p50_us:.1}, p99 {p99_us:.1}, p99.9 {p999_us:.1}, \
             max {max_us:.1} µs ({} {})",
            cpu.cpu,
            cpu.lateness_ns.len(),
            cpu.policy,
            cpu.priority
        );
        for refusal in &cpu.refused {
            anstream::eprintln!("CPU {}: measured without it: {refusal}", cpu.cpu);
        }
    }
    args.json.as_ref().map_or(Ok(()), |path| process::write_json(path, &cyclictest_json(&floor)))
}
