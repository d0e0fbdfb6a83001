//! `platoon identify`: what the coordination layer really drives.
//!
//! Theorem 1 designs its gain for a truck that answers a command u_i with gain 1 and one lag
//! [MCF, Eq. 1]. Here the command becomes a reference speed, the motion layer turns that into force
//! and actuators and truck make an acceleration of it. One truck on a free road, its leader far
//! ahead at constant speed, is given known commands, waves and a step, in place of the coordination
//! law; its acceleration beside them is gain and lag of the whole. `docs/identification.md` has the
//! figures of this version.

mod response;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use bench_sim::{Rig, Scenario};
use law::{Calibration, CoordinationLaw, Excitation, Structure};
use serde::Serialize;

use crate::calibration;
use crate::cli::{IdentifyArgs, SolverKind};
use crate::failure::Failure;
use crate::process;
use crate::rehearse::virtual_time::{Experiment, as_it_is, observe};
use response::{Course, Fit, StepResponse, WaveResponse};

/// Lag the published gain fits best \[s\]: Theorem 1's plant for it, with gain 1.
const DESIGNED_LAG_S: f64 = 0.45;
/// Frequencies of the waves \[Hz\] and how long each is measured \[s\], in whole periods.
const WAVES: [(f64, f64); 5] = [(0.05, 40.0), (0.1, 20.0), (0.2, 20.0), (0.4, 10.0), (0.8, 10.0)];
/// Amplitude of the waves \[m/s²\]: the speed stays within the margin over the leader's.
const WAVE_MPS2: f64 = 0.3;
/// Height of the step \[m/s²\].
const STEP_MPS2: f64 = 0.5;
/// How long the step is followed \[s\].
const STEP_S: f64 = 4.0;
/// When the command begins \[s\]: the truck has settled at its speed.
const FROM_S: f64 = 2.0;
/// How long a wave lasts before it is measured \[s\].
const SWING_IN_S: f64 = 10.0;
/// The truck that is measured; the one before it is the leader.
const MEASURED: usize = 1;
/// A scripted leader who goes on as it is, out of sight of its only follower.
const FREE_ROAD: [(&str, &str); 7] = [
    ("name", "\"identify\""),
    ("description", "\"one truck on a free road\""),
    ("platoon.trucks", "2"),
    ("platoon.spacing_m", "400.0"),
    ("leader.accelerations", "[]"),
    ("v2v.delay_min_s", "0.0"),
    ("v2v.delay_max_s", "0.0"),
];

/// What one plant at one rate of the loop answers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Identified {
    /// The plant, as `plant.model` names it.
    pub plant: String,
    /// Rate of the control loop \[Hz\].
    pub rate_hz: u32,
    /// Lead time of the reference speed \[s\].
    pub lead_time_s: f64,
    /// The lag of first order nearest to the waves' answers.
    pub fit: Fit,
    /// The waves' answers.
    pub waves: Vec<WaveResponse>,
    /// The step's answer.
    pub step: StepResponse,
}

/// Identifies every plant at every rate asked for, prints the table and writes the JSON.
///
/// # Errors
/// When a plant cannot be run or the file not be written.
pub fn run(args: &IdentifyArgs) -> Result<(), Failure> {
    let stop = process::stop_flag()?;
    let benches: Vec<Bench> = args
        .plant
        .iter()
        .flat_map(|plant| args.rate_hz.iter().map(move |&rate_hz| (plant, rate_hz)))
        .map(|(plant, rate_hz)| Bench::new(plant, rate_hz, &args.set, &stop))
        .collect::<Result<_, _>>()?;
    let found = thread::scope(|scope| {
        let threads: Vec<_> =
            benches.iter().map(|bench| scope.spawn(|| bench.identify())).collect();
        let join =
            |thread: thread::ScopedJoinHandle<'_, _>| thread.join().expect("a run never panics");
        threads.into_iter().map(join).collect::<Result<Vec<Identified>, Failure>>()
    })?;
    print(&found);
    args.json.as_ref().map_or(Ok(()), |path| process::write_json(path, &found))
}

/// One plant and one loop rate, ready to be excited.
struct Bench {
    plant: String,
    scenario: Scenario,
    calibration: Calibration,
    rate_hz: u32,
    stop: Arc<AtomicBool>,
}

