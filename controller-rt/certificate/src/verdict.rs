//! All checks of a gain, each with its number and its threshold.

use crate::check::{self, Checked, Part, Subject};
use crate::file::{CouplingProofs, GainFile, PlatoonProof, VehicleProofs};
use crate::form::Channel;
use crate::gain::{DelayBound, Gain, Plants, Rate};
use crate::margin;
use crate::proof::Wirtinger;
use crate::simulation::{Course, Leader, Run};
use crate::spectrum;

/// Constant delays looked at between none and the bound.
const DELAYS: usize = 5;
/// Followers of the simulated platoon.
const SIMULATED: usize = 3;
/// Seeds of every random course of the delays.
const SEEDS: u64 = 10;
/// Length of a simulated run \[s\].
const RUN_S: f64 = 24.0;
/// What may be left of an error at a run's end, relative to its peak.
const LEFT_MAX: f64 = 0.02;
/// A simulated gain may exceed the proven one by what the steps of the simulation cost.
const STEP_ERROR: f64 = 1.005;

/// What a gain is to be good for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// The plants it has to cope with.
    pub plants: Plants,
    /// The longest delay \[s\].
    pub longest_s: f64,
    /// Time between two messages \[s\].
    pub period_s: f64,
}

impl Conditions {
    /// Those a gain file names itself.
    #[must_use]
    pub fn of(file: &GainFile, period_s: f64) -> Self {
        Self { plants: file.plant, longest_s: file.delay.longest_s, period_s }
    }
}

/// What a number is held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Threshold {
    /// It must be less.
    Below(f64),
    /// It must be more.
    Above(f64),
    /// It is only told.
    None,
}

/// One line of a verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What was looked at.
    pub what: String,
    /// The number found.
    pub number: f64,
    /// What it is held against.
    pub threshold: Threshold,
    /// Whether it stands the test; true where there is none.
    pub is_passed: bool,
}

impl Finding {
    fn new(what: impl Into<String>, number: f64, threshold: Threshold) -> Self {
        let is_passed = match threshold {
            Threshold::Below(most) => number < most,
            Threshold::Above(least) => number > least,
            Threshold::None => true,
        };
        Self { what: what.into(), number, threshold, is_passed }
    }
}

/// All findings about a gain.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verdict {
    /// In the order they were made.
    pub findings: Vec<Finding>,
}

impl Verdict {
    /// Whether the gain is certified.
    #[must_use]
    pub fn is_certified(&self) -> bool {
        !self.findings.is_empty() && self.findings.iter().all(|finding| finding.is_passed)
    }

    fn add(&mut self, what: impl Into<String>, number: f64, threshold: Threshold) {
        self.findings.push(Finding::new(what, number, threshold));
    }
}

/// Checks everything.
#[must_use]
pub fn certify(file: &GainFile, conditions: &Conditions) -> Verdict {
    let mut verdict = proofs(file, conditions);
    margins(file, conditions, &mut verdict);
    peaks(file, conditions, &mut verdict);
    string(file, &mut verdict);
    runs(file, conditions, &mut verdict);
    verdict
}

/// Checks the one proof that an ECU asks for at its start: that the loop is stable under every
/// delay up to the bound, and how much of a disturbance it lets through. Where there is one for a
/// single truck it is that, which holds in a platoon of any length; it takes milliseconds.
#[must_use]
pub fn stability(file: &GainFile, conditions: &Conditions) -> Verdict {
    let mut file = file.clone();
    match &mut file.vehicle {
        Some(vehicle) => {
            vehicle.coupling = None;
            file.gain.k2 = [0.0; 3];
            file.platoon.clear();
        }
        None => file.platoon.sort_by_key(|proof| std::cmp::Reverse(proof.followers)),
    }
    file.platoon.truncate(1);
    proofs(&file, conditions)
}

/// Checks all proofs, and nothing but them.
#[must_use]
pub fn proofs(file: &GainFile, conditions: &Conditions) -> Verdict {
    let mut verdict = Verdict::default();
    let (plants, delay) = covering(file, conditions);
    let count = file.platoon.len() + usize::from(file.vehicle.is_some());
    verdict.add("proofs in the file", count as f64, Threshold::Above(0.0));
    if let Some(vehicle) = &file.vehicle {
        if vehicle.coupling.is_none() && file.gain.is_coupled() {
            verdict.add("one truck: proofs of what is forwarded", 0.0, Threshold::Above(0.0));
        }
        for (name, channel, proof) in channels(vehicle) {
            let subject = Subject { gain: file.gain, plants, part: Part::Vehicle(channel) };
            let checked = check::wirtinger(&subject, delay.longest_s, proof);
            add_proof(&mut verdict, &format!("one truck, {name}"), proof.gamma, checked);
        }
    }
    for PlatoonProof { followers, proof } in &file.platoon {
        let subject = Subject { gain: file.gain, plants, part: Part::Platoon(*followers) };
        let checked = check::jensen(&subject, delay, proof);
        add_proof(&mut verdict, &format!("{followers} followers"), proof.gamma, checked);
    }
    verdict
}

