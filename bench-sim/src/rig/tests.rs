//! The rig against small ECUs of its own that hold speed and lane over a loopback bus.

use std::cell::{Cell, RefCell};
use std::sync::atomic::AtomicBool;

use platoon_dbc::{
    Actuation, ActuationStatus, Bus, BusTiming, Clock, EcuMode, EcuStatus, EgoState, Emulated,
    Frame, FrameFlags, Loopback, Message, Mission, Obstacle, ObstacleKind, V2vOut, V2vState,
    V2vTrajectory, V2vTrajectoryOut,
};

use super::*;
use crate::truck_node::NodeCounts;

mod plans;

/// An ECU that answers every EgoState: proportional in speed, proportional-derivative in Y.
struct TestEcu {
    bus: Loopback,
    alive: [u8; 9],
    mission: Option<Mission>,
    ego: Option<EgoState>,
    answered: Option<u32>,
    v2v: Vec<V2vState>,
    plans: Vec<V2vTrajectory>,
    obstacles: Vec<Obstacle>,
    frames: Vec<Frame>,
    dead: bool,
    /// Tells the others its plan every 100 ms.
    announces: bool,
}

impl TestEcu {
    fn new(bus: Loopback) -> Self {
        Self {
            bus,
            alive: [0; 9],
            mission: None,
            ego: None,
            answered: None,
            v2v: Vec::new(),
            plans: Vec::new(),
            obstacles: Vec::new(),
            frames: Vec::new(),
            dead: false,
            announces: false,
        }
    }

    fn send(&mut self, message: &Message) {
        let alive = &mut self.alive[message.index()];
        self.bus.send(&message.encode(*alive).expect("in range")).expect("room");
        *alive = alive.wrapping_add(1);
    }

    fn drain(&mut self) {
        while let Some(received) = self.bus.receive().expect("up") {
            self.frames.push(received.frame);
            match Message::decode(&received.frame).expect("of the contract").0 {
                Message::EgoState(ego) => self.ego = Some(ego),
                Message::Mission(mission) => self.mission = Some(mission),
                Message::V2vState(state) => self.v2v.push(state),
                Message::V2vTrajectory(plan) => self.plans.push(plan),
                Message::Obstacle(obstacle) => self.obstacles.push(obstacle),
                other => panic!("the rig sent {other:?}"),
            }
        }
    }

    fn tick(&mut self) {
        self.drain();
        if self.dead {
            return;
        }
        if self.mission.is_some() && self.ego.is_none() {
            self.send(&Message::EcuStatus(status(EcuMode::Ready)));
        }
        let (Some(mission), Some(ego)) = (self.mission, self.ego) else {
            return;
        };
        if self.answered == Some(ego.tick) {
            return;
        }
        self.answered = Some(ego.tick);
        let force_n = 8_000.0 * (mission.set_speed_mps - ego.speed_forward_mps);
        let steering_rad = -0.01 * ego.position_y_m - 0.2 * ego.heading_rad;
        self.send(&Message::Actuation(Actuation {
            answers_tick: ego.tick,
            force_n: force_n.clamp(-20_000.0, 20_000.0),
            steering_rad,
            actuation_status: ActuationStatus::Solved,
        }));
        if ego.bench_time_ns % 20_000_000 == 0 {
            self.send(&Message::V2vOut(broadcast(&ego)));
        }
        if self.announces && ego.bench_time_ns % 100_000_000 == 0 {
            self.send(&Message::V2vTrajectoryOut(V2vTrajectoryOut {
                sequence: (ego.bench_time_ns / 100_000_000) as u16,
                generation_time_ns: ego.bench_time_ns,
                position_x_m: ego.position_x_m,
                speed_mps: [ego.speed_forward_mps; 21],
            }));
        }
    }
}

fn status(ecu_mode: EcuMode) -> EcuStatus {
    EcuStatus { ecu_mode, gain_id: 0, tick_count: 0, misses: 0, skipped: 0 }
}

fn broadcast(ego: &EgoState) -> V2vOut {
    V2vOut {
        sequence: (ego.bench_time_ns / 20_000_000) as u16,
        generation_time_ns: ego.bench_time_ns,
        position_x_m: ego.position_x_m,
        position_y_m: ego.position_y_m,
        heading_rad: ego.heading_rad,
        speed_mps: ego.speed_forward_mps,
        yaw_rate_radps: ego.yaw_rate_radps,
        accel_mps2: ego.accel_forward_mps2,
        intended_accel_mps2: 0.0,
    }
}

