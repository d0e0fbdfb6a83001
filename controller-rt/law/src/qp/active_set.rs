//! The real-time QP solver: a dense dual active-set method.
//!
//! D. Goldfarb and A. Idnani, *A numerically stable dual method for solving strictly convex
//! quadratic programs*, Mathematical Programming 27 (1983), with three additions: two-sided
//! limits, a start from any guessed working set, and one step of refinement at the end.
//!
//! The method keeps a point that is optimal for the constraints in its working set and adds the
//! most violated one until none is left. The dual objective grows with every full step, so no
//! working set comes back, degenerate or not. Work per iteration is bounded, nothing is allocated,
//! ties are broken by index: equal problems give equal bits.
//!
//! Most problems of the motion layer have the natural working set, every slack at zero and no input
//! limited. Then one factorisation, one pair of substitutions and one look at all rows is all there
//! is to do; the factors of the method proper are worked out when that look finds something.

use super::factors::{Cholesky, Factors};
use super::kkt::residual_at;
use super::row::Row;
use super::{
    Active, CONSTRAINTS, INPUTS, Qp, QpSolver, SLACKS, Solution, SolveStatus, VARIABLES, WorkingSet,
};
use crate::decision::QpReport;

/// Most iterations of one solve. The recorded problems of the paper's hardest scenario need 13 at
/// the most from a cold start; at this limit the caller falls back to its previous plan.
pub const ITERATIONS_MAX: u32 = 100;

/// A violation below this, relative to the limit, counts as rounding.
const VIOLATION_MIN: f64 = 1e-10;
/// A normal whose part outside the working set's span is relatively smaller depends on the set.
const INDEPENDENCE_MIN: f64 = 1e-9;

/// The dense dual active-set method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ActiveSet;

impl QpSolver for ActiveSet {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        let guess = if warm.is_empty() { WorkingSet::natural() } else { *warm };
        let Some(cholesky) = Cholesky::of(qp) else {
            return Solution {
                status: SolveStatus::Infeasible,
                z: Row::ZERO.into(),
                report: QpReport { kkt_residual: f64::INFINITY, ..QpReport::default() },
            };
        };
        let slacks_held = qp.lower[INPUTS..VARIABLES].iter().all(|limit| limit.is_finite());
        if slacks_held
            && guess.is_natural()
            && let Some(solution) = natural(qp, &cholesky)
        {
            *warm = WorkingSet::natural();
            return solution;
        }
        let mut search = Search::start(qp, &cholesky, slacks_held);
        search.adopt(&guess);
        let status = search.run();
        search.refine();
        *warm = search.working_set();
        search.solution(status)
    }
}

/// The solution with the natural working set; `None` when that is not optimal.
fn natural(qp: &Qp, cholesky: &Cholesky) -> Option<Solution> {
    let slacks: [f64; SLACKS] = core::array::from_fn(|i| qp.lower[INPUTS + i]);
    let z = cholesky.minimise_inputs(qp, &slacks);
    let slope = qp.slope(&z);
    let held = core::array::from_fn::<_, SLACKS, _>(|i| (INPUTS + i, slope.0[INPUTS + i]));
    // Written so that NaN is refused too.
    if !held.iter().all(|&(_, multiplier)| multiplier >= 0.0) {
        return None;
    }
    let values = qp.values(&z);
    if is_any_violated(qp, &values) {
        return None;
    }
    let report = QpReport {
        working_set: WorkingSet::natural().bits(),
        kkt_residual: residual_at(qp, &slope, &values, held.into_iter()),
        ..QpReport::default()
    };
    Some(Solution { status: SolveStatus::Solved, z: z.into(), report })
}

/// Whether a limit is exceeded by more than rounding, by its absolute size; NaN counts as exceeded.
fn is_any_violated(qp: &Qp, values: &[f64; CONSTRAINTS]) -> bool {
    let mut violated = false;
    for ((value, lower), upper) in values.iter().zip(&qp.lower).zip(&qp.upper) {
        // A comparison with NaN is false. Without a branch, many at once.
        let holds = (lower - value <= VIOLATION_MIN) & (value - upper <= VIOLATION_MIN);
        violated |= !holds;
    }
    violated
}

/// One search: a point optimal for its working set, with the factors that make a step cheap.
struct Search<'a> {
    qp: &'a Qp,
    factors: Factors,
    /// The working set; only the first `count` are meaningful.
    members: [Active; VARIABLES],
    count: usize,
    /// Multipliers of the working set, one more for the constraint being added.
    multipliers: Row,
    z: Row,
    iterations: u32,
    changes: u32,
}

