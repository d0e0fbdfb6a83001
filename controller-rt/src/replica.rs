//! An ECU that lives through what another one recorded: same inbox, picture, law, guard, outbox.

use platoon_dbc::{Bus, Clock, Frame, Loopback};
use traces::{FrameRecord, MemoryRecord, TickRecord};

use crate::controller::Controller;
use crate::ecu::{Config, Ecu};
use crate::inbox::DRAIN_MAX;
use crate::pacer::Slot;
use crate::recording::snapshot_records;

/// Frames a tick sends at most, with room to spare: a command, a status, a broadcast and a plan,
/// each in a few frames.
const SENT_MAX: usize = 64;

/// An ECU fed tick by tick with recorded frames and times.
///
/// Nothing of a tick but its frames, its number and its time reaches the ECU; so what it comes to
/// is the same, bit for bit, as on the day it was recorded.
pub struct Replica {
    ecu: Ecu,
    wire: Loopback,
}

impl Replica {
    /// An ECU that has seen nothing, with its control law.
    #[must_use]
    pub fn new(config: Config, controller: Box<dyn Controller>) -> Self {
        let (wire, end) = Loopback::pair("replica", DRAIN_MAX.max(SENT_MAX));
        Self { ecu: Ecu::new(config, Box::new(end), controller, None), wire }
    }

    /// Continues from a recorded snapshot; false when it is damaged, another truck's or of another
    /// version of this program.
    pub fn restore(&mut self, bytes: &[u8]) -> bool {
        self.ecu.restore(bytes)
    }

    /// A snapshot of what it has become by the tick `after`, as an ECU records it.
    pub fn snapshot(&mut self, after: &TickRecord) -> Vec<MemoryRecord> {
        snapshot_records(self.ecu.save(), after.tick, after.time_ns)
    }

    /// Runs the tick `recorded`, which consumed `frames`; what it comes to now. `sent` is handed
    /// every frame it sends.
    ///
    /// Times it took are zero, and nothing is late.
    pub fn tick(
        &mut self,
        frames: &[FrameRecord],
        recorded: &TickRecord,
        sent: &mut dyn FnMut(&Frame),
    ) -> TickRecord {
        // Before the first tick an ECU drains as often as it likes; later, never more than fits.
        let at_start = frames.len().saturating_sub(1) / DRAIN_MAX * DRAIN_MAX;
        for some in frames[..at_start].chunks(DRAIN_MAX) {
            self.feed(some);
            self.ecu.prepare(&Still);
        }
        self.feed(&frames[at_start..]);
        let slot = Slot {
            time_ns: recorded.time_ns,
            skipped: recorded.skipped,
            is_held: recorded.held,
            ..Slot::on_time(recorded.tick, 0, &Still)
        };
        self.ecu.tick(slot, &Still);
        while let Ok(Some(received)) = self.wire.receive() {
            sent(&received.frame);
        }
        self.ecu.newest_tick().copied().unwrap_or_default()
    }

    /// Puts frames on the ECU's bus. There is room: nobody else sends to it.
    fn feed(&mut self, frames: &[FrameRecord]) {
        while let Ok(Some(_)) = self.wire.receive() {}
        for record in frames {
            let _ = self.wire.send(&record.frame);
        }
    }
}

/// A clock that stands still: nothing an ECU computes depends on it.
struct Still;

impl Clock for Still {
    fn now_ns(&self) -> u64 {
        0
    }

    fn sleep_until_ns(&self, _deadline_ns: u64) {}
}
