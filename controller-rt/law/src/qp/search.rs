//! The search of the dual active-set method: from a working set to the optimal one.

use super::excess::Excess;
use super::factors::{Direction, Elimination, Factors};
use super::kkt::{larger, stationarity};
use super::row::{LANES, Row};
use super::{Active, CONSTRAINTS, Qp, SLACKS, Solution, SolveStatus, VARIABLES, WorkingSet};
use crate::decision::QpReport;

/// Most iterations of one solve. The recorded problems of the paper's hardest scenario need 6 at
/// the most from a cold start; at this limit the caller falls back to its previous plan.
pub const ITERATIONS_MAX: u32 = 100;

/// A violation below this, relative to the limit, counts as rounding.
pub const VIOLATION_MIN: f64 = 1e-10;
/// A normal whose part outside the working set's span is relatively smaller depends on the set.
const INDEPENDENCE_MIN: f64 = 1e-9;

/// One search: a point optimal for its working set, with the factors that make a step cheap.
pub struct Search<'a> {
    qp: &'a Qp,
    elimination: &'a Elimination,
    factors: &'a mut Factors,
    /// The working set and its normals; only the first `count` are meaningful.
    members: [Active; VARIABLES],
    normals: [Row; VARIABLES],
    count: usize,
    /// Multipliers of the working set, one more for the constraint being added.
    multipliers: Row,
    z: Row,
    /// Squared lengths of normals by H^-1, zero for those not asked for yet.
    lengths: [f64; CONSTRAINTS],
    iterations: u32,
    changes: u32,
}

impl<'a> Search<'a> {
    /// Starts without any constraint.
    #[inline(always)]
    pub fn start(qp: &'a Qp, elimination: &'a Elimination, factors: &'a mut Factors) -> Self {
        factors.start(elimination, &qp.gradient_row());
        Self {
            qp,
            elimination,
            factors,
            members: [Active { constraint: 0, upper: false }; VARIABLES],
            normals: [Row::ZERO; VARIABLES],
            count: 0,
            multipliers: Row::ZERO,
            z: Row::ZERO,
            lengths: [0.0; CONSTRAINTS],
            iterations: 0,
            changes: 0,
        }
    }

    /// Holds every slack at its lower bound.
    #[inline(always)]
    pub fn hold_slacks(&mut self) {
        self.factors.hold_slacks();
        self.count = SLACKS;
        for i in 0..SLACKS {
            let slack = VARIABLES - 1 - i;
            self.members[i].constraint = slack as u8;
            self.normals[i].0[slack] = 1.0;
        }
    }

    /// Takes over the natural working set's point, and its slope for the multipliers.
    #[inline(always)]
    pub fn settle_at(&mut self, z: &Row, slope: &Row) {
        self.z = *z;
        for i in 0..SLACKS {
            self.multipliers.0[i] = slope.0[VARIABLES - 1 - i];
        }
    }

    /// Takes over a guessed working set, without those members that depend on earlier ones, have
    /// no limit, or would have to pull the wrong way.
    #[inline(always)]
    pub fn adopt(&mut self, guess: &WorkingSet) {
        for active in guess.iter() {
            let is_held = self.members[..self.count].contains(&active);
            let is_sound = usize::from(active.constraint) < CONSTRAINTS;
            if !is_held && is_sound && self.qp.limit(active).is_finite() {
                let direction = self.factors.direction(&self.normal(active));
                if direction.is_independent(INDEPENDENCE_MIN) {
                    self.push(active, &direction);
                }
            }
        }
        loop {
            self.settle();
            match self.most_negative_multiplier() {
                Some(worst) => self.drop_member(worst),
                None => break,
            }
        }
        self.changes = 0;
    }

    /// Adds violated constraints until there is none. `excess` may be known for where it starts.
    #[inline(always)]
    pub fn run(&mut self, excess: &mut Excess, mut is_known: bool) -> Solution {
        let mut status = SolveStatus::Solved;
        loop {
            if !is_known {
                excess.look(self.qp, &self.z);
            }
            is_known = false;
            if status == SolveStatus::Solved {
                match self.most_violated(excess) {
                    Ok(None) => {}
                    Ok(Some(active)) => {
                        status = self.satisfy(active);
                        continue;
                    }
                    Err(ended) => status = ended,
                }
            }
            return self.solution(status, excess);
        }
    }

    /// Steps until `active` holds, dropping members whose multipliers reach zero on the way
    /// [Goldfarb & Idnani, algorithm 1, step 2].
    #[inline(always)]
    fn satisfy(&mut self, active: Active) -> SolveStatus {
        let normal = self.normal(active);
        self.multipliers.0[self.count] = 0.0;
        loop {
            self.iterations += 1;
            if self.iterations > ITERATIONS_MAX {
                return SolveStatus::IterationCap;
            }
            let direction = self.factors.direction(&normal);
            let pull = self.factors.pull(&direction);
            let is_independent = direction.is_independent(INDEPENDENCE_MIN);
            // Step that makes the constraint hold with equality.
            let full = match is_independent {
                true => (self.bound(active) - normal.dot(&self.z)) / direction.gain(),
                false => f64::INFINITY,
            };
            // Largest step that keeps every multiplier non-negative, and who stops it.
            let (mut step, mut blocking) = (full, None);
            for i in 0..self.count {
                let ratio = self.multipliers.0[i].max(0.0) / pull.0[i];
                if pull.0[i] > 0.0 && ratio < step {
                    (step, blocking) = (ratio, Some(i));
                }
            }
            if !step.is_finite() {
                return SolveStatus::Infeasible;
            }
            let Some(blocking) = blocking else {
                self.push(active, &direction);
                self.settle();
                return SolveStatus::Solved;
            };
            if is_independent {
                self.z.add_scaled(step, &self.factors.step(&direction));
            }
            self.multipliers.add_scaled(-step, &pull);
            self.multipliers.0[self.count] += step;
            self.drop_member(blocking);
        }
    }

