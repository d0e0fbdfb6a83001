use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex};

use law::qp::ActiveSet;
use law::{Calibration, Law, LmlReport, Phase, UclReport};
use platoon_dbc::{EgoState, Loopback, Message, Mission, NavStatus, Obstacle, ObstacleKind};

use super::*;
use crate::controller::LawController;
use crate::witness::ThreadTotals;

mod overruns;

const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = MS;

fn mission(run_state: RunState) -> Message {
    Message::Mission(Mission {
        truck_index: 0,
        platoon_size: 1,
        run_state,
        spacing_m: 25.0,
        set_speed_mps: 20.0,
        lane_width_m: 3.5,
        right_edge_y_m: -1.75,
        left_edge_y_m: 5.25,
        loop_period_ns: PERIOD_NS as u32,
        ..Mission::default()
    })
}

fn ego(n: u64) -> Message {
    Message::EgoState(EgoState {
        tick: n as u32,
        bench_time_ns: n * PERIOD_NS,
        position_x_m: 0.02 * n as f64,
        speed_forward_mps: 20.0,
        nav_status: NavStatus::Valid,
        ..EgoState::default()
    })
}

/// A rig that sends what it is told and hears what the ECU says.
struct Rig {
    bus: Loopback,
    counters: [u8; 9],
}

impl Rig {
    fn send(&mut self, message: &Message) {
        let counter = &mut self.counters[message.index()];
        self.bus.send(&message.encode(*counter).expect("in range")).expect("room");
        *counter = counter.wrapping_add(1);
    }

    fn hear(&mut self) -> Vec<Message> {
        let frames = std::iter::from_fn(|| self.bus.receive().expect("up"));
        frames.map(|received| Message::decode(&received.frame).expect("sound").0).collect()
    }

    fn modes(&mut self) -> Vec<EcuMode> {
        let heard = self.hear();
        heard
            .iter()
            .filter_map(|message| match message {
                Message::EcuStatus(status) => Some(status.ecu_mode),
                _ => None,
            })
            .collect()
    }
}

/// A clock that moves only when slept on or told to, and has the rig publish on its way.
#[derive(Default)]
struct BenchClock {
    now_ns: AtomicU64,
    rig: Mutex<Option<(Rig, u64)>>,
    /// Bench ticks the rig publishes; then it falls silent.
    publishes: AtomicU64,
    /// What the ECU said.
    heard: Mutex<Vec<Message>>,
}

impl BenchClock {
    fn advance_to(&self, to_ns: u64) {
        if let Some((rig, next)) = self.rig.lock().expect("not poisoned").as_mut() {
            while *next * PERIOD_NS <= to_ns && *next < self.publishes.load(Ordering::Relaxed) {
                rig.send(&ego(*next));
                self.heard.lock().expect("not poisoned").extend(rig.hear());
                *next += 1;
            }
        }
        self.now_ns.fetch_max(to_ns, Ordering::Relaxed);
    }
}

impl Clock for BenchClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.load(Ordering::Relaxed)
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.advance_to(deadline_ns);
    }
}

/// A controller that proposes what it is told and takes as long as it is told.
struct Scripted {
    force_n: f64,
    steering_rad: f64,
    /// Added to the force with every step \[N\].
    drift_n: f64,
    outcome: Outcome,
    /// At this bench time the QP takes this long.
    slow: Option<(u64, u64, Arc<BenchClock>)>,
    applied: Arc<Mutex<Vec<(f64, f64)>>>,
    asked_ns: Arc<Mutex<Vec<u64>>>,
}

impl Default for Scripted {
    fn default() -> Self {
        Self {
            force_n: 1_000.0,
            steering_rad: 0.0,
            drift_n: 0.0,
            outcome: Outcome::Solved,
            slow: None,
            applied: Arc::default(),
            asked_ns: Arc::default(),
        }
    }
}

impl Controller for Scripted {
    fn step(&mut self, seen: &Observation, mark: &mut dyn FnMut(Phase)) -> Decision {
        self.asked_ns.lock().expect("not poisoned").push(seen.time_ns);
        mark(Phase::Ucl);
        mark(Phase::LmlBuild);
        if let Some((at_ns, takes_ns, clock)) = &self.slow
            && *at_ns == seen.time_ns
        {
            clock.advance_to(clock.now_ns() + takes_ns);
        }
        mark(Phase::Qp);
        let force_n = self.force_n;
        self.force_n += self.drift_n;
        Decision {
            announced: None,
            force_n,
            steering_rad: self.steering_rad,
            intended_accel_mps2: 0.5,
            outcome: self.outcome,
            ucl: UclReport::default(),
            lml: LmlReport::default(),
        }
    }

