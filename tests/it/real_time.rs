//! Rehearsals on the machine's own clock: separate processes over UDP on the loopback interface.
//!
//! Nothing here depends on how punctual the machine is: these tests judge what must hold on the
//! slowest one, and every wait has a limit that only a hang exceeds.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use platoon::summary::{Summary, Verdict};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::bench::{self, Ongoing, Run};

/// How long a short run may take to end before it counts as hung.
const LIMIT: Duration = Duration::from_secs(120);
/// How long an interrupted run may take to end by itself.
const END_LIMIT: Duration = Duration::from_secs(30);
/// Size from which a rig's recording surely holds frames \[bytes\].
const RECORDING_MIN_BYTES: u64 = 100_000;
/// Every phase of a tick that a report must have.
const PHASES: [&str; 8] = ["wake", "drain", "ucl", "lml_build", "qp", "guard", "send", "total"];

fn over_udp<'a>(duration_s: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let arguments = ["--bus", "udp", "--rate-hz", "200", "--duration-s", duration_s];
    [&arguments, more].concat()
}

fn rehearse(name: &str, duration_s: &str, more: &[&str]) -> Run {
    bench::start_rehearsal(name, &over_udp(duration_s, more)).finish(LIMIT)
}

/// Trucks whose ECU left a report.
fn reporting(summary: &Summary) -> Vec<u8> {
    summary.ecus.iter().map(|ecu| ecu.truck).collect()
}

/// Asserts that a note holds all of these words.
#[track_caller]
fn assert_noted(summary: &Summary, words: &[&str]) {
    let has_all = |note: &String| words.iter().all(|word| note.contains(word));
    assert!(summary.notes.iter().any(has_all), "no {words:?} in {:?}", summary.notes);
}

/// Asserts that the trace has what every bus and these ECUs recorded; damage fails it.
#[track_caller]
fn assert_trace_is_whole(run: &Run, ecus: &[u8]) {
    let topics: BTreeMap<String, usize> = run.messages_by_topic();
    let expected = (0..4)
        .map(|bus| format!("/can/bus{bus}/frames"))
        .chain(ecus.iter().flat_map(|i| [format!("/ecu{i}/tick"), format!("/ecu{i}/rx")]))
        .chain(["/world/truth".to_owned(), "/scene".to_owned()]);
    for topic in expected {
        assert!(topics.get(&topic).is_some_and(|count| *count > 0), "no {topic} in {topics:?}");
    }
}

/// Asserts that percentiles are numbers, not negative, and rise.
#[track_caller]
fn assert_rising(of: &Value, names: &[&str]) {
    let number = |name: &&str| of[*name].as_f64().unwrap_or_else(|| panic!("no {name} in {of}"));
    let values: Vec<f64> = names.iter().map(number).collect();
    assert!(values[0] >= 0.0 && values.is_sorted(), "{of}");
}

#[test]
fn four_ecu_processes_and_the_rig_complete_a_run() {
    let run = rehearse("real-time-four", "8", &[]);
    assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
    let (summary, json) = (run.summary(), run.json());
    assert_eq!(reporting(&summary), [0, 1, 2, 3]);
    assert!((summary.duration_s - 8.0).abs() < 1e-6, "{} s", summary.duration_s);
    assert_eq!(summary.bus.backend, "udp");
    assert!(summary.rig_pace.is_some());
    for ecu in json["ecus"].as_array().expect("a list") {
        assert!(ecu["ticks"].as_u64() > Some(0), "{ecu}");
        assert!(ecu["realtime"]["policy"].is_string(), "{ecu}");
        assert_eq!(ecu["thread"]["heap_uses"].as_u64(), Some(0), "{ecu}");
        for phase in PHASES {
            assert_rising(&ecu["phase_us"][phase], &["p50", "p90", "p99", "p999", "max"]);
        }
    }
    assert_rising(&json["machine_floor_us"], &["p50", "p99", "p999", "max"]);
    let timing = json["timing_verdict"].as_str().expect("a word");
    assert!(["pass", "fail", "inconclusive"].contains(&timing), "{timing}");
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
}

