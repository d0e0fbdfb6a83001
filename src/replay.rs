//! `platoon replay`: every command of a recorded run once more, from the frames its ECUs consumed.
//!
//! The recorded frames and times of each ECU go to the same inbox, picture, law, guard and outbox;
//! whatever a tick came to must come out again, bit for bit, through late and skipped ticks, capped
//! QPs and interventions of the guard. Where records are missing, the ECU's next snapshot is
//! where it goes on. And what an ECU consumed must be what was on its bus.

mod account;
mod audit;
mod recomputation;
mod wire;

use std::collections::BTreeMap;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, ScopedJoinHandle};
use std::time::Instant;

use traces::{Source, Topic};

use crate::capture::CAPTURE;
use crate::cli::{ReplayArgs, SolverKind};
use crate::failure::Failure;
use crate::process;
use crate::summary::Verdict;
use crate::trace::{EXTRACT, Event, Trace, seconds};

use account::{Account, Outcome};
use recomputation::Recomputation;

pub use recomputation::Question;

/// Longest bench time between two snapshots of an ECU, and some for the ticks they take \[ns\].
pub const SNAPSHOT_REACH_NS: u64 = 10_500_000_000;
/// Events handed to an ECU's thread at once, and how many such batches may wait for it.
const BATCH: usize = 1024;
const BATCHES_WAITING: usize = 16;

/// Recomputes a run and says whether it is the same.
///
/// # Errors
/// When the trace cannot be read, or holds nothing to recompute.
pub fn run(args: &ReplayArgs) -> Result<Verdict, Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let began = Instant::now();
    let trace = Trace::open(&args.run)?;
    let question = question(&trace, args)?;
    let outcome = recompute(&trace, &question)?;
    if outcome.ecus.iter().all(|account| account.ticks == 0) {
        return Err(Failure::usage(format!(
            "{}: holds no tick to recompute{}; is it a run of ECUs, and does it last until --from?",
            trace.path().display(),
            args.ecu.map_or_else(String::new, |ecu| format!(" of ECU {ecu}"))
        )));
    }
    anstream::print!("{outcome}");
    anstream::eprintln!("in {:.1} s", began.elapsed().as_secs_f64());
    if let Some(path) = &args.json {
        process::write_json(path, &outcome)?;
    }
    Ok(if outcome.is_passed() { Verdict::Pass } else { Verdict::Fail })
}

/// What is asked of which ECUs.
fn question(trace: &Trace, args: &ReplayArgs) -> Result<Question, Failure> {
    let as_run = question_as_run(trace, args.ecu)?;
    if args.solver.is_some_and(|solver| solver == as_run.solver || solver != SolverKind::Clarabel) {
        return Err(Failure::usage(
            "--solver: checks the QPs of the law's own solver with clarabel, in runs that were not \
             solved by it; name clarabel, or leave it out",
        ));
    }
    let scenario = trace.scenario(&args.set)?;
    let calibration = trace.calibration(&scenario)?;
    let calibrations = recomputation::calibrations(&scenario, &calibration);
    if let (Some((key, value)), true) = (args.set.first(), calibrations == as_run.calibrations) {
        return Err(Failure::usage(format!(
            "--set {key}={value}: changes nothing that an ECU is told; a replay recomputes the \
             ECUs in the world that was recorded: change law.*, or rehearse anew"
        )));
    }
    Ok(Question {
        times: seconds(args.from, args.to, "--to")?,
        scenario,
        calibrations,
        is_audited: args.solver.is_some(),
        changes: args.set.clone(),
        ..as_run
    })
}

/// The whole run, as it was.
///
/// # Errors
/// When the trace does not say how it was run.
pub fn question_as_run(trace: &Trace, only: Option<u8>) -> Result<Question, Failure> {
    let scenario = trace.scenario(&[])?;
    let calibration = trace.calibration(&scenario)?;
    Ok(Question {
        times: 0..u64::MAX,
        calibrations: recomputation::calibrations(&scenario, &calibration),
        scenario,
        solver: trace.solver(),
        is_audited: false,
        profile: trace.profile(),
        without_emergency_braking: trace.was_without_emergency_braking(),
        only,
        changes: Vec::new(),
    })
}

/// One thread reads, and one per ECU recomputes.
///
/// # Errors
/// When the trace cannot be read any more.
pub fn recompute(trace: &Trace, question: &Question) -> Result<Outcome, Failure> {
    let (first_ns, last_ns) = (question.times.start, question.times.end);
    let reads_from_ns = if question.is_what_if() { 0 } else { first_ns };
    let reads_from_ns = reads_from_ns.saturating_sub(SNAPSHOT_REACH_NS);
    // The wire is compared with what follows a tick, too.
    let times = reads_from_ns..last_ns.saturating_add(wire::APART_MAX_NS);
    // An extract begins with snapshots, somewhere in a run.
    let is_midway = reads_from_ns > 0 || trace.metadata().contains_key(EXTRACT);
    let mut events = trace.events(|topic| topic != Topic::Truth, times)?;
    thread::scope(|scope| {
        let mut ecus: BTreeMap<u8, Feed<'_>> = BTreeMap::new();
        // Where a run was kept in spans only, frames consumed early in one are not on its bus.
        let mut is_tap_whole = !trace.metadata().contains_key(CAPTURE);
        for event in &mut events {
            if event.topic == Topic::Dropped(Source::Rig) {
                is_tap_whole = false;
            }
            let Some(truck) = truck(event.topic).filter(|truck| question.is_about(*truck)) else {
                continue;
            };
            let feed = ecus.entry(truck).or_insert_with(|| {
                let (sender, batches) = sync_channel::<Vec<Event>>(BATCHES_WAITING);
                let work = move || {
                    let mut ecu = Recomputation::new(question, truck, is_midway);
                    batches.iter().flatten().for_each(|event| ecu.take(event));
                    ecu.finish()
                };
                Feed { sender, batch: Vec::with_capacity(BATCH), ecu: scope.spawn(work) }
            });
            feed.push(event);
        }
        let damage = events.damage();
        let accounts = ecus.into_values().filter_map(Feed::finish);
        let accounts =
            accounts.map(|account| account.trusting_the_tap(is_tap_whole && damage.is_none()));
        let is_what_if = question.is_what_if();
        Ok(Outcome { is_what_if, ecus: accounts.collect(), damage })
    })
}

/// The ECU an event is about; a frame on its bus is about it, too.
fn truck(topic: Topic) -> Option<u8> {
    match topic {
        Topic::Rx(truck) | Topic::Tick(truck) | Topic::Memory(truck) | Topic::Frames(truck) => {
            Some(truck)
        }
        Topic::Dropped(Source::Ecu(truck)) => Some(truck),
        Topic::Dropped(Source::Rig) | Topic::Truth => None,
    }
}

/// The way to one ECU's thread.
struct Feed<'scope> {
    sender: SyncSender<Vec<Event>>,
    batch: Vec<Event>,
    ecu: ScopedJoinHandle<'scope, Option<Account>>,
}

impl Feed<'_> {
    fn push(&mut self, event: Event) {
        self.batch.push(event);
        if self.batch.len() == BATCH {
            let batch = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH));
            // A thread that ended early is found out when it is joined.
            let _ = self.sender.send(batch);
        }
    }

    fn finish(self) -> Option<Account> {
        let _ = self.sender.send(self.batch);
        drop(self.sender);
        self.ecu.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}
