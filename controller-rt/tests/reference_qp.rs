//! The reference solver against recorded solutions, the law's own solver, and bad data.

use controller_rt::Clarabel;
use law::qp::{ActiveSet, Qp, QpSolver, SolveStatus, VARIABLES, WorkingSet};
use recorded::recorded;

#[path = "../law/tests/recorded/mod.rs"]
mod recorded;

fn distance(found: &[f64], exact: &[f64]) -> f64 {
    found.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn clarabel_agrees_with_every_recorded_solution_to_1e_7() {
    for (number, one) in recorded().iter().enumerate() {
        let (qp, exact) = (&one.qp, &one.exact);
        let solution = Clarabel.solve(qp, &mut WorkingSet::default());
        assert_eq!(solution.status, SolveStatus::Solved, "QP {number}");
        let error = distance(solution.z.as_slice(), exact);
        assert!(error < 1e-7, "QP {number}: {error:e}, {:?}", solution.report);
    }
}

#[test]
fn clarabel_repeats_itself_bit_for_bit_whatever_it_solved_before() {
    let recorded = recorded();
    let first = Clarabel.solve(&recorded[7].qp, &mut WorkingSet::default());
    let mut warm = WorkingSet::natural();
    for one in &recorded[100..110] {
        Clarabel.solve(&one.qp, &mut warm);
    }
    assert_eq!(Clarabel.solve(&recorded[7].qp, &mut warm), first);
}

#[test]
fn clarabels_working_set_warm_starts_the_active_set_method() {
    for (number, one) in recorded().iter().enumerate().step_by(10) {
        let (qp, exact) = (&one.qp, &one.exact);
        let mut warm = WorkingSet::default();
        Clarabel.solve(qp, &mut warm);
        let solution = ActiveSet.solve(qp, &mut warm);
        assert_eq!(solution.status, SolveStatus::Solved, "QP {number}");
        assert!(distance(solution.z.as_slice(), exact) < 1e-7, "QP {number}");
    }
}

/// A QP without constraints whose solution is known.
fn simple() -> Qp {
    let mut qp = Qp::empty();
    qp.hessian.fill_with_identity();
    qp.gradient.fill(-1.0);
    qp
}

#[test]
fn an_unconstrained_qp_and_an_equality_are_solved() {
    let mut qp = simple();
    (qp.lower[2], qp.upper[2]) = (0.25, 0.25);
    let solution = Clarabel.solve(&qp, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Solved);
    let mut exact = [1.0; VARIABLES];
    exact[2] = 0.25;
    assert!(distance(solution.z.as_slice(), &exact) < 1e-7, "{}", solution.z);
    assert_eq!(solution.report.working_set, 1 << 2);
}

#[test]
fn contradicting_limits_are_infeasible() {
    let mut qp = simple();
    (qp.rows[(0, 0)], qp.rows[(1, 0)]) = (1.0, 1.0);
    (qp.upper[VARIABLES], qp.lower[VARIABLES + 1]) = (1.0, 2.0);
    let solution = Clarabel.solve(&qp, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Infeasible);
    let mut crossed = simple();
    (crossed.lower[0], crossed.upper[0]) = (1.0, -1.0);
    let solution = Clarabel.solve(&crossed, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Infeasible);
}

#[test]
fn data_that_is_no_qp_is_infeasible_and_never_a_panic() {
    for bad in [f64::NAN, f64::INFINITY, -1e300] {
        let spoilt: [fn(&mut Qp, f64); 4] = [
            |qp, x| qp.hessian[(3, 3)] = x,
            |qp, x| qp.gradient[1] = x,
            |qp, x| qp.rows[(5, 5)] = x,
            |qp, x| qp.upper[4] = -x.abs(),
        ];
        for (number, spoil) in spoilt.iter().enumerate() {
            let mut qp = simple();
            spoil(&mut qp, bad);
            let solution = Clarabel.solve(&qp, &mut WorkingSet::default());
            assert_eq!(solution.status, SolveStatus::Infeasible, "{bad} in place {number}");
        }
    }
    let mut indefinite = simple();
    indefinite.hessian[(0, 0)] = -1.0;
    let solution = Clarabel.solve(&indefinite, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Infeasible);
}
