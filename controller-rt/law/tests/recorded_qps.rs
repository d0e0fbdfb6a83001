//! The recorded QPs: our solver against solutions refined to machine accuracy.

use law::qp::{ActiveSet, CONSTRAINTS, Qp, QpSolver, ROWS, SolveStatus, VARIABLES, WorkingSet};
use nalgebra::{SMatrix, SVector};

struct Recorded {
    sequence: u32,
    qp: Qp,
    exact: SVector<f64, VARIABLES>,
}

/// Reads the file described in `data/README.md`.
fn recorded() -> Vec<Recorded> {
    let mut bytes: &[u8] = include_bytes!("data/obstacle_avoidance.qps");
    fn take<'a>(bytes: &mut &'a [u8], n: usize) -> &'a [u8] {
        let (head, tail) = bytes.split_at(n);
        *bytes = tail;
        head
    }
    fn u32_of(bytes: &mut &[u8]) -> u32 {
        u32::from_le_bytes(take(bytes, 4).try_into().expect("four bytes"))
    }
    fn u16_of(bytes: &mut &[u8]) -> usize {
        u16::from_le_bytes(take(bytes, 2).try_into().expect("two bytes")).into()
    }
    fn f64_of(bytes: &mut &[u8]) -> f64 {
        f64::from_le_bytes(take(bytes, 8).try_into().expect("eight bytes"))
    }
    assert_eq!(take(&mut bytes, 8), b"PLATOONQ");
    let (count, pairs, slots) = (u32_of(&mut bytes), u32_of(&mut bytes), u32_of(&mut bytes));
    let length = VARIABLES * VARIABLES + VARIABLES + ROWS * VARIABLES + 2 * CONSTRAINTS;
    let template: Vec<f64> = (0..length).map(|_| f64_of(&mut bytes)).collect();
    let pairs: Vec<_> = (0..pairs).map(|_| (u16_of(&mut bytes), u16_of(&mut bytes))).collect();
    (0..count)
        .map(|_| {
            let sequence = u32_of(&mut bytes);
            let values: Vec<f64> = (0..slots).map(|_| f64_of(&mut bytes)).collect();
            let mut flat = template.clone();
            for &(position, slot) in &pairs {
                flat[position] = values[slot];
            }
            let mut flat = &flat[..];
            let mut next = |n: usize| {
                let (head, tail) = flat.split_at(n);
                flat = tail;
                head
            };
            let qp = Qp {
                hessian: SMatrix::from_row_slice(next(VARIABLES * VARIABLES)),
                gradient: SVector::from_row_slice(next(VARIABLES)),
                rows: SMatrix::from_row_slice(next(ROWS * VARIABLES)),
                lower: next(CONSTRAINTS).try_into().expect("as many as constraints"),
                upper: next(CONSTRAINTS).try_into().expect("as many as constraints"),
            };
            let exact = SVector::from_fn(|_, _| f64_of(&mut bytes));
            Recorded { sequence, qp, exact }
        })
        .collect()
}

fn assert_exact(i: usize, recorded: &Recorded, solution: &law::qp::Solution) {
    assert_eq!(solution.status, SolveStatus::Solved, "QP {i}");
    let error = (solution.z - recorded.exact).amax();
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
