//! Why a deadline was missed: one cause, from evidence alone.
//!
//! Every suspect is given the time it verifiably took: what the scheduler, the page fault counters,
//! the CPU clock and the sentinel say, and how much longer than usual a phase was. Times that one
//! witness explains are taken off the others' first, so that a phase during which the machine stood
//! still is not held against the law. The suspect with most time is the cause if that is more than
//! half of the time by which the deadline was missed. Otherwise the miss stays unattributed.

use traces::MissCause;

/// CPU time \[ns\] that one page fault without I/O can cost at most; on this side of a hypervisor
/// one is served within a few microseconds.
const MINOR_FAULT_NS_MAX: u64 = 20_000;

/// What is known about one missed deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Evidence {
    /// How far beyond the deadline \[ns\].
    pub late_ns: u64,
    /// Until the loop's first instruction.
    pub before: Waiting,
    /// From there to the last frame sent; all zero for a slot that was never begun.
    pub during: Working,
}

/// What happened between due and the first instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Waiting {
    /// From due to the first instruction \[ns\].
    pub lateness_ns: u64,
    /// Runnable without a CPU \[ns\], since the end of the tick before.
    pub run_delay_ns: u64,
    /// The machine stood still \[ns\], as the sentinel saw it.
    pub standstill_ns: u64,
    /// The recorder was still being handed the tick before \[ns\], after due.
    pub recording_ns: u64,
    /// The tick before was still being computed or sent \[ns\], after due.
    pub busy_ns: u64,
    /// Why that one was late.
    pub busy_with: MissCause,
}

/// What happened between the first instruction and the last frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Working {
    /// Time that passed \[ns\].
    pub wall_ns: u64,
    /// CPU time used \[ns\]; `None` when nobody knows.
    pub cpu_ns: Option<u64>,
    /// Runnable without a CPU \[ns\].
    pub run_delay_ns: u64,
    /// The machine stood still \[ns\], as the sentinel saw it.
    pub standstill_ns: u64,
    /// Times the thread waited for something.
    pub voluntary_switches: u64,
    /// Page faults served without I/O.
    pub minor_faults: u64,
    /// Page faults that read from a disk.
    pub major_faults: u64,
    /// Draining took this much longer than usual \[ns\].
    pub drain_excess_ns: u64,
    /// There were clearly more frames than usual.
    pub has_more_frames: bool,
    /// Solving the QP took this much longer than usual \[ns\].
    pub qp_excess_ns: u64,
    /// It took more iterations than usual.
    pub has_more_iterations: bool,
    /// Observing, the rest of the law and the guard took this much longer than usual \[ns\].
    pub law_excess_ns: u64,
}

/// The one cause of a missed deadline.
#[must_use]
pub fn blame(evidence: &Evidence) -> MissCause {
    let mut worst = (MissCause::Unattributed, 0);
    for (cause, took_ns) in suspects(evidence) {
        if took_ns > worst.1 {
            worst = (cause, took_ns);
        }
    }
    if 2 * worst.1 > evidence.late_ns { worst.0 } else { MissCause::Unattributed }
}

