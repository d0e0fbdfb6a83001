use std::path::PathBuf;

use platoon_dbc::{Frame, FrameFlags};

use super::*;
use crate::{
    FrameRecord, MemoryRecord, Overflow, Recorder, RecorderOptions, Snapshot, Source, TickRecord,
    TruckTruth, TruthRecord,
};

const START_WALL_NS: u64 = 1_700_000_000_000_000_000;

/// A path of its own in the folder for temporary files; removed when dropped.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("traces-{}-{name}", std::process::id())))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn frame(tick: u32) -> FrameRecord {
    let flags = FrameFlags { is_extended: true, is_fd: true, ..FrameFlags::default() };
    let frame = Frame::new(0x18ff_1080, flags, &[tick as u8; 32]).expect("valid");
    let time_ns = u64::from(tick) * 1_000_000;
    let stamp_ns = START_WALL_NS + time_ns + 7;
    FrameRecord { bus: 2, time_ns, stamp_ns, tick, tx: false, frame }
}

fn tick(tick: u32) -> TickRecord {
    let time_ns = u64::from(tick) * 1_000_000;
    TickRecord { time_ns, tick, ecu: 2, force_n: -f64::from(tick), ..TickRecord::default() }
}

fn truth(tick: u32) -> TruthRecord {
    let mut truth = TruthRecord { time_ns: u64::from(tick) * 1_000_000, ..TruthRecord::default() };
    truth.trucks.push(TruckTruth { x_m: 1.5, ..TruckTruth::default() }).expect("room");
    truth
}

fn memory(tick: u32) -> MemoryRecord {
    let snapshot = Snapshot::new(&[tick as u8; 99]).expect("fits");
    MemoryRecord { time_ns: u64::from(tick) * 1_000_000, tick, snapshot }
}

/// A part of `ticks` ticks, four records each.
fn part(name: &str, ticks: u32) -> Vec<u8> {
    let scratch = Scratch::new(name);
    let options = RecorderOptions {
        start_wall_ns: START_WALL_NS,
        overflow: Overflow::Wait,
        ..RecorderOptions::new(Source::Ecu(2))
    };
    let mut recorder = Recorder::start(&scratch.0, options).expect("starts");
    for number in 0..ticks {
        recorder.push(frame(number));
        recorder.push(tick(number));
        recorder.push(truth(number));
        recorder.push(memory(number));
    }
    assert_eq!(recorder.finish().error, None);
    std::fs::read(&scratch.0).expect("readable")
}

/// Reads everything there is and decodes it; says how many messages and records that were.
fn read_out(bytes: Vec<u8>) -> Option<(usize, usize, Loss)> {
    let mut reader = Reader::from_bytes(bytes)?;
    let mut counts = (0, 0);
    for message in &mut reader {
        counts.0 += 1;
        counts.1 += usize::from(message.record().is_ok());
    }
    Some((counts.0, counts.1, reader.loss()))
}

#[test]
fn every_record_comes_back_as_it_was_pushed_and_in_order() {
    let mut reader = Reader::from_bytes(part("round-trip", 300)).expect("MCAP");
    assert_eq!(reader.start_wall_ns(), Some(START_WALL_NS));
    for number in 0..300 {
        let mut next = || {
            let message = reader.next().expect("a message");
            assert_eq!(message.time_ns(), u64::from(number) * 1_000_000);
            message.record().expect("decodes")
        };
        assert_eq!(next(), Record::Frame(frame(number)));
        assert_eq!(next(), Record::Tick(tick(number).into()));
        assert_eq!(next(), Record::Truth(truth(number).into()));
        assert_eq!(next(), Record::Memory(memory(number).into()));
    }
    assert_eq!(reader.next(), None);
    assert!(reader.loss().is_none());
}

