//! The inquest into missed deadlines: takes the evidence of every tick, and names causes.

use law::{Decision, Outcome};
use traces::MissCause;

use crate::blame::{Evidence, Waiting, Working, blame};
use crate::laps::PhaseTimes;
use crate::pacer::Slot;
use crate::report::ThreadCounts;
use crate::usual::Usual;
use crate::witness::{ThreadTotals, Witness};

/// Frames beyond twice the usual number that count as clearly more: what is sent now and then.
const MORE_FRAMES: u64 = 16;

/// What a tick had to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Frames taken from the bus.
    pub frames: u32,
    /// Iterations of the QP solver; `None` when none was solved.
    pub iterations: Option<u32>,
}

impl Work {
    /// What draining and deciding came to.
    #[must_use]
    pub fn of(frames: u32, decision: Option<&Decision>) -> Self {
        let solved = decision.filter(|decision| decision.outcome != Outcome::Held);
        Self { frames, iterations: solved.map(|decision| decision.lml.qp.iterations) }
    }
}

/// What was found out about one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Finding {
    /// Why it missed its deadline; `None` when it did not.
    pub miss: MissCause,
    /// Why the slots before it were passed over; `None` when none were.
    pub skip: MissCause,
    /// How far beyond its deadline it ended \[ns\].
    pub late_ns: u64,
    /// What the thread did from the end of the tick before to the start of this one.
    pub before: ThreadTotals,
    /// What it did from there to the last frame.
    pub during: ThreadTotals,
    /// How long the machine stood still \[ns\]; looked for only after a loss.
    pub standstill_ns: u64,
    /// Handing the tick before to the recorder \[ns\].
    pub record_before_ns: u64,
}

/// Keeps what a cause is found by.
pub struct Inquest {
    witness: Box<dyn Witness>,
    usual: Usual,
    opened: Option<ThreadTotals>,
    closed: Option<ThreadTotals>,
    /// The totals when the startup grace was over.
    settled: Option<ThreadTotals>,
    /// When the tick before had sent its last frame, and was recorded \[ns\] on the clock.
    sent_ns: u64,
    recorded_ns: u64,
    /// Why the tick before missed its deadline.
    cause: MissCause,
}

impl Inquest {
    /// Asks this witness.
    #[must_use]
    pub fn new(witness: Box<dyn Witness>) -> Self {
        Self {
            witness,
            usual: Usual::default(),
            opened: None,
            closed: None,
            settled: None,
            sent_ns: 0,
            recorded_ns: 0,
            cause: MissCause::None,
        }
    }

    /// Begins a tick.
    pub fn open(&mut self) {
        self.opened = self.witness.thread();
    }

    /// Ends a tick, all but its recording.
    pub fn close(
        &mut self,
        slot: &Slot,
        times: &PhaseTimes,
        work: Work,
        period_ns: u64,
    ) -> Finding {
        let closed = self.witness.thread();
        let opened = self.opened.unwrap_or_default();
        let mut finding = Finding {
            before: self.closed.map_or_else(ThreadTotals::default, |last| opened.since(&last)),
            during: closed.map_or_else(ThreadTotals::default, |now| now.since(&opened)),
            record_before_ns: self.recorded_ns.saturating_sub(self.sent_ns),
            ..Finding::default()
        };
        if slot.skipped > 0 && slot.has_deadline {
            self.blame_skip(slot, &mut finding, period_ns);
        }
        if slot.has_missed(times, period_ns) {
            finding.late_ns = times.total_ns - period_ns;
            self.blame_miss(slot, times, work, &mut finding, closed.is_some());
        } else {
            self.usual.learn(times, work);
        }
        self.cause = finding.miss;
        self.closed = closed;
        self.sent_ns = slot.due_ns + times.total_ns;
        finding
    }

    /// Begins to count what the report tells of the thread.
    pub fn settle(&mut self) {
        if self.settled.is_none() {
            self.settled = self.closed;
        }
    }

    /// What the thread did since; `None` when nobody knows.
    #[must_use]
    pub fn thread(&self) -> Option<ThreadCounts> {
        let totals = self.closed?.since(&self.settled?);
        Some(ThreadCounts {
            minor_faults: totals.minor_faults,
            major_faults: totals.major_faults,
            involuntary_switches: totals.involuntary_switches,
            cpu_ns: totals.cpu_ns,
            run_delay_ns: totals.run_delay_ns,
            heap_uses: totals.heap_uses,
        })
    }

    /// Notes that the tick has been handed to the recorder.
    pub fn recorded(&mut self, now_ns: u64) {
        self.recorded_ns = now_ns;
    }

    fn blame_miss(
        &self,
        slot: &Slot,
        times: &PhaseTimes,
        work: Work,
        finding: &mut Finding,
        is_witnessed: bool,
    ) {
        let woke_ns = slot.due_ns + times.wake_ns;
        let sent_ns = slot.due_ns + times.total_ns;
        let mut before = self.waiting(finding, slot.due_ns, woke_ns);
        // What kept the loop from the slots before is theirs.
        before.run_delay_ns = before.run_delay_ns.saturating_sub(slot.overslept_ns);
        let standstill_ns = self.witness.standstill_ns(woke_ns, sent_ns);
        let during = &finding.during;
        let usual = &self.usual;
        let during = Working {
            wall_ns: times.total_ns - times.wake_ns,
            cpu_ns: is_witnessed.then_some(during.cpu_ns),
            run_delay_ns: during.run_delay_ns,
            standstill_ns,
            voluntary_switches: during.voluntary_switches,
            minor_faults: during.minor_faults,
            major_faults: during.major_faults,
            drain_excess_ns: usual.drain_excess_ns(times),
            has_more_frames: u64::from(work.frames) > 2 * usual.frames() + MORE_FRAMES,
            qp_excess_ns: usual.qp_excess_ns(times),
            has_more_iterations: work
                .iterations
                .is_some_and(|iterations| u64::from(iterations) > usual.iterations()),
            law_excess_ns: usual.law_excess_ns(times),
        };
        finding.standstill_ns += before.standstill_ns + standstill_ns;
        finding.miss = blame(&Evidence { late_ns: finding.late_ns, before, during });
    }

    /// Finds the cause of slots that were never begun.
    fn blame_skip(&self, slot: &Slot, finding: &mut Finding, period_ns: u64) {
        let first_due_ns = slot.due_ns.saturating_sub(u64::from(slot.skipped) * period_ns);
        // Overslept, or busy until after the latest start.
        let lateness_ns = match slot.overslept {
            0 => self.recorded_ns.saturating_sub(first_due_ns),
            _ => slot.overslept_ns,
        };
        let before = self.waiting(finding, first_due_ns, first_due_ns + lateness_ns);
        let late_ns = lateness_ns.saturating_sub(period_ns / 2);
        finding.standstill_ns += before.standstill_ns;
        finding.skip = blame(&Evidence { late_ns, before, during: Working::default() });
    }

    /// What kept the loop from a slot that was due at `due_ns` until `woke_ns`.
    fn waiting(&self, finding: &Finding, due_ns: u64, woke_ns: u64) -> Waiting {
        let after_due_ns = self.recorded_ns.saturating_sub(due_ns);
        Waiting {
            lateness_ns: woke_ns - due_ns,
            run_delay_ns: finding.before.run_delay_ns,
            standstill_ns: self.witness.standstill_ns(due_ns, woke_ns),
            recording_ns: finding.record_before_ns.min(after_due_ns),
            busy_ns: self.sent_ns.saturating_sub(due_ns),
            busy_with: self.cause,
        }
    }
}
