use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex};

use super::*;
use crate::{MemoryRecord, Reader, Record, TickRecord};

/// A sink that fails once it holds `room` bytes.
#[derive(Clone)]
struct Disk {
    bytes: Arc<Mutex<Cursor<Vec<u8>>>>,
    room: usize,
}

impl Disk {
    fn with_room(room: usize) -> Self {
        Self { bytes: Arc::default(), room }
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut cursor = self.bytes.lock().expect("nobody panicked");
        if cursor.get_ref().len() + bytes.len() > self.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        cursor.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.bytes.lock().expect("nobody panicked").seek(to)
    }
}

fn options(overflow: Overflow) -> RecorderOptions {
    let capacity = Capacity { frames: 4, ticks: 4, truths: 1, memories: 1 };
    RecorderOptions { overflow, capacity, ..RecorderOptions::new(Source::Ecu(0)) }
}

fn start(disk: &Disk, overflow: Overflow) -> Result<Recorder, RecorderError> {
    Recorder::start_into(Box::new(disk.clone()), "test".into(), options(overflow))
}

fn tick(tick: u32) -> TickRecord {
    // Not compressible, so that disks fill up.
    let noise = u64::from(tick).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let working_set = [noise, noise.rotate_left(17)];
    TickRecord { time_ns: u64::from(tick), tick, working_set, ..TickRecord::default() }
}

#[test]
fn a_full_ring_drops_and_counts_and_every_record_is_accounted_for() {
    let disk = Disk::with_room(usize::MAX);
    let mut recorder = start(&disk, Overflow::DropNewest).expect("starts");
    let kept = (0..5_000).filter(|number| recorder.push(tick(*number))).count() as u64;
    let finished = recorder.finish();
    assert!(kept < 5_000, "four slots cannot hold a burst of five thousand");
    assert_eq!(finished.written, kept);
    assert_eq!(finished.dropped.ticks, 5_000 - kept);
    assert_eq!((finished.lost, finished.error), (0, None));
}

#[test]
fn every_gap_in_the_file_is_marked_where_it_is() {
    let disk = Disk::with_room(usize::MAX);
    let mut recorder = start(&disk, Overflow::DropNewest).expect("starts");
    for number in 0..5_000 {
        recorder.push(tick(number));
    }
    let dropped = recorder.finish().dropped.total();
    assert!(dropped > 0, "four slots cannot hold a burst of five thousand");
    let bytes = disk.bytes.lock().expect("nobody panicked").get_ref().clone();
    let (mut expected, mut marked) = (0, 0);
    for message in Reader::from_bytes(bytes).expect("MCAP") {
        match message.record().expect("decodes") {
            Record::Dropped(gap) => {
                marked += gap.count;
                expected += gap.count as u32;
            }
            Record::Tick(found) => {
                assert_eq!(found.tick, expected, "a gap without a mark");
                expected += 1;
            }
            other => panic!("nobody pushed {other:?}"),
        }
    }
    assert_eq!((marked, expected), (dropped, 5_000));
}

#[test]
fn waiting_drops_nothing() {
    let disk = Disk::with_room(usize::MAX);
    let mut recorder = start(&disk, Overflow::Wait).expect("starts");
    for number in 0..2_000 {
        assert!(recorder.push(tick(number)));
        if number % 500 == 0 {
            assert!(recorder.push(MemoryRecord::default()));
        }
    }
    let finished = recorder.finish();
    assert_eq!(finished.written, 2_004);
    assert_eq!(finished.dropped, Counts::default());
}

#[test]
fn a_disk_that_fills_up_is_reported_at_the_end_and_disturbs_nobody() {
    let disk = Disk::with_room(20_000);
    let mut recorder = start(&disk, Overflow::Wait).expect("starts");
    for number in 0..50_000 {
        assert!(recorder.push(tick(number)));
    }
    let finished = recorder.finish();
    assert_eq!(finished.written + finished.lost, 50_000);
    assert!(finished.lost > 0);
    let error = finished.error.expect("an error");
    assert!(error.contains("no storage space"), "{error}");
}

#[test]
fn a_disk_without_any_room_is_noticed_at_the_start() {
    let error = start(&Disk::with_room(3), Overflow::Wait).err().expect("refused");
    assert!(matches!(error, RecorderError::Write { .. }), "{error}");
}

#[test]
fn an_unwritable_folder_is_refused_by_name() {
    let path = Path::new("/proc/no-such-folder/ecu0.part.mcap");
    let error = Recorder::start(path, options(Overflow::Wait)).err().expect("refused");
    assert!(error.to_string().contains("/proc/no-such-folder"), "{error}");
}
