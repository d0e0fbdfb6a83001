//! Lemma 1's uniformity: the same disturbance at another time has the same effect.
//!
//! The delays vary with time, so the closed loop is no time-invariant system, and "asymptotically
//! stable" and "uniformly asymptotically stable" are two claims. We let the leader's manoeuvre
//! begin at several times and compare the envelopes of the errors, the largest |ŝ_i| of any truck
//! and seed at the same time after the beginning.

use serde::{Deserialize, Serialize};

use super::arm::{Contender, MANOEUVRE_S, Plant, START_DELAYS_S, Situation};
use super::design::{Design, Runs};
use super::figure::{Axis, Body, Curve, Curves, Figure, Ink, Panel};
use super::measure;
use crate::campaign::Outcome;

/// How far two envelopes may be apart and still coincide \[m\].
pub const BAND_M: f64 = 0.10;
/// Distance between two points of an envelope \[s\].
const GRID_S: f64 = 0.05;
/// The leader's script begins this long after the start of the run or of its delay \[s\].
const QUIET_S: f64 = 1.0;

/// The envelopes, one for each beginning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uniformity {
    /// One for every beginning of the manoeuvre; the first is what the others are held against.
    pub beginnings: Vec<Beginning>,
    /// Furthest that any envelope is from the first one \[m\].
    pub largest_difference_m: f64,
    /// How far they may be \[m\].
    pub band_m: f64,
    /// Whether they coincide within that band.
    pub holds: bool,
}

/// The manoeuvre with one beginning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Beginning {
    /// When the leader's manoeuvre begins \[s\].
    pub begins_s: f64,
    /// Largest |ŝ_i| of any truck and seed \[m\].
    pub peak_m: f64,
    /// When the envelope is below 0.1 m for good, after the beginning \[s\].
    pub settled_s: f64,
    /// Furthest that this envelope is from the first one \[m\].
    pub difference_m: f64,
    /// The envelope: time after the beginning \[s\], largest |ŝ_i| \[m\].
    #[serde(skip)]
    pub envelope: Vec<(f64, f64)>,
}

impl Uniformity {
    /// The envelopes; `None` when the runs were not made.
    pub fn of(design: &Design, runs: &Runs) -> Option<Self> {
        let mut beginnings = Vec::new();
        for seconds in START_DELAYS_S {
            let situation = Situation::PlatooningLater(seconds);
            let arm = design.arm(situation, Contender::MCF, Plant::SingleTrack);
            let outcomes = Some(runs.of(arm)).filter(|outcomes| !outcomes.is_empty())?;
            beginnings.push(Beginning::of(outcomes, f64::from(seconds)));
        }
        let reference = beginnings.first()?.envelope.clone();
        for beginning in &mut beginnings {
            beginning.difference_m = furthest_apart_m(&beginning.envelope, &reference);
        }
        let differences = beginnings.iter().map(|beginning| beginning.difference_m);
        let largest_difference_m = differences.fold(0.0, f64::max);
        let holds = largest_difference_m <= BAND_M;
        Some(Self { beginnings, largest_difference_m, band_m: BAND_M, holds })
    }

    /// The envelopes on top of each other.
    pub fn figure(&self) -> Figure {
        let curve = |(place, beginning): (usize, &Beginning)| Curve {
            name: format!("from {:.0} s", beginning.begins_s),
            ink: Ink::nth(place),
            points: beginning.envelope.clone(),
            band: Vec::new(),
        };
        Figure {
            of: "Lemma 1".into(),
            file: "lemma1".into(),
            title: "The same manoeuvre at other times".into(),
            caption: "Envelopes of the error to the leader, the largest of every truck and seed, \
                      for the leader's manoeuvre beginning at several times under delays that vary \
                      with time."
                .into(),
            panels: vec![Panel {
                title: String::new(),
                body: Body::Curves(Curves {
                    x: Axis::new("Time since the manoeuvre began", "s"),
                    y: Axis::new("Largest error to leader", "m"),
                    curves: self.beginnings.iter().enumerate().map(curve).collect(),
                }),
            }],
        }
    }
}

impl Beginning {
    fn of(outcomes: &[Outcome], delay_s: f64) -> Self {
        let begins_s = delay_s + QUIET_S;
        let points = ((MANOEUVRE_S - QUIET_S) / GRID_S) as usize;
        let envelope: Vec<(f64, f64)> = (0..points)
            .map(|place| GRID_S * place as f64)
            .map(|after_s| (after_s, largest_m(outcomes, begins_s + after_s)))
            .collect();
        let outside = envelope.iter().rev().find(|(_, error_m)| *error_m > 0.1);
        Self {
            begins_s,
            peak_m: envelope.iter().map(|(_, error_m)| *error_m).fold(0.0, f64::max),
            settled_s: outside.map_or(0.0, |(after_s, _)| *after_s),
            difference_m: 0.0,
            envelope,
        }
    }
}

/// The largest |ŝ_i| of any truck and run about an instant \[m\].
fn largest_m(outcomes: &[Outcome], time_s: f64) -> f64 {
    // Half a point of the grid to either side, so that slow loops have a sample there, too.
    let about = (time_s - 0.5 * GRID_S, time_s + 0.5 * GRID_S);
    let trucks = |outcome: &Outcome| outcome.results.trucks.len();
    let errors = outcomes.iter().flat_map(|outcome| {
        (1..trucks(outcome))
            .flat_map(move |truck| measure::between(outcome, truck, about, |m| m.leader_error_m))
    });
    errors.map(f64::abs).fold(0.0, f64::max)
}

fn furthest_apart_m(one: &[(f64, f64)], other: &[(f64, f64)]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a.1 - b.1).abs()).fold(0.0, f64::max)
}
