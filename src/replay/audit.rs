//! Every QP solved twice: by the law's own method and by Clarabel.

use std::fmt;
use std::sync::{Arc, Mutex};

use controller_rt::Clarabel;
use law::qp::{ActiveSet, INPUTS, Qp, QpSolver, Solution, SolveStatus, WorkingSet};
use serde::Serialize;

/// Furthest the two solutions may be apart in any input: kN of force, degrees of steering. Clarabel
/// stops at a gap of 1e-11, which leaves about 1e-7 in the point.
const APART_MAX: f64 = 1e-5;

/// What the other solver made of an ECU's QPs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Audit {
    /// QPs solved by both.
    pub qps: u64,
    /// QPs that one solved and the other did not.
    pub disputed: u64,
    /// The tick of the first of these.
    pub first_disputed_tick: Option<u32>,
    /// Furthest the two are apart in any input: kN of force, degrees of steering.
    pub furthest: f64,
    /// The tick at which they are.
    pub furthest_tick: u32,
    /// The tick that is being recomputed.
    #[serde(skip)]
    tick: u32,
}

impl Audit {
    /// What is solved from now on is this tick's.
    pub fn begin_tick(&mut self, tick: u32) {
        self.tick = tick;
    }

    /// Whether the two agree on every QP.
    pub fn is_passed(&self) -> bool {
        self.disputed == 0 && self.furthest <= APART_MAX
    }

    fn compare(&mut self, own: &Solution, other: &Solution) {
        let is_solved = |solution: &Solution| solution.status == SolveStatus::Solved;
        match (is_solved(own), is_solved(other)) {
            (true, true) => {}
            (false, false) => return,
            _ => {
                self.disputed += 1;
                self.first_disputed_tick.get_or_insert(self.tick);
                return;
            }
        }
        self.qps += 1;
        let apart = (0..INPUTS).map(|i| (own.z[i] - other.z[i]).abs()).fold(0.0, f64::max);
        if apart > self.furthest {
            (self.furthest, self.furthest_tick) = (apart, self.tick);
        }
    }
}

impl fmt::Display for Audit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { qps, disputed, furthest, furthest_tick, .. } = self;
        write!(
            f,
            "Clarabel: {qps} QPs solved by both, apart by at most {furthest:.1e} kN or degrees (at \
             tick {furthest_tick}; allowed {APART_MAX:.0e}); {disputed} solved by one only"
        )?;
        match self.first_disputed_tick {
            Some(tick) => write!(f, ", the first at tick {tick}"),
            None => Ok(()),
        }
    }
}

/// The active-set method, with Clarabel looking over its shoulder.
pub struct Audited {
    audit: Arc<Mutex<Audit>>,
}

impl Audited {
    /// Notes what Clarabel makes of each QP in `audit`.
    pub fn new(audit: Arc<Mutex<Audit>>) -> Self {
        Self { audit }
    }
}

impl QpSolver for Audited {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        let own = ActiveSet.solve(qp, warm);
        let other = Clarabel.solve(qp, &mut WorkingSet::default());
        if let Ok(mut audit) = self.audit.lock() {
            audit.compare(&own, &other);
        }
        own
    }
}
