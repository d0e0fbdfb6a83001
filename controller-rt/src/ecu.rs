//! The ECU and its loop: wait, drain, observe, step, admit, send, record.
//!
//! The same [`Ecu::tick`] runs in real time, where [`run`] waits for each slot, and in virtual
//! time, where whoever owns the clock calls it directly.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use law::{Decision, Observation, Outcome};
use platoon_dbc::{
    ActuationStatus, Bus, Clock, Decoder, EcuMode, Encoder, Mission, Profile, RunState, Vehicle,
};
use traces::{Recorder, TickRecord};

use crate::controller::Controller;
use crate::gallery::Gallery;
use crate::guard::{Admitted, Guard, Plan, Proposal};
use crate::inbox::{Drained, Inbox};
use crate::inquest::{Inquest, Work};
use crate::laps::{Laps, PhaseTimes};
use crate::outbox::{Health, Outbox};
use crate::overrun::{OnOverrun, Overruns, QUEUE_SLOTS_MAX};
use crate::pacer::{Pacer, Slot};
use crate::phase_lock::PhaseLock;
use crate::picture::Picture;
use crate::recording::{Recording, TickFacts};
use crate::report::{Ending, Realtime, Report};
use crate::snapshot::SnapshotBuffer;
use crate::statistics::Statistics;
use crate::witness::{Nobody, Witness};

/// A running rig that sends no `EgoState` for this long of executed ticks \[ns\] is gone.
pub const RIG_SILENT_NS: u64 = 2_000_000_000;
/// How long the start-up waits for a frame before it looks at the stop flag and its status again.
const START_WAIT: Duration = Duration::from_millis(10);

/// What makes one ECU differ from another.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Config {
    /// Truck this ECU drives, 0 is the leader; missions for others are refused.
    pub truck: u8,
    /// Identifier of the gain in use, for `EcuStatus`; 0 when it is from no library.
    pub gain_id: u8,
    /// How its bus carries messages.
    pub profile: Profile,
    /// What the profile must know of the truck, as this ECU believes it to be.
    pub vehicle: Vehicle,
    /// Real-time privileges obtained, for the report.
    pub realtime: Option<Realtime>,
    /// The guard's emergency layer does not brake: to see what the law does alone.
    pub without_emergency_braking: bool,
    /// What is done about ticks that come too late.
    pub overruns: Overruns,
}

/// One truck's ECU.
pub struct Ecu {
    config: Config,
    bus: Box<dyn Bus>,
    controller: Box<dyn Controller>,
    recording: Recording,
    inbox: Inbox,
    picture: Picture,
    guard: Guard,
    outbox: Outbox,
    statistics: Statistics,
    inquest: Inquest,
    gallery: Gallery,
    snapshot: SnapshotBuffer,
    mode: EcuMode,
    /// Executed ticks since the last `EgoState`: a pause of the whole machine adds none.
    silent_ticks: u64,
    /// The command sent last: force \[N\] and steering angle \[rad\].
    sent: (f64, f64),
    has_overrun: bool,
}

/// Runs the ECU in real time until the mission ends, the rig falls silent or `stop` is set.
///
/// Scheduling class, affinity and locked memory are the caller's business.
pub fn run(mut ecu: Ecu, clock: &dyn Clock, stop: &AtomicBool) -> Report {
    if let Some(mut pacer) = ecu.start_up(clock, stop) {
        while ecu.mode == EcuMode::Running && !stop.load(Ordering::Relaxed) {
            let Some(slot) = pacer.wait(clock) else {
                continue;
            }; // wait
            if let Some((bench_ns, arrival)) = ecu.tick(slot, clock).ego_arrival {
                pacer.note_ego(bench_ns, arrival);
            }
        }
    }
    ecu.finish(clock)
}

/// Waits for a truck's first mission, before there is an ECU: who puts one together may have to
/// know the platoon first. `None` when `stop` is set. Other frames are lost, which nobody misses
/// before the start.
pub fn first_mission(
    truck: u8,
    bus: &mut dyn Bus,
    decoder: Decoder,
    clock: &dyn Clock,
    stop: &AtomicBool,
) -> Option<Mission> {
    let (mut inbox, mut picture) = (Inbox::new(decoder), Picture::new(truck));
    while !stop.load(Ordering::Relaxed) {
        if bus.wait(START_WAIT).is_err() {
            // A bus that is down reports at once; do not spin on it.
            clock.sleep_until_ns(clock.now_ns() + START_WAIT.as_nanos() as u64);
        }
        inbox.drain(bus, &mut picture, clock.now_ns(), |_| ());
        if let Some(mission) = picture.mission() {
            return Some(*mission);
        }
    }
    None
}

