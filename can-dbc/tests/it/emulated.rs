//! The bus that pretends to have a bit rate: frames take their time, in the order of arbitration.

use crate::random::Random;
use platoon_dbc::bus_time::BusTiming;
use platoon_dbc::{Backend, Bus, BusCounts, Emulated, Frame, FrameFlags, Loopback};
use platoon_dbc::{ReceiveError, Received, SendError};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: u64 = 1_000_000;

fn frame(id: u32, byte: u8) -> Frame {
    let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::default() };
    Frame::new(id, flags, &[byte; 8]).expect("valid")
}

/// The rig's emulated end and the ECU's end of a bus in memory, with the run begun.
fn running() -> (Emulated<Loopback>, Loopback) {
    let (rig, ecu) = Loopback::pair("loopback0", 8192);
    let mut rig = Emulated::new(rig, BusTiming::default());
    rig.begin();
    (rig, ecu)
}

fn received(bus: &mut dyn Bus) -> Vec<Received> {
    std::iter::from_fn(|| bus.receive().expect("the bus is up")).collect()
}

fn frames(received: &[Received]) -> Vec<Frame> {
    received.iter().map(|received| received.frame).collect()
}

#[test]
fn a_frame_arrives_when_the_wire_has_carried_it_and_not_before() {
    let (mut rig, mut ecu) = running();
    let sent = frame(5, 1);
    let time_ns = BusTiming::default().frame_time_ns(&sent);
    rig.set_bench_time(7 * MS);
    rig.send(&sent).expect("room");
    rig.set_bench_time(7 * MS + time_ns - 1);
    assert_eq!((ecu.receive(), rig.receive()), (Ok(None), Ok(None)));
    rig.set_bench_time(7 * MS + time_ns);
    let heard = ecu.receive().expect("up").expect("through");
    assert_eq!((heard.frame, heard.stamp_ns, heard.own), (sent, 7 * MS + time_ns, false));
    let echo = rig.receive().expect("up").expect("through");
    assert_eq!((echo.frame, echo.own), (sent, true));
}

#[test]
fn both_sides_share_one_wire_and_the_more_urgent_goes_first() {
    let (mut rig, mut ecu) = running();
    let (first, low, high, top) = (frame(9, 0), frame(8, 1), frame(2, 2), frame(1, 3));
    rig.send(&first).expect("room");
    // The first one is on its way when the others come.
    rig.set_bench_time(1000);
    rig.send(&low).expect("room");
    ecu.send(&top).expect("room");
    ecu.send(&high).expect("room");
    rig.set_bench_time(1000);
    rig.set_bench_time(10 * MS);
    assert_eq!(frames(&received(&mut rig)), [first, top, high, low]);
    assert_eq!(frames(&received(&mut ecu)), [first, low]);
}

#[test]
fn every_kind_of_frame_arrives_unchanged() {
    let (mut rig, mut ecu) = running();
    let mut sent = crate::conformance::all_kinds();
    for frame in &sent {
        rig.send(frame).expect("room");
    }
    rig.set_bench_time(1000 * MS);
    let (mut echoed, mut heard) = (frames(&received(&mut rig)), frames(&received(&mut ecu)));
    assert_eq!(echoed, heard);
    for frames in [&mut sent, &mut echoed, &mut heard] {
        frames.sort_by_key(|frame| format!("{frame:?}"));
    }
    assert_eq!(heard, sent);
}

#[test]
fn outside_of_a_run_frames_pass_at_once() {
    let (rig, mut ecu) = Loopback::pair("loopback0", 16);
    let mut rig = Emulated::new(rig, BusTiming::default());
    let (invitation, answer) = (frame(1, 1), frame(2, 2));
    rig.send(&invitation).expect("room");
    assert_eq!(frames(&received(&mut ecu)), [invitation]);
    ecu.send(&answer).expect("room");
    assert_eq!(frames(&received(&mut rig)), [invitation, answer]);
    rig.begin();
    rig.send(&invitation).expect("room");
    assert_eq!(ecu.receive(), Ok(None));
    rig.end();
    assert_eq!(frames(&received(&mut ecu)), [invitation]);
}

#[test]
fn stamps_are_bench_time_where_that_is_asked_for() {
    let (rig, mut ecu) = Loopback::pair("loopback0", 16);
    let mut rig = Emulated::new(rig, BusTiming::default()).stamping_bench_time();
    rig.begin();
    rig.set_bench_time(3 * MS);
    rig.send(&frame(2, 0)).expect("room");
    ecu.send(&frame(1, 0)).expect("room");
    rig.set_bench_time(3 * MS);
    rig.set_bench_time(4 * MS);
    let time_ns = BusTiming::default().frame_time_ns(&frame(1, 0));
    let stamps: Vec<u64> = received(&mut rig).iter().map(|received| received.stamp_ns).collect();
    let second_ns = BusTiming::default().frame_time_ns(&frame(2, 0));
    assert_eq!(stamps, [3 * MS + time_ns, 3 * MS + time_ns + second_ns]);
}