fn scenario(sets: &[(&str, &str)]) -> Scenario {
    let sets: Vec<_> = sets.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    Scenario::load("obstacle-avoidance", &sets).expect("fits")
}

/// A rig and its test ECUs, neither started.
fn bench(scenario: &Scenario, seed: u64, rate_hz: u32) -> (Rig, Vec<TestEcu>) {
    let (mut rig_ends, mut ecus): (Vec<Box<dyn Bus>>, Vec<_>) = (Vec::new(), Vec::new());
    for truck in 0..scenario.platoon.trucks {
        let (rig_end, ecu_end) = Loopback::pair(&format!("loopback{truck}"), 8192);
        rig_ends.push(Box::new(rig_end));
        ecus.push(TestEcu::new(ecu_end));
    }
    (Rig::new(scenario, seed, rate_hz, rig_ends, None).expect("fits"), ecus)
}

fn start(rig: &mut Rig, ecus: &mut [TestEcu]) {
    rig.invite();
    assert!(!rig.ready());
    ecus.iter_mut().for_each(TestEcu::tick);
    assert!(rig.ready());
    rig.start();
}

fn drive(rig: &mut Rig, ecus: &mut [TestEcu], seconds: f64) {
    let until_ns = rig.time_ns() + (seconds * 1e9) as u64;
    while rig.time_ns() < until_ns && !rig.finished() {
        ecus.iter_mut().for_each(TestEcu::tick);
        (0..rig.steps_per_tick()).for_each(|_| rig.step());
    }
}

/// A rig and its ECUs after `seconds` on an empty road.
fn driven(sets: &[(&str, &str)], seed: u64, rate_hz: u32, seconds: f64) -> (Rig, Vec<TestEcu>) {
    let mut scenario = scenario(sets);
    scenario.obstacles.clear();
    let (mut rig, mut ecus) = bench(&scenario, seed, rate_hz);
    start(&mut rig, &mut ecus);
    drive(&mut rig, &mut ecus, seconds);
    (rig, ecus)
}

#[test]
fn the_run_starts_when_every_ecu_is_ready_with_tick_zero_at_time_zero() {
    let (mut rig, mut ecus) = bench(&scenario(&[]), 1, 1000);
    rig.invite();
    ecus[1..].iter_mut().for_each(TestEcu::tick);
    assert!(!rig.ready());
    assert_eq!(rig.silent_trucks().collect::<Vec<_>>(), [0]);
    ecus[0].tick();
    assert!(rig.ready());
    rig.start();
    ecus.iter_mut().for_each(TestEcu::drain);
    let ego = ecus[2].ego.expect("published");
    assert_eq!((ego.tick, ego.bench_time_ns, ego.position_x_m), (0, 0, -100.0));
    let mission = ecus[2].mission.expect("published");
    assert_eq!((mission.truck_index, mission.run_state), (2, RunState::Running));
    rig.end();
    ecus[2].drain();
    assert_eq!(ecus[2].mission.map(|m| m.run_state), Some(RunState::Ended));
}

#[test]
fn every_tick_carries_its_own_time_at_every_loop_rate() {
    for (rate_hz, period_ns) in
        [(100, 10_000_000), (300, 3_333_332), (1000, 1_000_000), (2000, 500_000)]
    {
        let (rig, mut ecus) = driven(&[], 1, rate_hz, 0.5);
        assert!(rig.base_step_ns() <= 1_000_000);
        ecus[1].drain();
        let egos = ecus[1].frames.iter().filter_map(|frame| EgoState::decode(frame).ok());
        let mut count = 0;
        for (expected, (ego, counter)) in egos.enumerate() {
            assert_eq!(ego.tick as usize, expected);
            assert_eq!(ego.bench_time_ns, expected as u64 * period_ns);
            assert_eq!(counter, expected as u8);
            count += 1;
        }
        assert_eq!(count, 1 + rig.time_ns() / period_ns);
        assert_eq!(ecus[1].mission.map(|m| u64::from(m.loop_period_ns)), Some(period_ns));
    }
}