impl Bench {
    fn new(
        plant: &str,
        rate_hz: u32,
        overrides: &[(String, String)],
        stop: &Arc<AtomicBool>,
    ) -> Result<Self, Failure> {
        let owned = |(key, value): (&str, &str)| (key.to_owned(), value.to_owned());
        let mut sets: Vec<_> = FREE_ROAD.map(owned).into();
        sets.push(owned(("plant.model", plant)));
        sets.extend(overrides.iter().cloned());
        let scenario = Scenario::load("platooning", &sets).map_err(Failure::usage)?;
        let mut calibration = calibration::from_table(&scenario.name, &scenario.law)?;
        calibration.structure = Structure::Mcf;
        calibration.ucl.law = CoordinationLaw::Excitation;
        Ok(Self { plant: plant.to_owned(), scenario, calibration, rate_hz, stop: stop.clone() })
    }

    fn identify(&self) -> Result<Identified, Failure> {
        let waves: Vec<WaveResponse> =
            WAVES.into_iter().map(|wave| self.wave(wave)).collect::<Result<_, _>>()?;
        Ok(Identified {
            plant: self.plant.clone(),
            rate_hz: self.rate_hz,
            lead_time_s: self.calibration.ucl.lead_time_s,
            fit: Fit::of(&waves),
            waves,
            step: self.step()?,
        })
    }

    fn wave(&self, (frequency_hz, measured_s): (f64, f64)) -> Result<WaveResponse, Failure> {
        let wave = Excitation { amplitude_mps2: WAVE_MPS2, frequency_hz, from_s: FROM_S };
        let course = self.excite(wave, FROM_S + SWING_IN_S, measured_s)?;
        Ok(WaveResponse::of(&course, &wave))
    }

    fn step(&self) -> Result<StepResponse, Failure> {
        let step = Excitation { amplitude_mps2: STEP_MPS2, frequency_hz: 0.0, from_s: FROM_S };
        Ok(StepResponse::of(&self.excite(step, FROM_S, STEP_S)?, &step))
    }

    /// The acceleration under a command, seen for `seen_s` from `from_s` on.
    fn excite(&self, command: Excitation, from_s: f64, seen_s: f64) -> Result<Course, Failure> {
        let mut calibration = self.calibration;
        calibration.ucl.excitation = command;
        let scenario = Scenario { duration_s: from_s + seen_s, ..self.scenario.clone() };
        let experiment = Experiment {
            scenario: &scenario,
            calibration,
            gain_id: 0,
            solver: SolverKind::ActiveSet,
            rate_hz: self.rate_hz,
            seed: 1,
            without_emergency_braking: false,
            faults: &[],
        };
        let (mut course, half_tick_s) = (Course::new(), 0.5 / f64::from(self.rate_hz));
        let mut watch = |rig: &Rig| {
            let time_s = 1e-9 * rig.time_ns() as f64;
            if time_s > from_s - half_tick_s {
                course.push((time_s, rig.truth().trucks[MEASURED].accel_forward_mps2));
            }
        };
        observe(&experiment, self.stop.clone(), None, Box::new(as_it_is), &mut watch)?;
        if self.stop.load(Ordering::Relaxed) {
            return Err(Failure::cannot_start("identify: interrupted; nothing was measured"));
        }
        Ok(course)
    }
}

/// The table, a row for every plant and rate.
fn print(found: &[Identified]) {
    anstream::println!(
        "{:12} {:>5} {:>6} {:>6} {:>6} {:>6}  {:>5} {:>6} {:>6}  lag by frequency (Hz)",
        "plant",
        "Hz",
        "Tv s",
        "gain",
        "lag s",
        "error",
        "step",
        "63 % s",
        "over"
    );
    for one in found {
        let lags: String = one
            .waves
            .iter()
            .map(|wave| format!("{} {:.3}  ", wave.frequency_hz, wave.lag_s))
            .collect();
        anstream::println!(
            "{:12} {:5} {:6.2} {:6.3} {:6.3} {:4.1} %  {:5.3} {:6.3} {:4.1} %  {}",
            one.plant,
            one.rate_hz,
            one.lead_time_s,
            one.fit.gain,
            one.fit.lag_s,
            100.0 * one.fit.error,
            one.step.gain,
            one.step.rise_s,
            100.0 * one.step.overshoot,
            lags.trim_end()
        );
    }
    anstream::println!("the published gain is designed for gain 1 and a lag of {DESIGNED_LAG_S} s");
}
