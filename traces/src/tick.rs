//! What an ECU records about one tick of its loop: timing, solver, guard, command.

use crate::schema::{choices, message};

choices! {
    /// What the law answered.
    pub enum TickOutcome = "platoon.TickOutcome" {
        /// The law did not run: no mission or no navigation solution yet.
        #[default]
        Waiting = 0,
        /// The QP was solved.
        Solved = 1,
        /// The solver reached its iteration cap; the previous plan, shifted, was used.
        IterationCap = 2,
        /// The QP had no feasible point; the previous plan, shifted, was used.
        Infeasible = 3,
    }
}

choices! {
    /// Why the guard changed a command.
    pub enum GuardReason = "platoon.GuardReason" {
        /// It let the command pass unchanged.
        #[default]
        None = 0,
        /// The command was not a number.
        NotFinite = 1,
        /// The force left its limits.
        Force = 2,
        /// The steering angle left its limits.
        Steering = 3,
        /// The command changed faster than the actuators may.
        Rate = 4,
        /// Too many ticks in a row without a solved plan.
        NoPlan = 5,
        /// The truck's own navigation solution is stale or lost.
        EgoStale = 6,
        /// The mission has ended or none came.
        NoMission = 7,
        /// An object ahead required harder braking.
        Emergency = 8,
    }
}

choices! {
    /// What made a tick miss its deadline: that without which it would have met it.
    pub enum MissCause = "platoon.MissCause" {
        /// It did not miss, or was recorded before causes were looked for by evidence.
        #[default]
        None = 0,
        /// The loop was runnable in time but waited for a CPU before its first instruction.
        RunQueue = 1,
        /// The machine under the kernel stood still: nothing ran on the loop's CPU.
        HostPause = 2,
        /// The loop was blocked in the bus.
        CanWait = 3,
        /// More frames than usual were waiting.
        CanDrain = 4,
        /// The law, the picture or the guard computed for longer than usual.
        Law = 5,
        /// The QP took more iterations than usual.
        QpIterations = 6,
        /// Memory was not where it was expected.
        PageFault = 7,
        /// Handing the tick before to the recorder took too long.
        Recorder = 8,
        /// The loop lost its CPU while it computed.
        Preempted = 9,
        /// No evidence explains it.
        Unattributed = 10,
    }
}

message! {
    /// One tick of one ECU.
    ///
    /// Phase times are durations \[ns\]; `wake_ns` runs from the tick's due instant to the loop's
    /// first instruction, `total_ns` from the due instant to the command handed to the bus. What
    /// was witnessed of the thread is 0 where nobody could witness it, as in virtual time.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct TickRecord = "platoon.Tick" {
        /// Bench time this tick stands for \[ns\].
        1 time_ns: u64,
        /// Tick number, the one of the EgoState it answers.
        2 tick: u32,
        /// Truck this ECU drives, 0 is the leader.
        3 ecu: u8,
        /// From due to awake \[ns\].
        4 wake_ns: u32,
        /// Reading and decoding frames \[ns\].
        5 drain_ns: u32,
        /// The cooperative controller, eqs. (1)-(7) \[ns\].
        6 ucl_ns: u32,
        /// Prediction, potential and QP matrices, eqs. (13)-(22) \[ns\].
        7 lml_build_ns: u32,
        /// Solving the QP \[ns\].
        8 qp_ns: u32,
        /// The guard \[ns\].
        9 guard_ns: u32,
        /// Encoding and sending \[ns\].
        10 send_ns: u32,
        /// From due to sent \[ns\].
        11 total_ns: u32,
        /// Grid points passed over before this tick because an earlier one ran late.
        12 skipped: u32,
        /// Whether the command came after the deadline.
        13 missed: bool,
        /// What the law answered.
        15 outcome: TickOutcome,
        /// What the guard changed.
        16 guard_reason: GuardReason,
        /// Solver iterations.
        17 qp_iterations: u32,
        /// Constraints that entered or left the working set.
        18 qp_changes: u32,
        /// Working set after the solve, one bit per row: rows 0-63, then 64-127.
        19 working_set: [u64; 2],
        /// Scaled KKT residual of the solution.
        20 kkt_residual: f32,
        /// Longitudinal force commanded \[N\], after the guard, before quantisation on the bus.
        21 force_n: f64,
        /// Front-wheel steering angle commanded \[rad\], positive to the left.
        22 steering_rad: f64,
        /// Reference speed of the UCL \[m/s\].
        23 reference_mps: f64,
        /// Acceleration the UCL asks for \[m/s²\].
        24 accel_mps2: f64,
        /// Error to the leader x_i: position \[m\], speed \[m/s\], acceleration \[m/s²\].
        25 leader_error: [f32; 3],
        /// Error to the truck ahead, same order and units.
        26 predecessor_error: [f32; 3],
        /// Age of the leader's newest state \[s\]; not a number when none is alive.
        27 leader_age_s: f32,
        /// Age of the state of the truck ahead \[s\]; not a number when none is alive.
        28 predecessor_age_s: f32,
        /// Adaptive weight on the reference speed, eq. (22).
        29 adaptive_weight: f32,
        /// Value of the potential field at the truck, eq. (19).
        30 potential: f32,
        /// Slack of the three softened constraint groups.
        31 slack: [f32; 3],
        // 14 was the phase that took longest, until causes were looked for by evidence.
        /// What made it miss.
        32 miss_cause: MissCause,
        /// What made the loop pass over the grid points before it.
        33 skip_cause: MissCause,
        // 34 was the loop's clock itself when the tick was due; its offset hardly changes.
        /// Building the observation \[ns\].
        35 observe_ns: u32,
        /// Handing the tick *before* to the recorder \[ns\].
        36 record_before_ns: u32,
        /// Frames taken from the bus.
        37 frames: u32,
        /// Ran on an older EgoState than its own: that came late, or not at all.
        38 stale: bool,
        /// The command was computed too late and the one before sent again (`--on-overrun hold`).
        39 held: bool,
        /// Time the thread waited for a CPU \[ns\], from the end of the tick before to its start.
        40 run_delay_wake_ns: u32,
        /// The same from its start to its end.
        41 run_delay_ns: u32,
        /// CPU time used \[ns\].
        42 cpu_ns: u32,
        /// Page faults served without I/O.
        43 minor_faults: u32,
        /// Page faults that read from a disk.
        44 major_faults: u32,
        /// Times the CPU was taken from the thread.
        45 involuntary_switches: u32,
        /// Times the thread waited for something.
        46 voluntary_switches: u32,
        /// How long the sentinel on the same CPU saw the machine stand still meanwhile \[ns\];
        /// asked only of ticks that missed or follow skipped ones.
        47 sentinel_gap_ns: u32,
        /// The loop's clock when the tick was due, less bench time \[ns\]; 0 in virtual time.
        48 due_offset_ns: i64,
    }
}

