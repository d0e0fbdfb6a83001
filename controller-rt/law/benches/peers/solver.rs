//! Our solver as a library that `peers.py` loads into its own process, so that it is called where
//! and as its peers are. Every function takes and gives plain numbers.

use std::hint::black_box;
use std::sync::{LazyLock, Mutex};
use std::time::Instant;

use law::qp::{ActiveSet, Qp, QpSolver, VARIABLES, WorkingSet};
use recorded::recorded;

#[path = "../../tests/recorded/mod.rs"]
mod recorded;

/// A recorded problem, and the working set of the one recorded before it.
struct Problem {
    qp: Qp,
    before: WorkingSet,
}

static PROBLEMS: LazyLock<Vec<Problem>> = LazyLock::new(|| {
    let mut last = (u32::MAX, WorkingSet::default());
    let problem = |one: recorded::Recorded| {
        let before = if last.0 == one.sequence { last.1 } else { WorkingSet::default() };
        let mut set = WorkingSet::default();
        ActiveSet.solve(&one.qp, &mut set);
        last = (one.sequence, set);
        Problem { qp: one.qp, before }
    };
    recorded().into_iter().map(problem).collect()
});

/// The solution of the last call.
static SOLUTION: Mutex<[f64; VARIABLES]> = Mutex::new([0.0; VARIABLES]);

/// Solves recorded problem `number` and tells how long that took \[ns\].
fn solve(number: usize, start: impl Fn(&Problem) -> WorkingSet) -> u64 {
    let problem = &PROBLEMS[number];
    let mut working_set = start(problem);
    let began = Instant::now();
    let solution = ActiveSet.solve(black_box(&problem.qp), &mut working_set);
    let ns = began.elapsed().as_nanos() as u64;
    *SOLUTION.lock().expect("nobody panics holding it") = solution.z.into();
    ns
}

/// Solves a recorded problem without history; its time \[ns\].
#[expect(unsafe_code, reason = "the name by which another language finds it")]
#[unsafe(no_mangle)]
pub extern "C" fn solve_cold(number: u32) -> u64 {
    solve(number as usize, |_| WorkingSet::default())
}

/// Solves a recorded problem from the working set of the one recorded before it; its time \[ns\].
#[expect(unsafe_code, reason = "the name by which another language finds it")]
#[unsafe(no_mangle)]
pub extern "C" fn solve_warm(number: u32) -> u64 {
    solve(number as usize, |problem| problem.before)
}

/// Variable `at` of the last solution.
#[expect(unsafe_code, reason = "the name by which another language finds it")]
#[unsafe(no_mangle)]
pub extern "C" fn variable(at: u32) -> f64 {
    SOLUTION.lock().expect("nobody panics holding it")[at as usize]
}
