//! The writer thread: drains the rings in the order of pushing and closes chunks in time.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use mcap::McapError;

use crate::dropped::DroppedRecord;
use crate::part::{Item, Part};
use crate::ring::{Numbered, Rings};

/// Most wall time a chunk stays open. A killed process loses that, the writer's nap and what waited
/// for the writer; together they are to stay below 100 ms on a machine that is busy.
const CHUNK_OPEN_MAX: Duration = Duration::from_millis(50);
/// How long the writer sleeps when the rings are empty.
const POLL: Duration = Duration::from_millis(5);
/// Records written between two looks at the chunk's age.
const BATCH: usize = 512;

/// What the thread did.
#[derive(Debug, Default)]
pub(crate) struct Written {
    pub(crate) written: u64,
    pub(crate) error: Option<String>,
}

/// State of the writer thread.
pub(crate) struct Writer {
    part: Part,
    rings: Arc<Rings>,
    heads: Heads,
    /// Number of the next record if none is missing.
    expected: u64,
    /// Bench time of the newest record \[ns\].
    newest_ns: u64,
    has_begun: bool,
    done: Written,
}

impl Writer {
    pub(crate) fn new(part: Part, rings: Arc<Rings>) -> Self {
        Self {
            part,
            rings,
            heads: Heads::default(),
            expected: 0,
            newest_ns: 0,
            has_begun: false,
            done: Written::default(),
        }
    }

    /// Runs until told to stop and the rings are empty.
    ///
    /// The wall clock here decides only where chunks end, never what they hold.
    pub(crate) fn run(mut self) -> Written {
        let mut chunk_closed = Instant::now();
        loop {
            let stopping = self.rings.is_stopping();
            let count = self.drain();
            if chunk_closed.elapsed() >= CHUNK_OPEN_MAX {
                let result = self.part.close_chunk();
                self.note(result);
                chunk_closed = Instant::now();
            }
            if count == 0 {
                if stopping {
                    break;
                }
                thread::park_timeout(POLL); // a pusher that waits wakes us sooner
            }
        }
        self.finish()
    }

    /// Writes up to a batch of records and says how many it took.
    fn drain(&mut self) -> usize {
        // Everything numbered below this is visible in the rings now, or was dropped.
        let numbered = self.rings.numbered();
        for count in 0..BATCH {
            self.heads.fill(&self.rings);
            let Some((number, item)) = self.heads.take_first(numbered) else {
                return count;
            };
            self.write(number, &item);
        }
        BATCH
    }

    fn write(&mut self, number: u64, item: &Item) {
        let result = self.try_write(number, item);
        self.expected = number + 1;
        self.newest_ns = item.time_ns();
        if result.is_ok() {
            self.done.written += 1;
        }
        self.note(result);
    }

    fn try_write(&mut self, number: u64, item: &Item) -> Result<(), McapError> {
        if self.done.error.is_some() {
            return Err(McapError::AttemptedWriteAfterFailure);
        }
        self.begin()?;
        if number > self.expected {
            self.write_gap(number, item.time_ns())?;
        }
        self.part.write(number, item)
    }

    fn begin(&mut self) -> Result<(), McapError> {
        if self.has_begun {
            return Ok(());
        }
        self.has_begun = true;
        self.part.begin(self.rings.start_wall_ns())
    }

    /// Marks the records missing before `number`.
    fn write_gap(&mut self, number: u64, time_ns: u64) -> Result<(), McapError> {
        let dropped = self.rings.dropped();
        let record = DroppedRecord {
            time_ns,
            count: number - self.expected,
            frames: dropped.frames,
            ticks: dropped.ticks,
            truths: dropped.truths,
            memories: dropped.memories,
        };
        self.part.write_dropped(number, &record)
    }

    fn finish(mut self) -> Written {
        let result = self.try_finish();
        self.note(result);
        self.done
    }

    fn try_finish(&mut self) -> Result<(), McapError> {
        if self.done.error.is_some() {
            return Err(McapError::AttemptedWriteAfterFailure);
        }
        self.begin()?;
        let numbered = self.rings.numbered();
        if numbered > self.expected {
            self.write_gap(numbered, self.newest_ns)?;
        }
        self.part.finish(self.done.written, self.rings.dropped())
    }

    /// Keeps the first error; later ones follow from it.
    fn note(&mut self, result: Result<(), McapError>) {
        if let Err(error) = result
            && self.done.error.is_none()
        {
            self.done.error = Some(describe(&error));
        }
    }
}

/// The error with its cause: mcap's own text leaves the operating system's words out.
fn describe(error: &McapError) -> String {
    match std::error::Error::source(error) {
        Some(cause) => format!("{error}: {cause}"),
        None => error.to_string(),
    }
}

/// The oldest record of each ring.
#[derive(Default)]
struct Heads {
    slots: [Option<(u64, Item)>; 4],
}

impl Heads {
    fn fill(&mut self, rings: &Rings) {
        fn numbered<T>(head: Numbered<T>, wrap: fn(T) -> Item) -> (u64, Item) {
            (head.number, wrap(head.record))
        }
        let [frame, tick, truth, memory] = &mut self.slots;
        fill_slot(frame, || Some(numbered(rings.frames.pop()?, Item::Frame)));
        fill_slot(tick, || Some(numbered(rings.ticks.pop()?, Item::Tick)));
        fill_slot(truth, || {
            Some(numbered(rings.truths.pop()?, |record| Item::Truth(Box::new(record))))
        });
        fill_slot(memory, || {
            Some(numbered(rings.memories.pop()?, |record| Item::Memory(Box::new(record))))
        });
    }

    /// Takes the record with the least number, if that is below `limit`.
    fn take_first(&mut self, limit: u64) -> Option<(u64, Item)> {
        let slots = self.slots.iter_mut().filter(|slot| slot.is_some());
        let first = slots.min_by_key(|slot| slot.as_ref().map(|(number, _)| *number))?;
        first.take_if(|(number, _)| *number < limit)
    }
}

fn fill_slot(slot: &mut Option<(u64, Item)>, pop: impl FnOnce() -> Option<(u64, Item)>) {
    if slot.is_none() {
        *slot = pop();
    }
}
