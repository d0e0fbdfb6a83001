//! Messages in flight: parts that have arrived and wait for the others.

use crate::messages::Message;
use serde::{Deserialize, Serialize};

/// Messages of one kind that may be in flight: as many as there are slots for obstacles.
const IN_FLIGHT: usize = 8;

/// The parts of one kind of message, by the alive counter they share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Flight<T> {
    slots: [Slot<T>; IN_FLIGHT],
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Slot<T> {
    counter: u8,
    parts: T,
}

/// Parts that make a message.
pub(super) trait Parts: Copy + Default {
    /// The message, once no part is missing.
    fn complete(&self) -> Option<Message>;
}

impl<T: Copy + Default> Flight<T> {
    /// The parts with this counter so far. They displace a message eight counters older.
    pub(super) fn of(&mut self, counter: u8) -> &mut T {
        let slot = &mut self.slots[usize::from(counter) % IN_FLIGHT];
        if slot.counter != counter {
            *slot = Slot { counter, parts: T::default() };
        }
        &mut slot.parts
    }

    /// All parts in flight.
    pub(super) fn all(&mut self) -> impl Iterator<Item = &mut T> {
        self.slots.iter_mut().map(|slot| &mut slot.parts)
    }
}

impl<T: Parts> Flight<T> {
    /// Adds a part; the message when that completes it, which leaves its slot empty.
    pub(super) fn add(&mut self, counter: u8, add: impl FnOnce(&mut T)) -> Option<Message> {
        let parts = self.of(counter);
        add(parts);
        let message = parts.complete()?;
        *parts = T::default();
        Some(message)
    }
}