impl Ecu {
    /// Runs one slot.
    pub fn tick(&mut self, slot: Slot, clock: &dyn Clock) -> Drained {
        let mut laps = Laps::start(clock, slot.due_ns);
        self.inquest.open();
        let drained = self.drain(slot.number, slot.time_ns, laps.last_ns()); // drain
        laps.drained();
        let seen = self.picture.observe(slot.time_ns); // observe
        laps.observed();
        let decision = seen.as_ref().map(|seen| self.step(seen, &mut laps)); // step
        let is_held = self.holds(&slot, laps.last_ns());
        let admitted = self.admit(slot.time_ns, decision.as_ref(), is_held); // admit
        laps.guarded();
        self.send(&slot, decision.as_ref(), &admitted); // send
        let facts = self.account((slot, laps.sent()), &drained, (decision, admitted), is_held);
        self.record(&facts); // record
        self.inquest.recorded(laps.recorded());
        self.watch_rig(drained.ego);
        drained
    }

    /// An ECU on its bus, with its control law, recording if there is a recorder.
    #[must_use]
    pub fn new(
        config: Config,
        bus: Box<dyn Bus>,
        controller: Box<dyn Controller>,
        recorder: Option<Recorder>,
    ) -> Self {
        let Config { truck, profile, vehicle, without_emergency_braking, .. } = config;
        let guard = Guard::new();
        Self {
            config,
            bus,
            controller,
            recording: Recording::new(recorder, truck),
            inbox: Inbox::new(Decoder::new(profile, vehicle)),
            picture: Picture::new(truck),
            guard: if without_emergency_braking {
                guard.without_emergency_braking()
            } else {
                guard
            },
            outbox: Outbox::new(Encoder::new(profile, vehicle)),
            statistics: Statistics::new(),
            inquest: Inquest::new(Box::new(Nobody)),
            gallery: Gallery::default(),
            snapshot: SnapshotBuffer::new(),
            mode: EcuMode::Waiting,
            silent_ticks: 0,
            sent: (0.0, 0.0),
            has_overrun: false,
        }
    }

    /// Lets this witness be asked about the thread of the loop.
    #[must_use]
    pub fn witnessed_by(mut self, witness: Box<dyn Witness>) -> Self {
        self.inquest = Inquest::new(witness);
        self
    }

    /// Before the first slot: takes what came, sends the status that is due.
    ///
    /// The mode is `Running` once both a mission and an `EgoState` are there.
    pub fn prepare(&mut self, clock: &dyn Clock) -> Drained {
        let now_ns = clock.now_ns();
        let (tick, time_ns) =
            self.picture.ego().map_or((0, 0), |ego| (ego.tick, ego.bench_time_ns));
        let drained = self.drain(tick, time_ns, now_ns);
        let before = self.mode;
        self.mode = match (self.picture.mission().map(|m| m.run_state), self.picture.ego()) {
            (None, _) => EcuMode::Waiting,
            (Some(RunState::Ended), _) => EcuMode::Ended,
            (Some(_), None) => EcuMode::Ready,
            (Some(_), Some(_)) => EcuMode::Running,
        };
        // From here on bench time is there to go by, and the same run says the same again.
        let status_ns = match (self.mode, self.picture.ego()) {
            (EcuMode::Running, Some(ego)) => ego.bench_time_ns,
            _ => now_ns,
        };
        let (bus, health) = (&mut *self.bus, health(&self.config, &self.statistics));
        if self.mode == before {
            self.outbox.status(bus, status_ns, self.mode, health);
        } else {
            self.outbox.status_now(bus, status_ns, self.mode, health);
        }
        drained
    }

    /// What the ECU is doing.
    #[must_use]
    pub const fn mode(&self) -> EcuMode {
        self.mode
    }

    /// The loop's period \[ns\], once a mission has told it.
    #[must_use]
    pub fn period_ns(&self) -> Option<u64> {
        self.picture.period_ns()
    }

    /// What the newest tick records, recorder or not; `None` before the first.
    #[must_use]
    pub const fn newest_tick(&self) -> Option<&TickRecord> {
        self.recording.newest_tick()
    }

    /// Continues from a recorded snapshot; false when it is damaged or another truck's.
    ///
    /// The snapshot is that of [`join_snapshot`](crate::join_snapshot).
    pub fn restore(&mut self, bytes: &[u8]) -> bool {
        let Some(saved) = crate::snapshot::read(bytes, self.config.truck) else {
            return false;
        };
        if !self.controller.restore(saved.controller) {
            return false;
        }
        (self.guard, self.picture) = (saved.guard, saved.picture);
        self.outbox.restore(saved.outbox);
        self.inbox.restore(saved.decoder);
        self.mode = EcuMode::Running;
        true
    }

