//! A recording survives its process: what a killed recorder wrote can be read and merged.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use traces::{MergeOptions, Reader, Record, Recorder, RecorderOptions, Source, TickRecord};

const PATH_VARIABLE: &str = "TRACES_KILLED_PART";
/// Ticks that must be in the file before its process is killed.
const TICKS_FIRST: usize = 300;
/// Looks at the file before giving up; no verdict depends on how long one takes.
const LOOKS_MAX: usize = 6_000;
/// What a killed recorder may lose, in the child's ticks of at least a millisecond.
const LOST_TICKS_MAX: u32 = 100;
/// Kills, and how many of them may lose more because the machine was too busy to write.
const KILLS: u32 = 20;
const KILLS_ON_A_BUSY_MACHINE: u32 = 2;

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
        .args(["--exact", "records_until_killed", "--ignored", "--nocapture"])
        .env(PATH_VARIABLE, path)
        .stdout(Stdio::piped())
        .spawn();
    Killed(child.expect("starts"))
}

/// The last tick a child said it had pushed, in the words it got out before it was killed.
fn last_said(words: &str) -> Option<u32> {
    let whole = &words[..words.rfind('\n')?];
    whole.rsplit('\n').find_map(|line| line.strip_prefix("pushed ")?.parse().ok())
}

#[test]
fn a_recorder_killed_at_any_moment_loses_at_most_a_tenth_of_a_second() {
    let folder = std::env::temp_dir().join(format!("traces-kills-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("writable");
    let (mut state, mut worse) = (1_u64, Vec::new());
    for kill in 0..KILLS {
        let part = folder.join(format!("{kill}.part.mcap"));
        let mut child = start_child(&part);
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        std::thread::sleep(Duration::from_millis(100 + (state >> 33) % 300));
        child.0.kill().expect("it runs until it is killed");
        let mut words = String::new();
        let said = child.0.stdout.take().expect("piped");
        std::io::BufReader::new(said).read_to_string(&mut words).expect("UTF-8");
        let pushed = last_said(&words).map_or(0, |tick| tick + 1);
        let kept = ticks(&part);
        assert!(kept.iter().copied().eq(0..kept.len() as u32), "without gaps from the start");
        let lost = pushed.saturating_sub(kept.len() as u32);
        if lost > LOST_TICKS_MAX {
            worse.push((pushed, lost));
        }
    }
    assert!(worse.len() as u32 <= KILLS_ON_A_BUSY_MACHINE, "pushed and lost: {worse:?}");
    std::fs::remove_dir_all(&folder).expect("removable");
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
        println!("pushed {tick}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