    fn note_applied(&mut self, force_n: f64, steering_rad: f64) {
        self.applied.lock().expect("not poisoned").push((force_n, steering_rad));
    }

    fn save(&self, _out: &mut [u8]) -> Option<usize> {
        Some(0)
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        bytes.is_empty()
    }
}

fn ecu_with(controller: impl Controller + 'static) -> (Rig, Ecu) {
    let (rig, bus) = Loopback::pair("loopback0", 1024);
    let ecu = Ecu::new(Config::default(), Box::new(bus), Box::new(controller), None);
    (Rig { bus: rig, counters: [0; 9] }, ecu)
}

/// An ECU that has its mission and tick 0, ready for slot 0.
fn running(controller: impl Controller + 'static) -> (Rig, Ecu, BenchClock) {
    let (mut rig, mut ecu) = ecu_with(controller);
    let clock = BenchClock::default();
    rig.send(&mission(RunState::Running));
    rig.send(&ego(0));
    ecu.prepare(&clock);
    assert_eq!(ecu.mode(), EcuMode::Running);
    rig.hear();
    (rig, ecu, clock)
}

fn tick(ecu: &mut Ecu, clock: &BenchClock, n: u64) {
    clock.advance_to(n * PERIOD_NS + PERIOD_NS / 2);
    ecu.tick(Slot::on_time(n as u32, PERIOD_NS, clock), clock);
}

