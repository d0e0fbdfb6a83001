//! A rehearsal in virtual time: one thread alternates rig and ECUs, bit-identical for a seed.
//!
//! On ideal buses an ECU ticks right after the rig has published, and its command is there at once.
//! On emulated ones it ticks half a period later, as in real time, with what has arrived by then;
//! its own frames take their time too. Thinking takes no time in either.

use std::sync::atomic::{AtomicBool, Ordering};

use bench_sim::Rig;
use controller_rt::{Config, Ecu, Slot};
use platoon_dbc::{Bus, Clock, EcuMode, Emulated, Loopback};
use traces::{Overflow, Source};

use super::{Outcome, Plan};
use crate::bench::{LOOPBACK_FRAMES, recording_loss};
use crate::calibration;
use crate::clock::HostClock;
use crate::failure::Failure;
use crate::fault::{Fault, FaultKind};
use crate::process;
use crate::progress::ProgressLine;
use crate::run_folder::RunFolder;

/// Ticks between two looks at progress and Ctrl-C.
const TICKS_PER_LOOK: u32 = 64;

/// Runs the plan as fast as the processor allows.
///
/// # Errors
/// When the run cannot start.
pub(super) fn run(plan: &Plan<'_>, folder: &RunFolder) -> Result<Outcome, Failure> {
    let stop = process::stop_flag()?;
    let clock = HostClock::default();
    let (mut rig, mut ecus) = assemble(plan, folder)?;
    rig.invite();
    for ecu in ecus.iter_mut().flatten() {
        ecu.prepare(&clock);
    }
    if !rig.ready() {
        return Err(Failure::cannot_start("an ECU did not answer its invitation on loopback"));
    }
    rig.start();
    for ecu in ecus.iter_mut().flatten() {
        ecu.prepare(&clock);
    }
    let interrupted = alternate(plan, &mut rig, &mut ecus, &clock, &stop);
    rig.end();
    let mut outcome = Outcome { interrupted, results: Some(rig.results()), ..Outcome::default() };
    for mut ecu in ecus.into_iter().flatten() {
        ecu.prepare(&clock);
        outcome.ecus.push(ecu.finish(&clock));
    }
    // Their last words belong to the recording.
    rig.listen();
    outcome.notes.extend(rig.take_recorder().and_then(recording_loss));
    outcome.notes.extend(interrupted.then(|| "interrupted".to_owned()));
    outcome.notes.extend(plan.args.fault.iter().map(|fault| format!("fault injected: {fault}")));
    Ok(outcome)
}

/// Rig and ECUs, one place per truck, joined by loopback buses.
fn assemble(plan: &Plan<'_>, folder: &RunFolder) -> Result<(Rig, Vec<Option<Ecu>>), Failure> {
    let mut ends: Vec<Box<dyn Bus>> = Vec::new();
    let mut ecus = Vec::new();
    for truck in 0..plan.trucks() as u8 {
        let (rig_end, ecu_end) = Loopback::pair(&format!("loopback{truck}"), LOOPBACK_FRAMES);
        ends.push(if plan.is_emulated() {
            let timing = plan.args.run.profile.timing();
            Box::new(Emulated::new(rig_end, timing).stamping_bench_time())
        } else {
            Box::new(rig_end)
        });
        if !plan.scenario.has_ecu(usize::from(truck)) {
            ecus.push(None);
            continue;
        }
        let source = Source::Ecu(truck);
        let interfaces = vec![ecu_end.name().to_owned()];
        let recorder = process::recorder(folder, source, Overflow::Wait, interfaces)?;
        let law = calibration::controller(plan.calibration, &plan.args.law_options);
        let config = Config {
            truck,
            profile: plan.args.run.profile,
            vehicle: calibration::vehicle(&plan.calibration),
            ..Config::default()
        };
        ecus.push(Some(Ecu::new(config, Box::new(ecu_end), law, Some(recorder))));
    }
    let names = process::bus_names(&ends);
    let recorder = process::recorder(folder, Source::Rig, Overflow::Wait, names)?;
    let run = &plan.args.run;
    let rig = Rig::new(&plan.scenario, run.seed, plan.rate_hz, ends, Some(recorder))
        .map_err(Failure::usage)?;
    Ok((rig.speaking(run.profile), ecus))
}

/// Tick by tick until the scenario ends; true when somebody interrupted it.
fn alternate(
    plan: &Plan<'_>,
    rig: &mut Rig,
    ecus: &mut [Option<Ecu>],
    clock: &dyn Clock,
    stop: &AtomicBool,
) -> bool {
    let line = ProgressLine::new(plan.scenario.duration_s);
    let period_ns = rig.base_step_ns() * rig.steps_per_tick();
    let mut interrupted = false;
    while !rig.finished() && !interrupted {
        let tick = rig.tick();
        let time_ns = rig.time_ns();
        let time_s = time_ns as f64 * 1e-9;
        let middle_ns = time_ns + period_ns / 2;
        let steps_before = if plan.is_emulated() { rig.steps_per_tick() / 2 } else { 0 };
        for _ in 0..steps_before {
            rig.step();
        }
        if plan.is_emulated() {
            rig.service(middle_ns);
        }
        for (truck, slot) in ecus.iter_mut().enumerate() {
            match stopped(&plan.args.fault, truck as u8, time_s) {
                Some(FaultKind::KillEcu) => drop(slot.take()),
                Some(FaultKind::PauseEcu { .. }) => (),
                None => {
                    if let Some(ecu) = slot {
                        tick_if_running(ecu, Slot::on_time(tick, period_ns, clock), clock);
                    }
                }
            }
        }
        if plan.is_emulated() {
            // What the ECUs have just sent is queued now.
            rig.service(middle_ns);
        }
        for _ in steps_before..rig.steps_per_tick() {
            rig.step();
        }
        if tick.is_multiple_of(TICKS_PER_LOOK) {
            line.show(time_s, plan.scenario.duration_s);
            interrupted = stop.load(Ordering::Relaxed);
        }
    }
    line.clear();
    interrupted
}

/// An ECU that has not heard of the run yet keeps waiting for it.
fn tick_if_running(ecu: &mut Ecu, slot: Slot, clock: &dyn Clock) {
    let is_waiting = |ecu: &Ecu| matches!(ecu.mode(), EcuMode::Waiting | EcuMode::Ready);
    if is_waiting(ecu) {
        ecu.prepare(clock);
    }
    if !is_waiting(ecu) {
        ecu.tick(slot, clock);
    }
}

/// The fault that keeps an ECU from ticking now.
fn stopped(faults: &[Fault], truck: u8, time_s: f64) -> Option<FaultKind> {
    faults.iter().find(|fault| fault.stops(truck, time_s)).map(|fault| fault.kind)
}