impl<'a> Search<'a> {
    /// Starts with every slack at its lower bound, or without any constraint.
    fn start(qp: &'a Qp, cholesky: &Cholesky, slacks_held: bool) -> Self {
        let mut members = [Active { constraint: 0, upper: false }; VARIABLES];
        let (factors, count) = if slacks_held {
            for (i, member) in members.iter_mut().enumerate().take(SLACKS) {
                member.constraint = (VARIABLES - 1 - i) as u8;
            }
            (Factors::with_slacks_held(cholesky), SLACKS)
        } else {
            (Factors::free(cholesky), 0)
        };
        let (multipliers, z) = (Row::ZERO, Row::ZERO);
        Self { qp, factors, members, count, multipliers, z, iterations: 0, changes: 0 }
    }

    /// Takes over a guessed working set, without those members that depend on earlier ones, have
    /// no limit, or would have to pull the wrong way.
    fn adopt(&mut self, guess: &WorkingSet) {
        for at in (0..self.count).rev() {
            if !guess.iter().any(|active| active == self.members[at]) {
                self.drop_member(at);
            }
        }
        for active in guess.iter() {
            let is_held = self.members[..self.count].contains(&active);
            let is_sound = usize::from(active.constraint) < CONSTRAINTS;
            if !is_held && is_sound && self.limit(active).is_finite() {
                let d = self.factors.project(&self.normal(active));
                if self.outside(&d) > INDEPENDENCE_MIN {
                    self.push(active, &d);
                }
            }
        }
        self.settle();
        while let Some(worst) = self.most_negative_multiplier() {
            self.drop_member(worst);
            self.settle();
        }
        self.changes = 0;
    }

    /// Adds violated constraints until there is none.
    fn run(&mut self) -> SolveStatus {
        while let Some((active, violation)) = self.most_violated() {
            if !violation.is_finite() {
                return SolveStatus::Infeasible;
            }
            if let Err(status) = self.satisfy(active) {
                return status;
            }
        }
        if self.z.0.iter().all(|x| x.is_finite()) {
            SolveStatus::Solved
        } else {
            SolveStatus::Infeasible
        }
    }

    /// Steps until `active` holds, dropping members whose multipliers reach zero on the way
    /// [Goldfarb & Idnani, algorithm 1, step 2].
    fn satisfy(&mut self, active: Active) -> Result<(), SolveStatus> {
        let normal = self.normal(active);
        self.multipliers.0[self.count] = 0.0;
        loop {
            self.iterations += 1;
            if self.iterations > ITERATIONS_MAX {
                return Err(SolveStatus::IterationCap);
            }
            let d = self.factors.project(&normal);
            let independent = self.outside(&d) > INDEPENDENCE_MIN;
            let pull = self.factors.back_substitute(&d);

            // Largest step that keeps every multiplier non-negative, and who stops it.
            let blocking = (0..self.count)
                .filter(|&i| pull.0[i] > 0.0)
                .map(|i| (self.multipliers.0[i] / pull.0[i], i))
                .fold(None, |best: Option<(f64, usize)>, x| match best {
                    Some(b) if b.0 <= x.0 => Some(b),
                    _ => Some(x),
                });
            // Step that makes the constraint hold with equality.
            let full = match independent {
                true => self.shortfall(active, &normal) / d.squares_from(self.count),
                false => f64::INFINITY,
            };

            let step = blocking.map_or(full, |(t, _)| full.min(t));
            if !step.is_finite() {
                return Err(SolveStatus::Infeasible);
            }
            if independent {
                self.z.add_scaled(step, &self.factors.combine_free(&d));
            }
            self.multipliers.add_scaled(-step, &pull);
            self.multipliers.0[self.count] += step;
            match blocking {
                Some((t, i)) if t < full => self.drop_member(i),
                _ => {
                    self.push(active, &d);
                    return Ok(());
                }
            }
        }
    }

    /// Computes point and multipliers afresh from the factors:
    /// `z = J y`, `y1 = R'^-1 b`, `y2 = -J2' g`, `R m = y1 + J1' g`.
    fn settle(&mut self) {
        let gradient = self.factors.project(&self.qp.gradient_row());
        let mut y = self.factors.forward_substitute(|i| self.bound(self.members[i]));
        for k in self.count..VARIABLES {
            y.0[k] = -gradient.0[k];
        }
        self.z = self.factors.combine(&y);
        y.add_scaled(1.0, &gradient);
        self.multipliers = self.factors.back_substitute(&y);
    }