impl MissCause {
    /// The word summaries use.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::RunQueue => "run_queue",
            Self::HostPause => "host_pause",
            Self::CanWait => "can_wait",
            Self::CanDrain => "can_drain",
            Self::Law => "law",
            Self::QpIterations => "qp_iterations",
            Self::PageFault => "page_fault",
            Self::Recorder => "recorder",
            Self::Preempted => "preempted",
            Self::Unattributed => "unattributed",
        }
    }
}

impl TickRecord {
    /// Reading of the loop's clock when the tick was due \[ns\]; 0 in virtual time.
    #[must_use]
    pub const fn due_ns(&self) -> u64 {
        match self.due_offset_ns {
            0 => 0,
            offset_ns => self.time_ns.wrapping_add_signed(offset_ns),
        }
    }

    /// The working set as one number, bit `i` for row `i`.
    #[must_use]
    pub fn working_set_bits(&self) -> u128 {
        u128::from(self.working_set[1]) << 64 | u128::from(self.working_set[0])
    }

    /// Splits a working set into the two halves that are recorded.
    #[must_use]
    pub const fn split_working_set(bits: u128) -> [u64; 2] {
        [bits as u64, (bits >> 64) as u64]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::Message;

    fn sample() -> TickRecord {
        TickRecord {
            time_ns: 60_001_000_000,
            tick: 60_001,
            ecu: 3,
            qp_ns: 83_000,
            missed: true,
            miss_cause: MissCause::Preempted,
            outcome: TickOutcome::Solved,
            guard_reason: GuardReason::Rate,
            working_set: TickRecord::split_working_set(1 << 100 | 5),
            force_n: -0.0,
            steering_rad: 0.012_345,
            leader_error: [0.0, -1.5, 2.5],
            leader_age_s: f32::INFINITY,
            ..TickRecord::default()
        }
    }

    #[test]
    fn a_tick_survives_encoding_bit_for_bit() {
        let mut bytes = Vec::new();
        sample().encode(&mut bytes);
        let back = TickRecord::decode(&bytes).expect("decodes");
        assert_eq!(back, sample());
        assert!(back.force_n.is_sign_negative(), "the sign of zero is kept");
        assert_eq!(back.working_set_bits(), 1 << 100 | 5);
    }

    #[test]
    fn unknown_fields_are_stepped_over() {
        let mut bytes = vec![0xfa, 0x7f, 2, 9, 9]; // field 2047, two bytes
        sample().encode(&mut bytes);
        assert_eq!(TickRecord::decode(&bytes), Ok(sample()));
    }

    #[test]
    fn an_enum_number_nobody_knows_is_refused() {
        assert_eq!(TickRecord::decode(&[15 << 3, 99]), Err(crate::DecodeError::OutOfRange));
    }

    #[test]
    fn a_record_from_before_causes_had_evidence_is_read_without_a_cause() {
        let old = TickRecord::decode(&[13 << 3, 1, 14 << 3, 8]).expect("decodes");
        assert_eq!((old.missed, old.miss_cause), (true, MissCause::None));
    }
}