/// What the proofs are checked for: what the file says, unless more is asked for. A proof for a
/// longer delay holds for a shorter one, one for more plants for fewer.
fn covering(file: &GainFile, conditions: &Conditions) -> (Plants, DelayBound) {
    let is_covered = file.plant.cover(&conditions.plants);
    let plants = if is_covered { file.plant } else { conditions.plants };
    let longest_s = conditions.longest_s.max(file.delay.longest_s);
    (plants, DelayBound { longest_s, rate: file.delay.rate })
}

fn channels(vehicle: &VehicleProofs) -> Vec<(&'static str, Channel, &Wirtinger)> {
    let mut channels =
        vec![("w to error", Channel::DisturbanceToError, &vehicle.disturbance_to_error)];
    if let Some(coupling) = &vehicle.coupling {
        channels.extend([
            ("w to K2 x", Channel::DisturbanceToForwarded, &coupling.disturbance_to_forwarded),
            ("v to error", Channel::ForwardedToError, &coupling.forwarded_to_error),
            ("v to K2 x", Channel::ForwardedToForwarded, &coupling.forwarded_to_forwarded),
        ]);
    }
    channels
}

fn add_proof(verdict: &mut Verdict, name: &str, gamma: f64, checked: Checked) {
    let Checked { form_max, positive_min, is_exact } = checked;
    let of = format!("proof of gamma {gamma} ({name})");
    verdict.add(format!("{of}: largest eigenvalue"), form_max, Threshold::Below(0.0));
    verdict.add(format!("{of}: least of P, Z, ..."), positive_min, Threshold::Above(0.0));
    let exact = f64::from(u8::from(is_exact));
    verdict.add(format!("{of}: exact, 1 is yes"), exact, Threshold::Above(0.5));
}

fn margins(file: &GainFile, conditions: &Conditions, verdict: &mut Verdict) {
    let (gain, plants) = (&file.gain, &conditions.plants);
    let longest_s = conditions.longest_s;
    let margin_s = margin::least_over(plants, gain, margin::delay_margin_s);
    verdict.add("longest constant delay [s]", margin_s, Threshold::Above(longest_s));
    let any_s = margin::least_over(plants, gain, margin::any_rate_small_gain_s);
    verdict.add("longest delay at any rate, by small gain [s]", any_s, Threshold::None);
    for i in 0..=DELAYS {
        let delay_s = longest_s * i as f64 / DELAYS as f64;
        let left = |gain: &Gain, lag_s: f64| {
            spectrum::rightmost_root(gain, lag_s, delay_s)
                .map_or(f64::NEG_INFINITY, |root| -root.re)
        };
        let right = -margin::least_over(plants, gain, left);
        let what = format!("rightmost root at {delay_s:.3} s [1/s]");
        verdict.add(what, right, Threshold::Below(0.0));
    }
    let period_s = conditions.period_s;
    let latency_s = (longest_s - period_s).max(0.0);
    let radius = |gain: &Gain, lag_s: f64| {
        -spectrum::sampled_radius(gain, lag_s, period_s, latency_s).unwrap_or(f64::INFINITY)
    };
    let radius = -margin::least_over(plants, gain, radius);
    let what = format!("spectral radius, {period_s} s messages {latency_s:.3} s late");
    verdict.add(what, radius, Threshold::Below(1.0));
}

fn peaks(file: &GainFile, conditions: &Conditions, verdict: &mut Verdict) {
    let mut most = margin::Peaks { error: 0.0, forwarded: 0.0, gap: 0.0 };
    for i in 0..=DELAYS {
        let delay_s = conditions.longest_s * i as f64 / DELAYS as f64;
        for corner in conditions.plants.corners() {
            let gain = file.gain.through(corner.gain);
            let peaks = margin::peaks(&gain, corner.lag_s, delay_s);
            most.error = most.error.max(peaks.error);
            most.forwarded = most.forwarded.max(peaks.forwarded);
            most.gap = most.gap.max(peaks.gap);
        }
    }
    let gamma = file.first_gamma().map_or(Threshold::None, Threshold::Below);
    verdict.add("peak over frequency, w to error", most.error, gamma);
    verdict.add("peak over frequency, truck to truck", most.forwarded, Threshold::Below(1.0));
    verdict.add("peak over frequency, gap behind a lone brake", most.gap, Threshold::None);
}

