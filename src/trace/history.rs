//! What one ECU recorded, in the order it happened, tick by tick.

use std::collections::BTreeMap;

use controller_rt::join_snapshot;
use traces::{FrameRecord, MemoryRecord, Record, TickRecord};

use super::Event;

/// Records held back while an earlier one may still come: the merge puts a process's records in
/// the order of bench time, which differs from their order by a few ticks at most.
const HELD_BACK_MAX: usize = 4096;

/// A tick and the frames it consumed, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct TickInputs {
    /// What was taken from the bus since the tick before.
    pub frames: Vec<FrameRecord>,
    /// What the tick came to.
    pub tick: TickRecord,
}

/// Records that are missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// How many.
    pub records: u64,
}

/// Something that happened to an ECU.
#[derive(Debug, Clone, PartialEq)]
pub enum Moment {
    /// It ran a tick.
    Tick(Box<TickInputs>),
    /// Everything later commands depend on, as it was after a tick.
    Snapshot {
        /// The tick.
        tick: u32,
        /// The snapshot, as `controller_rt::Ecu::restore` takes it.
        bytes: Vec<u8>,
    },
    /// Records are missing here: ring full, chunk damaged, or process killed and started again.
    Gap(Gap),
}

/// Puts the events of one ECU in order.
///
/// Feed it `rx`, `tick`, `memory` and `dropped` events in the order of the file. A gap is seen by
/// the numbers of the records around it.
#[derive(Debug, Default)]
pub struct History {
    held_back: BTreeMap<u32, Record>,
    expected: Option<u32>,
    frames: Vec<FrameRecord>,
    snapshot: Vec<MemoryRecord>,
}

impl History {
    /// Takes an event; hands on what is complete by it.
    pub fn push(&mut self, event: Event, out: &mut dyn FnMut(Moment)) {
        // A gap marker repeats what the numbers say, under a number that is not its own.
        if !matches!(event.record, Record::Dropped(_)) {
            self.held_back.insert(event.sequence, event.record);
        }
        self.release(out);
    }

    /// Hands on what was held back. Frames behind the last tick belong to no tick.
    pub fn finish(mut self, out: &mut dyn FnMut(Moment)) {
        while let Some((sequence, record)) = self.held_back.pop_first() {
            self.take(sequence, record, out);
        }
        self.take_snapshot(out);
    }

    fn release(&mut self, out: &mut dyn FnMut(Moment)) {
        while let Some(first) = self.held_back.first_entry() {
            let is_next = self.expected.unwrap_or(0) == *first.key();
            if !is_next && self.held_back.len() <= HELD_BACK_MAX {
                return;
            }
            if let Some((sequence, record)) = self.held_back.pop_first() {
                self.take(sequence, record, out);
            }
        }
    }

    fn take(&mut self, sequence: u32, record: Record, out: &mut dyn FnMut(Moment)) {
        let missing = sequence.wrapping_sub(self.expected.unwrap_or(0));
        self.expected = Some(sequence.wrapping_add(1));
        if !matches!(record, Record::Memory(_)) || missing > 0 {
            self.take_snapshot(out);
        }
        if missing > 0 {
            self.frames.clear();
            out(Moment::Gap(Gap { records: u64::from(missing) }));
        }
        match record {
            Record::Frame(frame) => self.frames.push(frame),
            Record::Tick(tick) => {
                let frames = std::mem::take(&mut self.frames);
                out(Moment::Tick(Box::new(TickInputs { frames, tick: *tick })));
            }
            Record::Memory(part) => {
                // A snapshot that did not fit the ring is begun again.
                if part.snapshot.as_bytes().first() == Some(&0) {
                    self.snapshot.clear();
                }
                self.snapshot.push(*part);
            }
            Record::Truth(_) | Record::Dropped(_) => {}
        }
    }

    /// Hands on the snapshot whose parts have all come.
    fn take_snapshot(&mut self, out: &mut dyn FnMut(Moment)) {
        let parts = std::mem::take(&mut self.snapshot);
        if let (Some(first), Some(bytes)) = (parts.first(), join_snapshot(&parts)) {
            out(Moment::Snapshot { tick: first.tick, bytes });
        }
    }
}
