//! Who strikes when the conductor asks: threads, buses and a solver.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use law::qp::{Active, ActiveSet, INPUTS, Qp, QpSolver, Solution, WorkingSet};
use platoon_dbc::{
    Backend, Bus, BusCounts, Clock, Frame, FrameFlags, ReceiveError, Received, SendError,
};
use vcan_setup::realtime::{self, Policy, Request};

use super::strikes::{Arm, StrikeLog};
use crate::clock::HostClock;
use crate::failure::Failure;

/// Identifier of flooding frames, outside the contract.
const FLOOD_ID: u32 = 0x7ff;
/// Frames of a flood: two drains' worth, and about what a socket's buffer holds.
const FLOOD_FRAMES: usize = 256;

/// How a strike is asked for, how long it lasts, and where it is noted.
#[derive(Debug, Clone)]
pub struct Order {
    /// Asked for by this.
    pub arm: Arc<Arm>,
    /// For so long \[ns\].
    pub lasts_ns: u64,
    /// Noted there.
    pub log: Arc<StrikeLog>,
}

impl Order {
    /// Blocks, if a strike is asked for.
    pub fn sleep_if_asked(&self) {
        if self.arm.take() {
            let clock = HostClock::default();
            let from_ns = clock.now_ns();
            clock.sleep_until_ns(from_ns + self.lasts_ns);
            self.log.note(from_ns);
        }
    }
}

/// A thread that takes a CPU away from the less urgent.
#[derive(Debug, Clone, Copy)]
pub struct Hog {
    /// The CPU.
    pub cpu: usize,
    /// Its SCHED_FIFO priority.
    pub priority: u8,
    /// How long it waits after it was asked \[ns\].
    pub delay_ns: u64,
}

impl Hog {
    /// Takes the CPU whenever it is asked to, until `stop` is set.
    ///
    /// # Errors
    /// When it may not have its priority.
    pub fn run(self, order: &Order, stop: &AtomicBool) -> Result<(), Failure> {
        let priority = Some(self.priority);
        let request = Request { priority, cpus: vec![self.cpu], ..Request::default() };
        let obtained = realtime::acquire(&request);
        if obtained.policy != Policy::Fifo {
            return Err(Failure::cannot_start(
                "a hog without SCHED_FIFO takes no CPU from anybody",
            ));
        }
        let clock = HostClock::default();
        while order.arm.wait(stop) {
            clock.sleep_until_ns(clock.now_ns() + self.delay_ns);
            let from_ns = clock.now_ns();
            clock.compute_until_ns(from_ns + order.lasts_ns);
            order.log.note(from_ns);
        }
        Ok(())
    }
}

/// Fills a bus that nobody empties whenever it is asked to, until `stop` is set, and says so.
///
/// # Panics
/// Never: the frame is a valid one.
pub fn fill(backlog: &mut dyn Bus, order: &Order, full: &Arm, stop: &AtomicBool) {
    let frame = Frame::new(FLOOD_ID, FrameFlags::default(), &[0x55; 8]).expect("a frame");
    while order.arm.wait(stop) {
        for _ in 0..FLOOD_FRAMES {
            // What does not fit is a flood's own loss.
            let _ = backlog.send(&frame);
        }
        full.raise();
    }
}

/// What an end of a bus receives first: another bus that was filled, as a gateway's backlog.
pub struct Backlog {
    /// The other bus.
    pub bus: Box<dyn Bus>,
    /// Raised when it is full.
    pub full: Arc<Arm>,
    /// Where emptying it is noted.
    pub log: Arc<StrikeLog>,
    /// Since when it is emptied \[ns\]; `None` when it is not.
    pub since_ns: Option<u64>,
}

impl Backlog {
    /// Its oldest frame, once it was full and until it is empty.
    pub fn receive(&mut self) -> Option<Received> {
        if self.since_ns.is_none() && self.full.take() {
            self.since_ns = Some(HostClock::default().now_ns());
        }
        let since_ns = self.since_ns?;
        let received = self.bus.receive().ok().flatten();
        if received.is_none() {
            self.log.note(since_ns);
            self.since_ns = None;
        }
        received
    }
}

/// A solver that solves its QP again and again, from a foreign working set, when it is asked to.
#[derive(Debug, Clone)]
pub struct Inflated {
    /// Asks for it.
    pub order: Order,
}

impl QpSolver for Inflated {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        let mut solution = ActiveSet.solve(qp, warm);
        if self.order.arm.take() {
            let clock = HostClock::default();
            let from_ns = clock.now_ns();
            while clock.now_ns() < from_ns + self.order.lasts_ns {
                let foreign =
                    (0..INPUTS as u8).map(|constraint| Active { constraint, upper: true });
                let again = ActiveSet.solve(qp, &mut WorkingSet::of(foreign));
                solution.report.iterations += again.report.iterations;
                solution.report.changes += again.report.changes;
            }
            self.order.log.note(from_ns);
        }
        solution
    }
}

/// An end of a bus that is tampered with.
pub struct Tampered<S, R> {
    /// The bus.
    pub bus: Box<dyn Bus>,
    /// What happens before a frame is sent.
    pub before_send: S,
    /// Frames that are received before those of the bus.
    pub receive_first: R,
}

impl<S, R> Bus for Tampered<S, R>
where
    S: FnMut(&Frame) + Send,
    R: FnMut() -> Option<Received> + Send,
{
    fn backend(&self) -> Backend {
        self.bus.backend()
    }

    fn name(&self) -> &str {
        self.bus.name()
    }

    fn echoes(&self) -> bool {
        self.bus.echoes()
    }

    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        (self.before_send)(frame);
        self.bus.send(frame)
    }

    fn receive(&mut self) -> Result<Option<Received>, ReceiveError> {
        match (self.receive_first)() {
            None => self.bus.receive(),
            first => Ok(first),
        }
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, ReceiveError> {
        self.bus.wait(timeout)
    }

    fn counts(&self) -> BusCounts {
        self.bus.counts()
    }

    fn set_bench_time(&mut self, time_ns: u64) {
        self.bus.set_bench_time(time_ns);
    }
}