#[test]
fn a_run_leaves_its_products_and_nothing_else() {
    let run = rehearse("real-time-files", "2", &[]);
    assert!(matches!(run.code(), Some(0 | 1)), "{}", run.stderr);
    let entries = fs::read_dir(run.out()).expect("the run's folder");
    let name = |entry: std::io::Result<fs::DirEntry>| {
        entry.expect("an entry").file_name().to_string_lossy().into_owned()
    };
    // A log stays when a process said something, such as a privilege it was refused.
    let mut names: Vec<String> = entries.map(name).filter(|n| !n.ends_with(".log")).collect();
    names.sort();
    let expected =
        ["floor.json", "law.toml", "report.html", "run.mcap", "scenario.toml", "summary.json"];
    assert_eq!(names, expected);
    let trace = run.trace();
    let attached = trace.attachments().iter().find(|file| file.name == "floor.json");
    let json = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).expect("JSON");
    let beside = fs::read(run.out().join("floor.json")).expect("it was listed");
    let floor = json(&attached.expect("the trace has the floor, too").data);
    assert_eq!(floor, json(&beside));
}

#[test]
fn one_ecu_under_test_and_the_others_beside_the_rig_all_report() {
    let ongoing = bench::start_rehearsal("real-time-one", &over_udp("4", &["--ecu", "2"]));
    let out = ongoing.out();
    wait_until_recording(&out);
    let of_ecus = |words: &Vec<String>| words.iter().any(|word| word == "controller");
    let ecus: Vec<_> = processes_of(&out).into_iter().filter(|(_, w)| of_ecus(w)).collect();
    let run = ongoing.finish(LIMIT);
    assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
    assert_eq!(ecus.len(), 1, "{ecus:?}");
    assert!(ecus[0].1.windows(2).any(|pair| pair == ["--truck", "2"]), "{ecus:?}");
    assert_eq!(reporting(&run.summary()), [0, 1, 2, 3]);
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
}

#[test]
#[ignore = "a minute in real time: ./test.sh --long"]
fn heavy_in_a_minute_at_1_khz_no_loop_uses_the_heap_or_faults_a_page() {
    let arguments = ["--bus", "udp", "--rate-hz", "1000", "--duration-s", "62"];
    let run = bench::start_rehearsal("real-time-minute", &arguments).finish(LIMIT);
    let summary = run.summary();
    assert_eq!(reporting(&summary), [0, 1, 2, 3], "{}", run.stderr);
    for ecu in &summary.ecus {
        let realtime = ecu.realtime.as_ref().expect("it ran in real time");
        assert!(realtime.mlock, "pages fault where memory is not locked: platoon vcan check");
        let thread = ecu.thread.expect("Linux tells");
        assert!(thread.cpu_ns > 0 && ecu.ticks > 30_000, "{ecu:?}");
        let found = (thread.heap_uses, thread.minor_faults, thread.major_faults);
        assert_eq!(found, (0, 0, 0), "uses of the heap, minor and major faults of {ecu:?}");
    }
}

#[test]
fn an_ecu_killed_by_a_fault_is_missed() {
    let run = rehearse("real-time-fault", "8", &["--fault", "kill-ecu@3:truck=1"]);
    run.expect_code(1);
    let summary = run.summary();
    assert_eq!(summary.verdict, Verdict::Fail);
    assert!((summary.duration_s - 8.0).abs() < 1e-6, "ended at {} s", summary.duration_s);
    assert_eq!(reporting(&summary), [0, 2, 3]);
    assert_noted(&summary, &["fault injected", "kill-ecu@3:truck=1"]);
    assert_noted(&summary, &["1 ECU(s)", "without a report"]);
    assert_noted(&summary, &["ecu1", "recording not closed"]);
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
}

#[test]
fn an_ecu_killed_by_somebody_else_is_missed() {
    let ongoing = bench::start_rehearsal("real-time-murder", &over_udp("10", &[]));
    let out = ongoing.out();
    wait_until_recording(&out);
    let is_ecu_2 = |words: &[String]| words.windows(2).any(|pair| pair == ["--truck", "2"]);
    let found = processes_of(&out).into_iter().find(|(_, words)| is_ecu_2(words));
    let (pid, _) = found.expect("ECU 2 runs");
    kill_process(pid, Signal::KILL).expect("a process of our own");
    let run = ongoing.finish(LIMIT);
    run.expect_code(1);
    let summary = run.summary();
    assert_eq!(reporting(&summary), [0, 1, 3]);
    assert_noted(&summary, &["ecu2", "killed"]);
    assert_noted(&summary, &["1 ECU(s)", "without a report"]);
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
}

