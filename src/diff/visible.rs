//! When a difference shows in the distances between the trucks.

use std::collections::VecDeque;

use serde::Serialize;
use traces::TruthRecord;

/// Distances apart by more than this show \[m\].
const VISIBLE_M: f64 = 0.01;

/// How far the spacing errors of two runs are apart.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Visible {
    /// When they were first apart by more than a centimetre \[s\], and which truck's.
    pub since_s: Option<f64>,
    /// The truck whose error showed first.
    pub truck: usize,
    /// Furthest apart \[m\].
    pub furthest_m: f64,
    /// When \[s\].
    pub furthest_s: f64,
    /// The truck whose error was.
    pub furthest_truck: usize,
}

/// Holds the worlds of two runs together.
#[derive(Debug, Default)]
pub struct Spacing {
    waiting: [VecDeque<(u64, Vec<f64>)>; 2],
    found: Visible,
}

impl Spacing {
    /// Takes a state of one side's world.
    pub fn add(&mut self, side: usize, truth: &TruthRecord) {
        let trucks = truth.trucks.as_slice();
        let errors = trucks.iter().map(|truck| truck.predecessor_error_m).collect();
        self.waiting[side].push_back((truth.time_ns, errors));
        let [a, b] = &mut self.waiting;
        while let (Some((a_ns, _)), Some((b_ns, _))) = (a.front(), b.front()) {
            let (a_ns, b_ns) = (*a_ns, *b_ns);
            let of_a = if a_ns <= b_ns { a.pop_front() } else { None };
            let of_b = if b_ns <= a_ns { b.pop_front() } else { None };
            if let (Some((time_ns, of_a)), Some((_, of_b))) = (of_a, of_b) {
                self.found.note(time_ns as f64 * 1e-9, &of_a, &of_b);
            }
        }
    }

    /// What was found.
    pub fn finish(self) -> Visible {
        self.found
    }
}

impl Visible {
    fn note(&mut self, time_s: f64, a: &[f64], b: &[f64]) {
        for (truck, (a, b)) in a.iter().zip(b).enumerate() {
            let apart_m = (a - b).abs();
            if apart_m > VISIBLE_M && self.since_s.is_none() {
                (self.since_s, self.truck) = (Some(time_s), truck);
            }
            if apart_m > self.furthest_m {
                (self.furthest_m, self.furthest_s) = (apart_m, time_s);
                self.furthest_truck = truck;
            }
        }
    }
}
