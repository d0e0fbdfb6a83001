//! Replay: a recorded run comes out the same again, bit for bit; what was tampered with is found.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use platoon_dbc::{Actuation, Frame, V2vState};
use serde_json::Value;
use traces::{
    FrameRecord, MergeOptions, Overflow, Reader, Record, Recorder, RecorderOptions, Source, Topic,
};

use crate::bench::{self, Run};

/// Replays a trace; what it says as JSON, and the command's end.
fn replay(name: &str, run: &Path, arguments: &[&str]) -> (Run, Value) {
    let run = run.to_str().expect("the place of the tests is UTF-8");
    let end = bench::platoon(name, &[&["replay", run, "--json", "out.json"], arguments].concat());
    let text = fs::read(bench::place(name).join("out.json"));
    let json = text.map_or(Value::Null, |text| serde_json::from_slice(&text).expect("JSON"));
    (end, json)
}

/// The sum of a count over the ECUs.
fn sum(json: &Value, key: &str) -> u64 {
    let ecus = json["ecus"].as_array().expect("one per ECU");
    ecus.iter().map(|ecu| ecu[key].as_u64().expect("a count")).sum()
}

#[test]
fn a_run_comes_out_the_same_whole_damaged_or_from_its_middle_and_otherwise_when_changed() {
    let run = bench::rehearse_virtually("replay-of", &["--rate-hz", "50", "--duration-s", "24"]);
    let trace = run.out().join("run.mcap");

    let (end, whole) = replay("replay-whole", &run.out(), &[]);
    end.expect_code(0);
    assert!(end.stdout.contains("identical: all 4800 ticks"), "{}", end.stdout);
    assert_eq!((sum(&whole, "ticks"), sum(&whole, "differing")), (4800, 0));

    let (end, part) = replay("replay-part", &trace, &["--ecu", "2", "--from", "15", "--to", "17"]);
    end.expect_code(0);
    assert_eq!((sum(&part, "ticks"), sum(&part, "differing")), (100, 0));

    let changed = ["--set", "law.ucl.k1=[0.3, 0.9, 0.2]", "--ecu", "1"];
    let (end, changed) = replay("replay-changed", &trace, &changed);
    end.expect_code(0);
    assert!(sum(&changed, "differing") > 100, "{}", end.stdout);
    let (end, _) = replay("replay-in-vain", &trace, &["--set", "obstacles.1.x_m=1"]);
    end.expect_code(2);

    // A chunk in the first ten seconds is lost; the snapshot at 10 s is where it goes on.
    let bytes = with_a_damaged_chunk(fs::read(&trace).expect("readable"));
    let damaged = run.out().join("damaged.mcap");
    fs::write(&damaged, bytes).expect("writable");
    let (end, damaged) = replay("replay-damaged", &damaged, &[]);
    end.expect_code(0);
    let holes = |ecu: &Value| ecu["holes"].as_array().map_or(0, Vec::len);
    assert!(damaged["ecus"].as_array().expect("ECUs").iter().all(|ecu| holes(ecu) == 1));
    assert!(end.stdout.contains("resumed by the snapshot of tick 500"), "{}", end.stdout);
    assert!((1400..4800).contains(&sum(&damaged, "ticks")), "{}", end.stdout);
}

/// The trace with one bit flipped a fifth into it, in the first place there that spoils a chunk.
fn with_a_damaged_chunk(whole: Vec<u8>) -> Vec<u8> {
    let damaged = (whole.len() / 5..whole.len()).step_by(20_000).map(|place| {
        let mut bytes = whole.clone();
        bytes[place] ^= 1;
        bytes
    });
    let is_spoiled = |bytes: &Vec<u8>| {
        let mut reader = Reader::from_bytes(bytes.clone()).expect("its beginning is whole");
        (&mut reader).for_each(drop);
        reader.loss().chunks == 1
    };
    let mut damaged = damaged;
    damaged.find(is_spoiled).expect("most of a trace is chunks")
}

#[test]
fn clarabel_agrees_with_every_qp_of_a_run() {
    let run = bench::rehearse_virtually("replay-qps", &["--rate-hz", "20", "--duration-s", "3"]);
    let (end, audit) = replay("replay-audit", &run.out(), &["--solver", "clarabel"]);
    end.expect_code(0);
    for ecu in audit["ecus"].as_array().expect("one per ECU") {
        assert!(ecu["audit"]["qps"].as_u64() >= Some(50), "{ecu}");
        assert_eq!(ecu["audit"]["disputed"], 0);
    }
}

#[test]
fn a_run_over_udp_comes_out_the_same() {
    let arguments = ["--bus", "udp", "--rate-hz", "50", "--duration-s", "3"];
    let run = bench::rehearse("replay-udp", &arguments);
    assert!(matches!(run.code(), Some(0 | 1)), "{}", run.stderr);
    let (end, _) = replay("replay-of-udp", &run.out(), &[]);
    end.expect_code(0);
}