#[test]
fn an_overfull_wire_refuses_the_rig_and_counts_what_the_ecu_loses() {
    let (rig, mut ecu) = Loopback::pair("loopback0", 16_384);
    let mut rig = Emulated::new(rig, BusTiming::default());
    rig.begin();
    let taken = (0..5000).take_while(|_| rig.send(&frame(1, 0)).is_ok()).count() as u64;
    for _ in 0..10 {
        ecu.send(&frame(2, 0)).expect("room");
    }
    rig.set_bench_time(1);
    let counts = rig.counts();
    assert_eq!((counts.sent, counts.send_full), (taken, 1));
    // One of the rig's is on the wire by now, or none yet.
    assert!((9..=10).contains(&counts.receive_overflow), "{}", counts.receive_overflow);
    rig.set_bench_time(1000 * 1000 * MS);
    assert_eq!(received(&mut ecu).len() as u64, taken);
}

#[test]
fn every_frame_is_told_with_how_long_it_took() {
    let (mut rig, mut ecu) = running();
    for step in 0..1000 {
        rig.set_bench_time(step * MS);
        rig.send(&frame(3, 0)).expect("room");
        rig.send(&frame(1, 0)).expect("room");
    }
    rig.set_bench_time(1000 * MS);
    let each_ns = [1, 3].map(|id| BusTiming::default().frame_time_ns(&frame(id, 0)));
    let told: Vec<(u32, u64, u64)> =
        rig.queueing().iter().map(|q| (q.id, q.frames(), q.max_ns())).collect();
    assert_eq!(told, [(1, 1000, each_ns[0]), (3, 1000, each_ns[0] + each_ns[1])]);
    assert_eq!(received(&mut ecu).len(), 2000);
}

#[test]
fn nothing_is_lost_twice_or_invented_whatever_the_times() {
    let mut random = Random::new(4);
    let (mut rig, mut ecu) = running();
    let (mut sent, mut time_ns) = ([0_u64; 2], 0);
    let mut heard = [0_u64; 2];
    for _ in 0..20_000 {
        time_ns += random.up_to(300_000);
        rig.set_bench_time(time_ns);
        let id = random.below(1 << 29) as u32;
        if random.below(3) == 0 {
            sent[0] += u64::from(rig.send(&frame(id, 0)).is_ok());
        } else if random.below(3) == 0 {
            sent[1] += u64::from(ecu.send(&frame(id, 0)).is_ok());
        }
        heard[0] += received(&mut ecu).len() as u64;
        heard[1] += received(&mut rig).iter().filter(|received| !received.own).count() as u64;
    }
    rig.end();
    heard[0] += received(&mut ecu).len() as u64;
    heard[1] += received(&mut rig).iter().filter(|received| !received.own).count() as u64;
    assert_eq!(heard, sent);
}

/// Two ends of an emulated bus whose time goes on whenever somebody listens, as it does for real.
struct Moving<End> {
    rig: Arc<Mutex<(Emulated<Loopback>, u64)>>,
    end: End,
}

struct RigEnd;

impl<End> Moving<End> {
    fn go_on(&self) {
        let mut rig = self.rig.lock().expect("nobody panicked");
        rig.1 += MS / 10;
        let time_ns = rig.1;
        rig.0.set_bench_time(time_ns);
    }

    /// Waits in small steps, because time must go on for a frame to arrive.
    fn wait_with(
        &mut self,
        timeout: Duration,
        wait: impl Fn(&mut Self, Duration) -> Result<bool, ReceiveError>,
    ) -> Result<bool, ReceiveError> {
        let mut left = timeout;
        loop {
            self.go_on();
            let step = left.min(Duration::from_millis(1));
            if wait(self, step)? || left.is_zero() {
                return wait(self, Duration::ZERO);
            }
            left -= step;
        }
    }
}

impl Bus for Moving<RigEnd> {
    fn backend(&self) -> Backend {
        Backend::Loopback
    }
    fn name(&self) -> &str {
        "emulated"
    }
    fn echoes(&self) -> bool {
        true
    }
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.rig.lock().expect("nobody panicked").0.send(frame)
    }
    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        self.go_on();
        self.rig.lock().expect("nobody panicked").0.receive()
    }
    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        self.wait_with(timeout, |moving, step| {
            moving.rig.lock().expect("nobody panicked").0.wait(step)
        })
    }
    fn counts(&self) -> BusCounts {
        self.rig.lock().expect("nobody panicked").0.counts()
    }
}

impl Bus for Moving<Loopback> {
    fn backend(&self) -> Backend {
        Backend::Loopback
    }
    fn name(&self) -> &str {
        "emulated"
    }
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.end.send(frame)
    }
    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        self.go_on();
        self.end.receive()
    }
    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        self.wait_with(timeout, |moving, step| moving.end.wait(step))
    }
    fn counts(&self) -> BusCounts {
        self.end.counts()
    }
}

/// A pair for the conformance suite.
pub(crate) fn pair() -> (Box<dyn Bus>, Box<dyn Bus>) {
    let (rig, end) = Loopback::pair("emulated", 4096);
    let mut rig = Emulated::new(rig, BusTiming::default()).stamping_bench_time();
    rig.begin();
    let rig = Arc::new(Mutex::new((rig, 0)));
    (Box::new(Moving { rig: Arc::clone(&rig), end: RigEnd }), Box::new(Moving { rig, end }))
}
