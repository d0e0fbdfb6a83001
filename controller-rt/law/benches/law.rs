//! What a step of the law costs, part by part: `cargo bench -p law`.
//!
//! Every part is called over a whole recorded course again and again; the table has nanoseconds a
//! call. The machine is rarely quiet: minima and ratios mean more than means. For figures that do
//! not depend on it, `benches/instructions.sh` counts instructions: this program with `--count PART
//! TIMES` calls one part so often and no other.

use std::hint::black_box;
use std::time::Instant;

use course::{Course, course};
use law::parts::{self, Bicycle};
use law::qp::{ActiveSet, Qp, QpSolver, WorkingSet};
use law::{Calibration, Law, Memory, Phase};
use recorded::{Recorded, recorded};
use table::timed;

mod course;
#[path = "../tests/recorded/mod.rs"]
mod recorded;
mod table;

/// How often each part goes over its course.
const ROUNDS: usize = 60;

/// Everything the parts are called with.
struct Inputs {
    law: Law,
    model: Bicycle,
    course: Course,
    recorded: Vec<Recorded>,
    /// Of those, the ones that the natural working set does not solve, each with the working set
    /// of the problem recorded before it.
    degenerate: Vec<(Qp, WorkingSet)>,
}

/// A part: its name, and one pass over its course that tells the time of every call \[ns\].
type Part = (&'static str, fn(&Inputs, &mut Vec<u64>));

const PARTS: [Part; 9] = [
    ("step", step),
    ("ucl", |inputs, times| phases(inputs, times, Phase::Ucl)),
    ("build", |inputs, times| phases(inputs, times, Phase::LmlBuild)),
    ("qp", |inputs, times| phases(inputs, times, Phase::Qp)),
    ("linearise", linearise),
    ("qp-cold", cold),
    ("qp-warm", warm),
    ("qp-degenerate", degenerate),
    ("qp-degenerate-warm", degenerate_warm),
];

fn main() {
    let inputs = Inputs::new();
    let words: Vec<String> = std::env::args().collect();
    if let Some(at) = words.iter().position(|word| word == "--count") {
        let times = words.get(at + 2).and_then(|n| n.parse().ok()).expect("--count PART TIMES");
        let part = PARTS.iter().find(|(name, _)| *name == words[at + 1]).expect("a part's name");
        let mut calls = Vec::new();
        (0..times).for_each(|_| part.1(&inputs, &mut calls));
        println!("{} {}", part.0, calls.len());
        return;
    }
    table::head();
    for (name, part) in PARTS {
        let mut times = Vec::new();
        (0..ROUNDS).for_each(|_| part(&inputs, &mut times));
        table::row(name, &mut times);
    }
}

impl Inputs {
    fn new() -> Self {
        let calibration = Calibration::default();
        let (law, recorded) = (Law::new(calibration, ActiveSet), recorded());
        let (mut degenerate, mut before) = (Vec::new(), (u32::MAX, WorkingSet::default()));
        for one in &recorded {
            let mut set = WorkingSet::default();
            let solution = ActiveSet.solve(&one.qp, &mut set);
            if solution.report.working_set != WorkingSet::natural().bits() {
                let warm = if before.0 == one.sequence { before.1 } else { WorkingSet::default() };
                degenerate.push((one.qp.clone(), warm));
            }
            before = (one.sequence, set);
        }
        let model = Bicycle::new(&calibration.truck);
        Self { course: course(&law), law, model, recorded, degenerate }
    }
}

fn step(inputs: &Inputs, times: &mut Vec<u64>) {
    let mut memory = Memory::new();
    for seen in &inputs.course.seen {
        timed(times, || inputs.law.step(&mut memory, black_box(seen)));
    }
}

/// A whole step, of which one phase is timed.
fn phases(inputs: &Inputs, times: &mut Vec<u64>, phase: Phase) {
    let mut memory = Memory::new();
    for seen in &inputs.course.seen {
        let mut before = Instant::now();
        let mut mark = |ended: Phase| {
            let now = Instant::now();
            if ended == phase {
                times.push((now - before).as_nanos() as u64);
            }
            before = now;
        };
        black_box(inputs.law.step_marked(&mut memory, black_box(seen), &mut mark));
    }
}

/// Rollout, tangents and gains of every predicted instant.
fn linearise(inputs: &Inputs, times: &mut Vec<u64>) {
    for (start, plan) in &inputs.course.plans {
        timed(times, || parts::linearise(&inputs.model, black_box(start), plan));
    }
}

fn cold(inputs: &Inputs, times: &mut Vec<u64>) {
    for one in &inputs.recorded {
        timed(times, || ActiveSet.solve(black_box(&one.qp), &mut WorkingSet::default()));
    }
}

/// Each from the working set before it, within its recording.
fn warm(inputs: &Inputs, times: &mut Vec<u64>) {
    let (mut working_set, mut sequence) = (WorkingSet::default(), u32::MAX);
    for one in &inputs.recorded {
        if one.sequence != sequence {
            (working_set, sequence) = (WorkingSet::default(), one.sequence);
        }
        timed(times, || ActiveSet.solve(black_box(&one.qp), &mut working_set));
    }
}

fn degenerate(inputs: &Inputs, times: &mut Vec<u64>) {
    for (qp, _) in &inputs.degenerate {
        timed(times, || ActiveSet.solve(black_box(qp), &mut WorkingSet::default()));
    }
}

fn degenerate_warm(inputs: &Inputs, times: &mut Vec<u64>) {
    for (qp, before) in &inputs.degenerate {
        let mut warm = *before;
        timed(times, || ActiveSet.solve(black_box(qp), &mut warm));
    }
}
