//! Everything of the law that changes from tick to tick.

use serde::{Deserialize, Serialize};

use crate::dmpc;
use crate::history::{History, Motion, seconds_between};
use crate::observation::Observation;
use crate::qp::{BLOCKS, WorkingSet};

/// The law's memory: a plain value that can be copied, stored and restored.
///
/// Restoring a memory and repeating the observations repeats the decisions bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Memory {
    /// This truck's own past.
    pub(crate) own: History,
    /// Which trucks the two histories below are of: leader and predecessor.
    pub(crate) followed: [u8; 2],
    /// The leader's messages.
    pub(crate) leader: History,
    /// The predecessor's messages.
    pub(crate) predecessor: History,
    /// What the coordination law last asked for \[m/s²\].
    pub(crate) asked_mps2: f64,
    /// The last plan of distributed MPC.
    pub(crate) dmpc: dmpc::Memory,
    /// The last plan: force \[kN\] and steering \[deg\] of each control block.
    pub(crate) plan: [[f64; 2]; BLOCKS],
    /// The command in force, as the guard admitted it: force \[kN\] and steering \[deg\].
    pub(crate) applied: [f64; 2],
    /// The QP's last working set.
    pub(crate) working_set: WorkingSet,
    /// When the law last stepped \[ns\].
    pub(crate) stepped_ns: Option<u64>,
    /// When the motion layer last solved \[ns\].
    pub(crate) solved_ns: Option<u64>,
    /// Ticks until the motion layer solves again.
    pub(crate) ticks_to_solve: u32,
}

impl Memory {
    /// The memory of a law that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes the command that was really sent, which may differ from the law's.
    pub fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.applied = [1e-3 * force_n, steering_rad.to_degrees()];
    }

    /// Notes the stamped states in an observation.
    pub(crate) fn note_seen(&mut self, seen: &Observation) {
        let ego = &seen.ego;
        self.own.note(Motion {
            time_ns: ego.time_ns,
            x_m: ego.x_m,
            speed_mps: ego.forward_mps,
            accel_mps2: ego.accel_mps2,
        });
        let followed = [seen.mission.leader, seen.mission.predecessor];
        let before = core::mem::replace(&mut self.followed, followed);
        let histories = [&mut self.leader, &mut self.predecessor];
        let messages = [seen.leader, seen.predecessor];
        for (n, (history, message)) in histories.into_iter().zip(messages).enumerate() {
            // The past of a lost truck, or of another one, must not be joined to a later message.
            if message.is_none() || followed[n] != before[n] {
                *history = History::new();
            }
            if let Some(message) = message {
                history.note(message.motion());
            }
        }
    }

    /// Seconds since `then`, 0 when there was none.
    pub(crate) fn seconds_since(then_ns: Option<u64>, now_ns: u64) -> f64 {
        then_ns.map_or(0.0, |then| seconds_between(then, now_ns).max(0.0))
    }
}
