//! What the ECU leaves behind: the frames each tick consumed, the tick, snapshots to start from.
//!
//! Records go into the recorder's ring, which drops and counts when it is full and never makes the
//! loop wait. Every [`SNAPSHOT_PERIOD_NS`], and once there is room again after a drop, everything
//! that later commands depend on is saved, so that a replay can start there.

use law::{Decision, Outcome};
use platoon_dbc::Received;
use traces::{
    FrameRecord, GuardReason, MemoryRecord, MissCause, Recorder, SNAPSHOT_BYTES_MAX, Snapshot,
    TickOutcome, TickRecord,
};

use crate::guard::{Admitted, Reason};
use crate::inquest::{Finding, Work};
use crate::laps::PhaseTimes;
use crate::pacer::Slot;

/// Bench time between two snapshots \[ns\].
pub const SNAPSHOT_PERIOD_NS: u64 = 10_000_000_000;
/// Bytes in front of each part of a snapshot: the part's number and how many parts there are.
const PART_HEADER: usize = 2;
/// Payload of one part.
const PART_BYTES: usize = SNAPSHOT_BYTES_MAX - PART_HEADER;

/// Pushes an ECU's records; does nothing without a recorder.
pub struct Recording {
    recorder: Option<Recorder>,
    truck: u8,
    next_snapshot_ns: u64,
    dropped: u64,
    owes_snapshot: bool,
    newest_tick: Option<TickRecord>,
}

impl Recording {
    /// Records truck `truck`'s ECU, if there is a recorder.
    #[must_use]
    pub fn new(recorder: Option<Recorder>, truck: u8) -> Self {
        Self {
            recorder,
            truck,
            next_snapshot_ns: 0,
            dropped: 0,
            owes_snapshot: false,
            newest_tick: None,
        }
    }

    /// Records a frame that was taken from the bus for tick `tick`.
    pub fn frame(&mut self, received: &Received, tick: u32, time_ns: u64) {
        if let Some(recorder) = &mut self.recorder {
            recorder.push(FrameRecord {
                bus: self.truck,
                time_ns,
                stamp_ns: received.stamp_ns,
                tick,
                tx: false,
                frame: received.frame,
            });
        }
    }

    /// Records a tick.
    pub fn tick(&mut self, facts: &TickFacts) {
        let record = facts.record(self.truck);
        if let Some(recorder) = &mut self.recorder {
            recorder.push(record);
        }
        self.newest_tick = Some(record);
    }

    /// What was last recorded, or would have been if there were a recorder.
    pub const fn newest_tick(&self) -> Option<&TickRecord> {
        self.newest_tick.as_ref()
    }

    /// Whether a snapshot is due after the tick at `time_ns`.
    pub fn wants_snapshot(&mut self, time_ns: u64) -> bool {
        let Some(recorder) = &self.recorder else {
            return false;
        };
        let dropped = recorder.dropped().total();
        if dropped != self.dropped || time_ns >= self.next_snapshot_ns {
            (self.dropped, self.owes_snapshot) = (dropped, true);
            self.next_snapshot_ns = (time_ns / SNAPSHOT_PERIOD_NS + 1) * SNAPSHOT_PERIOD_NS;
        }
        self.owes_snapshot
    }

    /// Records a snapshot, in as many parts as it needs; what does not fit the ring is tried again
    /// at the next tick.
    pub fn snapshot(&mut self, slot: &Slot, bytes: &[u8]) {
        let Some(recorder) = &mut self.recorder else {
            return;
        };
        let mut kept = true;
        for snapshot in split_snapshot(bytes) {
            kept &=
                recorder.push(MemoryRecord { time_ns: slot.time_ns, tick: slot.number, snapshot });
        }
        self.owes_snapshot = !kept;
        // A drop of its own must not count as a new one.
        self.dropped = recorder.dropped().total();
    }

    /// Closes the file; records missing from it, and what went wrong.
    pub fn finish(&mut self) -> (u64, Option<String>) {
        self.recorder.take().map_or((0, None), |recorder| {
            let finished = recorder.finish();
            (finished.dropped.total() + finished.lost, finished.error)
        })
    }
}

/// Splits a snapshot into the parts that are recorded.
fn split_snapshot(bytes: &[u8]) -> impl Iterator<Item = Snapshot> {
    let parts = bytes.len().div_ceil(PART_BYTES);
    bytes.chunks(PART_BYTES).enumerate().map(move |(number, payload)| {
        let mut part = [0; SNAPSHOT_BYTES_MAX];
        part[..PART_HEADER].copy_from_slice(&[number as u8, parts as u8]);
        part[PART_HEADER..PART_HEADER + payload.len()].copy_from_slice(payload);
        Snapshot::new(&part[..PART_HEADER + payload.len()]).unwrap_or_default()
    })
}

/// The records of a snapshot taken after tick `tick`, for [`join_snapshot`].
pub fn snapshot_records(bytes: &[u8], tick: u32, time_ns: u64) -> Vec<MemoryRecord> {
    split_snapshot(bytes).map(|snapshot| MemoryRecord { time_ns, tick, snapshot }).collect()
}

/// Joins the parts of a recorded snapshot, in the order of recording; `None` when some are missing.
///
/// All records must be of one tick.
#[must_use]
pub fn join_snapshot(parts: &[MemoryRecord]) -> Option<Vec<u8>> {
    let mut joined = Vec::with_capacity(parts.len() * PART_BYTES);
    for (number, record) in parts.iter().enumerate() {
        let (header, payload) = record.snapshot.as_bytes().split_first_chunk::<PART_HEADER>()?;
        if *header != [u8::try_from(number).ok()?, u8::try_from(parts.len()).ok()?] {
            return None;
        }
        joined.extend_from_slice(payload);
    }
    (!parts.is_empty()).then_some(joined)
}

