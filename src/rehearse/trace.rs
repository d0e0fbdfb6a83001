//! From the parts the processes recorded to the one trace of the run.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use platoon_dbc::Profile;
use traces::{Attachment, MergeOptions, MergeReport, PartReport, Source};

use super::{Outcome, Plan, cyclictest_json, describe_environment};
use crate::bus::BusChoice;
use crate::capture::{CAPTURE, Captured};
use crate::cli::Word;
use crate::run_folder::{FLOOR, RunFolder};
use crate::scenery;

/// Merges what there is into `run.mcap` and removes the parts; what a killed process lost, and what
/// was captured, comes back as notes.
///
/// # Errors
/// Why there is no trace, in words; the parts are kept.
pub(super) fn merge(
    plan: &Plan<'_>,
    folder: &RunFolder,
    bus: &BusChoice,
    outcome: &Outcome,
) -> Result<Vec<String>, String> {
    let parts: Vec<PathBuf> = std::iter::once(Source::Rig)
        .chain((0..plan.trucks() as u8).map(Source::Ecu))
        .map(|source| folder.part(&source.to_string()))
        .filter(|path| path.exists())
        .collect();
    let mut options = options(plan, bus, outcome);
    let asked = &plan.args.capture;
    let captured = (!asked.capture.is_empty()).then(|| Captured::of(&parts, asked));
    if let Some(captured) = &captured {
        options.focus = Some(captured.focus());
        options.metadata.insert(CAPTURE.to_owned(), captured.metadata(asked));
    }
    let report =
        traces::merge_thinned(&parts, &folder.trace(), &options, scenery::SIGNALS_PERIOD_NS)
            .map_err(|error| format!("no trace: {error}"))?;
    for part in &parts {
        // A part that cannot be removed only takes room.
        let _ = fs::remove_file(part);
    }
    Ok(notes(&report).into_iter().chain(captured.map(|captured| captured.to_string())).collect())
}

fn options(plan: &Plan<'_>, bus: &BusChoice, outcome: &Outcome) -> MergeOptions {
    let run = BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("scenario".to_owned(), plan.scenario.name.clone()),
        ("seed".to_owned(), plan.args.run.seed.to_string()),
        ("rate_hz".to_owned(), plan.rate_hz.to_string()),
        ("solver".to_owned(), plan.args.law_options.solver.word()),
        ("profile".to_owned(), plan.args.run.profile.to_string()),
        ("bus_timing".to_owned(), plan.args.run.bus_timing.word()),
        ("time".to_owned(), if plan.is_virtual() { "virtual" } else { "real" }.to_owned()),
        ("arguments".to_owned(), std::env::args().skip(1).collect::<Vec<_>>().join(" ")),
    ]);
    let profile = plan.args.run.profile;
    let file = |name: &str, media_type: &str, text: &str| Attachment {
        name: name.into(),
        media_type: media_type.into(),
        data: text.as_bytes().to_vec(),
    };
    let law = toml::to_string(&plan.calibration).unwrap_or_default();
    let floor = outcome.floor.as_ref().map(|floors| cyclictest_json(&floors.beside).to_string());
    let attachments = [
        file(dbc_name(profile), "text/plain", profile.dbc()),
        file("scenario.toml", "application/toml", &plan.scenario.to_toml()),
        file("law.toml", "application/toml", &law),
    ];
    let floor = floor.map(|text| file(FLOOR, "application/json", &text));
    MergeOptions {
        attachments: attachments.into_iter().chain(floor).collect(),
        metadata: BTreeMap::from([
            ("platoon.run".to_owned(), run),
            ("platoon.environment".to_owned(), describe_environment()),
            ("platoon.bus".to_owned(), describe_bus(bus, plan.trucks())),
            ("platoon.realtime".to_owned(), describe_privileges(outcome)),
            ("platoon.floor_us".to_owned(), describe_floor(outcome)),
        ]),
        scenery: scenery::of(&plan.scenario, &plan.calibration),
        focus: None,
    }
}

fn describe_bus(bus: &BusChoice, trucks: usize) -> BTreeMap<String, String> {
    let interfaces = bus.interfaces(trucks);
    let named = |(truck, name)| (format!("truck{truck}"), name);
    let place = [("backend", bus.backend()), ("reason", &bus.reason)];
    let words = place.map(|(key, value)| (key.to_owned(), value.to_owned()));
    interfaces.into_iter().enumerate().map(named).chain(words).collect()
}

/// What each ECU really obtained; nothing in virtual time.
fn describe_privileges(outcome: &Outcome) -> BTreeMap<String, String> {
    let reported = outcome.ecus.iter().filter_map(|ecu| Some((ecu.truck, ecu.realtime.as_ref()?)));
    reported
        .map(|(truck, obtained)| {
            let cpus = obtained.cpus.iter().map(usize::to_string).collect::<Vec<_>>().join(",");
            let words = format!(
                "policy {}, priority {}, cpus {cpus}, memory {}",
                obtained.policy,
                obtained.priority,
                if obtained.mlock { "locked" } else { "not locked" }
            );
            (format!("ecu{truck}"), words)
        })
        .collect()
}

/// Wake-up lateness of the machine beside the run; nothing in virtual time.
fn describe_floor(outcome: &Outcome) -> BTreeMap<String, String> {
    let Some(floor) = &outcome.floor else { return BTreeMap::new() };
    let p = floor.beside.percentiles();
    [("p50", p.p50_us), ("p99", p.p99_us), ("p999", p.p999_us), ("max", p.max_us)]
        .map(|(name, us)| (name.to_owned(), format!("{us:.1}")))
        .into()
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

/// What the profile's DBC is called, here and among the sources.
fn dbc_name(profile: Profile) -> &'static str {
    match profile {
        Profile::Fd => "platoon.dbc",
        Profile::J1939 => "j1939.dbc",
    }
}
