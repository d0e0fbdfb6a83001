//! A recording survives its process: what a killed recorder wrote can be read and merged.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use traces::{MergeOptions, Reader, Record, Recorder, RecorderOptions, Source, TickRecord};

const PATH_VARIABLE: &str = "TRACES_KILLED_PART";
/// Ticks that must be in the file before its process is killed.
const TICKS_FIRST: usize = 300;
/// Looks at the file before giving up; no verdict depends on how long one takes.
const LOOKS_MAX: usize = 6_000;

struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill(); // SIGKILL; it may be dead already
        let _ = self.0.wait();
    }
}

fn ticks(path: &Path) -> Vec<u32> {
    let Ok(reader) = Reader::open(path) else {
        return Vec::new();
    };
    let records = reader.filter_map(|message| message.record().ok());
    records
        .filter_map(|record| match record {
            Record::Tick(tick) => Some(tick.tick),
            _ => None,
        })
        .collect()
}

fn start_child(path: &Path) -> Killed {
    let child = Command::new(std::env::current_exe().expect("this test binary"))
        .args(["--exact", "records_until_killed", "--ignored"])
        .env(PATH_VARIABLE, path)
        .stdout(Stdio::null())
        .spawn();
    Killed(child.expect("starts"))
}

#[test]
fn what_was_on_disk_when_the_process_was_killed_is_merged() {
    let folder = std::env::temp_dir().join(format!("traces-killed-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("writable");
    let part = folder.join("ecu0.part.mcap");
    let child = start_child(&part);
    let mut seen = 0;
    for _ in 0..LOOKS_MAX {
        seen = ticks(&part).len();
        if seen >= TICKS_FIRST {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    drop(child);
    assert!(seen >= TICKS_FIRST, "the child wrote {seen} ticks only");

    let found = ticks(&part);
    assert!(found.len() >= seen, "what could be read before the kill is still there");
    assert!(found.iter().copied().eq(0..found.len() as u32), "without gaps from the start");
    let out = folder.join("run.mcap");
    let report = traces::merge(&[part], &out, &MergeOptions::default()).expect("merges");
    assert_eq!(report.messages, found.len() as u64);
    assert!(!report.parts[0].is_finished && report.parts[0].loss.is_truncated);
    std::fs::remove_dir_all(&folder).expect("removable");
}

#[test]
#[ignore = "the child process of what_was_on_disk_when_the_process_was_killed_is_merged"]
fn records_until_killed() {
    let Some(path) = std::env::var_os(PATH_VARIABLE).map(PathBuf::from) else {
        return;
    };
    let options = RecorderOptions::new(Source::Ecu(0));
    let mut recorder = Recorder::start(&path, options).expect("starts");
    for tick in 0.. {
        let time_ns = u64::from(tick) * 1_000_000;
        recorder.push(TickRecord { time_ns, tick, ..TickRecord::default() });
        std::thread::sleep(Duration::from_millis(1));
    }
}
