//! The summary as a page of text.

use std::fmt::Write;

use anstyle::{AnsiColor, Style};
use comfy_table::Table;
use controller_rt::{OnOverrun, Percentiles, Report};
use platoon_dbc::BusTiming;

use super::{Summary, Verdict};
use crate::cli::BusTimingKind;
use crate::table::{self, number};
use crate::timing::TimingVerdict;

/// Phases of a tick in the order they happen.
const PHASES: [&str; 8] = ["wake", "drain", "observe", "ucl", "lml_build", "qp", "guard", "send"];
/// Misses shown.
const GALLERY_ROWS: usize = 6;
const GOOD: Style = AnsiColor::Green.on_default().bold();
const BAD: Style = AnsiColor::Red.on_default().bold();
const UNSURE: Style = AnsiColor::Yellow.on_default().bold();
const HEADING: Style = Style::new().bold();

/// The page, with colours that a terminal understands.
pub(super) fn page(summary: &Summary) -> String {
    let mut page = String::new();
    // Writing to a string cannot fail.
    let _ = verdict(&mut page, summary);
    let _ = trucks(&mut page, summary);
    let _ = criteria(&mut page, summary);
    let _ = observed(&mut page, summary);
    let _ = profile_cost(&mut page, summary);
    let _ = timing(&mut page, summary);
    let _ = gallery(&mut page, summary);
    let _ = rest(&mut page, summary);
    page
}

fn verdict(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let (style, word) = match summary.verdict {
        Verdict::Pass => (GOOD, "PASS"),
        Verdict::Fail => (BAD, "FAIL"),
    };
    writeln!(
        page,
        "\n{style}{word}{style:#}  {}, seed {}, {} Hz, {:.1} s of bench time in {:.1} s",
        summary.scenario, summary.seed, summary.rate_hz, summary.duration_s, summary.elapsed_s
    )?;
    writeln!(page, "bus    {} ({})", summary.bus.backend, summary.bus.reason)?;
    bus(page, summary)?;
    if let (Some(min), Some(max)) = (summary.v2v.delay_min_s, summary.v2v.delay_max_s) {
        let rate = summary.v2v.max_abs_rate.unwrap_or(0.0);
        writeln!(
            page,
            "V2V    delay {:.0} to {:.0} ms, changing by up to {:.2} s/s; {} delivered, {} lost",
            1e3 * min,
            1e3 * max,
            rate,
            summary.v2v.delivered,
            summary.v2v.lost
        )?;
    }
    Ok(())
}

/// Whether a real bus would do, and how long frames wait for it.
fn bus(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let bus = &summary.bus;
    let rates = BusTiming::fd(bus.bit_rate_hz, bus.data_bit_rate_hz.unwrap_or(bus.bit_rate_hz));
    let kind = if bus.data_bit_rate_hz.is_some() { "CAN FD" } else { "classic CAN" };
    let most = bus.load_percent.iter().copied().fold(0.0, f64::max);
    let fits = match (bus.fits, &bus.fitting_rate) {
        (true, Some(slowest)) if *slowest == rates.to_string() => {
            "fits, nothing slower would".into()
        }
        (true, Some(slowest)) => format!("fits, as it would at {slowest}"),
        (true, None) => "fits".into(),
        (false, Some(slowest)) => format!("does not fit, but would at {slowest}"),
        (false, None) => "does not fit, nor at any common rate".into(),
    };
    let timing = match bus.timing {
        BusTimingKind::Ideal => "as",
        BusTimingKind::Emulate => "emulating",
    };
    writeln!(
        page,
        "       {timing} {kind} at {rates} bit/s: {most:.0} % of the fullest bus, {fits}"
    )?;
    if bus.overflowed > 0 {
        writeln!(page, "       {BAD}{} frames lost{BAD:#}: the bus was full", bus.overflowed)?;
    }
    if let Some(pace) = summary.rig_pace.filter(|pace| pace.service_gap_ns_max > 0) {
        let longest_ms = 1e-6 * pace.service_gap_ns_max as f64;
        let times = pace.late_services;
        writeln!(
            page,
            "       the rig served it late {times} times, for up to {longest_ms:.1} ms"
        )?;
    }
    Ok(())
}

/// How long the messages took on emulated buses.
fn observed(page: &mut String, summary: &Summary) -> std::fmt::Result {
    if summary.bus.observed.is_empty() {
        return Ok(());
    }
    let mut table = table::numbers(["µs", "frames", "p99", "max", "bound"]);
    for seen in &summary.bus.observed {
        table.add_row([
            seen.message.clone(),
            seen.frames.to_string(),
            micro(seen.p99_us),
            micro(seen.max_us),
            seen.bound_us.map_or("none".into(), micro),
        ]);
    }
    section(page, "Emulated buses: from queueing to arrival", &table)
}

