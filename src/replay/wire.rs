//! Whether frames of one recording are in another: what an ECU consumed was on its bus, and the
//! commands on its bus are what the recomputed ECU sends.

use std::collections::VecDeque;

use platoon_dbc::Frame;
use serde::Serialize;
use traces::FrameRecord;

/// Furthest the two recordings of a frame are apart in bench time \[ns\]: a machine can pause.
pub const APART_MAX_NS: u64 = 3_000_000_000;

/// Frames that were asked for without ever having been there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Strays {
    /// How many.
    pub frames: u64,
    /// Tick of the first.
    pub first_tick: u32,
    /// The first: identifier and data, in hexadecimal.
    pub first: String,
}

/// Matches frames that were recorded at one place with those that were at another.
#[derive(Debug, Default)]
pub struct Wire {
    /// Frames that were there and not asked for yet, with their bench time \[ns\].
    carried: VecDeque<(u64, Frame)>,
    /// Frames that are still looked for.
    consumed: VecDeque<FrameRecord>,
    /// What was there before this is not known \[ns\].
    known_from_ns: Option<u64>,
    newest_ns: u64,
    is_midway: bool,
    strays: Option<Strays>,
}

impl Wire {
    /// Nothing seen yet; `is_midway` when the recordings begin behind the start of the run.
    pub fn new(is_midway: bool) -> Self {
        Self { is_midway, ..Self::default() }
    }

    /// A frame that was there at this bench time \[ns\].
    pub fn carried(&mut self, time_ns: u64, frame: Frame) {
        self.known_from_ns.get_or_insert(time_ns);
        self.newest_ns = self.newest_ns.max(time_ns);
        self.carried.push_back((time_ns, frame));
        self.settle(self.newest_ns.saturating_sub(APART_MAX_NS));
    }

    /// A frame of which it is asked whether it was there.
    pub fn consumed(&mut self, record: &FrameRecord) {
        self.consumed.push_back(*record);
    }

    /// The frames asked for that were not there, once all has been seen; `None` when there are
    /// none, or nobody recorded what was there.
    pub fn strays(mut self) -> Option<Strays> {
        self.settle(u64::MAX);
        self.strays.filter(|_| self.known_from_ns.is_some())
    }

    /// Decides on the frames asked for up to a bench time \[ns\].
    fn settle(&mut self, until_ns: u64) {
        while self.consumed.front().is_some_and(|record| record.time_ns <= until_ns) {
            let Some(record) = self.consumed.pop_front() else { return };
            let oldest_ns = record.time_ns.saturating_sub(APART_MAX_NS);
            while self.carried.front().is_some_and(|(time_ns, _)| *time_ns < oldest_ns) {
                self.carried.pop_front();
            }
            let place = self.carried.iter().position(|(_, frame)| *frame == record.frame);
            match place {
                Some(place) => drop(self.carried.remove(place)),
                None => self.note_stray(&record),
            }
        }
    }

    fn note_stray(&mut self, record: &FrameRecord) {
        let known_from_ns = self.known_from_ns.unwrap_or(u64::MAX);
        if self.is_midway && record.time_ns < known_from_ns.saturating_add(APART_MAX_NS) {
            return;
        }
        // Invitations before the start are recorded by buses that echo only.
        if record.time_ns == 0 {
            return;
        }
        let fresh = || Strays {
            frames: 0,
            first_tick: record.tick,
            first: format!("{:X}#{}", record.frame.id(), hexadecimal(record.frame.data())),
        };
        self.strays.get_or_insert_with(fresh).frames += 1;
    }
}

fn hexadecimal(data: &[u8]) -> String {
    data.iter().map(|byte| format!("{byte:02X}")).collect()
}

#[cfg(test)]
mod tests {
    use platoon_dbc::FrameFlags;

    use super::*;

    fn record(time_ms: u64, says: u64) -> FrameRecord {
        let frame = Frame::new(0x123, FrameFlags::default(), &says.to_be_bytes());
        let frame = frame.expect("a frame");
        let tick = time_ms as u32;
        FrameRecord { bus: 0, time_ns: time_ms * 1_000_000, stamp_ns: 0, tick, tx: true, frame }
    }

    #[test]
    fn frames_are_matched_in_whatever_order_the_two_saw_them() {
        let mut wire = Wire::new(false);
        wire.consumed(&record(1, 1));
        for says in [0, 2, 1] {
            wire.carried(2_000_000, record(2, says).frame);
        }
        wire.consumed(&record(2, 2));
        assert_eq!(wire.strays(), None);
    }

    #[test]
    fn a_changed_frame_is_found_at_its_tick() {
        let mut wire = Wire::new(false);
        for time_ms in 1..10_000 {
            wire.carried(time_ms * 1_000_000, record(time_ms, time_ms).frame);
            let flipped = if time_ms == 777 { 1 << 40 } else { 0 };
            wire.consumed(&record(time_ms, time_ms ^ flipped));
        }
        let strays = wire.strays().expect("one was changed");
        assert_eq!((strays.frames, strays.first_tick), (1, 777));
    }

    #[test]
    fn nothing_is_said_where_nobody_recorded_the_bus() {
        let mut wire = Wire::new(false);
        wire.consumed(&record(1, 1));
        assert_eq!(wire.strays(), None);
    }
}
