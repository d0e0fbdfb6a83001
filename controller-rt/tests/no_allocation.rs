//! In the steady state a tick allocates nothing: with the law, over loopback, recording.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use bench::{PERIOD_NS, StillClock, follower, law};
use controller_rt::{Around, Controller, Slot};
use law::Structure;
use platoon_dbc::EcuMode;
use traces::{Recorder, RecorderOptions, Source};

mod bench;

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

#[test]
fn a_tick_in_the_steady_state_allocates_nothing() {
    for structure in [Structure::Mcf, Structure::SingleMpc, Structure::DmpcPlf] {
        let worst = allocations_of_the_worst_tick(law(structure), "steady");
        assert_eq!(worst, 0, "allocations in the worst tick of {structure:?}");
    }
}

#[test]
fn a_law_that_allocates_once_in_a_thousand_steps_is_caught() {
    let mut steps = 0;
    let careless = Around::new(law(Structure::Mcf), move |law, seen, mark| {
        steps += 1;
        if steps == 1_000 {
            std::hint::black_box(Box::new(steps));
        }
        law.step(seen, mark)
    });
    assert_eq!(allocations_of_the_worst_tick(Box::new(careless), "careless"), 1);
}

fn allocations_of_the_worst_tick(law: Box<dyn Controller>, name: &str) -> u64 {
    let file = format!("no-allocation-{name}-{}.mcap", std::process::id());
    let path = std::env::temp_dir().join(file);
    let recorder = Recorder::start(&path, RecorderOptions::new(Source::Ecu(1))).expect("writable");
    let (mut rig, mut ecu) = follower(law, Some(recorder));
    let clock = StillClock::default();
    rig.invite();
    rig.publish(0);
    ecu.prepare(&clock);
    assert_eq!(ecu.mode(), EcuMode::Running);

    let mut worst = 0;
    for n in 0..2_000 {
        if n > 0 {
            rig.publish(n);
        }
        clock.set(n * PERIOD_NS + PERIOD_NS / 2);
        let before = ALLOCATIONS.get();
        ecu.tick(Slot::on_time(n as u32, PERIOD_NS, &clock), &clock);
        // The first ticks may fill what is filled once, thread locals of libraries for instance.
        if n >= 10 {
            worst = worst.max(ALLOCATIONS.get() - before);
        }
        rig.hear();
    }
    let report = ecu.finish(&clock);
    std::fs::remove_file(&path).expect("ours");
    assert_eq!((report.ticks, report.qp.solves, report.qp.failures), (2_000, 2_000, 0));
    worst
}
