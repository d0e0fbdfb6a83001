//! In the steady state a tick allocates nothing: with the law, over loopback, recording.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use controller_rt::{Config, Ecu, LawController, Slot};
use law::qp::ActiveSet;
use law::{Calibration, Law};
use platoon_dbc::{
    Bus, Clock, EcuMode, EgoState, Loopback, Message, Mission, NavStatus, Obstacle, ObstacleKind,
    RunState, V2vState,
};
use traces::{Recorder, RecorderOptions, Source};

thread_local! {
    /// Allocations of this thread; the recorder's own thread may allocate as it likes.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

#[expect(unsafe_code, reason = "a global allocator is unsafe by its trait")]
// SAFETY: every call goes to the system's allocator with the arguments it came with.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // A thread that is ending has no counter any more.
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const PERIOD_NS: u64 = 1_000_000;

struct FixedClock(Cell<u64>);

impl Clock for FixedClock {
    fn now_ns(&self) -> u64 {
        self.0.get()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.0.set(deadline_ns);
    }
}

struct Rig {
    bus: Loopback,
    counters: [u8; 7],
}

impl Rig {
    fn send(&mut self, message: &Message) {
        let counter = &mut self.counters[message.index()];
        self.bus
            .send(&message.encode(*counter).expect("in range"))
            .expect("room");
        *counter = counter.wrapping_add(1);
    }

    /// What a follower gets in tick `n`: its state, its V2V, an obstacle to pass.
    fn publish(&mut self, n: u64) {
        let (time_ns, t) = (n * PERIOD_NS, 1e-3 * n as f64);
        self.send(&Message::EgoState(EgoState {
            tick: n as u32,
            bench_time_ns: time_ns,
            position_x_m: 20.0 * t,
            speed_forward_mps: 20.0,
            nav_status: NavStatus::Valid,
            ..EgoState::default()
        }));
        if n.is_multiple_of(20) {
            self.send(&Message::V2vState(V2vState {
                generation_time_ns: time_ns.saturating_sub(50_000_000),
                position_x_m: 25.0 + 20.0 * t,
                speed_mps: 20.0,
                ..V2vState::default()
            }));
        }
        if n.is_multiple_of(50) {
            self.send(&Message::Obstacle(Obstacle {
                kind: ObstacleKind::Vehicle,
                measured_time_ns: time_ns,
                position_x_m: 60.0 + 15.0 * t,
                speed_x_mps: 15.0,
                length_m: 5.0,
                width_m: 2.0,
                ..Obstacle::default()
            }));
        }
        while self.bus.receive().expect("up").is_some() {}
    }
}

fn mission() -> Message {
    Message::Mission(Mission {
        truck_index: 1,
        platoon_size: 2,
        run_state: RunState::Running,
        spacing_m: 25.0,
        set_speed_mps: 20.0,
        lane_width_m: 3.5,
        right_edge_y_m: -1.75,
        left_edge_y_m: 5.25,
        loop_period_ns: PERIOD_NS as u32,
        ..Mission::default()
    })
}

#[test]
fn a_tick_in_the_steady_state_allocates_nothing() {
    let path = std::env::temp_dir().join(format!("no-allocation-{}.mcap", std::process::id()));
    let recorder = Recorder::start(&path, RecorderOptions::new(Source::Ecu(1))).expect("writable");
    let (bus, ecu_bus) = Loopback::pair("loopback1", 1024);
    let law = LawController::new(Law::new(Calibration::default(), ActiveSet));
    let config = Config {
        truck: 1,
        ..Config::default()
    };
    let mut ecu = Ecu::new(config, Box::new(ecu_bus), Box::new(law), Some(recorder));
    let mut rig = Rig {
        bus,
        counters: [0; 7],
    };
    let clock = FixedClock(Cell::new(0));
    rig.send(&mission());
    rig.publish(0);
    ecu.prepare(&clock);
    assert_eq!(ecu.mode(), EcuMode::Running);

    let mut worst = 0;
    for n in 0..2_000 {
        if n > 0 {
            rig.publish(n);
        }
        clock.0.set(n * PERIOD_NS + PERIOD_NS / 2);
        let before = ALLOCATIONS.get();
        ecu.tick(Slot::on_time(n as u32, PERIOD_NS, &clock), &clock);
        // The first ticks may fill what is filled once, thread locals of libraries for instance.
        if n >= 10 {
            worst = worst.max(ALLOCATIONS.get() - before);
        }
    }
    let report = ecu.finish(&clock);
    std::fs::remove_file(&path).expect("ours");
    assert_eq!(worst, 0, "allocations in the worst tick");
    assert_eq!(
        (report.ticks, report.qp.solves, report.qp.failures),
        (2_000, 2_000, 0)
    );
    assert!(ALLOCATIONS.get() > 0, "the counter counts");
}
