//! A part's messages in time order, within a bounded look-ahead.
//!
//! A loop stamps what it records as it goes, so a part is almost in order: a frame that waited in
//! a socket may carry a time a little before the record ahead of it.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::reader::{Message, Reader};

/// How far back in bench time a message may come after a later one and still be put in order.
const LOOK_AHEAD_NS: u64 = 1_000_000_000;
/// Most messages held while looking ahead.
const HELD_MAX: usize = 100_000;

/// A message's key: bench time, then place in the part.
type Key = (u64, u64);

pub(crate) struct Sorted {
    pub(crate) reader: Reader,
    held: BinaryHeap<Reverse<Held>>,
    taken: u64,
    newest_ns: u64,
    /// Latest time handed out.
    given_ns: u64,
    /// Messages that came too late to be put in order.
    pub(crate) stragglers: u64,
    exhausted: bool,
}

struct Held {
    key: Key,
    message: Message,
}

impl PartialEq for Held {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

impl Eq for Held {}

impl PartialOrd for Held {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Held {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        self.key.cmp(&other.key)
    }
}

impl Sorted {
    pub(crate) fn new(reader: Reader) -> Self {
        Self {
            reader,
            held: BinaryHeap::new(),
            taken: 0,
            newest_ns: 0,
            given_ns: 0,
            stragglers: 0,
            exhausted: false,
        }
    }

    /// Bench time of the next message \[ns\].
    pub(crate) fn peek_ns(&mut self) -> Option<u64> {
        self.look_ahead();
        self.held.peek().map(|Reverse(held)| held.key.0)
    }

    /// The next message.
    pub(crate) fn pop(&mut self) -> Option<Message> {
        self.look_ahead();
        let Reverse(held) = self.held.pop()?;
        self.stragglers += u64::from(held.key.0 < self.given_ns);
        self.given_ns = self.given_ns.max(held.key.0);
        Some(held.message)
    }

    /// Reads until the oldest message held cannot be preceded by one to come.
    fn look_ahead(&mut self) {
        while !self.exhausted && self.held.len() < HELD_MAX && !self.reaches_ahead() {
            match self.reader.next() {
                Some(message) => self.hold(message),
                None => self.exhausted = true,
            }
        }
    }

    fn reaches_ahead(&self) -> bool {
        let oldest = self.held.peek().map(|Reverse(held)| held.key.0);
        oldest.is_some_and(|oldest_ns| oldest_ns.saturating_add(LOOK_AHEAD_NS) < self.newest_ns)
    }

    fn hold(&mut self, message: Message) {
        let key = (message.time_ns(), self.taken);
        self.taken += 1;
        self.newest_ns = self.newest_ns.max(key.0);
        self.held.push(Reverse(Held { key, message }));
    }

    /// Messages read so far.
    pub(crate) const fn taken(&self) -> u64 {
        self.taken
    }

    /// Latest bench time read so far \[ns\]; `None` before the first message.
    pub(crate) fn newest_ns(&self) -> Option<u64> {
        (self.taken > 0).then_some(self.newest_ns)
    }
}
