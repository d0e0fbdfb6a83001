//! The table for people: as text, as Markdown, and a line of it while it grows.

use std::fmt::Write;

use anstyle::{AnsiColor, Style};
use comfy_table::Table;

use super::load::Load;
use super::outcome::{CellOutcome, Deadline, Sustained};
use super::plan::Subject;
use crate::cli::Word;
use crate::table;
use crate::timing::TimingVerdict;

const GOOD: Style = AnsiColor::Green.on_default().bold();
const BAD: Style = AnsiColor::Red.on_default().bold();
const UNSURE: Style = AnsiColor::Yellow.on_default().bold();

/// One cell in a line.
pub fn line(outcome: &CellOutcome) -> String {
    let (style, word) = styled(outcome.verdict);
    let cell = &outcome.cell;
    let subject = match cell.subject {
        Subject::Bench => "bench",
        Subject::Ecu => "ECU alone",
    };
    format!(
        "{subject:9} {:5} Hz  {:6}  {style}{word:12}{style:#} {}",
        cell.rate_hz,
        cell.load.word(),
        lost(outcome)
    )
}

/// The whole, with colours that a terminal understands.
pub fn text(deadline: &Deadline) -> String {
    let mut page = String::new();
    for subject in [Subject::Bench, Subject::Ecu] {
        let cells: Vec<&CellOutcome> =
            deadline.cells.iter().filter(|outcome| outcome.cell.subject == subject).collect();
        if !cells.is_empty() {
            // Writing to a string cannot fail.
            let _ = writeln!(page, "\n{}\n{}", title(deadline, subject), matrix(&cells));
        }
    }
    let unsure = deadline.cells.iter().filter(|outcome| outcome.verdict != TimingVerdict::Pass);
    for (number, outcome) in unsure.enumerate() {
        if number == 0 {
            let _ = writeln!(page, "\nWhat the others stand on");
        }
        let _ = writeln!(page, "  {}", line(outcome));
        let _ = writeln!(page, "      {}", outcome.evidence);
    }
    let _ = writeln!(page);
    for sustained in deadline.sustained.iter().filter(|sustained| sustained.load.is_none()) {
        let _ = writeln!(page, "{}", sustains(deadline, sustained));
    }
    page.extend(taken(deadline));
    let (style, word) = styled(deadline.verdict);
    let _ = write!(
        page,
        "{style}{}{style:#}  {} Hz under every load; {} cells in {:.0} s",
        word.to_uppercase(),
        deadline.nominal_hz,
        deadline.cells.len(),
        deadline.elapsed_s
    );
    page
}

/// The same as Markdown.
pub fn markdown(deadline: &Deadline) -> String {
    let mut page = String::from(
        "| loop | rate | load | slots | lost | worst lateness | cause | sentinel | verdict |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for outcome in &deadline.cells {
        let cell = &outcome.cell;
        let _ = writeln!(
            page,
            "| {} | {} Hz | {} | {} | {} | {:+.2} ms | {} | {:.2} ms | {} |",
            title(deadline, cell.subject),
            cell.rate_hz,
            cell.load.word(),
            outcome.timing.slots,
            outcome.timing.lost,
            outcome.worst_lateness_ms,
            outcome.cause.as_deref().unwrap_or("-"),
            outcome.floor_us.max / 1e3,
            styled(outcome.verdict).1,
        );
    }
    let _ = writeln!(page);
    for sustained in &deadline.sustained {
        let _ = writeln!(page, "- {}", sustains(deadline, sustained));
    }
    page.extend(taken(deadline).map(|words| format!("- {words}")));
    for outcome in deadline.cells.iter().filter(|cell| cell.verdict != TimingVerdict::Pass) {
        let cell = &outcome.cell;
        let (rate_hz, load, word) = (cell.rate_hz, cell.load.word(), styled(outcome.verdict).1);
        let _ = writeln!(page, "- {rate_hz} Hz, {load}: {word}: {}", outcome.evidence);
    }
    page
}

fn title(deadline: &Deadline, subject: Subject) -> String {
    match subject {
        Subject::Bench => {
            format!("rig and ECUs over {}", deadline.bus.as_deref().unwrap_or("the bus"))
        }
        Subject::Ecu => "one ECU alone".to_owned(),
    }
}

/// Rates down, loads across.
fn matrix(cells: &[&CellOutcome]) -> Table {
    let mut loads: Vec<Load> = cells.iter().map(|outcome| outcome.cell.load).collect();
    loads.sort_unstable();
    loads.dedup();
    let mut rates: Vec<u32> = cells.iter().map(|outcome| outcome.cell.rate_hz).collect();
    rates.sort_unstable();
    rates.dedup();
    let header = std::iter::once("rate".to_owned()).chain(loads.iter().map(Word::word));
    let mut table = table::words(header.collect::<Vec<_>>());
    for rate_hz in rates {
        let at = |load: &Load| {
            let is_it = |outcome: &&&CellOutcome| {
                outcome.cell.rate_hz == rate_hz && outcome.cell.load == *load
            };
            cells.iter().find(is_it).map_or_else(String::new, |outcome| entry(outcome))
        };
        let row = std::iter::once(format!("{rate_hz} Hz")).chain(loads.iter().map(at));
        table.add_row(row);
    }
    table
}

/// Verdict, losses, worst lateness and cause, a line each.
fn entry(outcome: &CellOutcome) -> String {
    let lateness = format!("{:+.2} ms", outcome.worst_lateness_ms);
    let cause = outcome.cause.as_deref().unwrap_or("");
    format!("{}\n{}\n{lateness}\n{cause}", styled(outcome.verdict).1, lost(outcome))
}

fn lost(outcome: &CellOutcome) -> String {
    format!("{} of {}", outcome.timing.lost, outcome.timing.slots)
}

fn sustains(deadline: &Deadline, sustained: &Sustained) -> String {
    let load = sustained.load.map_or("every load".to_owned(), |load| match load {
        Load::Idle => "no load".to_owned(),
        load => format!("load {}", load.word()),
    });
    let rate = sustained.rate_hz.map_or("no rate for sure".to_owned(), |hz| format!("{hz} Hz"));
    format!("{}, {load}: sustains {rate}", title(deadline, sustained.subject))
}

/// What the machine took from cells that pass nevertheless.
fn taken(deadline: &Deadline) -> Option<String> {
    let passed = deadline.cells.iter().filter(|cell| cell.verdict == TimingVerdict::Pass);
    let share = |cell: &CellOutcome| cell.timing.denied as f64 / cell.timing.slots.max(1) as f64;
    let most = passed.map(share).fold(0.0, f64::max);
    let words = format!(
        "Where it passes, the machine itself took up to {:.2} % of the slots by standing still; \
         they count for nobody\n",
        100.0 * most
    );
    (most > 0.0).then_some(words)
}

fn styled(verdict: TimingVerdict) -> (Style, &'static str) {
    match verdict {
        TimingVerdict::Pass | TimingVerdict::Virtual => (GOOD, "pass"),
        TimingVerdict::Fail => (BAD, "fail"),
        TimingVerdict::Inconclusive => (UNSURE, "inconclusive"),
    }
}
