//! From the parts the processes recorded to the one trace of the run.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use traces::{Attachment, MergeOptions, MergeReport, PartReport, Source};

use super::{Plan, describe_environment};
use crate::run_folder::RunFolder;

/// Merges what there is into `run.mcap` and removes the parts; what a killed process lost comes
/// back as notes.
///
/// # Errors
/// Why there is no trace, in words; the parts are kept.
pub(super) fn merge(plan: &Plan<'_>, folder: &RunFolder) -> Result<Vec<String>, String> {
    let parts: Vec<PathBuf> = std::iter::once(Source::Rig)
        .chain((0..plan.trucks() as u8).map(Source::Ecu))
        .map(|source| folder.part(&source.to_string()))
        .filter(|path| path.exists())
        .collect();
    let report = traces::merge(&parts, &folder.trace(), &options(plan))
        .map_err(|error| format!("no trace: {error}"))?;
    for part in &parts {
        // A part that cannot be removed only takes room.
        let _ = fs::remove_file(part);
    }
    Ok(notes(&report))
}

fn options(plan: &Plan<'_>) -> MergeOptions {
    let run = BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("scenario".to_owned(), plan.scenario.name.clone()),
        ("seed".to_owned(), plan.args.run.seed.to_string()),
        ("rate_hz".to_owned(), plan.args.run.rate_hz.to_string()),
        ("solver".to_owned(), plan.args.solver.word().to_owned()),
        ("time".to_owned(), if plan.is_virtual() { "virtual" } else { "real" }.to_owned()),
        ("arguments".to_owned(), std::env::args().skip(1).collect::<Vec<_>>().join(" ")),
    ]);
    let file = |name: &str, media_type: &str, text: &str| Attachment {
        name: name.into(),
        media_type: media_type.into(),
        data: text.as_bytes().to_vec(),
    };
    let law = toml::to_string(&plan.calibration).unwrap_or_default();
    MergeOptions {
        attachments: vec![
            file("platoon.dbc", "text/plain", platoon_dbc::DBC),
            file("scenario.toml", "application/toml", &plan.scenario.to_toml()),
            file("law.toml", "application/toml", &law),
        ],
        metadata: BTreeMap::from([
            ("platoon.run".to_owned(), run),
            ("platoon.environment".to_owned(), describe_environment()),
        ]),
    }
}

fn notes(report: &MergeReport) -> Vec<String> {
    report.parts.iter().filter_map(part_note).collect()
}

fn part_note(part: &PartReport) -> Option<String> {
    let name = part.source.map_or_else(|| part.path.display().to_string(), |s| s.to_string());
    if let Some(why) = &part.unreadable {
        return Some(format!("{name}: recording lost: {why}"));
    }
    let until_s = part.last_time_ns.unwrap_or(0) as f64 * 1e-9;
    (!part.is_finished)
        .then(|| format!("{name}: recording not closed, kept up to {until_s:.3} s of bench time"))
}
