//! Writes a made-up but complete run: every topic, every message of both profiles, two kinds of
//! obstacles. It serves to try viewers and stock readers, and to measure size and speed.
//!
//! Of several trucks the last one speaks J1939; its actuators are unknown for half a second.
//!
//! ```text
//! cargo run --release -p traces --example sample_run -- FOLDER [SECONDS] [TRUCKS]
//! ```

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use platoon_dbc as dbc;
use traces::{
    Attachment, FrameRecord, MemoryRecord, MergeOptions, MissCause, ObstacleKind, ObstacleTruth,
    Overflow, Recorder, RecorderOptions, Snapshot, Source, TickOutcome, TickRecord, TruckTruth,
    TruthRecord,
};

const START_WALL_NS: u64 = 1_800_000_000_000_000_000;
const TICK_NS: u64 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: sample_run FOLDER [S] [TRUCKS]")?);
    let seconds: u32 = arguments.next().map_or(Ok(2), |text| text.parse())?;
    let trucks: u8 = arguments.next().map_or(Ok(2), |text| text.parse())?;
    std::fs::create_dir_all(&folder)?;

    let began = Instant::now();
    let parts = record(&folder, seconds * 1000, trucks)?;
    println!("recorded {seconds} s of {trucks} trucks in {:.2?}", began.elapsed());

    let began = Instant::now();
    let out = folder.join("run.mcap");
    let report = traces::merge(&parts, &out, &options(seconds))?;
    let megabytes = report.bytes as f64 * 1e-6;
    println!("merged {} messages in {:.2?}", report.messages, began.elapsed());
    println!("{}: {megabytes:.1} MB", out.display());
    for part in &report.parts {
        println!("  {}: {part}", part.name());
    }
    Ok(())
}

fn options(seconds: u32) -> MergeOptions {
    let run = [("seed", "1"), ("backend", "sample"), ("scenario", "sample")];
    let run = run.map(|(key, value)| (key.to_owned(), value.to_owned()));
    MergeOptions {
        attachments: vec![
            attachment("platoon.dbc", "text/plain", dbc::Profile::Fd.dbc()),
            attachment("j1939.dbc", "text/plain", dbc::Profile::J1939.dbc()),
            attachment("scenario.toml", "application/toml", &format!("duration_s = {seconds}\n")),
        ],
        metadata: BTreeMap::from([("run".to_owned(), run.into())]),
        ..MergeOptions::default()
    }
}

fn attachment(name: &str, media_type: &str, text: &str) -> Attachment {
    Attachment { name: name.into(), media_type: media_type.into(), data: text.into() }
}

/// Everything that records: the rig and one ECU per truck.
struct Bench {
    rig: Recorder,
    ecus: Vec<Recorder>,
    /// What makes the frames of each bus: those of the rig and those of the ECU.
    voices: Vec<[dbc::Encoder; 2]>,
    noise: Noise,
}

fn record(folder: &Path, ticks: u32, trucks: u8) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let mut parts = vec![folder.join("rig.part.mcap")];
    parts.extend((0..trucks).map(|truck| folder.join(format!("ecu{truck}.part.mcap"))));
    let mut bench = Bench {
        rig: start(&parts[0], Source::Rig)?,
        ecus: (0..trucks)
            .map(|truck| start(&parts[1 + usize::from(truck)], Source::Ecu(truck)))
            .collect::<Result<_, _>>()?,
        voices: (0..trucks).map(|truck| voices(truck > 0 && truck + 1 == trucks)).collect(),
        noise: Noise(1),
    };
    for tick in 0..ticks {
        for truck in 0..trucks {
            bench.tick(tick, truck)?;
        }
        if tick.is_multiple_of(10) {
            let truth = truth(tick, trucks);
            bench.rig.push(truth);
        }
    }
    for recorder in bench.ecus.into_iter().chain([bench.rig]) {
        let finished = recorder.finish();
        if let Some(error) = finished.error {
            return Err(error.into());
        }
    }
    Ok(parts)
}

fn voices(speaks_j1939: bool) -> [dbc::Encoder; 2] {
    let profile = if speaks_j1939 { dbc::Profile::J1939 } else { dbc::Profile::Fd };
    [dbc::Encoder::new(profile, dbc::Vehicle::default()); 2]
}

