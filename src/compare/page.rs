//! The comparison as a page of text, at most 100 columns wide.

use std::fmt::Write;

use anstyle::{AnsiColor, Style};
use comfy_table::{ContentArrangement, Table};

use super::claim::Agreement;
use super::comparison::Comparison;
use super::requirement::Judged;
use super::spread::fixed;
use crate::summary::Verdict;
use crate::table;

/// Widest line [columns].
const COLUMNS_MAX: u16 = 100;
const GOOD: Style = AnsiColor::Green.on_default().bold();
const BAD: Style = AnsiColor::Red.on_default().bold();
const HEADING: Style = Style::new().bold();

/// The page, with colours that a terminal understands.
pub fn page(comparison: &Comparison) -> String {
    let mut page = String::new();
    // Writing to a string cannot fail.
    let _ = claims(&mut page, comparison);
    let _ = improvements(&mut page, comparison);
    let _ = table_iii(&mut page, comparison);
    let _ = loop_rates(&mut page, comparison);
    let _ = requirements(&mut page, comparison);
    let _ = scenarios(&mut page, comparison);
    let _ = verdict(&mut page, comparison);
    page
}

fn claims(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    let mut table = words(&["paper", "about", "published", "ours", ""]);
    for claim in &comparison.claims {
        let word = claim.agreement.word();
        table.add_row([&claim.source, &claim.what, &claim.published, &claim.ours, word]);
    }
    section(page, "The paper's claims: medians over the seeds [5-95 %]", &table)?;
    let count = |agreement| comparison.claims.iter().filter(|c| c.agreement == agreement).count();
    writeln!(
        page,
        "{} same, {} different, {} not comparable",
        count(Agreement::Same),
        count(Agreement::Different),
        count(Agreement::NotComparable)
    )?;
    let mut table = words(&["not the same", "why"]);
    let other = comparison.claims.iter().filter(|c| c.agreement != Agreement::Same);
    let mut told = "";
    for claim in other {
        // Several in a row may have one reason.
        let why = if claim.why == told { "likewise" } else { claim.why.as_str() };
        table.add_row([claim.what.as_str(), why]);
        told = &claim.why;
    }
    section(page, "Why (docs/results.md has the reasons of all)", &table)
}

fn improvements(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.improvements.is_empty() {
        return Ok(());
    }
    let mut table =
        table(&["largest error to the truck ahead", "MCF m", "baseline m", "lower by %"]);
    for line in &comparison.improvements {
        table.add_row([
            format!("{}, {}", line.situation, line.baseline),
            line.mcf_m.text(2),
            line.baseline_m.text(2),
            line.percent.text(0),
        ]);
    }
    section(page, "MCF against the single-structure MPC", &table)
}

fn table_iii(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.table_iii.is_empty() {
        return Ok(());
    }
    let mut table = table(&["controller", "s̄₂/s̄₁", "s̄₃/s̄₂", "max s̄ m", "published"]);
    for line in &comparison.table_iii {
        table.add_row([
            line.controller.clone(),
            line.ratio_2_1.text(2),
            line.ratio_3_2.text(2),
            line.max_m.text(2),
            line.published.map_or("-".into(), |[two, three, max]| format!("{two}, {three}, {max}")),
        ]);
    }
    section(page, "Table III", &table)
}

fn loop_rates(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.loop_rates.is_empty() {
        return Ok(());
    }
    let mut table = table(&["situation", "rate Hz", "max s̄ m", "clearance m", "off %", ""]);
    for line in &comparison.loop_rates {
        table.add_row([
            line.situation.clone(),
            line.rate_hz.to_string(),
            fixed(line.largest_error_m, 3),
            line.clearance_m.map_or("-".into(), |clearance_m| fixed(clearance_m, 2)),
            fixed(line.off_percent, 1),
            holds(line.holds).into(),
        ]);
    }
    section(page, "The same at other loop rates, against 1000 Hz", &table)
}

fn requirements(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    let mut table = table(&["what we hold ourselves to", "limit", "single-track", "two-track", ""]);
    for line in &comparison.requirements {
        let value =
            |judged: &Option<Judged>| judged.map_or("-".into(), |judged| judged.text(line.digits));
        table.add_row([
            format!("{}: {} {}", line.situation, line.what, line.unit).trim_end().to_owned(),
            line.limits(),
            value(&line.single_track),
            value(&line.two_track),
            holds(line.holds()).into(),
        ]);
    }
    section(page, "Least to largest of all seeds", &table)
}

fn scenarios(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.scenarios.is_empty() {
        return Ok(());
    }
    let mut table = words(&["scenario", "passed", "criteria that fail"]);
    for line in &comparison.scenarios {
        let passed = format!("{} of {}", line.passed, line.runs);
        table.add_row([line.name.clone(), passed, line.failed.join(", ")]);
    }
    section(page, "Every scenario against its own criteria", &table)
}

fn verdict(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    let (style, word, what) = match comparison.verdict {
        Verdict::Pass => (GOOD, "PASS", "everything we hold ourselves to holds"),
        Verdict::Fail => (BAD, "FAIL", "not everything we hold ourselves to holds"),
    };
    let Comparison { runs, seeds, first_seed, rate_hz, .. } = comparison;
    writeln!(
        page,
        "\n{style}{word}{style:#}  {what}; {runs} runs, {seeds} seeds from {first_seed} on, \
         {rate_hz} Hz"
    )
}

fn holds(holds: bool) -> &'static str {
    if holds { "holds" } else { "FAILS" }
}

fn section(page: &mut String, title: &str, table: &Table) -> std::fmt::Result {
    writeln!(page, "\n{HEADING}{title}{HEADING:#}\n{table}")
}

/// A table of words.
fn words(header: &[&str]) -> Table {
    let mut table = table::words(header.to_vec());
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(COLUMNS_MAX);
    table
}

/// A table whose numbers line up on the right.
pub fn table(header: &[&str]) -> Table {
    let mut table = words(header);
    table::align_numbers(&mut table);
    table
}