#[test]
fn trucks_hold_speed_and_nothing_is_counted_as_wrong() {
    let (rig, _) = driven(&[], 1, 1000, 20.0);
    let results = rig.results();
    for (truck, counts) in results.trucks.iter().zip(&results.nodes) {
        assert!((truck.final_speed_mps - 18.0).abs() < 0.2, "{truck:?}");
        let clean = NodeCounts { accepted: counts.accepted, ..NodeCounts::default() };
        assert_eq!((*counts, counts.accepted), (clean, 20_000));
    }
}

#[test]
fn the_same_seed_gives_the_same_frames_and_another_does_not() {
    let sets = [("sensors.noise", "1"), ("v2v.loss", "0.1")];
    let frames = |seed| -> Vec<Vec<Frame>> {
        driven(&sets, seed, 1000, 5.0).1.into_iter().map(|ecu| ecu.frames).collect()
    };
    let first = frames(7);
    assert!(first == frames(7));
    assert!(first != frames(8));
}

#[test]
fn v2v_reaches_followers_late_by_the_bounded_delay() {
    let (rig, ecus) = driven(&[], 3, 1000, 30.0);
    assert!(ecus[0].v2v.is_empty());
    let sources = |ecu: &TestEcu| {
        let mut sources: Vec<u8> = ecu.v2v.iter().map(|v| v.source_truck).collect();
        sources.sort_unstable();
        sources.dedup();
        sources
    };
    assert_eq!((sources(&ecus[1]), sources(&ecus[3])), (vec![0], vec![0, 2]));
    let report = rig.results().v2v;
    assert!(report.delay_min_s >= Some(0.015 - 1e-12) && report.delay_max_s <= Some(0.15 + 1e-12));
    assert!(report.max_abs_rate <= Some(0.2) && report.max_abs_rate > Some(0.1));
    assert_eq!(report.refused, 0);
}

#[test]
fn obstacles_come_into_range_and_the_truck_ahead_is_a_member() {
    let mut scenario = scenario(&[("obstacles.1.x_m", "100"), ("obstacles.1.speed_mps", "0")]);
    scenario.obstacles.truncate(1);
    scenario.obstacles[0].y_m = 10.0;
    let (mut rig, mut ecus) = bench(&scenario, 1, 1000);
    start(&mut rig, &mut ecus);
    drive(&mut rig, &mut ecus, 12.0);
    let of = |truck: usize, kind| ecus[truck].obstacles.iter().filter(move |o| o.kind == kind);
    let first = of(0, ObstacleKind::Vehicle).next().expect("came into range");
    let seen_from_m = first.position_x_m - 18.0 * first.measured_time_ns as f64 * 1e-9;
    assert!((79.0..=80.0 + 0.5).contains(&seen_from_m), "{seen_from_m}");
    assert_eq!(of(0, ObstacleKind::None).count(), 1, "gone once, said once");
    assert!(of(1, ObstacleKind::PlatoonTruck).all(|o| o.member == 0));
    assert!(of(0, ObstacleKind::PlatoonTruck).next().is_none());
    assert!(of(1, ObstacleKind::PlatoonTruck).count() > 200);
}

#[test]
fn a_dead_ecu_stops_its_truck_and_fails_the_run() {
    let (mut rig, mut ecus) = driven(&[("duration_s", "20")], 1, 1000, 5.0);
    ecus[2].dead = true;
    drive(&mut rig, &mut ecus, 0.1);
    assert_eq!(rig.results().nodes[2].lost_commands, 1, "not noticed within 100 ms");
    let speed_mps = |rig: &Rig| rig.trucks()[2].state().forward_mps;
    let before_mps = speed_mps(&rig);
    drive(&mut rig, &mut ecus, 0.2);
    assert!(before_mps - speed_mps(&rig) < 0.15, "coasting");
    drive(&mut rig, &mut ecus, 1.0);
    let braking_mps = speed_mps(&rig);
    drive(&mut rig, &mut ecus, 1.0);
    assert!((braking_mps - speed_mps(&rig) - 4.0).abs() < 0.1, "4 m/s²");
    drive(&mut rig, &mut ecus, 100.0);
    assert!(rig.finished());
    assert_eq!(speed_mps(&rig), 0.0);
    let results = rig.results();
    assert!(!results.passed());
    assert_eq!(results.trucks.iter().map(|t| t.lost_commands).collect::<Vec<_>>(), [0, 0, 1, 0]);
}