    /// One step of iterative refinement: the same solve for the residuals of point and multipliers.
    fn refine(&mut self) {
        let mut residual = self.qp.slope(&self.z);
        for i in 0..self.count {
            residual.add_scaled(-self.multipliers.0[i], &self.normal(self.members[i]));
        }
        let residual = self.factors.project(&residual);
        let mut y = self.factors.forward_substitute(|i| {
            let active = self.members[i];
            self.shortfall(active, &self.normal(active))
        });
        for k in self.count..VARIABLES {
            y.0[k] = -residual.0[k];
        }
        self.z.add_scaled(1.0, &self.factors.combine(&y));
        y.add_scaled(1.0, &residual);
        self.multipliers.add_scaled(1.0, &self.factors.back_substitute(&y));
    }

    /// The constraint violated most, relative to its limit, and by how much.
    fn most_violated(&self) -> Option<(Active, f64)> {
        let values = self.qp.values(&self.z);
        if !is_any_violated(self.qp, &values) {
            return None;
        }
        let mut worst = None;
        let mut largest = VIOLATION_MIN;
        for (i, &value) in values.iter().enumerate() {
            for (violation, limit, upper) in [
                (self.qp.lower[i] - value, self.qp.lower[i], false),
                (value - self.qp.upper[i], self.qp.upper[i], true),
            ] {
                // Not `>`: a NaN anywhere must end the search, not pass as satisfied.
                if violation <= largest {
                    continue;
                }
                let relative = violation / (1.0 + limit.abs());
                if relative <= largest {
                    continue;
                }
                largest = relative;
                worst = Some((Active { constraint: i as u8, upper }, relative));
                if !relative.is_finite() {
                    return worst;
                }
            }
        }
        worst
    }

    fn push(&mut self, active: Active, d: &Row) {
        self.factors.push(d);
        self.members[self.count] = active;
        self.count += 1;
        self.changes += 1;
    }

    fn drop_member(&mut self, at: usize) {
        self.factors.remove(at);
        self.members.copy_within(at + 1..self.count, at);
        // The multiplier of the constraint being added sits behind the working set's.
        self.multipliers.0.copy_within(at + 1..=self.count, at);
        self.multipliers.0[self.count] = 0.0;
        self.count -= 1;
        self.changes += 1;
    }

    /// Relative length of a projected normal outside the working set's span.
    fn outside(&self, d: &Row) -> f64 {
        let (whole, rest) = (d.squares_from(0), d.squares_from(self.count));
        if whole > 0.0 { libm::sqrt(rest / whole) } else { 0.0 }
    }

    fn most_negative_multiplier(&self) -> Option<usize> {
        (0..self.count)
            .filter(|&i| self.multipliers.0[i] < 0.0)
            .min_by(|&a, &b| self.multipliers.0[a].total_cmp(&self.multipliers.0[b]))
    }

    /// The normal, turned so that the constraint reads `normal' z >= bound`.
    fn normal(&self, active: Active) -> Row {
        let normal = self.qp.normal(active.constraint.into());
        if active.upper { normal.scaled(-1.0) } else { normal }
    }

    fn limit(&self, active: Active) -> f64 {
        let side = if active.upper { &self.qp.upper } else { &self.qp.lower };
        side[usize::from(active.constraint)]
    }

    /// The bound in `normal' z >= bound`.
    fn bound(&self, active: Active) -> f64 {
        if active.upper { -self.limit(active) } else { self.limit(active) }
    }

    /// How much a constraint with this normal is short of holding.
    fn shortfall(&self, active: Active, normal: &Row) -> f64 {
        self.bound(active) - normal.dot(&self.z)
    }

    fn working_set(&self) -> WorkingSet {
        WorkingSet::of(self.members[..self.count].iter().copied())
    }

    fn solution(&self, status: SolveStatus) -> Solution {
        let multipliers = (0..self.count).map(|i| {
            let sign = if self.members[i].upper { -1.0 } else { 1.0 };
            (usize::from(self.members[i].constraint), sign * self.multipliers.0[i])
        });
        let (slope, values) = (self.qp.slope(&self.z), self.qp.values(&self.z));
        Solution {
            status,
            z: self.z.into(),
            report: QpReport {
                iterations: self.iterations,
                changes: self.changes,
                working_set: self.working_set().bits(),
                kkt_residual: residual_at(self.qp, &slope, &values, multipliers),
            },
        }
    }
}