#[test]
fn topics_and_times_narrow_what_is_read() {
    let reader = Reader::from_bytes(part("narrow", 100)).expect("MCAP");
    let reader = reader.with_topics(["/ecu2/tick"]).with_times(10_000_000..20_000_000);
    let ticks: Vec<_> = reader.map(|message| message.record().expect("decodes")).collect();
    let expected: Vec<_> = (10..20).map(|number| Record::Tick(tick(number).into())).collect();
    assert_eq!(ticks, expected);
}

#[test]
fn a_file_cut_anywhere_is_read_up_to_the_cut() {
    let bytes = part("cut", 40);
    let whole = read_out(bytes.clone()).expect("MCAP");
    assert_eq!((whole.0, whole.1), (160, 160));
    let mut before = 0;
    for length in (8..bytes.len()).step_by(bytes.len() / 300 + 1) {
        let (messages, records, loss) = read_out(bytes[..length].to_vec()).expect("MCAP");
        assert!(messages >= before && messages <= whole.0, "cut at {length}");
        assert_eq!(messages, records, "cut at {length}");
        let is_end_cut = messages < whole.0 && !loss.is_truncated;
        assert!(!is_end_cut, "cut at {length}: {messages} messages and no word about it");
        before = messages;
    }
    assert_eq!(read_out(bytes[..7].to_vec()), None, "too short to be MCAP");
}

#[test]
fn a_flipped_byte_anywhere_never_loses_a_message_without_a_word() {
    let bytes = part("flip", 5);
    let whole = read_out(bytes.clone()).expect("MCAP");
    assert_eq!((whole.0, whole.1, whole.2.is_none()), (20, 20, true));
    for position in 8..bytes.len() {
        let flip = [0x01, 0x80, 0xff][position % 3];
        let mut damaged = bytes.clone();
        damaged[position] ^= flip;
        let (messages, _, loss) = read_out(damaged).expect("magic is whole");
        assert!(messages == 20 || !loss.is_none(), "byte {position} flipped by {flip:#x}");
    }
}

#[test]
fn one_damaged_chunk_costs_no_other() {
    // More than three times the size at which a chunk is closed, however fast it is written.
    let bytes = part("chunks", 12_000);
    let spans = Reader::from_bytes(bytes.clone()).expect("MCAP").layout.spans;
    assert!(spans.len() >= 3, "{} chunks", spans.len());
    let mut damaged = bytes;
    let middle = spans[1];
    damaged[(middle.offset + middle.length / 2) as usize] ^= 0xff;
    let (messages, records, loss) = read_out(damaged).expect("MCAP");
    assert!(messages > 0 && messages < 48_000 && messages == records);
    assert_eq!((loss.chunks, loss.bytes, loss.is_truncated), (1, middle.length, false));
}

#[test]
fn noise_behind_the_magic_is_survived() {
    let mut state = 1u64;
    for length in 0..400usize {
        let mut bytes = mcap::MAGIC.to_vec();
        for _ in 0..length {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Small bytes make plausible opcodes and lengths.
            bytes.push((state >> 33) as u8 >> (state >> 61));
        }
        read_out(bytes);
    }
}

#[test]
fn damaged_records_are_refused_not_believed() {
    let reader = Reader::from_bytes(part("records", 2)).expect("MCAP");
    for mut message in reader {
        for position in 0..message.data.len() {
            let whole = message.data[position];
            for value in [0, 1, 0x7f, 0x80, 0xff, whole ^ 4] {
                message.data[position] = value;
                let _ = message.record();
            }
            message.data[position] = whole;
        }
        for length in 0..message.data.len() {
            let mut cut = message.clone();
            cut.data.truncate(length);
            let _ = cut.record();
        }
    }
}

#[test]
fn a_file_that_is_no_mcap_is_refused_by_name() {
    let scratch = Scratch::new("no-mcap");
    std::fs::write(&scratch.0, "candump?").expect("writable");
    let error = Reader::open(&scratch.0).err().expect("refused").to_string();
    assert!(error.contains("no-mcap") && error.contains("not an MCAP file"), "{error}");
}
