//! The in-memory bus: two ends, bounded queues, no clock.

use super::{Backend, Bus, BusCounts, ReceiveError, Received, SendError};
use crate::frame::Frame;
use core::time::Duration;
use crossbeam::queue::ArrayQueue;
use std::sync::Arc;

/// How long a waiting end sleeps between looks at its queue.
const WAIT_STEP: Duration = Duration::from_micros(100);

/// One end of an in-memory bus.
///
/// Frames arrive in the order sent, at once, and stamped with the sender's bench time. Within one
/// thread everything is deterministic; two threads may share a pair as well.
#[derive(Debug)]
pub struct Loopback {
    name: String,
    /// Queue this end reads.
    inbox: Arc<ArrayQueue<Received>>,
    /// Queue the other end reads; only the two ends hold it.
    outbox: Arc<ArrayQueue<Received>>,
    bench_time_ns: u64,
    counts: BusCounts,
}

impl Loopback {
    /// The two ends of a new bus, each with room for `capacity` unread frames.
    ///
    /// # Panics
    /// If `capacity` is 0.
    pub fn pair(name: &str, capacity: usize) -> (Self, Self) {
        let [there, back] = [(); 2].map(|()| Arc::new(ArrayQueue::new(capacity)));
        let end = |inbox: &Arc<_>, outbox: &Arc<_>| Self {
            name: name.to_owned(),
            inbox: Arc::clone(inbox),
            outbox: Arc::clone(outbox),
            bench_time_ns: 0,
            counts: BusCounts::default(),
        };
        (end(&there, &back), end(&back, &there))
    }
}

impl Bus for Loopback {
    fn backend(&self) -> Backend {
        Backend::Loopback
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if Arc::strong_count(&self.outbox) < 2 {
            self.counts.send_failed += 1;
            return Err(SendError::Down);
        }
        let received = Received { frame: *frame, stamp_ns: self.bench_time_ns, own: false };
        if self.outbox.push(received).is_err() {
            self.counts.send_full += 1;
            return Err(SendError::BufferFull);
        }
        self.counts.sent += 1;
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        let received = self.inbox.pop();
        self.counts.received += u64::from(received.is_some());
        Ok(received)
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        let mut left = timeout;
        while self.inbox.is_empty() {
            if left.is_zero() {
                return Ok(false);
            }
            let step = WAIT_STEP.min(left);
            std::thread::sleep(step);
            left -= step;
        }
        Ok(true)
    }

    fn counts(&self) -> BusCounts {
        self.counts
    }

    fn set_bench_time(&mut self, time_ns: u64) {
        self.bench_time_ns = time_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameFlags;

    fn frame(id: u32) -> Frame {
        Frame::new(id, FrameFlags::default(), &[]).expect("valid")
    }

    #[test]
    fn a_full_queue_refuses_and_counts() {
        let (mut sender, mut receiver) = Loopback::pair("loopback0", 2);
        let sent = [1, 2, 3].map(|id| sender.send(&frame(id)));
        assert_eq!(sent, [Ok(()), Ok(()), Err(SendError::BufferFull)]);
        assert_eq!((sender.counts().sent, sender.counts().send_full), (2, 1));
        let first = receiver.receive().expect("up").expect("waiting");
        assert_eq!(first.frame, frame(1));
    }

    #[test]
    fn frames_carry_the_senders_bench_time() {
        let (mut sender, mut receiver) = Loopback::pair("loopback0", 2);
        sender.set_bench_time(5_000_000);
        sender.send(&frame(1)).expect("room");
        assert_eq!(receiver.receive().expect("up").expect("waiting").stamp_ns, 5_000_000);
    }

    #[test]
    fn sending_to_an_end_that_is_gone_fails() {
        let (mut sender, receiver) = Loopback::pair("loopback0", 2);
        drop(receiver);
        assert_eq!(sender.send(&frame(1)), Err(SendError::Down));
        assert_eq!(sender.counts().send_failed, 1);
    }
}
