use std::path::PathBuf;

use platoon_dbc::{Actuation, ActuationStatus};

use super::*;
use crate::{
    FrameRecord, MemoryRecord, Overflow, Reader, Recorder, RecorderOptions, Source, TickRecord,
    TruckTruth, TruthRecord,
};

/// A folder of its own for temporary files; removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("traces-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).expect("writable");
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Records with `push` and says where.
    fn part(&self, source: Source, start_wall_ns: u64, push: impl Fn(&mut Recorder)) -> PathBuf {
        let path = self.path(&format!("{source}.part.mcap"));
        let options = RecorderOptions {
            start_wall_ns,
            overflow: Overflow::Wait,
            ..RecorderOptions::new(source)
        };
        let mut recorder = Recorder::start(&path, options).expect("starts");
        push(&mut recorder);
        assert_eq!(recorder.finish().error, None);
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn command(time_ns: u64) -> FrameRecord {
    let command = Actuation {
        answers_tick: 7,
        force_n: -1234.5,
        steering_rad: 0.01,
        actuation_status: ActuationStatus::Guard,
    };
    let frame = command.encode(3).expect("in range");
    FrameRecord { bus: 1, time_ns, stamp_ns: 0, tick: 7, tx: false, frame }
}

fn tick(time_ns: u64) -> TickRecord {
    TickRecord { time_ns, ..TickRecord::default() }
}

fn messages(path: &Path) -> Vec<Message> {
    Reader::open(path).expect("MCAP").collect()
}

fn topics_and_times(path: &Path) -> Vec<(String, u64)> {
    let messages = messages(path).into_iter();
    messages.map(|message| (message.channel.topic.clone(), message.time_ns())).collect()
}

#[test]
fn parts_are_merged_in_time_order_and_ties_in_part_order() {
    let folder = Folder::new("order");
    let rig = folder.part(Source::Rig, 1_000, |recorder| {
        for time_ns in [10, 30, 20] {
            recorder.push(command(time_ns));
        }
    });
    // Its wall clock was read 5 ns later: bench times count, not log times.
    let ecu = folder.part(Source::Ecu(1), 1_005, |recorder| {
        for time_ns in [20, 25] {
            recorder.push(tick(time_ns));
        }
    });
    let out = folder.path("run.mcap");
    let report = merge(&[rig, ecu], &out, &MergeOptions::default()).expect("merges");
    let expected = [
        ("/can/bus1/frames", 10),
        ("/bus1/Actuation", 10),
        ("/can/bus1/frames", 20),
        ("/bus1/Actuation", 20),
        ("/ecu1/tick", 20),
        ("/ecu1/tick", 25),
        ("/can/bus1/frames", 30),
        ("/bus1/Actuation", 30),
    ]
    .map(|(topic, time_ns)| (topic.to_owned(), time_ns));
    assert_eq!(topics_and_times(&out), expected);
    assert_eq!(report.messages, 8);
    assert_eq!(report.out_of_order, 0);
    assert!(report.parts.iter().all(PartReport::is_whole));
    assert_eq!(report.bytes, fs::metadata(&out).expect("there").len());
}

#[test]
fn a_merged_frame_reads_back_as_recorded() {
    let folder = Folder::new("frame");
    let stamped = FrameRecord { stamp_ns: 99, ..command(20) };
    let rig = folder.part(Source::Rig, 1_000, |recorder| {
        recorder.push(command(10));
        recorder.push(stamped);
    });
    // Its wall clock was read 5 ns later, so its log times are others than in the merged trace.
    let ecu = folder.part(Source::Ecu(1), 1_005, |recorder| {
        recorder.push(command(30));
        recorder.push(FrameRecord { stamp_ns: 98, ..command(40) });
    });
    let out = folder.path("run.mcap");
    merge(&[rig, ecu], &out, &MergeOptions::default()).expect("merges");
    let reader = Reader::open(&out).expect("MCAP");
    let reader = reader.with_topics(["/can/bus1/frames", "/ecu1/rx"]);
    let frames: Vec<_> = reader.map(|message| message.record().expect("decodes")).collect();
    let of_ecu = [command(30), FrameRecord { stamp_ns: 98, ..command(40) }];
    assert_eq!(frames, [command(10), stamped, of_ecu[0], of_ecu[1]].map(crate::Record::Frame));
}

#[test]
fn attachments_and_metadata_come_along() {
    let folder = Folder::new("attached");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        recorder.push(command(1));
    });
    let attachment = Attachment {
        name: "platoon.dbc".into(),
        media_type: "text/plain".into(),
        data: platoon_dbc::DBC.into(),
    };
    let run = BTreeMap::from([("seed".to_owned(), "42".to_owned())]);
    let options = MergeOptions {
        attachments: vec![attachment.clone()],
        metadata: BTreeMap::from([("run".to_owned(), run.clone())]),
        ..MergeOptions::default()
    };
    let out = folder.path("run.mcap");
    merge(&[rig], &out, &options).expect("merges");
    let reader = Reader::open(&out).expect("MCAP");
    assert_eq!(reader.attachments(), [attachment]);
    assert_eq!(reader.metadata().get("run"), Some(&run));
    assert!(reader.metadata()[PARTS].contains_key("rig.part.mcap"));
}