/// What the profile's rates and resolutions cost.
fn profile_cost(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let Some(cost) = &summary.profile_cost else {
        return Ok(());
    };
    let header = ["truck", "furthest apart", "error to leader", "to pred.", "clearance lost"];
    let mut table = table::numbers(header);
    let signed = |change_m: f64| format!("{change_m:+.3} m");
    for truck in &cost.trucks {
        table.add_row([
            truck.index.to_string(),
            format!("{:.3} m", truck.max_distance_m),
            signed(truck.leader_error_m),
            signed(truck.predecessor_error_m),
            truck.clearance_m.map_or("-".into(), signed),
        ]);
    }
    section(page, "What the profile costs, against the same run on CAN FD", &table)
}

fn trucks(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let mut table = table::numbers([
        "truck",
        "error to\nleader m",
        "to pred.\nm",
        "in slot\nfrom s",
        "at speed\nfrom s",
        "clear-\nance m",
        "gap\nm",
        "steering\nrad",
        "lateral\nm/s²",
        "force\nkN",
        "lane\nchanges",
        "passed\nobst.",
    ]);
    for truck in &summary.trucks {
        let passed: Vec<String> = truck.passed_obstacles.iter().map(usize::to_string).collect();
        table.add_row([
            if truck.index == 0 { "0 leader".into() } else { truck.index.to_string() },
            format!("{:.2}", truck.max_abs_leader_error_m),
            format!("{:.2}", truck.max_abs_predecessor_error_m),
            or_never(truck.settled_position_s, |s| format!("{s:.1}")),
            or_never(truck.settled_speed_s, |s| format!("{s:.1}")),
            or_dash(truck.min_obstacle_clearance_m, |m| format!("{m:.2}")),
            or_dash(truck.min_truck_gap_m, |m| format!("{m:.1}")),
            format!("{:.3}", truck.max_abs_steer_rad),
            format!("{:.2}", truck.max_abs_lateral_accel_mps2),
            format!("{:.1}..{:.1}", 1e-3 * truck.min_force_n, 1e-3 * truck.max_force_n),
            truck.lane_crossings.to_string(),
            if passed.is_empty() { "-".into() } else { passed.join(",") },
        ]);
    }
    section(page, "Trucks: largest errors, least distances", &table)
}

fn criteria(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let failed: Vec<_> = summary.criteria.iter().filter(|c| !c.passed).collect();
    if failed.is_empty() {
        return writeln!(page, "\n{GOOD}All {} criteria hold.{GOOD:#}", summary.criteria.len());
    }
    let mut table = table::numbers(["criterion that fails", "limit", "value"]);
    for criterion in failed {
        table.add_row([
            criterion.name.clone(),
            number(criterion.limit),
            or_never(criterion.value, number),
        ]);
    }
    section(page, "Criteria", &table)
}

fn timing(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let mut table = table::numbers(["µs", "p50", "p90", "p99", "p99.9", "max"]);
    let row = |name: String, p: &Percentiles| {
        [name, micro(p.p50), micro(p.p90), micro(p.p99), micro(p.p999), micro(p.max)]
    };
    for ecu in &summary.ecus {
        if let Some(total) = ecu.phase_us.get("total") {
            table.add_row(row(format!("ECU {} whole tick", ecu.truck), total));
        }
    }
    if let Some(slowest) = slowest(&summary.ecus) {
        for phase in PHASES {
            if let Some(percentiles) = slowest.phase_us.get(phase) {
                table.add_row(row(format!("  ECU {} {phase}", slowest.truck), percentiles));
            }
        }
    }
    if let Some(floor) = &summary.machine_floor_us {
        table.add_row([
            "wake-up of this machine alone".into(),
            micro(floor.p50),
            String::new(),
            micro(floor.p99),
            micro(floor.p999),
            micro(floor.max),
        ]);
    }
    section(page, "Timing of every tick, phases of the slowest ECU", &table)?;
    let is_virtual = summary.timing_verdict == TimingVerdict::Virtual;
    for ecu in &summary.ecus {
        writeln!(page, "{}", ecu_line(ecu, is_virtual))?;
    }
    let (style, words) = match summary.timing_verdict {
        TimingVerdict::Pass => (GOOD, "PASS: deadlines met"),
        TimingVerdict::Fail => (BAD, "FAIL: more late ticks than this machine explains"),
        TimingVerdict::Inconclusive => {
            (UNSURE, "INCONCLUSIVE: this machine is late by itself, or the run too short")
        }
        TimingVerdict::Virtual => (GOOD, "virtual time, no deadlines"),
    };
    let denied = summary.timing.as_ref().map_or(0, |timing| timing.denied);
    let but = match (summary.timing_verdict, denied) {
        (TimingVerdict::Pass, 1..) => {
            format!(", but for {denied} slots that pauses of this machine took")
        }
        _ => String::new(),
    };
    writeln!(page, "timing {style}{words}{but}{style:#}")
}

