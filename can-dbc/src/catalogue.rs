//! What the DBCs say, as tables: for tools that show or make whatever is on the bus.

use crate::bits::{self, Payload};
use crate::codec::{self, EncodeError};
use crate::frame::Frame;
use crate::protection::Protection;
use crate::reading::Reading;
use crate::{j1939, messages};

/// Bit numbering of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Intel, `@1` in the DBC: the start bit is the least significant one.
    LittleEndian,
}

/// Raw values that stand for no value. What lies between the range and them is an error too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Codes {
    /// What is sent for an error, when there is such a code.
    pub error: Option<i64>,
    /// What is sent when not available.
    pub not_available: i64,
    /// The first of the raw values that mean not available.
    pub not_available_from: i64,
}

/// One signal as the DBC describes it.
#[derive(Debug)]
pub struct SignalInfo {
    /// Name in the DBC.
    pub name: &'static str,
    /// Position of the least significant bit.
    pub start_bit: u32,
    /// Number of bits.
    pub size: u32,
    /// Bit numbering.
    pub byte_order: ByteOrder,
    /// Two's complement when true.
    pub signed: bool,
    /// Physical value of one raw step, in `unit`.
    pub factor: f64,
    /// Physical value of raw 0, in `unit`.
    pub offset: f64,
    /// Smallest physical value, in `unit`.
    pub min: f64,
    /// Largest physical value, in `unit`.
    pub max: f64,
    /// Smallest raw value.
    pub raw_min: i64,
    /// Largest raw value.
    pub raw_max: i64,
    /// Raw value before anything is known.
    pub raw_start: i64,
    /// Unit as written in the DBC; empty when dimensionless.
    pub unit: &'static str,
    /// Description.
    pub comment: &'static str,
    /// Suspect parameter number, when SAE J1939 has given the signal one.
    pub spn: Option<u32>,
    /// Raw values that have a name.
    pub values: &'static [(i64, &'static str)],
    /// Raw values that stand for no value.
    pub codes: Option<Codes>,
    /// Page this signal belongs to; `None` when every frame has it.
    pub multiplexed: Option<u32>,
    /// True for the signal that tells the page.
    pub is_multiplexor: bool,
}

impl SignalInfo {
    /// Name of a raw value, when the DBC gives it one.
    pub fn value_text(&self, raw: i64) -> Option<&'static str> {
        self.values.iter().find(|(value, _)| *value == raw).map(|(_, text)| *text)
    }

    /// What a raw value says, in `unit`.
    pub fn reading(&self, raw: i64) -> Reading<f64> {
        match self.codes {
            Some(codes) if raw >= codes.not_available_from => Reading::NotAvailable,
            Some(codes) if raw > self.raw_max || Some(raw) == codes.error => Reading::Error,
            _ => Reading::Value(raw as f64 * self.factor + self.offset),
        }
    }

    pub(crate) fn read(&self, payload: &Payload) -> i64 {
        if self.signed {
            bits::get_signed(payload, self.start_bit, self.size)
        } else {
            bits::get(payload, self.start_bit, self.size) as i64
        }
    }
}

/// One message as the DBC describes it.
#[derive(Debug)]
pub struct MessageInfo {
    /// Name in the DBC.
    pub name: &'static str,
    /// 29-bit identifier.
    pub id: u32,
    /// Payload length in bytes.
    pub length: usize,
    /// CAN FD when true, else classic CAN.
    pub is_fd: bool,
    /// Cycle time, milliseconds.
    pub cycle_time_ms: u32,
    /// How it is protected.
    pub protection: Protection,
    /// Index of its alive counter in `signals`.
    pub counter: Option<usize>,
    /// Node that sends it.
    pub sender: &'static str,
    /// Number of pages; 1 when not multiplexed.
    pub pages: u32,
    /// Description.
    pub comment: &'static str,
    /// Its signals in the order of their bits: those in every frame, then page by page.
    pub signals: &'static [SignalInfo],
}

/// The description of the message with this 29-bit identifier, whichever DBC has it.
pub fn message_info(id: u32) -> Option<&'static MessageInfo> {
    messages::MESSAGES.iter().chain(j1939::MESSAGES).find(|message| message.id == id)
}

/// Calls `visit` with each signal of a frame of any profile, its raw value and what that says.
///
/// For tools that show whatever is on the bus: neither checksum nor ranges are judged, and of a
/// multiplexed message only the page the frame carries is visited. Returns the message, or `None`
/// (and no call) when the frame is no data frame of a profile or its format or length differs.
pub fn decode_signals(
    frame: &Frame,
    visit: &mut dyn FnMut(&'static SignalInfo, i64, Reading<f64>),
) -> Option<&'static MessageInfo> {
    let message = message_info(frame.id())?;
    codec::check_shape(frame, message).ok()?;
    let payload = frame.payload();
    let page = message.signals.iter().find(|signal| signal.is_multiplexor);
    let page = page.map(|signal| signal.read(payload));
    for signal in message.signals {
        if signal.multiplexed.is_none() || signal.multiplexed.map(i64::from) == page {
            let raw = signal.read(payload);
            visit(signal, raw, signal.reading(raw));
        }
    }
    Some(message)
}

/// Makes a frame from what `value_of` says of each signal, in the signal's unit.
///
/// For tools that know a message by its name only. The checksum is made; the alive counter is a
/// signal like any other. A signal without a value keeps its start value, and of a multiplexed
/// message only the page chosen by its multiplexor is asked for.
///
/// # Errors
/// A value is not a number or leaves its range.
pub fn encode_signals(
    message: &MessageInfo,
    value_of: &mut dyn FnMut(&SignalInfo) -> Option<Reading<f64>>,
) -> Result<Frame, EncodeError> {
    let mut payload = codec::blank(message);
    let mut page = None;
    for signal in message.signals {
        if signal.multiplexed.is_some() && signal.multiplexed.map(i64::from) != page {
            continue;
        }
        match value_of(signal) {
            Some(value) => codec::put_reading(&mut payload, signal, value)?,
            None => bits::put(&mut payload, signal.start_bit, signal.size, signal.raw_start as u64),
        }
        if signal.is_multiplexor {
            page = Some(signal.read(&payload));
        }
    }
    Ok(codec::seal(payload, message))
}