#[test]
fn damaged_repeated_and_foreign_frames_have_no_effect_and_are_counted() {
    let (mut rig, mut ecus) = driven(&[], 1, 1000, 1.0);
    let order = Actuation {
        answers_tick: rig.tick(),
        force_n: -30_000.0,
        steering_rad: 0.1,
        actuation_status: ActuationStatus::Solved,
    };
    let ecu = &mut ecus[0];
    let good = order.encode(ecu.alive[1]).expect("in range");
    let mut data = good.data().to_vec();
    data[9] ^= 0x10;
    let damaged = Frame::new(good.id(), good.flags(), &data).expect("a frame");
    let repeated = order.encode(ecu.alive[1].wrapping_sub(1)).expect("in range");
    let foreign = Frame::new(0x123, FrameFlags::default(), &[1, 2]).expect("a frame");
    let short = Frame::new(good.id(), good.flags(), &data[..12]).expect("a frame");
    let rigs_own = Message::Mission(ecu.mission.expect("known")).encode(0).expect("in range");
    for frame in [damaged, repeated, foreign, short, rigs_own] {
        ecu.bus.send(&frame).expect("room");
    }
    rig.step();
    let counts = rig.results().nodes[0];
    assert_eq!((counts.bad_crc, counts.repeated, counts.malformed, counts.unknown), (1, 1, 1, 2));
    assert!(rig.results().trucks[0].min_force_n > -1_000.0);
}

#[test]
fn a_counter_jump_is_counted_and_the_command_still_counts() {
    let (mut rig, mut ecus) = driven(&[], 1, 1000, 1.0);
    ecus[0].alive[1] = ecus[0].alive[1].wrapping_add(3);
    drive(&mut rig, &mut ecus, 1.0);
    let counts = rig.results().nodes[0];
    assert_eq!((counts.counter_jumps, counts.missing, counts.accepted), (1, 3, 2_000));
}

#[test]
fn catching_up_publishes_only_the_latest_state_and_loses_no_time() {
    let (mut rig, mut ecus) = driven(&[], 1, 1000, 1.0);
    let before = ecus[0].frames.len();
    rig.advance(30);
    ecus[0].drain();
    let egos: Vec<u32> = ecus[0].frames[before..]
        .iter()
        .filter_map(|frame| EgoState::decode(frame).ok())
        .map(|(ego, _)| ego.tick)
        .collect();
    assert_eq!(egos, [1000, 1030]);
    assert_eq!(rig.time_ns(), 1_030_000_000);
}

#[test]
fn catching_up_changes_nothing_of_the_plant() {
    let travel = |burst: u64| {
        let (mut rig, _) = bench(&scenario(&[]), 1, 1000);
        rig.start();
        (0..60 / burst).for_each(|_| rig.advance(burst));
        rig.truth()
    };
    assert_eq!(travel(1), travel(6));
}

#[test]
fn wrong_buses_and_rates_are_refused() {
    let scenario = scenario(&[]);
    let refused = Rig::new(&scenario, 1, 1000, Vec::new(), None).err().expect("no buses");
    assert!(refused.to_string().contains("4 trucks and 0 buses"));
    let buses = || -> Vec<Box<dyn Bus>> {
        (0..4).map(|_| Box::new(Loopback::pair("x", 4).0) as Box<dyn Bus>).collect()
    };
    for rate_hz in [0, 9, 10_001] {
        assert_eq!(
            Rig::new(&scenario, 1, rate_hz, buses(), None).err(),
            Some(RigError::Rate { rate_hz })
        );
    }
}

/// A clock that runs the ECUs while the rig sleeps, and wakes it late when told to.
struct TestClock {
    now_ns: Cell<u64>,
    ecus: RefCell<Vec<TestEcu>>,
    sleeps: Cell<u64>,
    late_every: u64,
    late_ns: u64,
}