fn commands(heard: &[Message]) -> Vec<(u32, f64, f64, ActuationStatus)> {
    heard
        .iter()
        .filter_map(|message| match message {
            Message::Actuation(a) => {
                Some((a.answers_tick, a.force_n, a.steering_rad, a.actuation_status))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn the_ecu_reports_waiting_then_ready_then_running() {
    let (mut rig, mut ecu) = ecu_with(Scripted::default());
    let clock = BenchClock::default();
    for ms in 0..250 {
        clock.advance_to(ms * MS);
        ecu.prepare(&clock);
    }
    rig.send(&mission(RunState::Preparing));
    ecu.prepare(&clock);
    clock.advance_to(300 * MS);
    rig.send(&mission(RunState::Running));
    ecu.prepare(&clock);
    rig.send(&ego(0));
    ecu.prepare(&clock);
    use EcuMode::{Ready, Running, Waiting};
    assert_eq!(rig.modes(), [Waiting, Waiting, Waiting, Ready, Running]);
}

#[test]
fn every_tick_answers_the_newest_state_with_one_command() {
    let (mut rig, mut ecu, clock) = running(Scripted::default());
    tick(&mut ecu, &clock, 0);
    for n in 1..100 {
        rig.send(&ego(n));
        tick(&mut ecu, &clock, n);
    }
    let heard = rig.hear();
    let sent = commands(&heard);
    assert_eq!(sent.len(), 100);
    for (n, command) in sent.iter().enumerate() {
        assert_eq!(*command, (n as u32, 1_000.0, 0.0, ActuationStatus::Solved));
    }
    let broadcasts = heard.iter().filter(|message| matches!(message, Message::V2vOut(_)));
    assert_eq!(broadcasts.count(), 5, "every 20 ms");
}

#[test]
fn the_ecu_brakes_for_what_stands_ahead_whatever_its_controller_asks() {
    for without_emergency_braking in [false, true] {
        let (rig, bus) = Loopback::pair("loopback0", 1024);
        let config = Config { without_emergency_braking, ..Config::default() };
        let mut ecu = Ecu::new(config, Box::new(bus), Box::new(Scripted::default()), None);
        let (mut rig, clock) = (Rig { bus: rig, counters: [0; 9] }, BenchClock::default());
        rig.send(&mission(RunState::Running));
        rig.send(&ego(0));
        rig.send(&Message::Obstacle(Obstacle {
            kind: ObstacleKind::Vehicle,
            member: 255,
            position_x_m: 40.0,
            length_m: 6.0,
            width_m: 2.2,
            ..Obstacle::default()
        }));
        ecu.prepare(&clock);
        tick(&mut ecu, &clock, 0);
        rig.send(&ego(1));
        tick(&mut ecu, &clock, 1);
        let (_, force_n, _, status) = *commands(&rig.hear()).last().expect("two ticks");
        assert_eq!(force_n < 1_000.0, !without_emergency_braking, "{force_n} N");
        assert_eq!(status == ActuationStatus::Guard, !without_emergency_braking);
        let report = ecu.finish(&clock);
        assert_eq!(report.emergency_brakings, u32::from(!without_emergency_braking));
    }
}

#[test]
fn the_controller_learns_what_the_guard_admitted() {
    let scripted = Scripted { force_n: 30_000.0, ..Scripted::default() };
    let applied = Arc::clone(&scripted.applied);
    let (mut rig, mut ecu, clock) = running(scripted);
    tick(&mut ecu, &clock, 0);
    rig.send(&ego(1));
    tick(&mut ecu, &clock, 1);
    let sent = commands(&rig.hear());
    let applied = applied.lock().expect("not poisoned");
    assert_eq!(applied[1].0, 6_262.0, "6200 N at first, then 62 N in a millisecond");
    assert_eq!(sent[1].1, 6_262.0);
    assert_eq!(ecu.finish(&clock).guard["force"], 2);
}

#[test]
fn a_controller_that_computes_nonsense_is_never_heard_on_the_bus() {
    let scripted =
        Scripted { force_n: f64::NAN, steering_rad: f64::INFINITY, ..Scripted::default() };
    let (mut rig, mut ecu, clock) = running(scripted);
    for n in 0..1_000 {
        if n > 0 {
            rig.send(&ego(n));
        }
        tick(&mut ecu, &clock, n);
    }
    let sent = commands(&rig.hear());
    assert!(sent.iter().all(|command| command.3 == ActuationStatus::Guard));
    let last = sent.last().expect("commands");
    assert_eq!((last.1, last.2), (-23_040.0, 0.0), "it ends up braking straight");
    let report = ecu.finish(&clock);
    assert_eq!(report.guard["not_finite"], 1_000);
    assert_eq!(report.sent.encode_errors, 0);
}

#[test]
fn failed_solves_are_reported_on_the_bus_and_in_the_report() {
    let scripted = Scripted { outcome: Outcome::IterationCap, ..Scripted::default() };
    let (mut rig, mut ecu, clock) = running(scripted);
    tick(&mut ecu, &clock, 0);
    assert_eq!(commands(&rig.hear())[0].3, ActuationStatus::HeldPreviousPlan);
    let qp = ecu.finish(&clock).qp;
    assert_eq!((qp.solves, qp.failures), (1, 1));
}

#[test]
fn a_truck_that_lost_its_position_is_stopped_and_silent_on_v2v() {
    let scripted = Scripted::default();
    let asked_ns = Arc::clone(&scripted.asked_ns);
    let (mut rig, mut ecu, clock) = running(scripted);
    for n in 0..1_500 {
        tick(&mut ecu, &clock, n);
    }
    let heard = rig.hear();
    let last = *commands(&heard).last().expect("commands");
    assert_eq!(last, (0, -23_040.0, 0.0, ActuationStatus::Guard));
    assert_eq!(asked_ns.lock().expect("not poisoned").last(), Some(&(5 * MS)));
    let broadcasts = heard.iter().filter(|message| matches!(message, Message::V2vOut(_)));
    assert_eq!(broadcasts.count(), 1);
    assert_eq!(ecu.mode(), EcuMode::Running, "not given up yet");
}

#[test]
fn two_seconds_of_ticks_without_the_rig_end_the_run() {
    let (mut rig, mut ecu, clock) = running(Scripted::default());
    let ticks = (0..10_000).take_while(|&n| {
        tick(&mut ecu, &clock, n);
        rig.hear();
        ecu.mode() == EcuMode::Running
    });
    assert_eq!(ticks.count(), 1_999);
    assert_eq!(ecu.finish(&clock).ending, Ending::RigSilent);
    assert_eq!(rig.modes().last(), Some(&EcuMode::Fault));
}

#[test]
fn a_pause_of_the_machine_is_not_a_silent_rig() {
    let (mut rig, mut ecu, clock) = running(Scripted::default());
    tick(&mut ecu, &clock, 0);
    tick(&mut ecu, &clock, 60_000);
    assert_eq!(ecu.mode(), EcuMode::Running);
    rig.send(&ego(60_001));
    tick(&mut ecu, &clock, 60_001);
    let last = *commands(&rig.hear()).last().expect("commands");
    assert_eq!((last.0, last.3), (60_001, ActuationStatus::Solved));
}

#[test]
fn an_ended_mission_ends_the_run() {
    let (mut rig, mut ecu, clock) = running(Scripted::default());
    rig.send(&mission(RunState::Ended));
    tick(&mut ecu, &clock, 0);
    assert_eq!(ecu.mode(), EcuMode::Ended);
    assert_eq!(ecu.finish(&clock).ending, Ending::MissionEnded);
    assert_eq!(rig.modes().last(), Some(&EcuMode::Ended));
}

/// Runs `run` on a fake clock with a rig that publishes `ticks` states and then falls silent.
fn run_in_fake_time(ticks: u64, slow: Option<(u64, u64)>) -> (Report, Vec<u64>) {
    let (report, asked_ns, _) = overruns::run_with(Overruns::default(), ticks, slow);
    (report, asked_ns)
}

#[test]
fn a_run_that_keeps_up_misses_and_skips_nothing() {
    let (report, asked_ns) = run_in_fake_time(3_000, None);
    assert_eq!((report.misses, report.skipped, report.ending), (0, 0, Ending::RigSilent));
    assert_eq!(report.received.used, 3_001);
    assert_eq!(report.rate_hz, 1_000.0);
    assert!(asked_ns.windows(2).all(|pair| pair[1] - pair[0] == PERIOD_NS));
    assert_eq!(report.phase_us["total"].max, 0.0);
}

#[test]
fn an_overrun_is_one_miss_with_its_cause_and_skips_without_a_burst() {
    let (report, asked_ns) = run_in_fake_time(3_000, Some((1_000 * MS, 4_700_000)));
    assert_eq!((report.misses, report.skipped), (1, 4));
    assert_eq!((report.miss_causes["law"], report.skip_causes["law"]), (1, 4));
    assert_eq!(report.phase_us["qp"].max, 4_700.0);
    let after: Vec<u64> = asked_ns.into_iter().filter(|&at| at >= 999 * MS).take(4).collect();
    assert_eq!(after, [999 * MS, 1_000 * MS, 1_005 * MS, 1_006 * MS]);
}

#[test]
fn a_run_asked_to_stop_before_the_rig_comes_ends_at_once() {
    let (mut rig, ecu) = ecu_with(Scripted::default());
    let report = run(ecu, &BenchClock::default(), &AtomicBool::new(true));
    assert_eq!((report.ending, report.ticks), (Ending::Stopped, 0));
    assert_eq!(rig.modes(), [EcuMode::Ended]);
}

fn law_controller() -> LawController<ActiveSet> {
    LawController::new(Law::new(Calibration::default(), ActiveSet))
}

/// Everything sent while the rig publishes ticks `from..to`.
fn drive(rig: &mut Rig, ecu: &mut Ecu, clock: &BenchClock, from: u64, to: u64) -> Vec<Message> {
    for n in from..to {
        rig.send(&ego(n));
        tick(ecu, clock, n);
    }
    rig.hear()
}

#[test]
fn an_ecu_restored_from_a_snapshot_sends_the_same_frames() {
    let (mut rig, mut ecu, clock) = running(law_controller());
    drive(&mut rig, &mut ecu, &clock, 1, 50);
    let (saved, picture) = (&mut SnapshotBuffer::new(), ecu.picture);
    let bytes = saved
        .write(&ecu.guard, ecu.outbox.state(), ecu.inbox.decoder(), &picture, &*ecu.controller)
        .to_vec();
    assert!(!bytes.is_empty());

    let (mut other_rig, mut other) = ecu_with(law_controller());
    assert!(other.restore(&bytes));
    other_rig.counters = rig.counters;
    let expected = drive(&mut rig, &mut ecu, &clock, 50, 90);
    let restored = drive(&mut other_rig, &mut other, &clock, 50, 90);
    assert_eq!(commands(&restored), commands(&expected));
    let v2v = |heard: &[Message]| -> Vec<Message> {
        heard.iter().filter(|message| matches!(message, Message::V2vOut(_))).copied().collect()
    };
    assert_eq!(v2v(&restored), v2v(&expected));
}

#[test]
fn a_damaged_snapshot_is_refused_and_changes_nothing() {
    let (_rig, ecu, _clock) = running(law_controller());
    let bytes = SnapshotBuffer::new()
        .write(&ecu.guard, ecu.outbox.state(), ecu.inbox.decoder(), &ecu.picture, &*ecu.controller)
        .to_vec();
    for length in 0..bytes.len() {
        let (_rig, mut other) = ecu_with(law_controller());
        assert!(!other.restore(&bytes[..length]), "{length} bytes");
        assert_eq!(other.mode(), EcuMode::Waiting);
    }
}

#[test]
fn the_first_mission_is_that_of_the_own_truck() {
    let (rig, mut end) = Loopback::pair("truck0", 64);
    let mut rig = Rig { bus: rig, counters: [0; 9] };
    let Message::Mission(mission) = mission(RunState::Preparing) else { unreachable!() };
    rig.send(&ego(1));
    rig.send(&Message::Mission(Mission { truck_index: 1, platoon_size: 9, ..mission }));
    rig.send(&Message::Mission(Mission { platoon_size: 4, ..mission }));
    let decoder = Decoder::new(Profile::Fd, Vehicle::default());
    let (clock, stop) = (BenchClock::default(), AtomicBool::new(false));
    let first = first_mission(0, &mut end, decoder, &clock, &stop).expect("it came");
    assert_eq!((first.truck_index, first.platoon_size), (0, 4));
    stop.store(true, Ordering::Relaxed);
    assert_eq!(first_mission(0, &mut end, decoder, &clock, &stop), None);
}