fn start(path: &Path, source: Source) -> Result<Recorder, traces::RecorderError> {
    let options = RecorderOptions {
        start_wall_ns: START_WALL_NS,
        overflow: Overflow::Wait,
        interfaces: (0..4).map(|bus| format!("truck{bus}")).collect(),
        ..RecorderOptions::new(source)
    };
    Recorder::start(path, options)
}

impl Bench {
    /// One truck's traffic and tick.
    fn tick(&mut self, tick: u32, truck: u8) -> Result<(), Box<dyn Error>> {
        let time_ns = u64::from(tick) * TICK_NS;
        let ego = self.ego(tick, truck);
        self.rig_says(truck, tick, &dbc::Message::EgoState(ego))?;
        if tick.is_multiple_of(20) {
            let v2v = self.v2v(tick);
            self.rig_says(truck, tick, &dbc::Message::V2vState(v2v))?;
        }
        if tick.is_multiple_of(50) {
            for page in 0..8 {
                self.rig_says(truck, tick, &dbc::Message::Obstacle(obstacle(tick, page)))?;
            }
        }
        if tick.is_multiple_of(1000) {
            self.rig_says(truck, tick, &dbc::Message::Mission(mission(truck)))?;
        }
        let record = self.law(tick, truck, &ego);
        self.ecus[usize::from(truck)].push(record);
        if tick.is_multiple_of(10_000) {
            let snapshot = Snapshot::new(&[truck; 600]).ok_or("too long")?;
            self.ecus[usize::from(truck)].push(MemoryRecord { time_ns, tick, snapshot });
        }
        let command = dbc::Actuation {
            answers_tick: tick,
            force_n: record.force_n,
            steering_rad: record.steering_rad,
            actuation_status: dbc::ActuationStatus::Solved,
        };
        self.ecu_says(truck, tick, &dbc::Message::Actuation(command))?;
        if tick > 500 {
            let [rig, _] = &mut self.voices[usize::from(truck)];
            rig.note_actuators(record.force_n, record.steering_rad);
        }
        if tick.is_multiple_of(20) {
            self.ecu_says(truck, tick, &dbc::Message::V2vOut(v2v_out(tick, &ego)))?;
        }
        if tick.is_multiple_of(100) {
            self.ecu_says(truck, tick, &dbc::Message::EcuStatus(status(tick)))?;
        }
        Ok(())
    }

    fn rig_says(
        &mut self,
        bus: u8,
        tick: u32,
        message: &dbc::Message,
    ) -> Result<(), dbc::EncodeError> {
        let [mut voice, _] = self.voices[usize::from(bus)];
        let mut send = |frame: &dbc::Frame| self.rig_sends(bus, tick, *frame);
        voice.encode(message, u64::from(tick) * TICK_NS, &mut send)?;
        self.voices[usize::from(bus)][0] = voice;
        Ok(())
    }

    fn ecu_says(
        &mut self,
        bus: u8,
        tick: u32,
        message: &dbc::Message,
    ) -> Result<(), dbc::EncodeError> {
        let [_, mut voice] = self.voices[usize::from(bus)];
        let mut send = |frame: &dbc::Frame| self.ecu_sends(bus, tick, *frame);
        voice.encode(message, u64::from(tick) * TICK_NS, &mut send)?;
        self.voices[usize::from(bus)][1] = voice;
        Ok(())
    }

    /// A frame of the rig's: on its tap as sent, at the ECU as received.
    fn rig_sends(&mut self, bus: u8, tick: u32, frame: dbc::Frame) {
        let time_ns = u64::from(tick) * TICK_NS;
        let stamp_ns = START_WALL_NS + time_ns + 20_000 + self.noise.below(60_000);
        let sent = FrameRecord { bus, time_ns, stamp_ns: 0, tick, tx: true, frame };
        self.rig.push(sent);
        let received = FrameRecord { time_ns: time_ns + TICK_NS / 2, stamp_ns, tx: false, ..sent };
        self.ecus[usize::from(bus)].push(received);
    }

