//! A bus on which nobody else is: it gives an ECU the frames that one received in a recorded run,
//! at the times it received them, and takes what it sends.
//!
//! So the real loop, with the real law solving the problems of a real run, can be timed at rates
//! that no rig and no bus could serve beside it.

use std::path::Path;
use std::time::Duration;

use platoon_dbc::{Backend, Bus, BusCounts, Clock, Frame, ReceiveError, Received, SendError};
use traces::{FrameRecord, Record, Topic};

use crate::failure::Failure;
use crate::trace::Trace;

/// From the first time somebody waits to bench time 0 \[ns\].
const RUN_UP_NS: u64 = 20_000_000;

/// The bus.
pub struct Feed<C> {
    clock: C,
    frames: Vec<(u64, Frame)>,
    next: usize,
    /// Clock reading at bench time 0 \[ns\]; none before the first wait.
    start_ns: Option<u64>,
    counts: BusCounts,
}

impl<C: Clock + Send> Feed<C> {
    /// What the ECU of a truck received in virtual time, as it recorded it.
    ///
    /// # Errors
    /// When the recording cannot be read, or has nothing of that ECU.
    pub fn open(recording: &Path, truck: u8, clock: C) -> Result<Self, Failure> {
        let trace = Trace::open(recording)?;
        let events = trace.events(move |topic| topic == Topic::Rx(truck), 0..u64::MAX)?;
        let frames: Vec<(u64, Frame)> = events
            .filter_map(|event| match event.record {
                // In virtual time a frame is stamped with the bench time it was sent at, unless it
                // was handled at that very time.
                Record::Frame(FrameRecord { stamp_ns: 0, time_ns, frame, .. }) => {
                    Some((time_ns, frame))
                }
                Record::Frame(FrameRecord { stamp_ns, frame, .. }) => Some((stamp_ns, frame)),
                _ => None,
            })
            .collect();
        if frames.is_empty() {
            let path = recording.display();
            return Err(Failure::usage(format!(
                "--feed {path}: holds nothing that the ECU of truck {truck} received; name its \
                 part of a run in virtual time"
            )));
        }
        Ok(Self::of(frames, clock))
    }

    /// These frames, each at its bench time \[ns\].
    fn of(frames: Vec<(u64, Frame)>, clock: C) -> Self {
        Self { clock, frames, next: 0, start_ns: None, counts: BusCounts::default() }
    }

    /// When the next frame arrives on the clock \[ns\].
    fn next_arrival_ns(&self) -> Option<u64> {
        let (time_ns, _) = self.frames.get(self.next)?;
        Some(self.start_ns? + time_ns)
    }
}

impl<C: Clock + Send> Bus for Feed<C> {
    fn backend(&self) -> Backend {
        Backend::Loopback
    }

    fn name(&self) -> &str {
        "feed"
    }

    fn send(&mut self, _frame: &Frame) -> Result<(), SendError> {
        self.counts.sent += 1;
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        let Some(arrival_ns) = self.next_arrival_ns() else { return Ok(None) };
        if arrival_ns > self.clock.now_ns() {
            return Ok(None);
        }
        let (_, frame) = self.frames[self.next];
        self.next += 1;
        self.counts.received += 1;
        Ok(Some(Received { frame, stamp_ns: arrival_ns, own: false }))
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        let now_ns = self.clock.now_ns();
        self.start_ns.get_or_insert(now_ns + RUN_UP_NS);
        let until_ns = now_ns + timeout.as_nanos() as u64;
        let arrival_ns = self.next_arrival_ns().unwrap_or(u64::MAX);
        self.clock.sleep_until_ns(until_ns.min(arrival_ns));
        Ok(arrival_ns <= until_ns)
    }

    fn counts(&self) -> BusCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use platoon_dbc::FrameFlags;

    use super::*;
    use crate::clock::SleptClock;

    const MS: u64 = 1_000_000;

    fn frame(id: u32) -> Frame {
        Frame::new(id, FrameFlags::default(), &[]).expect("valid")
    }

    #[test]
    fn frames_arrive_at_their_times_and_not_before() {
        let clock = SleptClock::default();
        let mut feed = Feed::of(vec![(0, frame(1)), (MS, frame(2)), (MS, frame(3))], clock.clone());
        assert_eq!(feed.receive(), Ok(None), "nobody has waited yet");
        while feed.wait(Duration::from_millis(10)) == Ok(false) {}
        let start_ns = clock.now_ns();
        assert_eq!(start_ns, RUN_UP_NS);
        let received = |feed: &mut Feed<SleptClock>| {
            feed.receive().expect("up").map(|got| (got.frame.id(), got.stamp_ns - start_ns))
        };
        assert_eq!((received(&mut feed), received(&mut feed)), (Some((1, 0)), None));
        clock.sleep_until_ns(start_ns + 5 * MS);
        assert_eq!(received(&mut feed), Some((2, MS)), "late, with the time it arrived");
        assert_eq!((received(&mut feed), received(&mut feed)), (Some((3, MS)), None));
        assert_eq!((feed.counts().received, feed.send(&frame(9))), (3, Ok(())));
    }
}
