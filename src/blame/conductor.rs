//! The law of the ECU under test, which now and then does something else first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use controller_rt::{Around, Controller};
use platoon_dbc::Clock;

use super::strikes::{Arm, Beat, StrikeLog, Turn};
use crate::clock::HostClock;

/// Bytes of the smallest page.
const PAGE_BYTES: usize = 4096;
/// Memory that a strike touches parts of \[bytes\]: more than a heap keeps, so that it is new each
/// time.
const FRESH_BYTES: usize = 256 << 20;

/// How a strike is brought about from within a step of the law.
pub enum Means {
    /// Not at all.
    Nothing,
    /// By computing for so long \[ns\].
    Computing(u64),
    /// By touching new memory for so long \[ns\].
    TouchingMemory(u64),
    /// By asking somebody else.
    Asking(Arc<Arm>),
}

/// Puts strikes before steps of a law, and ends the run when all have been made.
pub struct Conductor {
    /// When to strike.
    pub beat: Beat,
    /// How.
    pub means: Means,
    /// Where strikes are noted.
    pub log: Arc<StrikeLog>,
    /// Ends the run.
    pub stop: Arc<AtomicBool>,
}

impl Conductor {
    /// The law with its strikes.
    pub fn before(mut self, law: Box<dyn Controller>) -> Box<dyn Controller> {
        Box::new(Around::new(law, move |law, seen, mark| {
            match self.beat.at(seen.time_ns) {
                Turn::Rest => (),
                Turn::Strike => self.strike(),
                Turn::End => self.stop.store(true, Ordering::Relaxed),
            }
            law.step(seen, mark)
        }))
    }

    fn strike(&self) {
        let clock = HostClock::default();
        let from_ns = clock.now_ns();
        match &self.means {
            Means::Nothing => return,
            Means::Computing(lasts_ns) => clock.compute_until_ns(from_ns + lasts_ns),
            Means::TouchingMemory(lasts_ns) => touch_memory_until(from_ns + lasts_ns),
            // Who strikes notes it.
            Means::Asking(arm) => return arm.raise(),
        }
        self.log.note(from_ns);
    }
}

/// Has the kernel find page after page until then.
fn touch_memory_until(until_ns: u64) {
    let mut fresh = Vec::<u8>::with_capacity(FRESH_BYTES);
    for byte in fresh.spare_capacity_mut().iter_mut().step_by(PAGE_BYTES) {
        byte.write(1);
        if HostClock::default().now_ns() >= until_ns {
            break;
        }
    }
    std::hint::black_box(&mut fresh);
}