    /// A frame of an ECU's, as the rig receives it.
    fn ecu_sends(&mut self, bus: u8, tick: u32, frame: dbc::Frame) {
        let time_ns = u64::from(tick + 1) * TICK_NS;
        let stamp_ns = START_WALL_NS + time_ns - 300_000 + self.noise.below(60_000);
        self.rig.push(FrameRecord { bus, time_ns, stamp_ns, tick: tick + 1, tx: false, frame });
    }

    fn ego(&mut self, tick: u32, truck: u8) -> dbc::EgoState {
        let time_s = f64::from(tick) * 1e-3;
        let mut noisy = |value: f64, sigma: f64| value + sigma * self.noise.unit();
        dbc::EgoState {
            tick,
            bench_time_ns: u64::from(tick) * TICK_NS,
            position_x_m: noisy(x_m(time_s, truck), 1e-3),
            position_y_m: noisy(y_m(time_s), 1e-3),
            heading_rad: noisy(0.02 * (0.2 * time_s).cos(), 1e-4),
            speed_forward_mps: noisy(20.0 + (0.1 * time_s).sin(), 1e-3),
            speed_lateral_mps: noisy(0.0, 1e-3),
            yaw_rate_radps: noisy(0.0, 1e-4),
            accel_forward_mps2: noisy(0.1 * (0.1 * time_s).cos(), 5e-3),
            nav_status: dbc::NavStatus::Valid,
        }
    }

    fn v2v(&mut self, tick: u32) -> dbc::V2vState {
        let time_s = f64::from(tick) * 1e-3;
        dbc::V2vState {
            source_truck: 0,
            sequence: (tick / 20) as u16,
            generation_time_ns: u64::from(tick) * TICK_NS,
            position_x_m: x_m(time_s, 0) + 1e-2 * self.noise.unit(),
            position_y_m: y_m(time_s),
            speed_mps: 20.0,
            accel_mps2: 0.0,
            intended_accel_mps2: 0.1,
        }
    }

    /// A made-up answer of the law: every field moves as it would.
    fn law(&mut self, tick: u32, truck: u8, ego: &dbc::EgoState) -> TickRecord {
        let mut around = |middle_ns: u32| middle_ns + self.noise.below(u64::from(middle_ns)) as u32;
        let phases = [around(4_000), around(2_000), around(800), around(20_000), around(60_000)];
        let [wake_ns, drain_ns, ucl_ns, lml_build_ns, qp_ns] = phases;
        let noise = self.noise.unit();
        let is_late = self.noise.below(5_000) == 0;
        TickRecord {
            time_ns: u64::from(tick) * TICK_NS + TICK_NS / 2,
            tick,
            ecu: truck,
            wake_ns,
            drain_ns,
            ucl_ns,
            lml_build_ns,
            qp_ns,
            guard_ns: 300,
            send_ns: 5_000,
            total_ns: phases.iter().sum::<u32>() + 5_300,
            missed: is_late,
            miss_cause: if is_late { MissCause::Preempted } else { MissCause::None },
            outcome: TickOutcome::Solved,
            qp_iterations: 3,
            qp_changes: 1,
            working_set: TickRecord::split_working_set(1 << 77 | 0b101),
            kkt_residual: 1e-12 * noise as f32,
            force_n: 2_000.0 * ego.accel_forward_mps2 + 100.0 * noise,
            steering_rad: -0.1 * ego.heading_rad + 1e-4 * noise,
            reference_mps: 20.0 + 0.01 * noise,
            accel_mps2: 0.1 * noise,
            leader_error: [0.1, 0.01, 0.001].map(|scale| scale * noise as f32),
            predecessor_error: [0.05, 0.02, 0.003].map(|scale| scale * noise as f32),
            leader_age_s: 0.05,
            predecessor_age_s: 0.04,
            adaptive_weight: 1.0,
            potential: noise.abs() as f32,
            ..TickRecord::default()
        }
    }
}

fn x_m(time_s: f64, truck: u8) -> f64 {
    20.0 * time_s - 10.0 * (0.1 * time_s).cos() - 25.0 * f64::from(truck)
}

fn y_m(time_s: f64) -> f64 {
    2.0 + 1.9 * (0.2 * time_s).sin()
}

