//! The recorded QPs: our solver against solutions refined to machine accuracy.

use law::qp::{ActiveSet, QpSolver, SolveStatus, VARIABLES, WorkingSet};
use recorded::{Recorded, recorded};

mod recorded;

fn assert_exact(i: usize, recorded: &Recorded, solution: &law::qp::Solution) {
    assert_eq!(solution.status, SolveStatus::Solved, "QP {i}");
    let apart = solution.z.iter().zip(&recorded.exact).map(|(found, exact)| (found - exact).abs());
    let error = apart.fold(0.0, f64::max);
    assert!(error < 1e-7, "QP {i}: off by {error:e}");
    let residual = solution.report.kkt_residual;
    assert!(residual < 1e-9, "QP {i}: KKT residual {residual:e}");
}

#[test]
fn a_cold_start_solves_every_recorded_qp() {
    let all = recorded();
    assert_eq!(all.len(), 440);
    let mut iterations_max = 0;
    for (i, recorded) in all.iter().enumerate() {
        let solution = ActiveSet.solve(&recorded.qp, &mut WorkingSet::default());
        assert_exact(i, recorded, &solution);
        iterations_max = iterations_max.max(solution.report.iterations);
    }
    // Far from the limit of 100, so that the limit never decides.
    assert!(iterations_max <= 20, "took up to {iterations_max} iterations");
}

#[test]
fn the_previous_working_set_solves_every_recorded_qp() {
    let mut warm = WorkingSet::default();
    let mut sequence = u32::MAX;
    for (i, recorded) in recorded().iter().enumerate() {
        if recorded.sequence != sequence {
            warm = WorkingSet::default();
            sequence = recorded.sequence;
        }
        let solution = ActiveSet.solve(&recorded.qp, &mut warm);
        assert_exact(i, recorded, &solution);
    }
}

#[test]
fn the_natural_working_set_is_the_answer_to_most() {
    let at_once = recorded()
        .iter()
        .filter(|r| ActiveSet.solve(&r.qp, &mut WorkingSet::default()).report.iterations == 0)
        .count();
    assert_eq!(at_once, 341);
}

#[test]
fn a_foreign_working_set_does_not_change_the_answer() {
    let all = recorded();
    for (i, recorded) in all.iter().enumerate() {
        let mut warm = WorkingSet::default();
        ActiveSet.solve(&all[(i * 7919) % all.len()].qp, &mut warm);
        assert_exact(i, recorded, &ActiveSet.solve(&recorded.qp, &mut warm));
    }
}

#[test]
fn equal_problems_give_equal_bits() {
    for recorded in recorded().iter().step_by(11) {
        let once = ActiveSet.solve(&recorded.qp, &mut WorkingSet::default());
        let again = ActiveSet.solve(&recorded.qp, &mut WorkingSet::default());
        assert_eq!(once.z.map(f64::to_bits), again.z.map(f64::to_bits));
    }
}

#[test]
fn contradictory_limits_are_infeasible_not_a_panic() {
    let mut qp = recorded().swap_remove(0).qp;
    // Force must rise and fall by a lot at once.
    qp.lower[VARIABLES] = 10.0;
    qp.upper[0] = 5.0;
    let solution = ActiveSet.solve(&qp, &mut WorkingSet::default());
    assert_eq!(solution.status, SolveStatus::Infeasible);
}

#[test]
fn numbers_that_are_not_finite_are_infeasible_not_a_panic() {
    let clean = recorded().swap_remove(0).qp;
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for place in 0..4 {
            let mut qp = clean.clone();
            match place {
                0 => qp.hessian[(3, 3)] = poison,
                1 => qp.gradient[2] = poison,
                2 => qp.rows[(20, 1)] = poison,
                _ => qp.lower[VARIABLES + 12] = poison,
            }
            let harmless = place == 3 && poison == f64::NEG_INFINITY;
            let solution = ActiveSet.solve(&qp, &mut WorkingSet::default());
            assert_eq!(solution.status == SolveStatus::Solved, harmless, "{poison} at {place}");
        }
    }
}
