//! One ECU, recomputed from what it recorded.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use bench_sim::Scenario;
use controller_rt::{Config, Controller, LawController, Replica};
use law::{Calibration, Law};
use platoon_dbc::{Profile, message_info};
use traces::{FrameRecord, GuardReason, Record, TickOutcome, TickRecord, Topic};

use super::account::{Account, Divergence, Hole};
use super::audit::{Audit, Audited};
use super::wire::Wire;
use crate::calibration;
use crate::cli::SolverKind;
use crate::trace::{Event, Gap, History, Moment, TickInputs, differences};

/// The ECU's node in the DBCs.
const ECU: &str = "Ecu";
/// The messages by which it commands its truck.
const COMMANDS: [&str; 4] = ["Actuation", "TSC1", "XBR", "SteerCommand"];

/// What is to be recomputed.
pub struct Question {
    /// Bench time to compare within \[ns\].
    pub times: Range<u64>,
    /// The scenario, changes applied.
    pub scenario: Scenario,
    /// The calibration of each truck's ECU, changes applied.
    pub calibrations: Vec<Calibration>,
    /// Who solves the QPs.
    pub solver: SolverKind,
    /// Whether Clarabel solves each of them, too.
    pub is_audited: bool,
    /// How the buses carry messages.
    pub profile: Profile,
    /// Whether the guards' emergency layer is off.
    pub without_emergency_braking: bool,
    /// The one ECU to recompute; all when `None`.
    pub only: Option<u8>,
    /// What was changed.
    pub changes: Vec<(String, String)>,
}

impl Question {
    /// Whether something was changed on purpose.
    pub fn is_what_if(&self) -> bool {
        !self.changes.is_empty()
    }

    /// Whether this truck's ECU is to be recomputed.
    pub fn is_about(&self, truck: u8) -> bool {
        self.only.is_none_or(|only| only == truck) && self.scenario.has_ecu(usize::from(truck))
    }

    fn controller(&self, truck: u8, audit: &Arc<Mutex<Audit>>) -> Box<dyn Controller> {
        let calibration = self.calibrations.get(usize::from(truck)).copied().unwrap_or_default();
        if self.is_audited {
            let solver = Audited::new(Arc::clone(audit));
            Box::new(LawController::new(Law::new(calibration, solver)))
        } else {
            calibration::controller(calibration, self.solver)
        }
    }

    /// A truck's ECU that has seen nothing; what Clarabel makes of its QPs is noted in `audit`.
    pub fn replica(&self, truck: u8, audit: &Arc<Mutex<Audit>>) -> Replica {
        let calibration = self.calibrations.get(usize::from(truck)).copied().unwrap_or_default();
        let config = Config {
            truck,
            profile: self.profile,
            vehicle: calibration::vehicle(&calibration),
            without_emergency_braking: self.without_emergency_braking,
            ..Config::default()
        };
        Replica::new(config, self.controller(truck, audit))
    }
}

/// The calibration of each truck's ECU.
pub fn calibrations(scenario: &Scenario, common: &Calibration) -> Vec<Calibration> {
    let trucks = 0..scenario.platoon.trucks as u8;
    trucks.map(|truck| calibration::of_truck(common, scenario, truck)).collect()
}

/// An ECU being recomputed.
pub struct Recomputation<'a> {
    question: &'a Question,
    replica: Replica,
    audit: Arc<Mutex<Audit>>,
    history: Option<History>,
    /// What it consumed, against what was on its bus.
    wire: Wire,
    /// Commands on its bus, against what it sends when recomputed.
    commands: Wire,
    account: Account,
    /// Whether the replica has lived through everything the ECU has.
    is_in_step: bool,
    /// Whether the replica has left the recorded path; a snapshot brings it back.
    has_diverged: bool,
    hole: Option<Hole>,
    last_tick: Option<u32>,
}

impl<'a> Recomputation<'a> {
    /// Nothing recomputed yet; `is_midway` when the events begin behind the start of the run.
    pub fn new(question: &'a Question, truck: u8, is_midway: bool) -> Self {
        let audit = Arc::new(Mutex::new(Audit::default()));
        Self {
            question,
            replica: question.replica(truck, &audit),
            audit,
            history: Some(History::default()),
            wire: Wire::new(is_midway),
            commands: Wire::new(is_midway),
            account: Account { truck, ..Account::default() },
            is_in_step: !is_midway,
            has_diverged: false,
            hole: None,
            last_tick: None,
        }
    }

    /// Takes the next event of the file that is about this ECU or its bus.
    pub fn take(&mut self, event: Event) {
        match (&event.record, event.topic) {
            (Record::Frame(frame), Topic::Frames(_)) => return self.on_bus(frame),
            (Record::Frame(frame), Topic::Rx(_)) => self.wire.consumed(frame),
            _ => {}
        }
        self.feed(|history, out| history.push(event, out));
    }

    /// A frame that the rig recorded on the ECU's bus.
    fn on_bus(&mut self, record: &FrameRecord) {
        let info = message_info(record.frame.id()).filter(|info| info.sender == ECU && !record.tx);
        match info {
            None => self.wire.carried(record.time_ns, record.frame),
            Some(info) if COMMANDS.contains(&info.name) => self.commands.consumed(record),
            Some(_) => {}
        }
    }

