//! A thousand damaged traces: every one is refused, or read as far as it is sound, and says so.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use platoon_dbc::EgoState;
use traces::{
    Attachment, FrameRecord, MergeOptions, Overflow, Reader, Recorder, RecorderOptions, Source,
    TickRecord,
};

/// Damaged files.
const FILES: usize = 1000;
/// Longer than a recorder leaves a chunk open.
const CHUNK_CLOSED: Duration = Duration::from_millis(120);
/// Most bytes one damage touches.
const REACH_MAX: usize = 64;

/// What a message says: topic, number, data.
type Content = (String, u32, Vec<u8>);

/// A reproducible row of numbers.
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (self.0 >> 33) as usize % limit.max(1)
    }
}

fn recorder(path: &Path, source: Source) -> Recorder {
    let options = RecorderOptions { overflow: Overflow::Wait, ..RecorderOptions::new(source) };
    Recorder::start(path, options).expect("starts")
}

/// A part of several chunks, and a small merged run with everything in it that a run has.
fn files() -> [Vec<u8>; 2] {
    let folder = std::env::temp_dir().join(format!("traces-damaged-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("writable");
    let (rig, ecu) = (folder.join("rig.part.mcap"), folder.join("ecu1.part.mcap"));
    let (mut of_rig, mut of_ecu) = (recorder(&rig, Source::Rig), recorder(&ecu, Source::Ecu(1)));
    for tick in 0..60 {
        let time_ns = u64::from(tick) * 1_000_000;
        let ego = EgoState { bench_time_ns: time_ns, tick, ..EgoState::default() };
        let frame = ego.encode(tick as u8 & 15).expect("in range");
        let record = FrameRecord { bus: 1, time_ns, stamp_ns: 0, tick, tx: true, frame };
        of_rig.push(record);
        of_ecu.push(FrameRecord { tx: false, ..record });
        of_ecu.push(TickRecord { time_ns, tick, ecu: 1, ..TickRecord::default() });
        if tick % 20 == 19 {
            std::thread::sleep(CHUNK_CLOSED);
        }
    }
    assert_eq!((of_rig.finish().error, of_ecu.finish().error), (None, None));
    let attachment = Attachment {
        name: "scenario.toml".into(),
        media_type: "application/toml".into(),
        data: vec![b'x'; 300],
    };
    let options = MergeOptions { attachments: vec![attachment], ..MergeOptions::default() };
    let out = folder.join("run.mcap");
    traces::merge(&[rig, ecu.clone()], &out, &options).expect("merges");
    let files = [ecu, out].map(|path| std::fs::read(path).expect("readable"));
    std::fs::remove_dir_all(&folder).expect("removable");
    files
}

/// Cuts, flips, overwrites, removes, repeats or inserts something somewhere.
fn damage(bytes: &mut Vec<u8>, dice: &mut Dice) {
    if bytes.is_empty() {
        return;
    }
    let at = dice.below(bytes.len());
    let end = (at + 1 + dice.below(REACH_MAX)).min(bytes.len());
    match dice.below(7) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << dice.below(8),
        2 => bytes[at..end].fill(0),
        3 => bytes[at..end].fill(0xff),
        4 => drop(bytes.drain(at..end)),
        5 => {
            let again = bytes[at..end].to_vec();
            bytes.splice(at..at, again);
        }
        _ => {
            let noise: Vec<u8> = (at..end).map(|_| dice.below(256) as u8).collect();
            bytes.splice(at..at, noise);
        }
    }
}

/// All messages of a file, and whether it is said to be whole; `None` when it is refused.
fn read(bytes: Vec<u8>) -> Option<(Vec<Content>, bool)> {
    let mut reader = Reader::from_bytes(bytes)?;
    let messages = (&mut reader).map(|message| {
        let _ = message.record();
        (message.channel.topic.clone(), message.sequence, message.data)
    });
    Some((messages.collect(), reader.loss().is_none()))
}

#[test]
fn a_thousand_damaged_files_are_refused_or_read_honestly() {
    let (mut dice, mut partial) = (Dice(1), 0);
    for whole in files() {
        let (all, is_whole) = read(whole.clone()).expect("MCAP");
        assert!(is_whole && all.len() >= 120, "{} messages", all.len());
        let known: BTreeSet<_> = all.iter().collect();
        for file in 0..FILES / 2 {
            let mut bytes = whole.clone();
            (0..=dice.below(2)).for_each(|_| damage(&mut bytes, &mut dice));
            let Some((messages, says_whole)) = read(bytes) else { continue };
            assert!(messages.iter().all(|message| known.contains(message)), "{file}: made up");
            let is_missing = messages.len() < all.len();
            assert!(!(is_missing && says_whole), "{file}: {} messages", messages.len());
            partial += usize::from(is_missing && !messages.is_empty());
        }
    }
    assert!(partial > FILES / 20, "{partial} files were read in part");
}