/// The worst misses of all ECUs, with where their time went.
fn gallery(page: &mut String, summary: &Summary) -> std::fmt::Result {
    let misses = summary
        .ecus
        .iter()
        .flat_map(|ecu| ecu.worst_misses.iter().map(move |miss| (ecu.truck, miss)));
    let mut worst: Vec<_> = misses.collect();
    worst.sort_by(|(_, a), (_, b)| b.late_us.total_cmp(&a.late_us));
    if worst.is_empty() {
        return Ok(());
    }
    let mut table = table::numbers(["ECU", "at s", "late by µs", "cause", "ended after due, µs"]);
    for (truck, miss) in worst.into_iter().take(GALLERY_ROWS) {
        let ends: Vec<String> =
            miss.timeline_us.iter().map(|(phase, us)| format!("{phase} {us:.0}")).collect();
        table.add_row([
            truck.to_string(),
            format!("{:.3}", miss.time_s),
            micro(miss.late_us),
            miss.cause.clone(),
            ends.join(", "),
        ]);
    }
    section(page, "Worst misses", &table)
}

/// The ECU whose median tick is longest.
fn slowest(ecus: &[Report]) -> Option<&Report> {
    let median = |ecu: &Report| ecu.phase_us.get("total").map_or(0.0, |total| total.p50);
    ecus.iter().max_by(|a, b| median(a).total_cmp(&median(b)))
}

fn ecu_line(ecu: &Report, is_virtual: bool) -> String {
    let mut line = format!("ECU {}: {} ticks", ecu.truck, ecu.ticks);
    if !is_virtual {
        line += &format!(", {} late, {} skipped", ecu.misses, ecu.skipped);
    }
    let qp = &ecu.qp;
    line += &format!(
        "; {} QPs, {} failed, at most {} iterations",
        qp.solves, qp.failures, qp.iterations_max
    );
    if ecu.emergency_brakings > 0 {
        line += &format!("; EMERGENCY BRAKING, {} times", ecu.emergency_brakings);
    }
    if is_virtual {
        return line;
    }
    for (what, causes) in [("late", &ecu.miss_causes), ("skipped", &ecu.skip_causes)] {
        let causes: Vec<String> =
            causes.iter().map(|(cause, count)| format!("{cause} {count}")).collect();
        if !causes.is_empty() {
            line += &format!("; {what} by {}", causes.join(", "));
        }
    }
    if ecu.on_overrun != OnOverrun::Skip {
        line += &format!("; on overrun: {}, {} commands held", ecu.on_overrun, ecu.held_ticks);
    }
    if let Some(thread) = ecu.thread {
        let faults = thread.minor_faults + thread.major_faults;
        line += &format!("; {faults} page faults, {} uses of the heap", thread.heap_uses);
    }
    match &ecu.realtime {
        Some(rt) if rt.policy.contains("FIFO") || rt.policy.contains("fifo") => line,
        Some(rt) => line + &format!("; without real-time priority ({})", rt.policy),
        None => line,
    }
}

fn rest(page: &mut String, summary: &Summary) -> std::fmt::Result {
    if !summary.notes.is_empty() {
        writeln!(page, "\n{HEADING}Notes{HEADING:#}")?;
        for note in &summary.notes {
            writeln!(page, "  {note}")?;
        }
    }
    let files = [("trace", &summary.files.mcap), ("report", &summary.files.report)];
    writeln!(page)?;
    for (what, path) in files {
        if let Some(path) = path {
            writeln!(page, "{what:6} {path}")?;
        }
    }
    Ok(())
}

fn section(page: &mut String, title: &str, table: &Table) -> std::fmt::Result {
    writeln!(page, "\n{HEADING}{title}{HEADING:#}\n{table}")
}

fn or_never<T>(value: Option<T>, text: impl Fn(T) -> String) -> String {
    value.map_or("never".into(), text)
}

fn or_dash<T>(value: Option<T>, text: impl Fn(T) -> String) -> String {
    value.map_or("-".into(), text)
}

fn micro(us: f64) -> String {
    if us < 100.0 { format!("{us:.1}") } else { format!("{us:.0}") }
}
