//! `platoon report`: one run, or two over each other, as one page that opens without a network.
//!
//! A [`Story`] is what the page tells, read from a trace; [`page`] puts it, packed, into the
//! HTML, style and code of `page/`. All drawing happens where the page is opened.

mod bus_load;
mod envelope;
mod latency;
mod packing;
mod page;
mod story;
mod timing_events;

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::cli::ReportArgs;
use crate::failure::Failure;
use crate::process;
use crate::summary::Summary;
use crate::trace::Trace;
use story::Story;

/// Writes the page of one or two traces.
///
/// # Errors
/// When a trace cannot be read or the page cannot be written.
pub fn run(args: &ReportArgs) -> Result<(), Failure> {
    let trace = if args.run.is_dir() { args.run.join("run.mcap") } else { args.run.clone() };
    let beside = trace.with_file_name("report.html");
    let output = args.output.as_deref().unwrap_or(&beside);
    process::check_parent("-o", output)?;
    let mut stories = vec![recorded(&args.run)?];
    if let Some(other) = &args.other {
        stories.push(recorded(other)?);
    }
    write(output, &stories)?;
    anstream::eprintln!("wrote {}", output.display());
    Ok(())
}

/// Writes the page a rehearsal ends with; without a trace it tells what the summary knows.
///
/// # Errors
/// When the trace cannot be read or the page cannot be written.
pub fn conclude(output: &Path, trace: Option<&Path>, summary: &Summary) -> Result<(), Failure> {
    let mut story = match trace {
        Some(trace) => Story::read(&Trace::open(trace)?)?,
        None => Story::default(),
    };
    story.summary = serde_json::to_value(summary).unwrap_or_default();
    write(output, &[story])
}

/// The story of a trace, and of the summary beside it if there is one.
fn recorded(trace: &Path) -> Result<Story, Failure> {
    let trace = Trace::open(trace)?;
    let beside = trace.path().with_file_name("summary.json");
    let summary = process::read_json(&beside).unwrap_or(Value::Null);
    Ok(Story { summary, ..Story::read(&trace)? })
}

fn write(output: &Path, stories: &[Story]) -> Result<(), Failure> {
    let page = page::html(stories).map_err(Failure::cannot_start)?;
    fs::write(output, page).map_err(|error| {
        // Half a page is none; what cannot be removed says so itself when it is opened.
        let _ = fs::remove_file(output);
        Failure::cannot_start(format!("cannot write {}: {error}", output.display()))
    })
}