    /// Everything later commands depend on, for [`restore`](Self::restore); empty when something
    /// has no room.
    pub fn save(&mut self) -> &[u8] {
        self.snapshot.write(
            &self.guard,
            self.outbox.state(),
            self.inbox.decoder(),
            &self.picture,
            &*self.controller,
        )
    }

    /// Says goodbye on the bus, closes the recording and reports.
    #[must_use]
    pub fn finish(mut self, clock: &dyn Clock) -> Report {
        let ending = match self.mode {
            EcuMode::Ended => Ending::MissionEnded,
            EcuMode::Fault if self.has_overrun => Ending::Overrun,
            EcuMode::Fault => Ending::RigSilent,
            EcuMode::Waiting | EcuMode::Ready | EcuMode::Running => Ending::Stopped,
        };
        if self.mode != EcuMode::Fault {
            self.mode = EcuMode::Ended;
        }
        let health = health(&self.config, &self.statistics);
        self.outbox.status_now(&mut *self.bus, clock.now_ns(), self.mode, health);
        let (dropped_records, recording_error) = self.recording.finish();
        Report {
            truck: self.config.truck,
            rate_hz: self.picture.period_ns().map_or(0.0, |period_ns| 1e9 / period_ns as f64),
            ending,
            ticks: self.statistics.ticks(),
            misses: self.statistics.misses(),
            skipped: self.statistics.skipped(),
            dropped_records,
            recording_error,
            realtime: self.config.realtime,
            phase_us: self.statistics.percentiles(),
            qp: self.statistics.qp(),
            miss_causes: self.statistics.miss_causes(),
            skip_causes: self.statistics.skip_causes(),
            lapses: self.statistics.lapses(),
            slowest_us: self.statistics.slowest_us(),
            on_overrun: self.config.overruns.policy,
            forgiven: self.statistics.forgiven(),
            stale_ticks: self.statistics.stale(),
            held_ticks: self.statistics.held(),
            thread: self.inquest.thread(),
            worst_misses: self.gallery.misses(),
            guard: self.statistics.guard_reasons(),
            emergency_brakings: self.guard.emergency_brakings(),
            received: self.inbox.counts(),
            sent: self.outbox.counts(),
            receive_overflow: self.bus.counts().receive_overflow,
        }
    }

    /// Waits for mission and first `EgoState`, answering with status; `None` when there is no run.
    fn start_up(&mut self, clock: &dyn Clock, stop: &AtomicBool) -> Option<Pacer> {
        let mut lock = PhaseLock::new();
        while !stop.load(Ordering::Relaxed) {
            if self.bus.wait(START_WAIT).is_err() {
                // A bus that is down reports at once; do not spin on it.
                clock.sleep_until_ns(clock.now_ns() + START_WAIT.as_nanos() as u64);
            }
            let drained = self.prepare(clock);
            if let Some(arrival) = drained.first_arrival {
                lock.note_frame(arrival);
            }
            if self.mode == EcuMode::Ended {
                return None;
            }
            let period_ns = self.picture.period_ns();
            if let (Some((bench_ns, arrival)), Some(period_ns)) = (drained.ego_arrival, period_ns) {
                lock.note_ego(bench_ns, arrival, period_ns);
                if self.mode == EcuMode::Running {
                    let pacer = Pacer::new(period_ns, lock, bench_ns);
                    return Some(match self.config.overruns.policy {
                        OnOverrun::Queue => pacer.queueing(QUEUE_SLOTS_MAX),
                        OnOverrun::Skip | OnOverrun::Hold | OnOverrun::Abort => pacer,
                    });
                }
            }
        }
        None
    }

    fn drain(&mut self, tick: u32, time_ns: u64, now_ns: u64) -> Drained {
        let recording = &mut self.recording;
        self.inbox.drain(&mut *self.bus, &mut self.picture, now_ns, |received| {
            recording.frame(received, tick, time_ns);
        })
    }

    fn step(&mut self, seen: &Observation, laps: &mut Laps<'_>) -> Decision {
        let decision = self.controller.step(seen, &mut |phase| laps.stepped(phase));
        self.statistics.count_decision(&decision);
        decision
    }

    /// Whether the tick's command comes too late to be sent.
    fn holds(&self, slot: &Slot, now_ns: u64) -> bool {
        let period_ns = self.picture.period_ns().unwrap_or(u64::MAX);
        let holds = self.config.overruns.policy == OnOverrun::Hold;
        slot.is_held || (holds && slot.is_over(now_ns, period_ns))
    }