impl Clock for TestClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.ecus.borrow_mut().iter_mut().for_each(TestEcu::tick);
        self.sleeps.set(self.sleeps.get() + 1);
        let late = self.sleeps.get().is_multiple_of(self.late_every);
        let wake_ns = deadline_ns + if late { self.late_ns } else { 20_000 };
        self.now_ns.set(self.now_ns.get().max(wake_ns));
    }
}

fn clock(ecus: Vec<TestEcu>, late_every: u64, late_ns: u64) -> TestClock {
    let (now_ns, sleeps) = (Cell::new(55_000_000_000), Cell::new(0));
    TestClock { now_ns, ecus: RefCell::new(ecus), sleeps, late_every, late_ns }
}

#[test]
fn a_late_rig_catches_up_with_the_clock() {
    let (mut rig, ecus) = bench(&scenario(&[("duration_s", "5")]), 1, 1000);
    let clock = clock(ecus, 50, 7_300_000);
    let stop = AtomicBool::new(false);
    let mut seen = Vec::new();
    let report = run(&mut rig, &RunOptions::new(&clock, &stop), &mut |p| seen.push(*p));
    let report = report.expect("starts");
    assert_eq!(report.end, RunEnd::Finished);
    assert_eq!(rig.time_ns(), 5_000_000_000);
    assert!(report.late_wakes > 50 && report.caught_up_steps >= 7 * report.late_wakes);
    assert_eq!(report.lateness_ns_max, 7_300_000);
    assert!(matches!(seen[0], Progress::Preparing { missing: 4 }));
    let running = seen.iter().filter(|p| matches!(p, Progress::Running { .. })).count();
    assert!((45..=55).contains(&running), "{running}");
    let results = rig.results();
    assert!(results.nodes.iter().all(|n| n.lost_commands == 0 && n.bad_crc == 0));
    let mut ecus = clock.ecus.into_inner();
    ecus[0].drain();
    let ended = ecus[0].frames.iter().rev().take(3);
    for frame in ended {
        let mission = Mission::decode(frame).expect("a farewell").0;
        assert_eq!(mission.run_state, RunState::Ended);
    }
}

#[test]
fn a_rig_of_a_slow_loop_wakes_no_more_often_than_it_must() {
    for (rate_hz, wakes) in [(1000, 2000), (500, 2000), (200, 2000), (100, 1000), (10, 80)] {
        let (mut rig, ecus) = bench(&scenario(&[("duration_s", "2")]), 1, rate_hz);
        let clock = clock(ecus, u64::MAX, 0);
        let stop = AtomicBool::new(false);
        let report = run(&mut rig, &RunOptions::new(&clock, &stop), &mut |_| {}).expect("starts");
        assert_eq!((report.wakes, report.late_wakes), (wakes, 0), "{rate_hz} Hz");
        assert_eq!((rig.time_ns(), u64::from(rig.tick())), (2_000_000_000, u64::from(2 * rate_hz)));
    }
}

/// A run of two seconds on emulated buses, with a clock that wakes the rig late now and then.
fn run_emulated(late_every: u64, late_ns: u64) -> (RunReport, Results) {
    let scenario = scenario(&[("duration_s", "2")]);
    let (mut rig_ends, mut ecus): (Vec<Box<dyn Bus>>, Vec<_>) = (Vec::new(), Vec::new());
    for _ in 0..scenario.platoon.trucks {
        let (rig_end, ecu_end) = Loopback::pair("loopback", 8192);
        rig_ends.push(Box::new(Emulated::new(rig_end, BusTiming::default())));
        ecus.push(TestEcu::new(ecu_end));
    }
    let mut rig = Rig::new(&scenario, 1, 1000, rig_ends, None).expect("fits");
    let clock = clock(ecus, late_every, late_ns);
    let stop = AtomicBool::new(false);
    let options = RunOptions { serves_buses: true, ..RunOptions::new(&clock, &stop) };
    let report = run(&mut rig, &options, &mut |_| {}).expect("starts");
    (report, rig.results())
}