#[test]
fn an_ecu_that_pauses_comes_back_and_reports() {
    let run = rehearse("real-time-pause", "4", &["--fault", "pause-ecu@1+0.5:truck=1"]);
    assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
    let summary = run.summary();
    assert_eq!(reporting(&summary), [0, 1, 2, 3]);
    assert_noted(&summary, &["fault injected", "pause-ecu@1+0.5:truck=1"]);
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
}

#[test]
fn no_process_outlives_a_supervisor_that_was_killed() {
    let ongoing = bench::start_rehearsal("real-time-orphans", &over_udp("100", &[]));
    let out = ongoing.out();
    wait_until_recording(&out);
    assert_eq!(processes_of(&out).len(), 5, "the rig and four ECUs");
    send(&ongoing, Signal::KILL);
    let run = ongoing.finish(END_LIMIT);
    assert_eq!(run.code(), None);
    bench::eventually("the end of its children", END_LIMIT, || {
        processes_of(&out).is_empty().then_some(())
    });
}

#[test]
fn an_interrupted_run_ends_by_itself_with_everything_written() {
    let ongoing = bench::start_rehearsal("real-time-interrupted", &over_udp("100", &[]));
    let out = ongoing.out();
    wait_until_recording(&out);
    send(&ongoing, Signal::INT);
    let run = ongoing.finish(END_LIMIT);
    run.expect_code(1);
    let summary = run.summary();
    assert_eq!(summary.verdict, Verdict::Fail);
    assert!((0.01..100.0).contains(&summary.duration_s), "{} s", summary.duration_s);
    assert_noted(&summary, &["interrupted"]);
    assert_eq!(reporting(&summary), [0, 1, 2, 3], "the ECUs ended in order");
    assert_trace_is_whole(&run, &[0, 1, 2, 3]);
    assert_eq!(processes_of(&out), Vec::new(), "left running");
}

#[test]
fn two_runs_at_once_take_different_ports_and_both_end() {
    let names = ["real-time-first", "real-time-second"];
    let runs: Vec<Ongoing> =
        names.iter().map(|name| bench::start_rehearsal(name, &over_udp("4", &[]))).collect();
    let runs: Vec<Run> = runs.into_iter().map(|run| run.finish(LIMIT)).collect();
    let interfaces: Vec<_> = runs.iter().map(|run| run.summary().bus.interfaces).collect();
    assert!(interfaces[0].iter().all(|name| !interfaces[1].contains(name)), "{interfaces:?}");
    for run in &runs {
        assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
        assert_eq!(reporting(&run.summary()), [0, 1, 2, 3]);
        let foreign: u64 = run.summary().nodes.iter().map(|node| node.unknown).sum();
        assert_eq!(foreign, 0, "frames of the other run");
        assert_trace_is_whole(run, &[0, 1, 2, 3]);
    }
}

/// Waits until the rig has surely begun: its recording grows from bench time 0 on.
fn wait_until_recording(out: &Path) {
    let part = out.join("rig.part.mcap");
    bench::eventually("the rig records", LIMIT, || {
        let bytes = fs::metadata(&part).map_or(0, |part| part.len());
        (bytes > RECORDING_MIN_BYTES).then_some(())
    });
}

fn send(run: &Ongoing, what: Signal) {
    let pid = Pid::from_raw(run.pid() as i32).expect("no process has number 0");
    kill_process(pid, what).expect("a process of our own");
}

/// The processes that were started for the run in this folder, with their arguments.
fn processes_of(out: &Path) -> Vec<(Pid, Vec<String>)> {
    let out = out.to_str().expect("UTF-8").to_owned();
    let entries = fs::read_dir("/proc").expect("Linux has /proc");
    let number = |entry: fs::DirEntry| entry.file_name().to_str()?.parse::<i32>().ok();
    entries
        .filter_map(|entry| number(entry.ok()?))
        .filter_map(|number| Some((Pid::from_raw(number)?, arguments_of(number)?)))
        .filter(|(_, words)| words.iter().any(|word| word == "--supervised"))
        .filter(|(_, words)| words.contains(&out))
        .collect()
}

/// The arguments of a process; none when it has ended.
fn arguments_of(number: i32) -> Option<Vec<String>> {
    let line = fs::read(format!("/proc/{number}/cmdline")).ok()?;
    Some(line.split(|byte| *byte == 0).map(|word| String::from_utf8_lossy(word).into()).collect())
}