    fn admit(&mut self, now_ns: u64, decision: Option<&Decision>, is_held: bool) -> Admitted {
        let proposal = decision.map(|decision| match (is_held, self.sent) {
            (true, (force_n, steering_rad)) => Proposal { force_n, steering_rad, plan: Plan::Held },
            (false, _) => Proposal {
                force_n: decision.force_n,
                steering_rad: decision.steering_rad,
                plan: plan(decision.outcome),
            },
        });
        let (own, objects) = (self.picture.own_motion(now_ns), self.picture.objects(now_ns));
        let admitted = self.guard.admit(now_ns, proposal, own, &objects);
        self.controller.note_applied(admitted.force_n, admitted.steering_rad);
        self.statistics.count_guard(admitted.reason);
        self.sent = (admitted.force_n, admitted.steering_rad);
        admitted
    }

    fn send(&mut self, slot: &Slot, decision: Option<&Decision>, admitted: &Admitted) {
        let bus = &mut *self.bus;
        let answers_tick = self.picture.ego().map_or(slot.number, |ego| ego.tick);
        let status = actuation_status(decision, admitted);
        let command = (admitted.force_n, admitted.steering_rad);
        self.outbox.command(bus, slot.time_ns, answers_tick, command, status);
        // A truck that does not know where it is says nothing rather than something old.
        if let (Some(decision), Some(ego)) = (decision, self.picture.ego()) {
            self.outbox.broadcast(bus, slot.time_ns, ego, decision.intended_accel_mps2);
            if let Some(plan) = &decision.announced {
                self.outbox.announce(bus, slot.time_ns, plan);
            }
        }
        self.outbox.status(bus, slot.time_ns, self.mode, health(&self.config, &self.statistics));
    }

    /// Counts the tick, and finds out why it came too late if it did.
    fn account(
        &mut self,
        (slot, times): (Slot, PhaseTimes),
        drained: &Drained,
        (decision, admitted): (Option<Decision>, Admitted),
        is_held: bool,
    ) -> TickFacts {
        let period_ns = self.picture.period_ns().unwrap_or(u64::MAX);
        let work = Work::of(drained.frames, decision.as_ref());
        let finding = self.inquest.close(&slot, &times, work, period_ns);
        let is_forgiven = self.config.overruns.forgives(slot.time_ns);
        self.statistics.count_times(&slot, &times, &finding, is_forgiven);
        self.gallery.consider(&slot, &times, work, &finding);
        if !is_forgiven {
            self.inquest.settle();
        }
        let is_stale = self.picture.ego().is_none_or(|ego| ego.bench_time_ns < slot.time_ns);
        self.statistics.count_lacks(is_stale, is_held);
        TickFacts { slot, times, work, finding, is_stale, is_held, decision, admitted }
    }

    fn record(&mut self, facts: &TickFacts) {
        self.recording.tick(facts);
        if self.recording.wants_snapshot(facts.slot.time_ns) {
            let saved = self.snapshot.write(
                &self.guard,
                self.outbox.state(),
                self.inbox.decoder(),
                &self.picture,
                &*self.controller,
            );
            self.recording.snapshot(&facts.slot, saved);
        }
    }

    /// Notices the end of the run.
    fn watch_rig(&mut self, ego_came: bool) {
        let period_ns = self.picture.period_ns().unwrap_or(u64::MAX);
        self.silent_ticks = if ego_came { 0 } else { self.silent_ticks + 1 };
        if self.picture.mission().is_some_and(|mission| mission.run_state == RunState::Ended) {
            self.mode = EcuMode::Ended;
        } else if self.silent_ticks.saturating_mul(period_ns) >= RIG_SILENT_NS {
            self.mode = EcuMode::Fault;
        } else if self.config.overruns.is_too_much(self.statistics.lost()) {
            (self.mode, self.has_overrun) = (EcuMode::Fault, true);
        }
    }
}

fn plan(outcome: Outcome) -> Plan {
    match outcome {
        Outcome::Solved => Plan::Solved,
        Outcome::Held => Plan::Held,
        Outcome::IterationCap | Outcome::Infeasible => Plan::Shifted,
    }
}

fn actuation_status(decision: Option<&Decision>, admitted: &Admitted) -> ActuationStatus {
    match decision.map(|decision| decision.outcome) {
        _ if admitted.reason.replaces() => ActuationStatus::Guard,
        None => ActuationStatus::Guard,
        Some(Outcome::Solved | Outcome::Held) => ActuationStatus::Solved,
        Some(Outcome::IterationCap | Outcome::Infeasible) => ActuationStatus::HeldPreviousPlan,
    }
}

fn health(config: &Config, statistics: &Statistics) -> Health {
    Health {
        gain_id: config.gain_id,
        ticks: statistics.ticks(),
        misses: statistics.misses(),
        skipped: statistics.skipped(),
    }
}

#[cfg(test)]
mod tests;