/// Every suspect with the time it verifiably took \[ns\]; of equals the first is blamed.
fn suspects(evidence: &Evidence) -> [(MissCause, u64); 10] {
    let (before, during) = (&evidence.before, &evidence.during);
    let run_queue_ns = before.run_delay_ns.saturating_sub(before.standstill_ns);
    let recording_ns =
        before.recording_ns.saturating_sub(before.run_delay_ns.max(before.standstill_ns));
    let preempted_ns = during.run_delay_ns.saturating_sub(during.standstill_ns);
    // Neither computing nor waiting for a CPU: blocked, or the machine took the CPU away unseen.
    let off_cpu_ns = during.cpu_ns.map_or(0, |cpu_ns| {
        during.wall_ns.saturating_sub(cpu_ns + during.run_delay_ns + during.standstill_ns)
    });
    let (is_reading, is_waiting) = (during.major_faults > 0, during.voluntary_switches > 0);
    let when = |condition: bool, took_ns: u64| if condition { took_ns } else { 0 };
    let unseen_ns = when(!is_waiting && !is_reading, off_cpu_ns);
    let elsewhere_ns = during.run_delay_ns.max(during.standstill_ns) + off_cpu_ns;
    let computed =
        |excess_ns: u64| excess_ns.saturating_sub(elsewhere_ns).min(during.cpu_ns.unwrap_or(0));
    let (drain_ns, qp_ns) = (computed(during.drain_excess_ns), computed(during.qp_excess_ns));
    let law_ns =
        computed(during.law_excess_ns + when(!during.has_more_iterations, during.qp_excess_ns));
    let served_ns = (during.minor_faults * MINOR_FAULT_NS_MAX).min(law_ns.max(qp_ns).max(drain_ns));
    let faults_ns = when(is_reading, off_cpu_ns) + served_ns;
    [
        (MissCause::HostPause, before.standstill_ns + during.standstill_ns + unseen_ns),
        (MissCause::PageFault, faults_ns),
        (MissCause::RunQueue, run_queue_ns.min(before.lateness_ns)),
        (MissCause::Preempted, preempted_ns),
        (MissCause::Recorder, recording_ns),
        (before.busy_with, when(before.busy_with != MissCause::None, before.busy_ns)),
        (MissCause::CanWait, when(is_waiting && !is_reading, off_cpu_ns)),
        (MissCause::CanDrain, when(during.has_more_frames, drain_ns)),
        (MissCause::QpIterations, when(during.has_more_iterations, qp_ns)),
        (MissCause::Law, law_ns),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: u64 = 1_000;
    const MS: u64 = 1_000_000;

    /// A tick that worked for this long on its CPU, every phase as usual, and was late by so much.
    fn worked(wall_ns: u64, late_ns: u64) -> Evidence {
        let during = Working { wall_ns, cpu_ns: Some(wall_ns), ..Working::default() };
        Evidence { late_ns, during, ..Evidence::default() }
    }

    fn with(change: impl FnOnce(&mut Evidence)) -> MissCause {
        let mut evidence = worked(3 * MS, 2 * MS);
        change(&mut evidence);
        blame(&evidence)
    }

    #[test]
    fn nothing_is_claimed_without_evidence() {
        assert_eq!(with(|_| ()), MissCause::Unattributed);
        assert_eq!(blame(&Evidence::default()), MissCause::Unattributed);
        let unwitnessed = with(|e| {
            (e.during.cpu_ns, e.during.law_excess_ns) = (None, 3 * MS);
        });
        assert_eq!(unwitnessed, MissCause::Unattributed, "a long phase alone proves nothing");
    }

    #[test]
    fn a_late_wake_is_the_run_queues_or_the_machines() {
        let late = |run_delay_ns, standstill_ns| {
            let before =
                Waiting { lateness_ns: MS, run_delay_ns, standstill_ns, ..Waiting::default() };
            blame(&Evidence { late_ns: 500 * US, before, ..Evidence::default() })
        };
        assert_eq!(late(900 * US, 0), MissCause::RunQueue);
        assert_eq!(late(0, 900 * US), MissCause::HostPause);
        assert_eq!(late(900 * US, 850 * US), MissCause::HostPause, "it queued while all stood");
        assert_eq!(late(200 * US, 0), MissCause::Unattributed, "too little to explain it");
        assert_eq!(late(0, 0), MissCause::Unattributed);
    }

    #[test]
    fn queueing_long_before_due_does_not_explain_a_little_lateness() {
        let before = Waiting { lateness_ns: 10 * US, run_delay_ns: 9 * MS, ..Waiting::default() };
        let evidence = Evidence { late_ns: 500 * US, before, ..Evidence::default() };
        assert_eq!(blame(&evidence), MissCause::Unattributed);
    }

    #[test]
    fn the_tick_before_passes_its_own_cause_on() {
        let before = Waiting {
            lateness_ns: 3 * MS,
            busy_ns: 3 * MS,
            busy_with: MissCause::Law,
            ..Waiting::default()
        };
        assert_eq!(blame(&Evidence { late_ns: MS, before, ..Evidence::default() }), MissCause::Law);
    }

    #[test]
    fn a_recorder_that_makes_the_loop_wait_is_named() {
        let before = Waiting { lateness_ns: 3 * MS, recording_ns: 3 * MS, ..Waiting::default() };
        let evidence = Evidence { late_ns: 2 * MS, before, ..Evidence::default() };
        assert_eq!(blame(&evidence), MissCause::Recorder);
        let before = Waiting { run_delay_ns: 3 * MS, ..before };
        let evidence = Evidence { before, ..evidence };
        assert_eq!(blame(&evidence), MissCause::RunQueue, "it was preempted while recording");
    }

    #[test]
    fn a_phase_that_computed_for_longer_than_usual_is_named() {
        assert_eq!(with(|e| e.during.law_excess_ns = 2_800 * US), MissCause::Law);
        let inflated = with(|e| {
            (e.during.qp_excess_ns, e.during.has_more_iterations) = (2_800 * US, true);
        });
        assert_eq!(inflated, MissCause::QpIterations);
        let same_iterations = with(|e| e.during.qp_excess_ns = 2_800 * US);
        assert_eq!(same_iterations, MissCause::Law);
        let flood = with(|e| {
            (e.during.drain_excess_ns, e.during.has_more_frames) = (2_800 * US, true);
        });
        assert_eq!(flood, MissCause::CanDrain);
        let few_frames = with(|e| e.during.drain_excess_ns = 2_800 * US);
        assert_eq!(few_frames, MissCause::Unattributed);
    }

    #[test]
    fn losing_the_cpu_is_not_held_against_the_phase_it_happened_in() {
        let preempted = with(|e| {
            e.during.law_excess_ns = 2_800 * US;
            (e.during.cpu_ns, e.during.run_delay_ns) = (Some(300 * US), 2_700 * US);
        });
        assert_eq!(preempted, MissCause::Preempted);
        let paused = with(|e| {
            (e.during.law_excess_ns, e.during.standstill_ns) = (2_800 * US, 2_700 * US);
        });
        assert_eq!(paused, MissCause::HostPause, "even if the guest's clock calls it CPU time");
        let stolen = with(|e| {
            (e.during.law_excess_ns, e.during.cpu_ns) = (2_800 * US, Some(200 * US));
        });
        assert_eq!(stolen, MissCause::HostPause, "off the CPU, though nobody switched it");
    }

    #[test]
    fn blocking_is_the_disks_or_the_buses() {
        let blocked = |major_faults| {
            with(|e| {
                (e.during.cpu_ns, e.during.voluntary_switches) = (Some(200 * US), 1);
                e.during.major_faults = major_faults;
            })
        };
        assert_eq!(blocked(0), MissCause::CanWait);
        assert_eq!(blocked(1), MissCause::PageFault);
    }

    #[test]
    fn minor_faults_explain_what_they_can_cost_and_no_more() {
        let faults = |minor_faults| {
            with(|e| {
                (e.during.law_excess_ns, e.during.minor_faults) = (2_800 * US, minor_faults);
            })
        };
        assert_eq!(faults(1), MissCause::Law);
        assert_eq!(faults(500), MissCause::PageFault);
    }
}
