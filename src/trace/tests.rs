use platoon_dbc::{Frame, FrameFlags};
use traces::{
    FrameRecord, MemoryRecord, MergeOptions, Recorder, RecorderOptions, Snapshot, Source,
    TickRecord,
};

use super::*;

/// A folder of its own for a test, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("trace-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn frame(tick: u32) -> FrameRecord {
    let frame = Frame::new(0x123, FrameFlags::default(), &[tick as u8]).expect("a frame");
    let time_ns = u64::from(tick) * 1_000_000;
    FrameRecord { bus: 1, time_ns, stamp_ns: 0, tick, tx: false, frame }
}

fn tick(tick: u32) -> TickRecord {
    TickRecord { tick, time_ns: u64::from(tick) * 1_000_000, ecu: 1, ..TickRecord::default() }
}

fn event(sequence: u32, record: Record) -> Event {
    Event { time_ns: 0, sequence, topic: Topic::Tick(1), record }
}

fn moments(events: impl IntoIterator<Item = Event>) -> Vec<Moment> {
    let (mut history, mut moments) = (History::default(), Vec::new());
    for event in events {
        history.push(event, &mut |moment| moments.push(moment));
    }
    history.finish(&mut |moment| moments.push(moment));
    moments
}

fn ticks(moments: &[Moment]) -> Vec<(u32, usize)> {
    let tick = |moment: &Moment| match moment {
        Moment::Tick(inputs) => Some((inputs.tick.tick, inputs.frames.len())),
        Moment::Snapshot { .. } | Moment::Gap(_) => None,
    };
    moments.iter().filter_map(tick).collect()
}

#[test]
fn what_one_ecu_recorded_comes_back_tick_by_tick() {
    let folder = Folder::new("comes-back");
    let (part, run) = (folder.0.join("ecu1.part.mcap"), folder.0.join("run.mcap"));
    let mut recorder =
        Recorder::start(&part, RecorderOptions::new(Source::Ecu(1))).expect("starts");
    for n in 0..10 {
        (0..n % 3).for_each(|_| assert!(recorder.push(frame(n))));
        assert!(recorder.push(tick(n)));
    }
    assert_eq!(recorder.finish().lost, 0);
    traces::merge(std::slice::from_ref(&part), &run, &MergeOptions::default()).expect("merges");
    for path in [&part, &run, &folder.0] {
        let trace = Trace::open(path).expect("opens");
        let mut events = trace.events(|_| true, 0..u64::MAX).expect("reads");
        let read = ticks(&moments(&mut events));
        assert_eq!(read, (0..10).map(|n| (n, n as usize % 3)).collect::<Vec<_>>());
        assert_eq!(events.damage(), None);
    }
}

#[test]
fn records_are_put_in_the_order_of_their_numbers() {
    let records = [
        event(1, Record::Tick(Box::new(tick(0)))),
        event(0, Record::Frame(frame(0))),
        event(2, Record::Tick(Box::new(tick(1)))),
    ];
    assert_eq!(ticks(&moments(records)), [(0, 1), (1, 0)]);
}

#[test]
fn missing_numbers_are_a_gap_and_cost_the_frames_before_it() {
    let records = [
        event(0, Record::Tick(Box::new(tick(0)))),
        event(1, Record::Frame(frame(1))),
        event(5, Record::Frame(frame(1))),
        event(6, Record::Tick(Box::new(tick(1)))),
    ];
    let moments = moments(records);
    assert_eq!(ticks(&moments), [(0, 0), (1, 1)]);
    assert!(moments.contains(&Moment::Gap(Gap { records: 3 })));
}

#[test]
fn a_snapshot_counts_once_all_its_parts_are_there() {
    let part = |sequence, bytes: &[u8]| {
        let snapshot = Snapshot::new(bytes).expect("fits");
        event(sequence, Record::Memory(Box::new(MemoryRecord { time_ns: 0, tick: 7, snapshot })))
    };
    let whole = moments([part(0, &[0, 2, 9]), part(1, &[1, 2, 8])]);
    assert_eq!(whole, [Moment::Snapshot { tick: 7, bytes: vec![9, 8] }]);
    // The second part was dropped, and the snapshot taken again.
    let again = moments([part(0, &[0, 2, 9]), part(2, &[0, 2, 9]), part(3, &[1, 2, 8])]);
    let expected = Moment::Snapshot { tick: 7, bytes: vec![9, 8] };
    assert_eq!(again, [Moment::Gap(Gap { records: 1 }), expected]);
}

#[test]
fn what_is_no_trace_is_refused_with_its_name() {
    let folder = Folder::new("refused");
    let text = folder.0.join("notes.txt");
    std::fs::write(&text, "no trace").expect("writes");
    for path in [text, folder.0.join("nosuch.mcap")] {
        let refused = Trace::open(&path).map(drop).expect_err("no trace").to_string();
        assert!(refused.contains(&path.display().to_string()), "{refused}");
    }
}
