//! Many runs in virtual time: cells of scenario, law and seed, spread over threads.
//!
//! Nothing is recorded but what a cell asks for. Every cell is a run of its own with nothing
//! shared, so what comes back depends neither on the number of threads nor on who ran first.

#[cfg(test)]
mod tests;
mod trajectory;

use std::num::NonZero;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use bench_sim::{Results, Scenario};
use controller_rt::Report;
use law::Calibration;

use platoon_dbc::Profile;

use crate::calibration;
use crate::cli::{ControllerKind, LawArgs, SolverKind};
use crate::failure::Failure;
use crate::fault::Fault;
use crate::gain::{self, Settled};
use crate::rehearse::virtual_time::{Experiment, observe};

pub use trajectory::{Moment, ObstacleMoment, Sampling, Trajectory, TruckMoment};
use trajectory::{Overheard, Sampler};

/// One run to be made.
#[derive(Debug, Clone)]
pub struct Cell {
    /// The scenario, every override applied.
    pub scenario: Scenario,
    /// The law's numbers.
    pub calibration: Calibration,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// How closely the trucks are followed.
    pub sampling: Sampling,
    /// What breaks, and when.
    pub faults: Vec<Fault>,
    /// Number of the law's gain in the ECUs' states.
    pub gain_id: u8,
    /// QP solver of the motion layer.
    pub solver: SolverKind,
    /// Whether the guards' emergency layer is off.
    pub without_emergency_braking: bool,
}

impl Cell {
    /// A cell of a scenario by name, with overrides and a controller; seed 1, nothing sampled,
    /// nothing broken.
    ///
    /// # Errors
    /// When the scenario or its law makes no sense.
    pub fn new(
        scenario: &str,
        sets: &[(String, String)],
        controller: Option<ControllerKind>,
        rate_hz: u32,
    ) -> Result<Self, Failure> {
        let scenario = Scenario::load(scenario, sets).map_err(Failure::usage)?;
        let mut calibration = calibration::from_table(&scenario.name, &scenario.law)?;
        if let Some(controller) = controller {
            calibration.structure = controller.into();
        }
        Ok(Self {
            scenario,
            calibration,
            rate_hz,
            seed: 1,
            sampling: Sampling::default(),
            faults: Vec::new(),
            gain_id: 0,
            solver: SolverKind::ActiveSet,
            without_emergency_braking: false,
        })
    }

    /// The same cell with its law run as the options say, if its gain may drive what it drives.
    ///
    /// # Errors
    /// When there is no such gain, or it is not certified and nobody allowed that.
    pub fn with_law(self, options: &LawArgs) -> Result<Self, Failure> {
        let calibration = calibration::asked_for(self.calibration, options, Profile::Fd)?;
        let trucks = self.scenario.platoon.trucks;
        let Settled { calibration, gain_id, .. } =
            gain::settled(calibration, options, Some(trucks))?;
        Ok(Self {
            calibration,
            gain_id,
            solver: options.solver,
            without_emergency_braking: options.no_emergency_braking,
            ..self
        })
    }

    /// What is run.
    pub fn experiment(&self) -> Experiment<'_> {
        Experiment {
            scenario: &self.scenario,
            calibration: self.calibration,
            gain_id: self.gain_id,
            solver: self.solver,
            rate_hz: self.rate_hz,
            seed: self.seed,
            without_emergency_braking: self.without_emergency_braking,
            faults: &self.faults,
        }
    }

    /// Bench time it covers \[s\].
    fn duration_s(&self) -> f64 {
        self.scenario.duration_s
    }

    /// What it costs, in seconds of bench time of one truck at 1 Hz.
    fn cost(&self) -> f64 {
        self.duration_s() * self.scenario.platoon.trucks as f64 * f64::from(self.rate_hz)
    }
}

/// What one cell came to.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// What the rig saw.
    pub results: Results,
    /// What each ECU reports.
    pub ecus: Vec<Report>,
    /// The trucks' way, as closely as the cell asked for.
    pub trajectory: Trajectory,
    /// Least distance of a truck to an obstacle at the moment that one appears \[m\].
    pub spawn_clearance_m: Option<f64>,
}

impl Outcome {
    /// QPs of all ECUs that were not solved.
    pub fn qp_failures(&self) -> u64 {
        self.ecus.iter().map(|ecu| ecu.qp.failures).sum()
    }

    /// How often a guard's emergency layer began to brake.
    pub fn emergency_brakings(&self) -> u64 {
        self.ecus.iter().map(|ecu| u64::from(ecu.emergency_brakings)).sum()
    }
}

/// As many threads as this process may use at once.
pub fn threads() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get)
}

/// Runs every cell; the outcomes are in the cells' order. `None` when `stop` was set before the
/// end. `tell` hears of every cell that is done: how many are, and the share of all the work.
///
/// # Errors
/// When a cell cannot start; the others are given up.
pub fn run(
    cells: &[Cell],
    threads: usize,
    stop: &Arc<AtomicBool>,
    tell: &(dyn Fn(usize, f64) + Sync),
) -> Result<Option<Vec<Outcome>>, Failure> {
    // The longest first, so that no thread is left with one at the end.
    let mut order: Vec<usize> = (0..cells.len()).collect();
    order.sort_by(|&a, &b| cells[b].cost().total_cmp(&cells[a].cost()));
    let total: f64 = cells.iter().map(Cell::cost).sum();
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let done = Mutex::new((0_usize, 0.0_f64));
    let ended: Mutex<Vec<Option<Result<Outcome, Failure>>>> =
        Mutex::new(cells.iter().map(|_| None).collect());
    let work = || {
        while !stop.load(Ordering::Relaxed) && !failed.load(Ordering::Relaxed) {
            let Some(&index) = order.get(next.fetch_add(1, Ordering::Relaxed)) else {
                return;
            };
            let outcome = one(&cells[index], stop);
            failed.fetch_or(outcome.is_err(), Ordering::Relaxed);
            ended.lock().expect("no thread panics with it")[index] = Some(outcome);
            let mut done = done.lock().expect("no thread panics with it");
            *done = (done.0 + 1, done.1 + cells[index].cost());
            tell(done.0, done.1 / total);
        }
    };
    thread::scope(|scope| {
        for _ in 0..threads.clamp(1, cells.len().max(1)) {
            scope.spawn(work);
        }
    });
    let ended = ended.into_inner().expect("no thread panicked");
    if let Some(Err(_)) = ended.iter().flatten().find(|outcome| outcome.is_err()) {
        let first = ended.into_iter().flatten().find_map(Result::err);
        return Err(first.expect("one has just been found"));
    }
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    Ok(ended.into_iter().map(|outcome| outcome.and_then(Result::ok)).collect())
}

/// Runs one cell.
fn one(cell: &Cell, stop: &Arc<AtomicBool>) -> Result<Outcome, Failure> {
    let overheard = Overheard::of(cell.scenario.platoon.trucks);
    let mut sampler = Sampler::new(cell, &overheard);
    let wrap = Box::new(|truck, law| overheard.wrap(truck, law));
    let mut watch = |rig: &_| sampler.see(rig);
    let observed = observe(&cell.experiment(), Arc::clone(stop), None, wrap, &mut watch)?;
    let (trajectory, spawn_clearance_m) = sampler.end();
    Ok(Outcome { results: observed.results, ecus: observed.ecus, trajectory, spawn_clearance_m })
}
