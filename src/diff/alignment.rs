//! The ticks of two runs side by side.

use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};

use crate::trace::{Event, History, Moment, TickInputs, differences};

use super::finding::{Apart, Ecu, First, What};
use super::upstream::Inputs;

/// Both sides of every ECU that both runs have.
#[derive(Default)]
pub struct Alignment {
    ecus: BTreeMap<u8, Sides>,
}

/// One ECU on both sides.
#[derive(Default)]
struct Sides {
    histories: [History; 2],
    waiting: [VecDeque<TickInputs>; 2],
    has_ticked: [bool; 2],
    inputs: Inputs,
    found: Ecu,
}

impl Alignment {
    /// Takes an event of an ECU of one side.
    pub fn add(&mut self, side: usize, truck: u8, event: Event) {
        let sides = self.ecus.entry(truck).or_default();
        let waiting = &mut sides.waiting[side];
        sides.histories[side].push(event, &mut |moment| note(waiting, moment));
        sides.has_ticked[side] |= !sides.waiting[side].is_empty();
        sides.compare(false);
    }

    /// What was found of each ECU that both runs have.
    pub fn finish(self) -> Vec<Ecu> {
        let ecus = self.ecus.into_iter().map(|(truck, mut sides)| {
            let histories = std::mem::take(&mut sides.histories);
            for (history, waiting) in histories.into_iter().zip(&mut sides.waiting) {
                history.finish(&mut |moment| note(waiting, moment));
            }
            sides.compare(true);
            (sides.has_ticked == [true; 2]).then_some(Ecu { truck, ..sides.found })
        });
        ecus.flatten().collect()
    }
}

fn note(waiting: &mut VecDeque<TickInputs>, moment: Moment) {
    if let Moment::Tick(inputs) = moment {
        waiting.push_back(*inputs);
    }
}

impl Sides {
    /// Compares what has come on both sides; at the end, also what has come on one only.
    fn compare(&mut self, is_end: bool) {
        loop {
            let heads = self.waiting.each_ref().map(|side| side.front().map(|i| i.tick.time_ns));
            let (from_a, from_b) = match heads {
                [Some(a), Some(b)] => match a.cmp(&b) {
                    Ordering::Equal => (true, true),
                    Ordering::Less => (true, false),
                    Ordering::Greater => (false, true),
                },
                [a, b] if is_end && (a.is_some() || b.is_some()) => (a.is_some(), b.is_some()),
                _ => return,
            };
            let [a, b] = &mut self.waiting;
            let a = from_a.then(|| a.pop_front()).flatten();
            let b = from_b.then(|| b.pop_front()).flatten();
            self.hold_together(a, b);
        }
    }

    fn hold_together(&mut self, a: Option<TickInputs>, b: Option<TickInputs>) {
        self.inputs.add([&a, &b]);
        match (a, b) {
            (Some(a), Some(b)) => self.hold_both(&a, &b),
            (Some(only), None) => self.note_lonely(0, &only),
            (None, Some(only)) => self.note_lonely(1, &only),
            (None, None) => {}
        }
    }

    fn hold_both(&mut self, a: &TickInputs, b: &TickInputs) {
        self.found.ticks += 1;
        let mut apart = differences(&a.tick, &b.tick).map(|one| Apart::of(&one)).peekable();
        if apart.peek().is_none() {
            return;
        }
        self.found.differing += 1;
        self.found.force_n = self.found.force_n.max((a.tick.force_n - b.tick.force_n).abs());
        let steering_rad = (a.tick.steering_rad - b.tick.steering_rad).abs();
        self.found.steering_rad = self.found.steering_rad.max(steering_rad);
        if self.found.first.is_none() {
            self.found.first = Some(First {
                tick: a.tick.tick,
                time_s: a.tick.time_ns as f64 * 1e-9,
                what: What::Apart(apart.collect()),
                upstream: self.inputs.first_difference(),
            });
        }
    }

    fn note_lonely(&mut self, side: usize, only: &TickInputs) {
        self.found.only_in[side] += 1;
        if self.found.first_only.is_none() {
            self.found.first_only = Some(only.tick.time_ns as f64 * 1e-9);
        }
    }
}
