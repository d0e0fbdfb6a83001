//! Handing a record to the recorder costs the loop no allocation, full ring or not.

#![expect(unsafe_code, reason = "a global allocator that counts is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use platoon_dbc::{Frame, FrameFlags};
use traces::{
    Capacity, FrameRecord, MemoryRecord, Recorder, RecorderOptions, Source, TickRecord, TruthRecord,
};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system's allocator unchanged; counting touches only a
// constant-initialised thread local without a destructor, which itself allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_push_neither_allocates_nor_frees() {
    let path = std::env::temp_dir().join(format!("traces-alloc-{}.mcap", std::process::id()));
    let capacity = Capacity { frames: 64, ticks: 64, truths: 4, memories: 4 };
    let options = RecorderOptions { capacity, ..RecorderOptions::new(Source::Rig) };
    let mut recorder = Recorder::start(&path, options).expect("starts");
    let frame = Frame::new(1, FrameFlags::default(), &[1, 2]).expect("valid");
    let frame = FrameRecord { bus: 0, time_ns: 0, stamp_ns: 0, tick: 0, tx: true, frame };

    let before = ALLOCATIONS.get();
    for _ in 0..10_000 {
        recorder.push(frame);
        recorder.push(TickRecord::default());
        recorder.push(TruthRecord::default());
        recorder.push(MemoryRecord::default());
    }
    let after = ALLOCATIONS.get();

    let finished = recorder.finish();
    std::fs::remove_file(&path).expect("removable");
    assert_eq!(after, before);
    assert!(finished.dropped.total() > 0, "the ring was never full");
    assert_eq!(finished.written + finished.dropped.total(), 40_000);
}
