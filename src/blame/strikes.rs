//! When faults strike: the beat they keep, how they are asked for, and the log of those that did.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, Thread};

use platoon_dbc::Clock;
use serde::{Deserialize, Serialize};

use crate::clock::HostClock;

/// Bench time before the first strike \[ns\]: start-up and what is usual are learnt by then.
pub const FIRST_NS: u64 = 1_500_000_000;

/// One fault at work, on CLOCK_MONOTONIC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Strike {
    /// From \[ns\].
    pub from_ns: u64,
    /// To \[ns\].
    pub to_ns: u64,
}

/// The strikes of a run, noted by the one thread that strikes, without waiting.
#[derive(Debug)]
pub struct StrikeLog {
    places: Box<[(AtomicU64, AtomicU64)]>,
    noted: AtomicUsize,
}

impl StrikeLog {
    /// A log with room for so many.
    pub fn new(room: u32) -> Arc<Self> {
        let places = (0..room).map(|_| (AtomicU64::new(0), AtomicU64::new(0))).collect();
        Arc::new(Self { places, noted: AtomicUsize::new(0) })
    }

    /// Notes that a fault was at work from `from_ns` until now.
    pub fn note(&self, from_ns: u64) {
        let place = self.noted.fetch_add(1, Ordering::Relaxed);
        if let Some((from, to)) = self.places.get(place) {
            from.store(from_ns, Ordering::Relaxed);
            to.store(HostClock::default().now_ns(), Ordering::Relaxed);
        }
    }

    /// What was noted; to be asked for when nobody strikes any more.
    pub fn strikes(&self) -> Vec<Strike> {
        let noted = self.noted.load(Ordering::Relaxed).min(self.places.len());
        let read = |place: &AtomicU64| place.load(Ordering::Relaxed);
        self.places[..noted]
            .iter()
            .map(|(from, to)| Strike { from_ns: read(from), to_ns: read(to) })
            .collect()
    }
}

/// Asks somebody else for one strike.
#[derive(Debug, Default)]
pub struct Arm {
    raised: AtomicBool,
    sleeper: OnceLock<Thread>,
}

impl Arm {
    /// Asks for a strike, waking who sleeps in [`wait`](Self::wait).
    pub fn raise(&self) {
        self.raised.store(true, Ordering::Release);
        if let Some(sleeper) = self.sleeper.get() {
            sleeper.unpark();
        }
    }

    /// Whether a strike is asked for; asking once.
    pub fn take(&self) -> bool {
        self.raised.load(Ordering::Relaxed) && self.raised.swap(false, Ordering::Acquire)
    }

    /// Sleeps until a strike is asked for; false when `stop` is set instead.
    pub fn wait(&self, stop: &AtomicBool) -> bool {
        self.sleeper.get_or_init(thread::current);
        while !self.take() {
            if stop.load(Ordering::Relaxed) {
                return false;
            }
            thread::park();
        }
        true
    }
}

/// What is to be done at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Nothing.
    Rest,
    /// A strike.
    Strike,
    /// The end of the run.
    End,
}

/// The beat of the strikes: far enough apart for one not to touch the next, and not in step with
/// anything else.
#[derive(Debug, Clone, Copy)]
pub struct Beat {
    period_ns: u64,
    spacing: u64,
    strikes: u32,
    struck: u32,
    next_ns: u64,
}

impl Beat {
    /// So many strikes, `spacing` periods apart or a little more.
    pub fn new(period_ns: u64, spacing: u64, strikes: u32) -> Self {
        Self { period_ns, spacing, strikes, struck: 0, next_ns: FIRST_NS }
    }

    /// What is to be done at bench time `time_ns`.
    pub fn at(&mut self, time_ns: u64) -> Turn {
        if time_ns < self.next_ns {
            return Turn::Rest;
        }
        if self.struck == self.strikes {
            return Turn::End;
        }
        self.struck += 1;
        let more = u64::from(self.struck) * 7 % 11;
        self.next_ns = time_ns + (self.spacing + more) * self.period_ns;
        Turn::Strike
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn strikes_keep_their_distance_and_then_the_run_ends() {
        let mut beat = Beat::new(MS, 25, 3);
        let turns: Vec<(u64, Turn)> = (0..2_000)
            .map(|tick| (tick, beat.at(tick * MS)))
            .filter(|(_, turn)| *turn != Turn::Rest)
            .take(4)
            .collect();
        let expected = [
            (1_500, Turn::Strike),
            (1_532, Turn::Strike),
            (1_560, Turn::Strike),
            (1_595, Turn::End),
        ];
        assert_eq!(turns, expected);
    }

    #[test]
    fn an_arm_is_taken_once() {
        let arm = Arm::default();
        assert!(!arm.take());
        arm.raise();
        assert_eq!((arm.take(), arm.take()), (true, false));
        assert!(!arm.wait(&AtomicBool::new(true)), "stopped, not asked for");
    }

    #[test]
    fn a_full_log_keeps_what_it_has() {
        let log = StrikeLog::new(2);
        (1..4).for_each(|n| log.note(n));
        let from_ns: Vec<u64> = log.strikes().iter().map(|strike| strike.from_ns).collect();
        assert_eq!(from_ns, [1, 2]);
    }
}
