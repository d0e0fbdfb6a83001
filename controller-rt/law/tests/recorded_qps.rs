//! The recorded QPs: our solver against solutions refined to machine accuracy.

use law::qp::{ActiveSet, ITERATIONS_MAX, Qp, QpSolver, SolveStatus, VARIABLES, WorkingSet};
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
    assert!(iterations_max <= 12, "took up to {iterations_max} iterations");
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

/// What is sampled of the recorded problems' box: H, g, A and the limits that are finite in both,
/// blended between two of them. H stays positive definite, slacks keep the problem feasible.
fn blended(a: &Qp, b: &Qp, share: f64) -> Qp {
    let mix = |a: f64, b: f64| {
        let finite = a.is_finite() && b.is_finite();
        if finite { a + share * (b - a) } else { a }
    };
    Qp {
        hessian: a.hessian.zip_map(&b.hessian, mix),
        gradient: a.gradient.zip_map(&b.gradient, mix),
        rows: a.rows.zip_map(&b.rows, mix),
        lower: std::array::from_fn(|i| mix(a.lower[i], b.lower[i])),
        upper: std::array::from_fn(|i| mix(a.upper[i], b.upper[i])),
    }
}

#[test]
fn between_the_recorded_problems_iterations_stay_far_from_the_cap() {
    let all = recorded();
    let (mut cold_max, mut warm_max) = (0, 0);
    for i in 0..2000 {
        let (a, b) = (&all[(i * 7919) % all.len()].qp, &all[(i * 104_729 + 13) % all.len()].qp);
        let qp = blended(a, b, (i % 19) as f64 / 18.0);
        let cold = ActiveSet.solve(&qp, &mut WorkingSet::default());
        let mut foreign = WorkingSet::default();
        ActiveSet.solve(b, &mut foreign);
        let warm = ActiveSet.solve(&qp, &mut foreign);
        for solution in [cold, warm] {
            assert_eq!(solution.status, SolveStatus::Solved, "blend {i}");
            assert!(solution.report.kkt_residual < 1e-8, "blend {i}: {:?}", solution.report);
        }
        cold_max = cold_max.max(cold.report.iterations);
        warm_max = warm_max.max(warm.report.iterations);
    }
    println!("{cold_max} cold, {warm_max} warm");
    assert!(cold_max.max(warm_max) <= ITERATIONS_MAX / 2, "{cold_max} cold, {warm_max} warm");
    assert!(cold_max > 3, "the blends are too easy to tell anything: {cold_max}");
}
