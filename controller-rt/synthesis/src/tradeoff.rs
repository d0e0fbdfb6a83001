//! What a gain is good for is more than its gamma: the choice among designs.
//!
//! Small errors, long delays and small commands pull a gain in different directions. Two numbers of
//! a design move it between them: the delay it is designed for, beyond the one that is asked for,
//! and the weight of the command. A grid of both gives candidates; each is judged for what is asked
//! by the gamma that Jensen's inequality proves, by its margins in closed form, and by what it does
//! in the paper's platooning manoeuvre. Nothing of that is a proof of more than gamma: the gain
//! that is chosen gets its own.

use certificate::simulation::Run;
use certificate::{DelayBound, Gain, Plants, margin};

use crate::plant::Platoon;
use crate::{Undesigned, Unsolved, analysis, convex};

/// Delays of the designs, times the one that is asked for.
const STRETCHES: [f64; 5] = [1.0, 1.15, 1.3, 1.5, 1.75];
/// Weights of the command \[s²\].
const WEIGHTS: [f64; 6] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3];
/// Where every design looks for its rho.
const RHO_GRID: [f64; 4] = [0.4, 0.6, 0.8, 1.2];

/// A gain by what it is good for, over all plants it is for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The gain.
    pub gain: Gain,
    /// What Jensen's inequality proves from the disturbance to the error, for the delays asked for
    /// at any rate.
    pub gamma: f64,
    /// Longest constant delay \[s\].
    pub margin_s: f64,
    /// Longest delay at any rate, by small gain \[s\].
    pub any_rate_s: f64,
    /// Largest error while the leader does 2 m/s² for a second \[m\].
    pub error_m: f64,
    /// Largest command in the same \[m/s²\].
    pub command_mps2: f64,
}

/// What a gain is chosen by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// The least gamma.
    Gamma,
    /// The longest constant delay.
    Margin,
    /// The least of the largest commands.
    Command,
    /// The gain that gives up least, relative to the best in each of the three.
    Balanced,
}

/// What a candidate must keep to be chosen at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Gamma at most.
    pub gamma_max: f64,
    /// Longest constant delay at least \[s\].
    pub margin_min_s: f64,
    /// Largest command at most \[m/s²\].
    pub command_max_mps2: f64,
}

impl Limits {
    /// None.
    pub const NONE: Self =
        Self { gamma_max: f64::INFINITY, margin_min_s: 0.0, command_max_mps2: f64::INFINITY };

    fn admit(&self, one: &Candidate) -> bool {
        one.gamma <= self.gamma_max
            && one.margin_s >= self.margin_min_s
            && one.command_mps2 <= self.command_max_mps2
    }
}

impl Candidate {
    /// Judges a gain.
    ///
    /// # Errors
    /// When no gamma can be proven.
    pub fn of(gain: Gain, plants: &Plants, longest_s: f64) -> Result<Self, Unsolved> {
        let corner = |plant| {
            let open = Platoon::alike(1, plant);
            open.closed(&open.k(&gain))
        };
        let loops: Vec<_> = plants.corners().into_iter().map(corner).collect();
        let gamma = analysis::jensen_gamma(&loops, DelayBound::any_rate(longest_s))?;
        let (mut error_m, mut command_mps2) = (0.0_f64, 0.0_f64);
        for corner in plants.corners() {
            let run = Run::ramp(gain.through(corner.gain), corner.lag_s);
            let outcome = run.simulate();
            error_m = error_m.max(outcome.error_max_m);
            command_mps2 = command_mps2.max(outcome.command_max_mps2 / corner.gain);
        }
        Ok(Self {
            gain,
            gamma,
            margin_s: margin::least_over(plants, &gain, margin::delay_margin_s),
            any_rate_s: margin::least_over(plants, &gain, margin::any_rate_small_gain_s),
            error_m,
            command_mps2,
        })
    }

    /// At least as good in gamma, margin and command.
    #[must_use]
    pub fn is_as_good_as(&self, other: &Self) -> bool {
        self.gamma <= other.gamma
            && self.margin_s >= other.margin_s
            && self.command_mps2 <= other.command_mps2
    }
}

