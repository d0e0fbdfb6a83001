//! Encodes and decodes on request, one line each, so that another codec can be held against ours.
//!
//! ```text
//! encode Actuation E2eCounter=17 AnswersTick=5 Force=-100.05 Steering=0.01 ActuationStatus=0
//!     -> 18FF112A 1C3A11...
//! encode VDC2 SteeringWheelAngle=not_available YawRate=error LateralAcceleration=0.5 ...
//!     -> 18F0090B FFFF...
//! decode 18FF112A 1C3A11...
//!     -> Actuation E2eCrc=14876 ... Steering=0.01 | Actuation(Actuation { answers_tick: 5, ... })
//! ```
//!
//! `decode` goes through the generated struct and back, and shows it behind the bar. What is
//! refused is answered with `refused` and the reason. `tests/interop` drives it.

use platoon_dbc::{
    Frame, FrameFlags, MESSAGES, Message, MessageInfo, Reading, decode_signals, encode_signals,
    j1939, message_info,
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
    let mut messages = MESSAGES.iter().chain(j1939::MESSAGES);
    let message = messages.find(|message| message.name == name).ok_or("no such message")?;
    let given = words
        .map(|word| {
            let (signal, text) = word.split_once('=').ok_or_else(|| format!("{word}: no value"))?;
            Ok((signal, reading(text)?))
        })
        .collect::<Result<HashMap<_, _>, Box<dyn std::error::Error>>>()?;
    let frame = encode_signals(message, &mut |signal| given.get(signal.name).copied())?;
    Ok(format!("{:08X} {}", frame.id(), hex(&frame)))
}

fn reading(text: &str) -> Result<Reading<f64>, std::num::ParseFloatError> {
    Ok(match text {
        "error" => Reading::Error,
        "not_available" => Reading::NotAvailable,
        number => Reading::Value(number.parse()?),
    })
}

fn decode(line: &str) -> Answer {
    let (id, data) = line.split_once(' ').ok_or("no data")?;
    let data = (0..data.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(data.get(at..at + 2).unwrap_or("odd length"), 16))
        .collect::<Result<Vec<_>, _>>()?;
    let message = message_info(u32::from_str_radix(id, 16)?).ok_or("no such message")?;
    let is_fd = message.is_fd;
    let flags = FrameFlags { is_extended: true, is_fd, brs: is_fd, ..FrameFlags::default() };
    let frame = Frame::new(message.id, flags, &data)?;
    let fields = through_the_struct(message, &frame)?;
    let mut signals = String::new();
    decode_signals(&frame, &mut |signal, _, reading| {
        signals += &match reading {
            Reading::Value(value) => format!(" {}={value:?}", signal.name),
            Reading::Error => format!(" {}=error", signal.name),
            Reading::NotAvailable => format!(" {}=not_available", signal.name),
        };
    });
    Ok(format!("{}{signals} | {fields}", message.name))
}

/// The generated struct, once it has been shown to encode to the frame it came from.
fn through_the_struct(message: &MessageInfo, frame: &Frame) -> Answer {
    let (fields, again) = if message.is_fd {
        let (message, counter) = Message::decode(frame)?;
        (format!("{message:?}"), message.encode(counter)?)
    } else {
        let (message, counter) = j1939::Message::decode(frame)?;
        (format!("{message:?}"), message.encode(counter.unwrap_or(0))?)
    };
    if again == *frame {
        Ok(fields)
    } else {
        Err(format!("{fields} encodes to {}", hex(&again)).into())
    }
}

fn hex(frame: &Frame) -> String {
    frame.data().iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02X}");
        text
    })
}