fn obstacle(tick: u32, page: u8) -> dbc::Obstacle {
    let time_ns = u64::from(tick) * TICK_NS;
    let kinds = [dbc::ObstacleKind::Vehicle, dbc::ObstacleKind::Pedestrian];
    let kind = kinds.get(usize::from(page)).copied().unwrap_or(dbc::ObstacleKind::None);
    dbc::Obstacle {
        page,
        kind,
        member: 255,
        measured_time_ns: time_ns,
        position_x_m: 100.0 + 10.0 * f64::from(page),
        position_y_m: 2.0,
        speed_x_mps: 17.0,
        speed_y_mps: -0.5,
        heading_rad: 0.0,
        length_m: 4.5,
        width_m: 1.9,
    }
}

fn mission(truck: u8) -> dbc::Mission {
    dbc::Mission {
        truck_index: truck,
        platoon_size: 4,
        run_state: dbc::RunState::Running,
        spacing_m: 25.0,
        set_speed_mps: 20.0,
        desired_y_m: 2.0,
        lane_width_m: 4.0,
        right_edge_y_m: 0.0,
        left_edge_y_m: 8.0,
        loop_period_ns: TICK_NS as u32,
        place: truck,
        leader_truck: 0,
        predecessor_truck: truck.saturating_sub(1),
        leader_distance_m: 25.0 * f64::from(truck),
    }
}

fn v2v_out(tick: u32, ego: &dbc::EgoState) -> dbc::V2vOut {
    dbc::V2vOut {
        sequence: (tick / 20) as u16,
        generation_time_ns: ego.bench_time_ns,
        position_x_m: ego.position_x_m,
        position_y_m: ego.position_y_m,
        heading_rad: ego.heading_rad,
        speed_mps: ego.speed_forward_mps,
        yaw_rate_radps: ego.yaw_rate_radps,
        accel_mps2: ego.accel_forward_mps2,
        intended_accel_mps2: 0.1,
    }
}

fn status(tick: u32) -> dbc::EcuStatus {
    dbc::EcuStatus {
        ecu_mode: dbc::EcuMode::Running,
        gain_id: 1,
        tick_count: tick,
        misses: 2,
        skipped: 0,
    }
}

fn truth(tick: u32, trucks: u8) -> TruthRecord {
    let time_s = f64::from(tick) * 1e-3;
    let mut truth = TruthRecord { time_ns: u64::from(tick) * TICK_NS, ..TruthRecord::default() };
    for truck in 0..trucks {
        let state = TruckTruth {
            x_m: x_m(time_s, truck),
            y_m: y_m(time_s),
            heading_rad: 0.02 * (0.2 * time_s).cos(),
            forward_mps: 20.0 + (0.1 * time_s).sin(),
            accel_forward_mps2: 0.1 * (0.1 * time_s).cos(),
            force_command_n: 200.0 * (0.1 * time_s).cos(),
            force_n: 199.0 * (0.1 * time_s).cos(),
            obstacle_clearance_m: 30.0 + time_s.sin(),
            leader_delay_s: 0.05,
            predecessor_delay_s: 0.04,
            front_m: 4.0,
            rear_m: 6.0,
            width_m: 2.5,
            ..TruckTruth::default()
        };
        let _ = truth.trucks.push(state); // a sample of more trucks than fit shows those that do
    }
    for (number, kind) in [(1, ObstacleKind::Vehicle), (2, ObstacleKind::Pedestrian)] {
        let state = ObstacleTruth {
            number,
            kind,
            present: number == 1 || tick > 500,
            x_m: 100.0 + 17.0 * time_s,
            y_m: 2.0,
            vx_mps: 17.0,
            length_m: 4.5,
            width_m: 1.9,
            ..ObstacleTruth::default()
        };
        let _ = truth.obstacles.push(state);
    }
    truth
}

/// A small generator of noise, seeded: a run is the same every time.
struct Noise(u64);

impl Noise {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) % limit
    }

    /// Between -1 and 1.
    fn unit(&mut self) -> f64 {
        self.below(1 << 30) as f64 / f64::from(1 << 29) - 1.0
    }
}