/// Everything known about one tick once it is over.
#[derive(Debug, Clone, Copy)]
pub struct TickFacts {
    /// Which one.
    pub slot: Slot,
    /// How long it took.
    pub times: PhaseTimes,
    /// What it had to do.
    pub work: Work,
    /// What was found out about it.
    pub finding: Finding,
    /// Whether it ran on an older `EgoState` than its own.
    pub is_stale: bool,
    /// Whether its command came too late to be sent.
    pub is_held: bool,
    /// What the law decided, if it was asked.
    pub decision: Option<Decision>,
    /// What was sent.
    pub admitted: Admitted,
}

impl TickFacts {
    fn record(&self, truck: u8) -> TickRecord {
        let Self { slot, times, finding, decision, admitted, .. } = self;
        let record = TickRecord {
            time_ns: slot.time_ns,
            tick: slot.number,
            ecu: truck,
            wake_ns: short(times.wake_ns),
            drain_ns: short(times.drain_ns),
            observe_ns: short(times.observe_ns),
            ucl_ns: short(times.ucl_ns.unwrap_or(0)),
            lml_build_ns: short(times.lml_build_ns.unwrap_or(0)),
            qp_ns: short(times.qp_ns.unwrap_or(0)),
            guard_ns: short(times.guard_ns),
            send_ns: short(times.send_ns),
            total_ns: short(times.total_ns),
            skipped: slot.skipped,
            missed: finding.miss != MissCause::None,
            miss_cause: finding.miss,
            skip_cause: finding.skip,
            due_offset_ns: match slot.has_deadline {
                true => slot.due_ns.wrapping_sub(slot.time_ns).cast_signed(),
                false => 0,
            },
            stale: self.is_stale,
            held: self.is_held,
            frames: self.work.frames,
            guard_reason: guard_reason(admitted.reason),
            force_n: admitted.force_n,
            steering_rad: admitted.steering_rad,
            leader_age_s: f32::NAN,
            predecessor_age_s: f32::NAN,
            ..with_evidence(finding)
        };
        decision.map_or(record, |decision| with_decision(record, &decision))
    }
}

/// A record of what was witnessed and of nothing else.
fn with_evidence(finding: &Finding) -> TickRecord {
    let Finding { before, during, .. } = finding;
    TickRecord {
        record_before_ns: short(finding.record_before_ns),
        run_delay_wake_ns: short(before.run_delay_ns),
        run_delay_ns: short(during.run_delay_ns),
        cpu_ns: short(during.cpu_ns),
        minor_faults: short(during.minor_faults),
        major_faults: short(during.major_faults),
        involuntary_switches: short(during.involuntary_switches),
        voluntary_switches: short(during.voluntary_switches),
        sentinel_gap_ns: short(finding.standstill_ns),
        ..TickRecord::default()
    }
}

/// A number as the record has room for it.
fn short(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// The record with the law's account filled in.
fn with_decision(record: TickRecord, decision: &Decision) -> TickRecord {
    let (ucl, lml) = (&decision.ucl, &decision.lml);
    TickRecord {
        outcome: outcome(decision.outcome),
        qp_iterations: lml.qp.iterations,
        qp_changes: lml.qp.changes,
        working_set: TickRecord::split_working_set(lml.qp.working_set),
        kkt_residual: lml.qp.kkt_residual as f32,
        reference_mps: ucl.v_ref_mps,
        accel_mps2: ucl.accel_mps2,
        leader_error: [ucl.x_own[0], ucl.x_own[1], ucl.x_own[2]].map(|x| x as f32),
        predecessor_error: [ucl.x_predecessor[0], ucl.x_predecessor[1], ucl.x_predecessor[2]]
            .map(|x| x as f32),
        leader_age_s: ucl.leader_age_s as f32,
        predecessor_age_s: ucl.predecessor_age_s as f32,
        adaptive_weight: lml.q_ref as f32,
        potential: lml.potential as f32,
        slack: lml.slack.map(|slack| slack as f32),
        ..record
    }
}

/// A held command came from a solved plan; its zero iterations tell it apart.
fn outcome(outcome: Outcome) -> TickOutcome {
    match outcome {
        Outcome::Solved | Outcome::Held => TickOutcome::Solved,
        Outcome::IterationCap => TickOutcome::IterationCap,
        Outcome::Infeasible => TickOutcome::Infeasible,
    }
}

/// The trace knows one reason for steering, whichever bound it met.
fn guard_reason(reason: Reason) -> GuardReason {
    match reason {
        Reason::Passed => GuardReason::None,
        Reason::Rate => GuardReason::Rate,
        Reason::Force => GuardReason::Force,
        Reason::Steering | Reason::LateralAccel => GuardReason::Steering,
        Reason::Emergency => GuardReason::Emergency,
        Reason::NoPlan => GuardReason::NoPlan,
        Reason::NotFinite => GuardReason::NotFinite,
        Reason::EgoStale => GuardReason::EgoStale,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(bytes: &[u8]) -> MemoryRecord {
        let snapshot = Snapshot::new(bytes).expect("fits");
        MemoryRecord { time_ns: 0, tick: 0, snapshot }
    }

    #[test]
    fn parts_of_a_snapshot_join_only_when_all_are_there_in_order() {
        let (first, second) = (part(&[0, 2, 7, 8]), part(&[1, 2, 9]));
        assert_eq!(join_snapshot(&[first, second]), Some(vec![7, 8, 9]));
        assert_eq!(join_snapshot(&[first]), None);
        assert_eq!(join_snapshot(&[second, first]), None);
        assert_eq!(join_snapshot(&[part(&[0])]), None);
        assert_eq!(join_snapshot(&[]), None);
    }
}