    /// What was found; nothing when there was no tick.
    pub fn finish(mut self) -> Option<Account> {
        if let Some(history) = self.history.take() {
            let mut moments = Vec::new();
            history.finish(&mut |moment| moments.push(moment));
            moments.into_iter().for_each(|moment| self.live(moment));
        }
        self.account.holes.extend(self.hole.take());
        if !self.question.is_what_if() {
            self.account.strays = self.wire.strays();
            // What an ECU sent while it cannot be recomputed is not known.
            let is_whole = self.account.holes.is_empty() && self.account.differing == 0;
            self.account.foreign_commands = self.commands.strays().filter(|_| is_whole);
        }
        if self.question.is_audited {
            self.account.audit = self.audit.lock().ok().map(|audit| *audit);
        }
        (self.last_tick.is_some() || !self.account.holes.is_empty()).then_some(self.account)
    }

    fn feed(&mut self, work: impl FnOnce(&mut History, &mut dyn FnMut(Moment))) {
        // The history is out of its place while the moments it hands on are lived through.
        let Some(mut history) = self.history.take() else { return };
        work(&mut history, &mut |moment| self.live(moment));
        self.history = Some(history);
    }

    fn live(&mut self, moment: Moment) {
        match moment {
            Moment::Tick(inputs) => self.tick(&inputs),
            Moment::Snapshot { tick, bytes } => self.snapshot(tick, &bytes),
            Moment::Gap(gap) => self.gap(gap),
        }
    }

    fn tick(&mut self, inputs: &TickInputs) {
        let TickInputs { frames, tick: recorded } = inputs;
        self.last_tick = Some(recorded.tick);
        let is_asked = self.question.times.contains(&recorded.time_ns);
        if !self.is_in_step {
            if let Some(hole) = self.hole.as_mut().filter(|_| is_asked) {
                hole.ticks += 1;
            }
            return;
        }
        if let Ok(mut audit) = self.audit.lock() {
            audit.begin_tick(recorded.tick);
        }
        let commands = &mut self.commands;
        let now = self.replica.tick(frames, recorded, &mut |frame| {
            if message_info(frame.id()).is_some_and(|info| COMMANDS.contains(&info.name)) {
                commands.carried(recorded.time_ns, *frame);
            }
        });
        if is_asked {
            self.compare(&now, recorded);
        }
    }

    fn compare(&mut self, now: &TickRecord, recorded: &TickRecord) {
        let account = &mut self.account;
        account.ticks += 1;
        account.late += u64::from(recorded.missed);
        account.skipped += u64::from(recorded.skipped);
        account.fallbacks += u64::from(is_fallback(recorded));
        let mut differences = differences(now, recorded).peekable();
        let Some(first) = differences.peek().copied() else { return };
        self.has_diverged = true;
        account.differing += 1;
        account.force_n.note((now.force_n - recorded.force_n).abs(), recorded.time_ns);
        let steering_rad = (now.steering_rad - recorded.steering_rad).abs();
        account.steering_rad.note(steering_rad, recorded.time_ns);
        if account.first.is_none() {
            account.first = Some(Divergence {
                tick: recorded.tick,
                time_s: recorded.time_ns as f64 * 1e-9,
                quantity: first.quantity.name,
                differences: differences.map(|difference| difference.to_string()).collect(),
            });
        }
    }

    /// A snapshot ends a gap, and brings an ECU that has gone astray back to what was recorded,
    /// so that a later fault is found for itself. What was changed on purpose stays astray.
    fn snapshot(&mut self, tick: u32, bytes: &[u8]) {
        let is_needed = !self.is_in_step || (self.has_diverged && !self.question.is_what_if());
        if !is_needed {
            return;
        }
        if !self.replica.restore(bytes) {
            self.account.snapshots_refused += 1;
            return;
        }
        (self.is_in_step, self.has_diverged) = (true, false);
        if let Some(hole) = self.hole.take() {
            self.account.holes.push(Hole { resumed_after_tick: Some(tick), ..hole });
        }
    }

    fn gap(&mut self, Gap { records }: Gap) {
        let is_expected = self.last_tick.is_none() && !self.is_in_step;
        self.is_in_step = false;
        if is_expected {
            return; // The events begin midway because they were asked for so.
        }
        let fresh =
            Hole { after_tick: self.last_tick, records: 0, ticks: 0, resumed_after_tick: None };
        self.hole.get_or_insert(fresh).records += records;
    }
}

/// Whether a tick came to something else than a solved plan that the guard let pass or limited.
fn is_fallback(tick: &TickRecord) -> bool {
    let is_capped = matches!(tick.outcome, TickOutcome::IterationCap | TickOutcome::Infeasible);
    let is_replaced = matches!(
        tick.guard_reason,
        GuardReason::NoPlan
            | GuardReason::EgoStale
            | GuardReason::NotFinite
            | GuardReason::NoMission
            | GuardReason::Emergency
    );
    is_capped || is_replaced
}
