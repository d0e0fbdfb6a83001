//! The bounded queues between a loop that must not wait and the thread that writes.
//!
//! One queue per kind of record, so that a slot is no bigger than its record; every record gets
//! a number from one sequence, so that the writer can restore the order of pushing and see gaps.
//!
//! crossbeam's `ArrayQueue` has one spot where a pusher may spin: when the queue wraps onto the
//! very slot its consumer is emptying. A pusher with a real-time priority would spin there for
//! ever if it had pre-empted the consumer, so one slot is always left free.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crossbeam::queue::ArrayQueue;

use crate::frame::FrameRecord;
use crate::memory::MemoryRecord;
use crate::tick::TickRecord;
use crate::topic::Source;
use crate::truth::TruthRecord;

/// How many records of each kind wait for the writer before further ones are dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacity {
    /// Frames.
    pub frames: usize,
    /// Ticks.
    pub ticks: usize,
    /// World states.
    pub truths: usize,
    /// Memory snapshots.
    pub memories: usize,
}

impl Capacity {
    /// Room for a writer that gets no CPU for some seconds: the rig sees every bus at 1 kHz, an
    /// ECU its own and a tick per millisecond. 6 MB and 4 MB.
    #[must_use]
    pub const fn of(source: Source) -> Self {
        match source {
            Source::Rig => Self { frames: 32_768, ticks: 1, truths: 512, memories: 1 },
            Source::Ecu(_) => Self { frames: 8_192, ticks: 8_192, truths: 1, memories: 64 },
        }
    }
}

/// Records by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Frames.
    pub frames: u64,
    /// Ticks.
    pub ticks: u64,
    /// World states.
    pub truths: u64,
    /// Memory snapshots.
    pub memories: u64,
}

impl Counts {
    /// All kinds together.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.frames + self.ticks + self.truths + self.memories
    }
}

/// A record and its place in the order of pushing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Numbered<T> {
    pub(crate) number: u64,
    pub(crate) record: T,
}

/// One kind's queue and its count of drops.
pub(crate) struct Lane<T> {
    queue: ArrayQueue<Numbered<T>>,
    dropped: AtomicU64,
}

impl<T> Lane<T> {
    fn new(capacity: usize) -> Self {
        Self { queue: ArrayQueue::new(capacity.max(1) + 1), dropped: AtomicU64::new(0) }
    }

    fn is_full(&self) -> bool {
        self.queue.len() + 1 >= self.queue.capacity()
    }

    pub(crate) fn pop(&self) -> Option<Numbered<T>> {
        self.queue.pop()
    }
}

/// All queues between one pusher and one writer.
pub(crate) struct Rings {
    pub(crate) frames: Lane<FrameRecord>,
    pub(crate) ticks: Lane<TickRecord>,
    pub(crate) truths: Lane<TruthRecord>,
    pub(crate) memories: Lane<MemoryRecord>,
    /// Numbers given out so far; everything below is in a queue, written, or dropped.
    numbered: AtomicU64,
    stopping: AtomicBool,
    start_wall_ns: AtomicU64,
}

impl Rings {
    pub(crate) fn new(capacity: Capacity, start_wall_ns: u64) -> Self {
        Self {
            frames: Lane::new(capacity.frames),
            ticks: Lane::new(capacity.ticks),
            truths: Lane::new(capacity.truths),
            memories: Lane::new(capacity.memories),
            numbered: AtomicU64::new(0),
            stopping: AtomicBool::new(false),
            start_wall_ns: AtomicU64::new(start_wall_ns),
        }
    }

    /// Queues a record under the next number, or counts it as dropped. One pusher only.
    pub(crate) fn push<T: Recordable>(&self, record: T) -> bool {
        let lane = T::lane(self);
        let number = self.numbered.load(Ordering::Relaxed);
        let kept = !lane.is_full() && lane.queue.push(Numbered { number, record }).is_ok();
        if !kept {
            lane.dropped.fetch_add(1, Ordering::Relaxed);
        }
        // Release: whoever sees the new number also sees the record or the drop.
        self.numbered.store(number + 1, Ordering::Release);
        kept
    }

    pub(crate) fn has_room<T: Recordable>(&self) -> bool {
        !T::lane(self).is_full()
    }

    /// How many numbers have been given out.
    pub(crate) fn numbered(&self) -> u64 {
        self.numbered.load(Ordering::Acquire)
    }

    pub(crate) fn dropped(&self) -> Counts {
        Counts {
            frames: self.frames.dropped.load(Ordering::Relaxed),
            ticks: self.ticks.dropped.load(Ordering::Relaxed),
            truths: self.truths.dropped.load(Ordering::Relaxed),
            memories: self.memories.dropped.load(Ordering::Relaxed),
        }
    }

    pub(crate) fn stop(&self) {
        self.stopping.store(true, Ordering::Release);
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }

    pub(crate) fn set_start_wall_ns(&self, start_wall_ns: u64) {
        self.start_wall_ns.store(start_wall_ns, Ordering::Release);
    }

    pub(crate) fn start_wall_ns(&self) -> u64 {
        self.start_wall_ns.load(Ordering::Acquire)
    }
}

mod sealed {
    /// Keeps [`Recordable`](super::Recordable) to the records of this crate.
    pub trait Sealed {}
    impl Sealed for super::FrameRecord {}
    impl Sealed for super::TickRecord {}
    impl Sealed for super::TruthRecord {}
    impl Sealed for super::MemoryRecord {}
}

/// A record that [`Recorder::push`](crate::Recorder::push) takes.
#[expect(private_interfaces, reason = "the trait is sealed; its one item is for this crate")]
pub trait Recordable: sealed::Sealed + Copy {
    #[doc(hidden)]
    fn lane(rings: &Rings) -> &Lane<Self>;
}

macro_rules! lanes {
    ($($record:ty => $lane:ident;)*) => {$(
        #[expect(private_interfaces, reason = "the trait is sealed")]
        impl Recordable for $record {
            fn lane(rings: &Rings) -> &Lane<Self> {
                &rings.$lane
            }
        }
    )*};
}

lanes! {
    FrameRecord => frames;
    TickRecord => ticks;
    TruthRecord => truths;
    MemoryRecord => memories;
}