#[test]
fn a_cut_part_is_merged_as_far_as_it_goes_and_the_report_says_so() {
    let folder = Folder::new("cut");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        for time_ns in 0..1000 {
            recorder.push(command(time_ns));
        }
    });
    let ecu = folder.part(Source::Ecu(1), 0, |recorder| {
        for time_ns in 0..60_000 {
            recorder.push(tick(time_ns));
        }
    });
    let bytes = fs::read(&ecu).expect("there");
    fs::write(&ecu, &bytes[..bytes.len() * 2 / 3]).expect("writable");
    let out = folder.path("run.mcap");
    let report = merge(&[rig, ecu], &out, &MergeOptions::default()).expect("merges");
    let [rig, ecu] = report.parts.as_slice() else { panic!("two parts") };
    assert!(rig.is_whole() && !ecu.is_whole());
    assert!(ecu.loss.is_truncated && !ecu.is_finished);
    assert!(ecu.messages > 0 && ecu.messages < 60_000);
    assert_eq!(ecu.last_time_ns, Some(ecu.messages - 1));
    assert!(ecu.to_string().contains("its process ended early"), "{ecu}");
    assert_eq!(report.messages, 2 * 1000 + ecu.messages);
}

#[test]
fn a_part_that_is_not_there_is_reported_and_the_others_are_merged() {
    let folder = Folder::new("missing");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        recorder.push(command(1));
    });
    let parts = [rig, folder.path("ecu0.part.mcap")];
    let out = folder.path("run.mcap");
    let report = merge(&parts, &out, &MergeOptions::default()).expect("merges");
    assert!(report.parts[1].unreadable.is_some());
    assert_eq!(report.messages, 2);
}

#[test]
fn without_any_part_nothing_is_left_behind() {
    let folder = Folder::new("nothing");
    let out = folder.path("run.mcap");
    let error = merge(&[folder.path("x.mcap")], &out, &MergeOptions::default());
    assert!(matches!(error, Err(MergeError::NoPart(_))));
    assert_eq!(fs::read_dir(&folder.0).expect("there").count(), 0);
}

#[test]
fn the_scene_comes_at_twenty_hertz() {
    let folder = Folder::new("scene");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        for time_ms in 0..1000 {
            let mut truth = TruthRecord { time_ns: time_ms * 1_000_000, ..TruthRecord::default() };
            truth.trucks.push(TruckTruth::default()).expect("room");
            recorder.push(truth);
        }
    });
    let out = folder.path("run.mcap");
    merge(&[rig], &out, &MergeOptions::default()).expect("merges");
    let topics = topics_and_times(&out);
    let scenes: Vec<_> = topics.iter().filter(|(topic, _)| topic == "/scene").collect();
    assert_eq!(scenes.len(), 20);
    assert!(scenes.iter().all(|(_, time_ns)| time_ns % 50_000_000 == 0));
}

#[test]
fn decoded_messages_can_be_thinned_but_frames_stay() {
    let folder = Folder::new("thinned");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        for time_ns in 0..100 {
            recorder.push(command(time_ns));
            recorder.push(command(time_ns)); // as the pages of a multiplexed message
        }
    });
    let out = folder.path("run.mcap");
    merge_thinned(&[rig], &out, &MergeOptions::default(), 10).expect("merges");
    let found = topics_and_times(&out);
    let (frames, decoded): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|(topic, _)| topic.starts_with("/can/"));
    assert_eq!(frames.len(), 200);
    assert_eq!(decoded.len(), 20);
    assert!(decoded.iter().all(|(_, time_ns)| time_ns % 10 == 0));
}

#[test]
fn the_same_parts_merge_into_the_same_bytes() {
    let folder = Folder::new("same");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        for time_ns in 0..20_000 {
            recorder.push(command(time_ns));
        }
        recorder.push(MemoryRecord::default());
    });
    let outs = [folder.path("a.mcap"), folder.path("b.mcap")];
    for out in &outs {
        merge(std::slice::from_ref(&rig), out, &MergeOptions::default()).expect("merges");
    }
    let [a, b] = outs.map(|out| fs::read(out).expect("there"));
    assert!(a == b, "two merges of the same part differ");
}

#[test]
fn damaged_parts_never_stop_a_merge() {
    let folder = Folder::new("damaged");
    let rig = folder.part(Source::Rig, 0, |recorder| {
        for time_ns in 0..50 {
            recorder.push(command(time_ns));
        }
    });
    let whole = fs::read(&rig).expect("there");
    let out = folder.path("run.mcap");
    for position in (8..whole.len()).step_by(whole.len() / 60 + 1) {
        let mut damaged = whole.clone();
        damaged[position] ^= 0x55;
        fs::write(&rig, &damaged).expect("writable");
        let report = merge(std::slice::from_ref(&rig), &out, &MergeOptions::default());
        report.expect("merges what is left");
    }
}
