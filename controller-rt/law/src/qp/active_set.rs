//! The real-time QP solver: a dense dual active-set method.
//!
//! D. Goldfarb and A. Idnani, *A numerically stable dual method for solving strictly convex
//! quadratic programs*, Mathematical Programming 27 (1983), with three additions: two-sided
//! limits, a start from any guessed working set, and a choice of the constraint to add that looks
//! at the length of its normal.
//!
//! The method keeps a point that is optimal for the constraints in its working set and adds a
//! violated one until none is left. The dual objective grows with every full step, so no working
//! set comes back, degenerate or not. Work per iteration is bounded, nothing is allocated, ties are
//! broken by index: equal problems give equal bits, whatever the width of the registers.
//!
//! Most problems of the motion layer have the natural working set, every slack at zero and no input
//! limited. Then one factorisation, one pair of substitutions and one look at all rows is all there
//! is to do; the search proper begins when that look finds something.

use super::excess::Excess;
use super::factors::{Elimination, Factors};
use super::kkt::{larger, stationarity};
use super::row::Row;
use super::search::{Search, VIOLATION_MIN};
use super::{INPUTS, Qp, QpSolver, SLACKS, Solution, SolveStatus, VARIABLES, WorkingSet};
use crate::decision::QpReport;
use crate::wide::{self, Work};

/// The dense dual active-set method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ActiveSet;

impl QpSolver for ActiveSet {
    fn solve(&self, qp: &Qp, warm: &mut WorkingSet) -> Solution {
        wide::widest(Solve { qp, warm, rest: |rest| wide::widest(rest) })
    }
}

/// One solve.
struct Solve<'a> {
    qp: &'a Qp,
    warm: &'a mut WorkingSet,
    /// Does what is left when the natural working set is not it: a function of its own, so that
    /// the usual case is short and finds its way into the caches at once.
    rest: fn(Rest) -> Solution,
}

/// What is left of a solve.
struct Rest<'a> {
    qp: &'a Qp,
    elimination: &'a Elimination,
    /// Where the search may start right away, point and slope; `excess` is of there then.
    natural: Option<(&'a Row, &'a Row)>,
    excess: &'a mut Excess,
    are_slacks_held: bool,
    /// The working set to start from, and then the one found.
    warm: &'a mut WorkingSet,
}

impl Work for Rest<'_> {
    type Result = Solution;

    #[inline(always)]
    fn run(self) -> Solution {
        let Self { qp, elimination, natural, excess, are_slacks_held, warm } = self;
        let guess = if warm.is_empty() { WorkingSet::natural() } else { *warm };
        let mut factors = Factors::EMPTY;
        let mut search = Search::start(qp, elimination, &mut factors);
        if are_slacks_held && guess.has_slacks() {
            search.hold_slacks();
        }
        match natural {
            Some((z, slope)) => search.settle_at(z, slope),
            None => search.adopt(&guess),
        }
        let solution = search.run(excess, natural.is_some());
        *warm = search.working_set();
        solution
    }
}

impl Work for Solve<'_> {
    type Result = Solution;

    #[inline(always)]
    fn run(self) -> Solution {
        let Self { qp, warm, rest } = self;
        let limits: [f64; SLACKS] = core::array::from_fn(|i| qp.lower[INPUTS + i]);
        let are_slacks_held = limits.iter().all(|limit| limit.is_finite());
        let slacks = if are_slacks_held { limits } else { [0.0; SLACKS] };
        let mut elimination = Elimination::EMPTY;
        if !elimination.fill(qp, &slacks) {
            return Solution {
                status: SolveStatus::Infeasible,
                z: Row::ZERO.into(),
                report: QpReport { kkt_residual: f64::INFINITY, ..QpReport::default() },
            };
        }
        let mut excess = Excess::EMPTY;
        let (mut z, mut slope) = (Row::ZERO, Row::ZERO);
        let mut is_natural = false;
        if are_slacks_held && (warm.is_empty() || warm.is_natural()) {
            z = elimination.minimise_inputs(&slacks);
            slope = qp.slope(&z);
            excess.look(qp, &z);
            // Written so that NaN is refused too.
            is_natural = slope.0[INPUTS..VARIABLES].iter().all(|&multiplier| multiplier >= 0.0);
            if is_natural && excess.is_within(VIOLATION_MIN) {
                *warm = WorkingSet::natural();
                return natural_solution(qp, &z, &slope, &excess);
            }
        }
        rest(Rest {
            qp,
            elimination: &elimination,
            natural: is_natural.then_some((&z, &slope)),
            excess: &mut excess,
            are_slacks_held,
            warm,
        })
    }
}

/// The account of the natural working set's point, where the slacks' slopes are the multipliers of
/// their bounds.
#[inline(always)]
fn natural_solution(qp: &Qp, z: &Row, slope: &Row, excess: &Excess) -> Solution {
    let stationarity = stationarity(qp, slope, &slope.beyond(INPUTS));
    let report = QpReport {
        working_set: WorkingSet::NATURAL_BITS,
        // The slacks are at their bounds to the last bit.
        kkt_residual: larger(excess.relative(qp), stationarity),
        ..QpReport::default()
    };
    Solution { status: SolveStatus::Solved, z: (*z).into(), report }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A convex QP with numbers that look drawn, and slacks coupled to nothing.
    fn drawn(seed: u32) -> Qp {
        let mut state = seed;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX) - 0.5
        };
        let mut qp = Qp::empty();
        for k in 0..VARIABLES {
            qp.gradient[k] = if k < INPUTS { 8.0 * draw() } else { 100.0 };
            qp.hessian[(k, k)] = 2.0;
            if k < INPUTS {
                let row = nalgebra::SVector::<f64, INPUTS>::from_fn(|_, _| draw());
                let mut inputs = qp.hessian.fixed_view_mut::<INPUTS, INPUTS>(0, 0);
                inputs += row * row.transpose();
            } else {
                qp.lower[k] = 0.0;
            }
        }
        for i in 0..crate::qp::ROWS {
            for j in 0..INPUTS {
                qp.rows[(i, j)] = draw();
            }
            qp.rows[(i, INPUTS + i % SLACKS)] = -1.0;
            qp.upper[VARIABLES + i] = 0.6 + draw();
        }
        qp
    }

    #[test]
    fn registers_of_any_width_give_the_same_bits() {
        let mut iterations = 0;
        for seed in 0..50 {
            let qp = drawn(seed);
            let (mut wide, mut narrow) = (WorkingSet::default(), WorkingSet::default());
            // Cold, then warm.
            for _ in 0..2 {
                let by_wide = ActiveSet.solve(&qp, &mut wide);
                let by_narrow = Solve { qp: &qp, warm: &mut narrow, rest: |rest| rest.run() }.run();
                assert_eq!(by_wide.status, SolveStatus::Solved);
                assert!(by_wide.report.kkt_residual < 1e-9, "{:?}", by_wide.report);
                assert_eq!(by_wide.z.map(f64::to_bits), by_narrow.z.map(f64::to_bits));
                assert_eq!(by_wide.report, by_narrow.report);
                assert_eq!(wide, narrow);
                iterations += by_wide.report.iterations;
            }
        }
        assert!(iterations > 100, "too easy to tell anything: {iterations}");
    }
}
