//! The node on a bus that echoes, as SocketCAN and UDP do at the rig's end.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use platoon_dbc::{
    Actuation, Backend, BusCounts, Frame, FrameFlags, Mission, ReceiveError, SendError,
};
use traces::{Reader, Record, Recorder, RecorderOptions, Source};

use super::*;

/// A wire that both sides of the test put frames on; each gets the next number as its time.
#[derive(Clone, Default)]
struct Wire {
    frames: Arc<Mutex<VecDeque<Received>>>,
    time_ns: Arc<Mutex<u64>>,
}

impl Wire {
    fn carry(&self, frame: Frame, own: bool) {
        let mut time_ns = self.time_ns.lock().expect("one thread");
        *time_ns += 1;
        let received = Received { frame, stamp_ns: *time_ns, own };
        self.frames.lock().expect("one thread").push_back(received);
    }

    fn lose_newest(&self) {
        self.frames.lock().expect("one thread").pop_back();
    }
}

impl Bus for Wire {
    fn backend(&self) -> Backend {
        Backend::Udp
    }
    fn name(&self) -> &str {
        "wire"
    }
    fn echoes(&self) -> bool {
        true
    }
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.carry(*frame, true);
        Ok(())
    }
    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        Ok(self.frames.lock().expect("one thread").pop_front())
    }
    fn wait(&mut self, _timeout: Duration) -> Result<bool, ReceiveError> {
        Ok(false)
    }
    fn counts(&self) -> BusCounts {
        BusCounts::default()
    }
}

/// A node on a wire, with a tap that records to a file of this name.
struct Bench {
    wire: Wire,
    node: TruckNode,
    tap: Tap,
    path: std::path::PathBuf,
}

impl Bench {
    fn new(name: &str) -> Self {
        let file = format!("platoon-tap-{name}-{}.part.mcap", std::process::id());
        let path = std::env::temp_dir().join(file);
        let recorder = Recorder::start(&path, RecorderOptions::new(Source::Rig));
        let tap = Tap::new(Some(recorder.expect("the temp folder can be written")), true);
        let wire = Wire::default();
        let node = TruckNode::new(0, Box::new(wire.clone()), 1_000_000);
        Self { wire, node, tap, path }
    }

    fn send(&mut self) {
        self.node.send(&Message::Mission(Mission::default()), &mut self.tap);
    }

    fn drain(&mut self) {
        self.node.drain(&mut self.tap, |_| {});
    }

    /// Stamp and direction of every frame recorded, in the recording's order.
    fn recorded(mut self) -> Vec<(u64, bool)> {
        self.node.give_up_waiting(&mut self.tap);
        let finished = self.tap.recorder.take().expect("given").finish();
        assert_eq!((finished.lost, finished.dropped.total()), (0, 0));
        let reader = Reader::open(&self.path).expect("readable");
        let frames = reader.map(|message| match message.record() {
            Ok(Record::Frame(frame)) => (frame.stamp_ns, frame.tx),
            other => panic!("{other:?} is no frame"),
        });
        let frames = frames.collect();
        std::fs::remove_file(&self.path).expect("was written");
        frames
    }
}

fn answer() -> Frame {
    Actuation::default().encode(0).expect("in range")
}

#[test]
fn what_passes_is_recorded_in_the_order_and_with_the_time_of_the_wire() {
    let mut bench = Bench::new("order");
    bench.tap.open();
    bench.send();
    bench.wire.carry(answer(), false);
    bench.send();
    bench.drain();
    assert_eq!((bench.node.counts.unechoed, bench.node.counts.unknown), (0, 0));
    assert!(!bench.node.is_waiting());
    assert_eq!(bench.recorded(), [(1, true), (2, false), (3, true)]);
}

#[test]
fn a_frame_whose_echo_is_lost_is_recorded_all_the_same_and_counted() {
    let mut bench = Bench::new("lost");
    bench.tap.open();
    bench.send();
    bench.wire.lose_newest();
    bench.send();
    for _ in 0..600 {
        bench.tap.time_ns += 10_000_000;
        bench.drain();
    }
    assert_eq!(bench.node.counts.unechoed, 1);
    assert_eq!(bench.recorded(), [(2, true), (0, true)]);
}

#[test]
fn what_passes_before_the_run_is_recorded_when_it_starts() {
    let mut bench = Bench::new("early");
    bench.send();
    bench.wire.carry(answer(), false);
    bench.drain();
    bench.tap.open();
    bench.send();
    bench.drain();
    assert_eq!(bench.node.counts.unrecorded, 0);
    assert_eq!(bench.recorded(), [(1, true), (2, false), (3, true)]);
}

#[test]
fn echoes_do_not_use_up_the_room_for_frames_of_others() {
    let mut bench = Bench::new("room");
    for _ in 0..200 {
        bench.send();
    }
    let foreign = Frame::new(0x123, FrameFlags::default(), &[]).expect("a frame");
    for _ in 0..200 {
        bench.wire.carry(foreign, false);
    }
    bench.drain();
    let counts = bench.node.counts;
    assert_eq!((counts.unknown, counts.drain_cut, counts.unechoed), (200, 0, 0));
    drop(bench.recorded());
}
