//! Diff and export: two runs held against each other, and one in the formats of others.

use std::fs;

use serde_json::Value;

use crate::bench::{self, Run};

/// Compares two runs; what it says as JSON, and the command's end.
fn diff(name: &str, a: &Run, b: &Run) -> (Run, Value) {
    let path = |run: &Run| run.out().display().to_string();
    let end = bench::platoon(name, &["diff", &path(a), &path(b), "--json", "out.json"]);
    let text = fs::read(bench::place(name).join("out.json")).expect("it was written");
    (end, serde_json::from_slice(&text).expect("JSON"))
}

fn run(name: &str, more: &[&str]) -> Run {
    let arguments = ["--rate-hz", "20", "--duration-s", "12"];
    bench::rehearse_virtually(name, &[&arguments[..], more].concat())
}

#[test]
fn two_runs_are_told_apart_at_their_first_tick_with_the_frame_that_explains_it() {
    let (one, again) = (run("diff-one", &[]), run("diff-again", &[]));
    let (end, _) = diff("diff-same", &one, &again);
    end.expect_code(0);
    assert!(end.stdout.contains("identical"), "{}", end.stdout);

    // Another seed: other delays, so some V2V message comes at another tick.
    let other = run("diff-other", &["--seed", "2"]);
    let (end, found) = diff("diff-seeds", &one, &other);
    end.expect_code(1);
    let first = &found["ecus"][1]["first"];
    assert!(first["upstream"]["message"].as_str().is_some_and(|name| name.starts_with("V2v")));
    assert!(end.stdout.contains("set up differently: seed: 1 against 2"), "{}", end.stdout);

    // Another law: the same frames until it makes itself felt.
    let law = run("diff-law", &["--ucl", "ploeg"]);
    let (end, found) = diff("diff-laws", &one, &law);
    end.expect_code(1);
    assert_eq!(found["ecus"][1]["first"]["upstream"], Value::Null, "{}", end.stdout);
    assert!(found["spacing"]["since_s"].as_f64().is_some(), "{}", end.stdout);
}

#[test]
fn a_run_is_exported_to_logs_and_tables() {
    let run = run("export-of", &[]);
    let path = run.out().display().to_string();
    let export = |format: &str, out: &str| {
        let name = format!("export-{format}");
        let end = bench::platoon(&name, &["export", &path, "--to", format, "-o", out]);
        end.expect_code(0);
        let out = bench::place(&name).join(out);
        let lines = |file: &str| {
            let file = if file.is_empty() { out.clone() } else { out.join(file) };
            let text = fs::read_to_string(file).expect("it was written");
            (text.lines().count(), text.lines().next().unwrap_or_default().to_owned())
        };
        match format {
            "csv" => lines("bus1.EgoState.csv"),
            "parquet" => {
                let bytes = fs::read(out.join("bus1.EgoState.parquet")).expect("it was written");
                assert_eq!((&bytes[..4], &bytes[bytes.len() - 4..]), (&b"PAR1"[..], &b"PAR1"[..]));
                (0, String::new())
            }
            _ => lines(""),
        }
    };
    let frames: usize =
        (0..4).map(|bus| run.messages_by_topic()[&format!("/can/bus{bus}/frames")]).sum();
    let (lines, first) = export("candump", "run.log");
    assert_eq!(lines, frames);
    assert!(first.starts_with("(0000000000.000000) loopback"), "{first}");
    assert_eq!(export("asc", "run.asc").0, frames + 6);
    let (rows, head) = export("csv", "tables");
    assert!(head.starts_with("time_s,") && head.contains("[m/s]"), "{head}");
    assert_eq!(rows, 1 + 241, "an EgoState per tick");
    export("parquet", "tables");
}
