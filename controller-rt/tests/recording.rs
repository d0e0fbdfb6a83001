//! What an ECU records is enough to compute its commands again, from any snapshot.

use std::path::PathBuf;

use bench::{PERIOD_NS, StillClock, follower, law};
use controller_rt::{Slot, join_snapshot};
use law::Structure;
use platoon_dbc::Bus;
use traces::{
    FrameRecord, MemoryRecord, Overflow, Reader, Record, Recorder, RecorderOptions, Source,
    TickRecord,
};

mod bench;

/// Long enough for the snapshot at 10 s.
const TICKS: u64 = 10_500;

#[derive(Default)]
struct Recorded {
    frames: Vec<FrameRecord>,
    ticks: Vec<TickRecord>,
    memories: Vec<MemoryRecord>,
}

/// A recording of this test and process, deleted once it is read.
struct Recording(PathBuf);

impl Recording {
    fn named(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("{name}-{}.mcap", std::process::id())))
    }

    /// A recorder that never drops.
    fn recorder(&self) -> Recorder {
        let overflow = Overflow::Wait;
        let options = RecorderOptions { overflow, ..RecorderOptions::new(Source::Ecu(1)) };
        Recorder::start(&self.0, options).expect("writable")
    }

    fn read(self) -> Recorded {
        let mut recorded = Recorded::default();
        for message in Reader::open(&self.0).expect("readable") {
            match message.record().expect("sound") {
                Record::Frame(frame) => recorded.frames.push(frame),
                Record::Tick(tick) => recorded.ticks.push(*tick),
                Record::Memory(memory) => recorded.memories.push(*memory),
                _ => {}
            }
        }
        std::fs::remove_file(&self.0).expect("ours");
        recorded
    }
}

/// Runs a follower for [`TICKS`] ticks, leaving out some, and reads its recording back.
fn recorded(name: &str, structure: Structure) -> Recorded {
    let recording = Recording::named(name);
    let (mut rig, mut ecu) = follower(law(structure), Some(recording.recorder()));
    let clock = StillClock::default();
    rig.invite();
    rig.publish(0);
    ecu.prepare(&clock);
    let mut skipped = 0;
    for n in 0..TICKS {
        if n > 0 {
            rig.publish(n);
        }
        if (10_100..10_120).contains(&n) {
            skipped += 1;
            continue;
        }
        clock.set(n * PERIOD_NS + PERIOD_NS / 2);
        let slot = Slot { skipped, ..Slot::on_time(n as u32, PERIOD_NS, &clock) };
        ecu.tick(slot, &clock);
        rig.hear();
        skipped = 0;
    }
    let report = ecu.finish(&clock);
    assert_eq!((report.dropped_records, report.recording_error), (0, None));
    recording.read()
}

/// Computes every tick after tick `from` again, from the snapshot taken there.
fn replayed(recorded: &Recorded, structure: Structure, from: u32) -> Recorded {
    let parts: Vec<MemoryRecord> =
        recorded.memories.iter().filter(|part| part.tick == from).copied().collect();
    let snapshot = join_snapshot(&parts).expect("a snapshot");
    let recording = Recording::named("replayed");
    let (mut rig, mut ecu) = follower(law(structure), Some(recording.recorder()));
    let clock = StillClock::default();
    assert!(ecu.restore(&snapshot));
    let mut frames = recorded.frames.iter().filter(|frame| frame.tick > from).peekable();
    for tick in recorded.ticks.iter().filter(|tick| tick.tick > from) {
        while let Some(frame) = frames.next_if(|frame| frame.tick == tick.tick) {
            rig.bus.send(&frame.frame).expect("room");
        }
        let slot = Slot { skipped: tick.skipped, ..Slot::on_time(tick.tick, PERIOD_NS, &clock) };
        ecu.tick(slot, &clock);
        rig.hear();
    }
    let report = ecu.finish(&clock);
    assert_eq!(report.dropped_records, 0);
    recording.read()
}

#[test]
fn commands_computed_again_from_any_recorded_snapshot_are_the_same_bits() {
    for structure in [Structure::Mcf, Structure::DmpcPlf] {
        let recorded = recorded("recorded", structure);
        for from in [0, 10_000] {
            let replayed = replayed(&recorded, structure, from);
            let original = recorded.ticks.iter().filter(|tick| tick.tick > from);
            assert_eq!(original.clone().count(), replayed.ticks.len());
            for (tick, again) in original.zip(&replayed.ticks) {
                let bits = |t: &TickRecord| {
                    let command = (t.force_n.to_bits(), t.steering_rad.to_bits());
                    (t.tick, command, t.working_set, t.outcome)
                };
                assert_eq!(bits(tick), bits(again), "{structure:?} replayed from tick {from}");
            }
        }
    }
}

#[test]
fn every_tick_is_recorded_with_the_frames_it_consumed() {
    let recorded = recorded("ticks", Structure::Mcf);
    assert_eq!(recorded.ticks.len() as u64, TICKS - 20);
    assert_eq!(recorded.ticks.iter().map(|tick| tick.skipped).sum::<u32>(), 20);
    let after = recorded.ticks.iter().find(|tick| tick.skipped > 0).expect("one tick skipped");
    assert_eq!((after.tick, after.time_ns), (10_120, 10_120 * PERIOD_NS));
    let consumed = recorded.frames.iter().filter(|frame| frame.tick == after.tick).count();
    let expected = "21 states, V2V at 10.1 and 10.12 s, a plan and an obstacle at 10.1 s";
    assert_eq!(consumed, 21 + 4, "{expected}");
    let snapshots = recorded.memories.iter().filter(|part| part.snapshot.as_bytes()[0] == 0);
    assert_eq!(snapshots.count(), 2, "at the start and at 10 s");
}
