//! `platoon gain certify`: every check with its number and its threshold.

use std::fmt::Write;
use std::path::PathBuf;

use anstyle::{AnsiColor, Style};
use certificate::{Conditions, Finding, GainFile, Threshold, Verdict as Certified};
use clap::Args;
use comfy_table::{CellAlignment, Table, presets};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::process;
use crate::summary::Verdict;

use super::conditions::{Range, find, parse_range, parse_seconds, plants, shown};

/// Time between two V2V messages in the built-in scenarios \[s\].
const PERIOD_S: f64 = 0.02;

/// Options of `gain certify`.
#[derive(Debug, Clone, Args)]
pub struct CertifyArgs {
    /// A gain file, or the name of a gain that comes with the program.
    gain: String,
    /// Lag of the trucks in seconds, or the least and the largest; the file's own when left out.
    #[arg(long, value_name = "S|LO-HI", value_parser = parse_range)]
    lag_s: Option<Range>,
    /// Gain of the trucks, acceleration per commanded acceleration, or the least and the largest;
    /// the file's own when left out.
    #[arg(long, value_name = "G|LO-HI", value_parser = parse_range)]
    plant_gain: Option<Range>,
    /// Longest delay in seconds; the file's own when left out.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    delay_s: Option<f64>,
    /// Time between two messages in seconds.
    #[arg(long, value_name = "S", default_value_t = PERIOD_S, value_parser = parse_seconds)]
    period_s: f64,
    /// Where to write the findings as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Certifies, prints, and says whether the gain stands.
///
/// # Errors
/// When there is no such gain.
pub fn run(args: &CertifyArgs) -> Result<Verdict, Failure> {
    let file = find(&args.gain)?;
    let mut conditions = Conditions::of(&file, args.period_s);
    let own = conditions.plants;
    conditions.plants = plants(
        args.lag_s.unwrap_or(Range(own.lag_min_s, own.lag_max_s)),
        args.plant_gain.unwrap_or(Range(own.gain_min, own.gain_max)),
    );
    conditions.longest_s = args.delay_s.unwrap_or(conditions.longest_s);
    let certified = certificate::certify(&file, &conditions);
    anstream::println!("{}", page(&file, &conditions, &certified));
    if let Some(path) = &args.json {
        process::write_json(path, &as_json(&file, &certified))?;
    }
    Ok(if certified.is_certified() { Verdict::Pass } else { Verdict::Fail })
}

/// The findings as a table.
pub fn page(file: &GainFile, conditions: &Conditions, certified: &Certified) -> String {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING);
    for finding in &certified.findings {
        table.add_row([
            mark(finding).to_owned(),
            finding.what.clone(),
            number(finding.number),
            threshold(finding.threshold),
        ]);
    }
    if let Some(column) = table.column_mut(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    let mut page = format!(
        "gain {}: K1 {:?}, K2 {:?}\n\
         {}, delays up to {} s, messages every {} s\n\n{table}\n\n",
        file.name,
        file.gain.k1,
        file.gain.k2,
        shown(&conditions.plants),
        conditions.longest_s,
        conditions.period_s
    );
    let failed = certified.findings.iter().filter(|finding| !finding.is_passed).count();
    let (colour, words) = if certified.is_certified() {
        (AnsiColor::Green, "CERTIFIED".to_owned())
    } else {
        (AnsiColor::Red, format!("REFUSED: {failed} of {} checks fail", certified.findings.len()))
    };
    let style = Style::new().bold().fg_color(Some(colour.into()));
    let _ = write!(page, "{style}{words}{style:#}");
    page
}

fn mark(finding: &Finding) -> &'static str {
    match (finding.threshold, finding.is_passed) {
        (Threshold::None, _) => "note",
        (_, true) => "pass",
        (_, false) => "FAIL",
    }
}

fn threshold(threshold: Threshold) -> String {
    match threshold {
        Threshold::Below(most) if most.is_infinite() => "finite".to_owned(),
        Threshold::Below(most) => format!("< {most}"),
        Threshold::Above(least) => format!("> {least}"),
        Threshold::None => String::new(),
    }
}

/// Four digits, whatever the size.
fn number(x: f64) -> String {
    if x == 0.0 || (1e-2..1e4).contains(&x.abs()) { format!("{x:.4}") } else { format!("{x:.3e}") }
}

fn as_json(file: &GainFile, certified: &Certified) -> Value {
    let finding = |finding: &Finding| {
        json!({
            "what": finding.what,
            "number": finding.number,
            "threshold": threshold(finding.threshold),
            "result": mark(finding),
        })
    };
    json!({
        "gain": file.name,
        "certified": certified.is_certified(),
        "findings": certified.findings.iter().map(finding).collect::<Vec<_>>(),
    })
}
