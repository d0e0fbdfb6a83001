//! Encodes and decodes on request, one line each, so that another codec can be held against ours.
//!
//! ```text
//! encode Actuation 17 AnswersTick=5 Force=-100.05 Steering=0.01 ActuationStatus=0
//!     -> 18FF112A 1C3A11...
//! decode 18FF112A 1C3A11...
//!     -> Actuation 17 E2eCrc=14876 ... Steering=0.01
//! ```
//!
//! What is refused is answered with `refused` and the reason. `tests/interop` drives it.

use platoon_dbc::{
    Actuation, ActuationStatus, EcuMode, EcuStatus, EgoState, Frame, FrameFlags, Message, Mission,
    NavStatus, Obstacle, ObstacleKind, RunState, V2vOut, V2vState, decode_signals,
};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::{BufRead, Write as _};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let answer = match line.split_once(' ') {
            Some(("encode", rest)) => encode(rest),
            Some(("decode", rest)) => decode(rest),
            _ => Err(format!("{line}: begin with encode or decode").into()),
        };
        writeln!(out, "{}", answer.unwrap_or_else(|why| format!("refused {why}")))?;
    }
    Ok(())
}

type Answer = Result<String, Box<dyn std::error::Error>>;

fn encode(line: &str) -> Answer {
    let mut words = line.split(' ');
    let name = words.next().ok_or("no message")?;
    let counter = words.next().ok_or("no counter")?.parse()?;
    let signals = words
        .map(|word| word.split_once('=').ok_or_else(|| format!("{word}: no value")))
        .collect::<Result<HashMap<_, _>, _>>()?;
    let frame = message(name, &Given(&signals))?.encode(counter)?;
    let mut answer = format!("{:08X} ", frame.id());
    for byte in frame.data() {
        write!(answer, "{byte:02X}")?;
    }
    Ok(answer)
}

fn decode(line: &str) -> Answer {
    let (id, data) = line.split_once(' ').ok_or("no data")?;
    let data = (0..data.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(data.get(at..at + 2).unwrap_or("odd length"), 16))
        .collect::<Result<Vec<_>, _>>()?;
    let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::default() };
    let frame = Frame::new(u32::from_str_radix(id, 16)?, flags, &data)?;
    let (message, counter) = Message::decode(&frame)?;
    if message.encode(counter)? != frame {
        return Err("what was decoded does not encode to the same frame".into());
    }
    let mut signals = String::new();
    let info = decode_signals(&frame, &mut |signal, _, physical| {
        signals += &format!(" {}={:?}", signal.name, physical.value().unwrap_or(f64::NAN));
    });
    Ok(format!("{} {counter}{signals}", info.ok_or("not in the DBC")?.name))
}

/// The values of one line by signal name.
struct Given<'a>(&'a HashMap<&'a str, &'a str>);

impl Given<'_> {
    fn get<T: std::str::FromStr>(&self, signal: &str) -> Result<T, String> {
        let text = self.0.get(signal).ok_or_else(|| format!("{signal} is missing"))?;
        text.parse().map_err(|_| format!("{signal}: {text} does not fit"))
    }

    fn one_of<T>(&self, signal: &str, from_raw: fn(i64) -> Option<T>) -> Result<T, String> {
        from_raw(self.get(signal)?).ok_or_else(|| format!("{signal}: no such value"))
    }
}

fn message(name: &str, given: &Given<'_>) -> Result<Message, String> {
    Ok(match name {
        "EgoState" => Message::EgoState(EgoState {
            tick: given.get("Tick")?,
            bench_time_ns: given.get("BenchTime")?,
            position_x_m: given.get("PositionX")?,
            position_y_m: given.get("PositionY")?,
            heading_rad: given.get("Heading")?,
            speed_forward_mps: given.get("SpeedForward")?,
            speed_lateral_mps: given.get("SpeedLateral")?,
            yaw_rate_radps: given.get("YawRate")?,
            accel_forward_mps2: given.get("AccelForward")?,
            nav_status: given.one_of("NavStatus", NavStatus::from_raw)?,
        }),
        "Actuation" => Message::Actuation(Actuation {
            answers_tick: given.get("AnswersTick")?,
            force_n: given.get("Force")?,
            steering_rad: given.get("Steering")?,
            actuation_status: given.one_of("ActuationStatus", ActuationStatus::from_raw)?,
        }),
        "V2vState" => Message::V2vState(V2vState {
            source_truck: given.get("SourceTruck")?,
            sequence: given.get("Sequence")?,
            generation_time_ns: given.get("GenerationTime")?,
            position_x_m: given.get("PositionX")?,
            position_y_m: given.get("PositionY")?,
            speed_mps: given.get("Speed")?,
            accel_mps2: given.get("Accel")?,
            intended_accel_mps2: given.get("IntendedAccel")?,
        }),
        "V2vOut" => Message::V2vOut(V2vOut {
            sequence: given.get("Sequence")?,
            generation_time_ns: given.get("GenerationTime")?,
            position_x_m: given.get("PositionX")?,
            position_y_m: given.get("PositionY")?,
            heading_rad: given.get("Heading")?,
            speed_mps: given.get("Speed")?,
            yaw_rate_radps: given.get("YawRate")?,
            accel_mps2: given.get("Accel")?,
            intended_accel_mps2: given.get("IntendedAccel")?,
        }),
        "Obstacle" => obstacle(given)?,
        "Mission" => mission(given)?,
        "EcuStatus" => Message::EcuStatus(EcuStatus {
            ecu_mode: given.one_of("EcuMode", EcuMode::from_raw)?,
            gain_id: given.get("GainId")?,
            tick_count: given.get("TickCount")?,
            misses: given.get("Misses")?,
            skipped: given.get("Skipped")?,
        }),
        _ => return Err(format!("{name}: no such message")),
    })
}

fn obstacle(given: &Given<'_>) -> Result<Message, String> {
    let page = given.get("ObstaclePage")?;
    let paged = |signal: &str| format!("{signal}_{page}");
    Ok(Message::Obstacle(Obstacle {
        page,
        kind: given.one_of(&paged("Kind"), ObstacleKind::from_raw)?,
        member: given.get(&paged("Member"))?,
        measured_time_ns: given.get(&paged("MeasuredTime"))?,
        position_x_m: given.get(&paged("PositionX"))?,
        position_y_m: given.get(&paged("PositionY"))?,
        speed_x_mps: given.get(&paged("SpeedX"))?,
        speed_y_mps: given.get(&paged("SpeedY"))?,
        heading_rad: given.get(&paged("Heading"))?,
        length_m: given.get(&paged("Length"))?,
        width_m: given.get(&paged("Width"))?,
    }))
}

fn mission(given: &Given<'_>) -> Result<Message, String> {
    Ok(Message::Mission(Mission {
        truck_index: given.get("TruckIndex")?,
        platoon_size: given.get("PlatoonSize")?,
        run_state: given.one_of("RunState", RunState::from_raw)?,
        spacing_m: given.get("Spacing")?,
        set_speed_mps: given.get("SetSpeed")?,
        desired_y_m: given.get("DesiredY")?,
        lane_width_m: given.get("LaneWidth")?,
        right_edge_y_m: given.get("RightEdgeY")?,
        left_edge_y_m: given.get("LeftEdgeY")?,
        loop_period_ns: given.get("LoopPeriod")?,
    }))
}
