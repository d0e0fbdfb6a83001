//! A disk that fills up ends the recording, not the run.

use std::fs;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::bench;

/// Room that each file of the run has, in the blocks of 512 bytes that a shell counts in: less than
/// the rig records in four seconds, and enough for the summary.
const BLOCKS: &str = "256";

#[test]
fn a_full_disk_is_told_and_counted_and_the_loop_goes_on() {
    let place = bench::place("full-disk");
    // What an earlier run left, if anything.
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(&place).expect("the place of the tests can be written");
    // Beyond the limit a write fails as on a full disk, once the signal for it is ignored.
    let script = "trap '' XFSZ; ulimit -f \"$0\"; exec \"$@\"";
    let arguments = ["--bus", "udp", "--rate-hz", "50", "--duration-s", "4", "--out", "run"];
    let end = Command::new("sh")
        .args(["-c", script, BLOCKS, env!("CARGO_BIN_EXE_platoon"), "rehearse"])
        .args(arguments)
        .current_dir(&place)
        .stdin(Stdio::null())
        .output()
        .expect("there is a shell");
    let said = String::from_utf8_lossy(&end.stdout);
    assert!(matches!(end.status.code(), Some(0 | 1)), "{said}{:?}", end);
    let text = fs::read(place.join("run/summary.json")).expect("it is there");
    let summary: Value = serde_json::from_slice(&text).expect("and whole");
    let notes = summary["notes"].to_string();
    for told in ["records did not reach the trace", "File too large", "no trace"] {
        assert!(notes.contains(told), "{told}: {notes}");
    }
    for ecu in summary["ecus"].as_array().expect("one per truck") {
        let lived = ecu["ticks"].as_u64().unwrap_or(0) + ecu["skipped"].as_u64().unwrap_or(0);
        assert!(lived >= 199, "four seconds at 50 Hz, no slot lost unnoticed: {ecu}");
    }
    let part =
        traces::Reader::open(&place.join("run/rig.part.mcap")).expect("what fitted is there");
    assert!(part.count() > 1_000, "and can be read");
    fs::remove_dir_all(&place).expect("removable");
}