/// Designs the candidates; `progress` hears of every design, with its number and how many there
/// are.
///
/// # Errors
/// When there is not a single one.
pub fn candidates(
    plants: &Plants,
    longest_s: f64,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<Candidate>, Undesigned> {
    let grid = STRETCHES.iter().flat_map(|stretch| WEIGHTS.iter().map(move |w| (*stretch, *w)));
    let count = STRETCHES.len() * WEIGHTS.len();
    let mut found = Vec::new();
    for (number, (stretch, weight)) in grid.enumerate() {
        progress(number + 1, count);
        let corners: Vec<Platoon> = plants
            .corners()
            .into_iter()
            .map(|plant| Platoon { command_weight: weight, ..Platoon::alike(1, plant) })
            .collect();
        let delay = DelayBound::any_rate(stretch * longest_s);
        let tangents = RHO_GRID.iter().filter_map(|rho| convex::at_rho(&corners, delay, *rho).ok());
        let Some(best) = tangents.min_by(|a, b| a.gamma.total_cmp(&b.gamma)) else { continue };
        let k1 = [0, 1, 2].map(|state| best.k[(0, state)]);
        let gain = Gain { k1, ..Gain::default() };
        found.extend(Candidate::of(gain, plants, longest_s));
    }
    if found.is_empty() { Err(Unsolved::Infeasible.into()) } else { Ok(found) }
}

/// Those that no other is as good as in gamma, margin and command, from least gamma.
#[must_use]
pub fn front(candidates: &[Candidate]) -> Vec<Candidate> {
    let is_beaten =
        |one: &Candidate| candidates.iter().any(|other| other != one && other.is_as_good_as(one));
    let mut front: Vec<Candidate> =
        candidates.iter().filter(|one| !is_beaten(one)).copied().collect();
    front.sort_by(|a, b| a.gamma.total_cmp(&b.gamma));
    front
}

/// The candidate that serves the objective best within the limits; `None` when none keeps them.
#[must_use]
pub fn choose(
    candidates: &[Candidate],
    objective: Objective,
    limits: &Limits,
) -> Option<Candidate> {
    let kept: Vec<&Candidate> = candidates.iter().filter(|one| limits.admit(one)).collect();
    let least =
        |of: fn(&Candidate) -> f64| kept.iter().map(|one| of(one)).fold(f64::INFINITY, f64::min);
    let cost = |one: &Candidate| match objective {
        Objective::Gamma => one.gamma,
        Objective::Margin => -one.margin_s,
        Objective::Command => one.command_mps2,
        Objective::Balanced => {
            let gamma = one.gamma / least(|one| one.gamma);
            let delay = least(|one| -one.margin_s) / -one.margin_s;
            gamma.max(delay).max(one.command_mps2 / least(|one| one.command_mps2))
        }
    };
    kept.iter().min_by(|a, b| cost(a).total_cmp(&cost(b))).map(|one| **one)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate([gamma, margin_s, command_mps2]: [f64; 3]) -> Candidate {
        let gain = Gain::default();
        Candidate { gain, gamma, margin_s, any_rate_s: 0.3, error_m: 0.5, command_mps2 }
    }

    #[test]
    fn the_choice_follows_the_objective_within_the_limits() {
        let sharp = candidate([0.4, 0.3, 4.0]);
        let patient = candidate([0.8, 0.6, 3.0]);
        let gentle = candidate([0.9, 0.5, 2.5]);
        let even = candidate([0.5, 0.5, 3.0]);
        let beaten = candidate([0.9, 0.4, 4.0]);
        let all = [beaten, gentle, patient, even, sharp];
        assert_eq!(front(&all), [sharp, even, patient, gentle]);
        let choose = |objective| choose(&all, objective, &Limits::NONE);
        assert_eq!(choose(Objective::Gamma), Some(sharp));
        assert_eq!(choose(Objective::Margin), Some(patient));
        assert_eq!(choose(Objective::Command), Some(gentle));
        assert_eq!(choose(Objective::Balanced), Some(even));
        let limits = Limits { command_max_mps2: 3.5, ..Limits::NONE };
        assert_eq!(super::choose(&all, Objective::Gamma, &limits), Some(even));
        let none = Limits { gamma_max: 0.1, ..Limits::NONE };
        assert_eq!(super::choose(&all, Objective::Gamma, &none), None);
    }
}