/// The bound that no length of a platoon of equal trucks exceeds: a truck's error is what w does to
/// it directly, plus what all trucks ahead forward, a geometric series.
///
/// q is what a delay may do to the energy of a forwarded signal, 1/sqrt(1 - mu). Truck for truck
/// the delay may be another.
#[must_use]
pub fn string_bound(vehicle: &VehicleProofs, mu: f64) -> Option<f64> {
    mixed_string_bound(std::slice::from_ref(vehicle), mu)
}

/// The same for trucks that differ, in any order and any number of each: with the largest of each
/// of the four gains in the place of one truck's, |x_i| <= g1 |w| + gs |f|, |f| <= q (gw |w| +
/// gT |f ahead|), whatever truck is ahead. `None` when the series has no bound, or no truck is
/// given.
#[must_use]
pub fn mixed_string_bound(vehicles: &[VehicleProofs], mu: f64) -> Option<f64> {
    let own = |vehicle: &VehicleProofs| vehicle.disturbance_to_error.gamma;
    let own = vehicles.iter().map(own).max_by(f64::total_cmp)?;
    let largest = |of: fn(&CouplingProofs) -> &Wirtinger| {
        let gammas = vehicles.iter().filter_map(|vehicle| vehicle.coupling.as_ref());
        gammas.map(|coupling| of(coupling).gamma).fold(0.0, f64::max)
    };
    let q = 1.0 / (1.0 - mu).sqrt();
    let repeated = q * largest(|coupling| &coupling.forwarded_to_forwarded);
    let fed = q * largest(|coupling| &coupling.disturbance_to_forwarded);
    let taken = largest(|coupling| &coupling.forwarded_to_error);
    (repeated < 1.0).then(|| own + taken * fed / (1.0 - repeated))
}

fn string(file: &GainFile, verdict: &mut Verdict) {
    let Some(vehicle) = &file.vehicle else { return };
    if let Some(coupling) = &vehicle.coupling {
        let forwarded = coupling.forwarded_to_forwarded.gamma;
        verdict.add("string: proven gain truck to truck", forwarded, Threshold::Below(1.0));
    }
    for mu in [0.0, 0.5] {
        let bound = string_bound(vehicle, mu).unwrap_or(f64::INFINITY);
        let what = format!("string: bound for any number of trucks, rate below {mu}");
        verdict.add(what, bound, Threshold::Below(f64::INFINITY));
    }
}

fn runs(file: &GainFile, conditions: &Conditions, verdict: &mut Verdict) {
    let Conditions { longest_s, period_s, .. } = *conditions;
    let courses = [
        Course::Constant(1.0),
        Course::Sawtooth { period_s: longest_s },
        Course::Sawtooth { period_s },
        Course::BangBang,
        Course::Wander,
    ];
    let leaders = [
        Leader::Push { length_s: 1.0 },
        Leader::Push { length_s: 4.0 },
        Leader::Tone { w_radps: 1.0 },
        Leader::Tone { w_radps: 3.0 },
    ];
    let (mut left, mut first, mut all) = (0.0_f64, 0.0_f64, 0.0_f64);
    for corner in conditions.plants.corners() {
        for (course, leader) in courses.iter().flat_map(|c| leaders.iter().map(move |l| (c, l))) {
            let is_random = matches!(course, Course::BangBang | Course::Wander);
            for seed in 0..if is_random { SEEDS } else { 1 } {
                let run = Run {
                    gain: Gain { leader_feedforward: false, ..file.gain.through(corner.gain) },
                    lags_s: vec![corner.lag_s; SIMULATED],
                    longest_s,
                    course: *course,
                    leader: *leader,
                    duration_s: RUN_S,
                    seed: 1000 * (seed + 1),
                };
                let outcome = run.simulate();
                left = left.max(outcome.error_end_m / outcome.error_max_m);
                first = first.max(outcome.first_gain);
                all = all.max(outcome.platoon_gain);
            }
        }
    }
    verdict.add("runs: error left at the end, of its peak", left, Threshold::Below(LEFT_MAX));
    let bound = |gamma: Option<f64>| {
        let is_any = file.delay.rate == Rate::Any;
        gamma.filter(|_| is_any).map_or(Threshold::None, |g| Threshold::Below(g * STEP_ERROR))
    };
    verdict.add("runs: energy gain of the first truck", first, bound(file.first_gamma()));
    let three = file.platoon.iter().find(|p| p.followers == SIMULATED).map(|p| p.proof.gamma);
    verdict.add("runs: energy gain of three trucks", all, bound(three));
}