    /// Computes point and multipliers afresh from the factors, so that no error adds up.
    #[inline(always)]
    fn settle(&mut self) {
        (self.z, self.multipliers) = self.factors.optimum(|i| self.bound(self.members[i]));
    }

    /// The violated constraint that promises to raise the dual objective most, were no input
    /// limited yet: by its squared violation over the squared length of its normal.
    ///
    /// The largest violation alone would pick the ends of the horizon, which every input moves,
    /// where a limit in the middle holds them all.
    #[inline(always)]
    fn most_violated(&mut self, excess: &Excess) -> Result<Option<Active>, SolveStatus> {
        let mut violated = [0; CONSTRAINTS];
        let mut count = 0;
        for (i, &by) in excess.of.iter().enumerate() {
            if by <= VIOLATION_MIN {
                continue;
            }
            // NaN gets here too.
            if !by.is_finite() {
                return Err(SolveStatus::Infeasible);
            }
            let limit = self.qp.limit(excess.nearer(self.qp, i));
            if by > VIOLATION_MIN * (1.0 + limit.abs()) {
                violated[count] = i as u8;
                count += 1;
            }
        }
        let violated = &violated[..count];
        self.measure(violated);
        let (mut best, mut largest) = (None, 0.0);
        for i in violated.iter().map(|&i| usize::from(i)) {
            let by = excess.of[i];
            // A bound of a slack has no length, and goes first.
            let gain = by * by / self.lengths[i];
            if gain > largest {
                (best, largest) = (Some(excess.nearer(self.qp, i)), gain);
            }
        }
        Ok(best)
    }

    /// Has the lengths of these constraints' normals worked out, some at once.
    #[inline(always)]
    fn measure(&mut self, constraints: &[u8]) {
        let mut waiting = [0; LANES];
        let mut count = 0;
        for (at, &constraint) in constraints.iter().enumerate() {
            if self.lengths[usize::from(constraint)] == 0.0 {
                waiting[count] = constraint;
                count += 1;
            }
            if count == LANES || (count > 0 && at + 1 == constraints.len()) {
                let mut normals = [Row::ZERO; LANES];
                for (normal, &constraint) in normals.iter_mut().zip(&waiting) {
                    *normal = self.qp.normal(usize::from(constraint));
                }
                let lengths = self.elimination.lengths(&normals);
                for (&constraint, length) in waiting.iter().zip(lengths).take(count) {
                    self.lengths[usize::from(constraint)] = length;
                }
                count = 0;
            }
        }
    }

    #[inline(always)]
    fn push(&mut self, active: Active, direction: &Direction) {
        self.factors.push(direction);
        self.members[self.count] = active;
        self.normals[self.count] = self.normal(active);
        self.count += 1;
        self.changes += 1;
    }

    #[inline(always)]
    fn drop_member(&mut self, at: usize) {
        self.factors.remove(at);
        self.members.copy_within(at + 1..self.count, at);
        self.normals.copy_within(at + 1..self.count, at);
        // The multiplier of the constraint being added sits behind the working set's.
        self.multipliers.0.copy_within(at + 1..=self.count, at);
        self.multipliers.0[self.count] = 0.0;
        self.count -= 1;
        self.changes += 1;
    }

    #[inline(always)]
    fn most_negative_multiplier(&self) -> Option<usize> {
        let (mut worst, mut least) = (None, 0.0);
        for (i, &multiplier) in self.multipliers.0.iter().enumerate().take(self.count) {
            if multiplier < least {
                (worst, least) = (Some(i), multiplier);
            }
        }
        worst
    }

    /// The normal, turned so that the constraint reads `normal' z >= bound`.
    #[inline(always)]
    fn normal(&self, active: Active) -> Row {
        let normal = self.qp.normal(active.constraint.into());
        if active.upper { normal.scaled(-1.0) } else { normal }
    }

    /// The bound in `normal' z >= bound`.
    #[inline(always)]
    fn bound(&self, active: Active) -> f64 {
        let limit = self.qp.limit(active);
        if active.upper { -limit } else { limit }
    }

    /// How much a member is short of holding.
    #[inline(always)]
    fn shortfall(&self, at: usize) -> f64 {
        self.bound(self.members[at]) - self.normals[at].dot(&self.z)
    }

    /// The sum of the members' normals times their multipliers.
    #[inline(always)]
    fn pull(&self) -> Row {
        let mut pull = Row::ZERO;
        for (normal, &multiplier) in self.normals.iter().zip(&self.multipliers.0).take(self.count) {
            pull.add_scaled(multiplier, normal);
        }
        pull
    }

    /// The working set as it is now.
    #[inline(always)]
    pub fn working_set(&self) -> WorkingSet {
        WorkingSet::of(self.members[..self.count].iter().copied())
    }

    #[inline(always)]
    fn solution(&self, status: SolveStatus, excess: &Excess) -> Solution {
        let mut residual = excess.relative(self.qp);
        for i in 0..self.count {
            let room = self.shortfall(i).abs();
            residual = larger(residual, self.multipliers.0[i].abs().min(room));
        }
        let stationarity = stationarity(self.qp, &self.qp.slope(&self.z), &self.pull());
        Solution {
            status,
            z: self.z.into(),
            report: QpReport {
                iterations: self.iterations,
                changes: self.changes,
                working_set: self.working_set().bits(),
                kkt_residual: larger(residual, stationarity),
            },
        }
    }
}