#[test]
fn one_flipped_bit_in_one_frame_is_found_at_its_tick() {
    let run = bench::rehearse_virtually("replay-flip", &["--rate-hz", "20", "--duration-s", "6"]);
    let mut is_done = false;
    let forged = rewritten(&run, |topic, record| {
        let is_asked = topic == Topic::Rx(1) && record.frame.id() == V2vState::ID;
        let is_it = !is_done && record.tick >= 60 && is_asked;
        is_done |= is_it;
        if is_it { flipped(&record.frame) } else { record.frame }
    });
    let (end, found) = replay("replay-forged", &forged, &["--ecu", "1"]);
    end.expect_code(1);
    let stray = &found["ecus"][0]["strays"];
    assert_eq!((&stray["frames"], &stray["first_tick"]), (&1.into(), &60.into()), "{}", end.stdout);
}

#[test]
fn a_command_on_the_bus_that_the_ecu_would_not_send_is_found() {
    let run = bench::rehearse_virtually("replay-bus", &["--rate-hz", "20", "--duration-s", "6"]);
    let mut is_done = false;
    let forged = rewritten(&run, |topic, record| {
        let is_asked = topic == Topic::Frames(1) && record.frame.id() == Actuation::ID;
        let is_it = !is_done && record.tick >= 60 && is_asked;
        is_done |= is_it;
        if is_it { flipped(&record.frame) } else { record.frame }
    });
    let (end, found) = replay("replay-foreign", &forged, &["--ecu", "1"]);
    end.expect_code(1);
    let ecu = &found["ecus"][0];
    assert_eq!((&ecu["differing"], &ecu["strays"]), (&0.into(), &Value::Null));
    let foreign = &ecu["foreign_commands"];
    let expected = (&1.into(), &60.into());
    assert_eq!((&foreign["frames"], &foreign["first_tick"]), expected, "{}", end.stdout);
}

/// The frame with its last bit the other way round.
fn flipped(frame: &Frame) -> Frame {
    let mut data = frame.data().to_vec();
    *data.last_mut().expect("it has data") ^= 1;
    Frame::new(frame.id(), frame.flags(), &data).expect("as valid as before")
}

/// The run once more as its rig and ECU 1 recorded it, with `change` in the frames of truck 1.
fn rewritten(run: &Run, mut change: impl FnMut(Topic, &FrameRecord) -> Frame) -> PathBuf {
    let (mut of_rig, mut of_ecu) = (BTreeMap::new(), BTreeMap::new());
    for message in run.trace() {
        let mut record = message.record().ok();
        if let (Some(topic @ (Topic::Rx(1) | Topic::Frames(1))), Some(Record::Frame(frame))) =
            (message.channel.kind, &mut record)
        {
            frame.frame = change(topic, frame);
        }
        let part = match message.channel.kind {
            Some(Topic::Frames(1)) => &mut of_rig,
            Some(Topic::Rx(1) | Topic::Tick(1) | Topic::Memory(1)) => &mut of_ecu,
            _ => continue,
        };
        part.insert(message.sequence, record.expect("every record of ours decodes"));
    }
    let parts = [(Source::Rig, of_rig), (Source::Ecu(1), of_ecu)]
        .map(|(source, records)| record(&run.out(), source, records.into_values()));
    let reader = run.trace();
    let options = MergeOptions {
        attachments: reader.attachments().to_vec(),
        metadata: BTreeMap::from([(
            "platoon.run".into(),
            reader.metadata()["platoon.run"].clone(),
        )]),
        ..MergeOptions::default()
    };
    let forged = run.out().join("forged.mcap");
    traces::merge(&parts, &forged, &options).expect("merges");
    forged
}

/// Records these in a part of their own.
fn record(folder: &Path, source: Source, records: impl Iterator<Item = Record>) -> PathBuf {
    let path = folder.join(format!("{source}.part.mcap"));
    let options = RecorderOptions { overflow: Overflow::Wait, ..RecorderOptions::new(source) };
    let mut recorder = Recorder::start(&path, options).expect("starts");
    for record in records {
        match record {
            Record::Frame(frame) => recorder.push(frame),
            Record::Tick(tick) => recorder.push(*tick),
            Record::Memory(memory) => recorder.push(*memory),
            Record::Truth(_) | Record::Dropped(_) => true,
        };
    }
    assert_eq!(recorder.finish().error, None);
    path
}

#[test]
fn every_extract_that_was_kept_comes_out_the_same() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("traces/golden");
    let files = fs::read_dir(&folder).expect("there are extracts").filter_map(Result::ok);
    let kept: Vec<PathBuf> = files.map(|file| file.path()).filter(|path| is_mcap(path)).collect();
    assert!(!kept.is_empty(), "{}: no extract", folder.display());
    for path in kept {
        let (end, _) = replay("replay-golden", &path, &[]);
        end.expect_code(0);
    }
}

fn is_mcap(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "mcap")
}

#[test]
fn a_moment_cut_out_of_a_run_replays_by_itself() {
    let run = bench::rehearse_virtually("extract-of", &["--rate-hz", "20", "--duration-s", "14"]);
    let out = run.out();
    let path = out.to_str().expect("the place of the tests is UTF-8");
    let arguments = ["--tick", "250", "--before", "1", "--after", "0.5", "-o", "cut.mcap"];
    let end = bench::platoon("extract", &[&["extract", path], &arguments[..]].concat());
    end.expect_code(0);
    let (end, json) = replay("extract-again", &bench::place("extract").join("cut.mcap"), &[]);
    end.expect_code(0);
    assert_eq!(sum(&json, "ticks"), 4 * 31, "{}", end.stdout);
}