#[test]
fn emulated_buses_are_served_between_the_steps_and_the_traffic_is_told() {
    let (report, results) = run_emulated(u64::MAX, 0);
    assert!((1..=290_000).contains(&report.service_gap_ns_max), "{report:?}");
    assert_eq!((report.late_services, report.late_wakes), (0, 0));
    assert!(results.nodes.iter().all(|node| node.lost_commands == 0 && node.accepted > 1900));
    let of_ego = EgoState::default().encode(0).expect("in range");
    let shortest_ns = BusTiming::default().frame_time_ns(&of_ego) / 2;
    for wire in &results.wires {
        assert_eq!((wire.identifiers[0].id, wire.overflowed), (EgoState::ID, 0));
        assert!(wire.identifiers[0].frames >= 2000 && wire.identifiers[0].max_ns > shortest_ns);
    }
}

#[test]
fn services_that_come_late_are_counted() {
    let (report, results) = run_emulated(200, 3_000_000);
    assert!(report.late_services > 10 && report.service_gap_ns_max >= 3_000_000, "{report:?}");
    assert!(results.wires.iter().all(|wire| wire.overflowed == 0));
}

#[test]
fn a_silent_ecu_is_named() {
    let (mut rig, mut ecus) = bench(&scenario(&[]), 1, 1000);
    ecus[2].dead = true;
    let clock = clock(ecus, u64::MAX, 0);
    let stop = AtomicBool::new(false);
    let refused = run(&mut rig, &RunOptions::new(&clock, &stop), &mut |_| {});
    let message = refused.expect_err("truck 2 is silent").to_string();
    assert!(message.contains("truck 2") && message.contains("loopback2"), "{message}");
    assert!(message.contains("10 s"), "{message}");
}

#[test]
fn a_stop_ends_the_run_and_its_verdict_is_fail() {
    let (mut rig, ecus) = bench(&scenario(&[]), 1, 1000);
    let clock = clock(ecus, u64::MAX, 0);
    let stop = AtomicBool::new(false);
    let report = run(&mut rig, &RunOptions::new(&clock, &stop), &mut |p| {
        if matches!(p, Progress::Running { time_s, .. } if *time_s > 1.0) {
            stop.store(true, core::sync::atomic::Ordering::Relaxed);
        }
    });
    assert_eq!(report.expect("starts").end, RunEnd::Stopped);
    let results = rig.results();
    assert!(!results.passed() && results.duration_s < 1.5);
}

#[test]
fn results_are_json_with_the_contracts_names() {
    let (rig, _) = driven(&[], 1, 1000, 0.2);
    let json = serde_json::to_value(rig.results()).expect("serialises");
    let truck = &json["trucks"][1];
    for key in [
        "index",
        "max_abs_leader_error_m",
        "max_abs_predecessor_error_m",
        "final_predecessor_error_m",
        "settled_position_s",
        "settled_speed_s",
        "min_obstacle_clearance_m",
        "min_truck_gap_m",
        "max_abs_steer_rad",
        "max_abs_lateral_accel_mps2",
        "min_force_n",
        "max_force_n",
        "lane_crossings",
        "passed_obstacles",
    ] {
        assert!(truck.get(key).is_some(), "{key} is missing");
    }
    assert!(truck["min_obstacle_clearance_m"].is_null());
    assert!(json["v2v"]["delay_min_s"].is_number() && json["criteria"][0]["passed"] == false);
}

#[test]
fn every_frame_and_the_truth_are_recorded_from_the_start_on() {
    use traces::{Overflow, Recorder, RecorderOptions, Source};
    let path = std::env::temp_dir().join(format!("platoon-rig-{}.part.mcap", std::process::id()));
    let options = RecorderOptions { overflow: Overflow::Wait, ..RecorderOptions::new(Source::Rig) };
    let recorder = Recorder::start(&path, options).expect("the temp folder can be written");
    let (mut rig, mut ecus) = bench(&scenario(&[("duration_s", "2")]), 1, 1000);
    rig.tap.recorder = Some(recorder);
    start(&mut rig, &mut ecus);
    drive(&mut rig, &mut ecus, 2.0);
    let counts =
        |rig: &Rig, truck| (rig.bus(truck).counts().sent, rig.bus(truck).counts().received);
    let frames: u64 = (0..4).map(|t| counts(&rig, t)).map(|(sent, received)| sent + received).sum();
    // Before the start: one invitation and one answer per truck.
    let expected = frames - 8 + 201;
    let finished = rig.take_recorder().expect("given").finish();
    std::fs::remove_file(&path).expect("was written");
    assert_eq!((finished.written, finished.lost, finished.error), (expected, 0, None));
}
