//! What the generated messages call: scaling, range checks, sealing and opening of frames.
//!
//! Scaling is done in `f64` with the quotient rounded to the nearest integer, ties to even, so a
//! decoded value is at most half a factor away from the one encoded. Nothing is ever clipped: what
//! does not fit is refused by name.

use crate::bits::{self, Payload};
use crate::e2e;
use crate::frame::Frame;
use crate::messages::MESSAGES;

/// Bit numbering of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Intel, `@1` in the DBC: the start bit is the least significant one.
    LittleEndian,
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
    /// Raw values that have a name.
    pub values: &'static [(i64, &'static str)],
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

    fn read(&self, payload: &Payload) -> i64 {
        if self.signed {
            bits::get_signed(payload, self.start_bit, self.size)
        } else {
            bits::get(payload, self.start_bit, self.size) as i64
        }
    }

    fn scale(&self, raw: i64) -> f64 {
        raw as f64 * self.factor + self.offset
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
    /// Cycle time, milliseconds.
    pub cycle_time_ms: u32,
    /// Data ID of the E2E protection.
    pub e2e_data_id: u16,
    /// Node that sends it.
    pub sender: &'static str,
    /// Number of pages; 1 when not multiplexed.
    pub pages: u32,
    /// Description.
    pub comment: &'static str,
    /// Its signals: `E2eCrc` and `E2eCounter`, those in every frame, then page by page.
    pub signals: &'static [SignalInfo],
}

/// Why a message was not encoded. Carries the name of the signal in the DBC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The value is NaN.
    #[error("{0} is not a number")]
    NotANumber(&'static str),
    /// The value leaves the DBC's range.
    #[error("{0} is out of the range the DBC allows")]
    OutOfRange(&'static str),
}

/// Why a frame was not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The identifier is not in the DBC, or not the one of the message asked for.
    #[error("the identifier is not the expected one")]
    UnknownId,
    /// Not an extended CAN FD data frame.
    #[error("not an extended CAN FD data frame")]
    WrongFlags,
    /// The payload length differs from the DBC.
    #[error("the payload length differs from the DBC")]
    WrongLength,
    /// The E2E CRC does not match.
    #[error("the E2E CRC does not match")]
    Crc,
    /// The signal's value leaves the DBC's range or has no meaning in its value table.
    #[error("{0} is out of the range the DBC allows")]
    OutOfRange(&'static str),
}

/// The DBC's description of the message with this 29-bit identifier.
pub fn message_info(id: u32) -> Option<&'static MessageInfo> {
    MESSAGES.iter().find(|message| message.id == id)
}

/// Calls `visit` with each signal of a frame of the contract, its raw and its physical value.
///
/// For tools that show whatever is on the bus: neither CRC nor ranges are judged, and of a
/// multiplexed message only the page the frame carries is visited. Returns the message, or `None`
/// (and no call) when the frame is no data frame of the contract or its length differs.
pub fn decode_signals(
    frame: &Frame,
    visit: &mut dyn FnMut(&'static SignalInfo, i64, f64),
) -> Option<&'static MessageInfo> {
    let message = message_info(frame.id())?;
    check_shape(frame, message).ok()?;
    let payload = frame.payload();
    let page = message.signals.iter().find(|signal| signal.is_multiplexor);
    let page = page.map(|signal| signal.read(payload));
    for signal in message.signals {
        if signal.multiplexed.is_none() || signal.multiplexed.map(i64::from) == page {
            let raw = signal.read(payload);
            visit(signal, raw, signal.scale(raw));
        }
    }
    Some(message)
}

/// Writes a scaled signal.
pub(crate) fn put_physical(
    payload: &mut Payload,
    signal: &SignalInfo,
    value: f64,
) -> Result<(), EncodeError> {
    if value.is_nan() {
        return Err(EncodeError::NotANumber(signal.name));
    }
    if !(signal.min..=signal.max).contains(&value) {
        return Err(EncodeError::OutOfRange(signal.name));
    }
    let raw = ((value - signal.offset) / signal.factor).round_ties_even();
    put_integer(payload, signal, raw as i128)
}

/// Writes a signal given in raw steps.
pub(crate) fn put_integer(
    payload: &mut Payload,
    signal: &SignalInfo,
    raw: i128,
) -> Result<(), EncodeError> {
    if !(i128::from(signal.raw_min)..=i128::from(signal.raw_max)).contains(&raw) {
        return Err(EncodeError::OutOfRange(signal.name));
    }
    bits::put(payload, signal.start_bit, signal.size, raw as u64);
    Ok(())
}

/// Reads a signal in raw steps.
pub(crate) fn integer(payload: &Payload, signal: &SignalInfo) -> Result<i64, DecodeError> {
    let raw = signal.read(payload);
    if !(signal.raw_min..=signal.raw_max).contains(&raw) {
        return Err(DecodeError::OutOfRange(signal.name));
    }
    Ok(raw)
}

/// Reads a scaled signal.
pub(crate) fn physical(payload: &Payload, signal: &SignalInfo) -> Result<f64, DecodeError> {
    integer(payload, signal).map(|raw| signal.scale(raw))
}

/// Reads a signal whose every value must have a meaning.
pub(crate) fn described<E>(
    payload: &Payload,
    signal: &SignalInfo,
    from_raw: impl Fn(i64) -> Option<E>,
) -> Result<E, DecodeError> {
    from_raw(integer(payload, signal)?).ok_or(DecodeError::OutOfRange(signal.name))
}

/// The signals of the page to be written, `page` in raw steps of the multiplexor.
pub(crate) fn encode_page(
    signals: &'static [SignalInfo],
    multiplexor: usize,
    first: usize,
    stride: usize,
    page: i128,
) -> Result<&'static [SignalInfo], EncodeError> {
    let refused = EncodeError::OutOfRange(signals[multiplexor].name);
    let page = usize::try_from(page).map_err(|_| refused)?;
    page_window(signals, first, stride, page).ok_or(refused)
}

/// The number and the signals of the page a frame carries.
pub(crate) fn decode_page(
    payload: &Payload,
    signals: &'static [SignalInfo],
    multiplexor: usize,
    first: usize,
    stride: usize,
) -> Result<(i64, &'static [SignalInfo]), DecodeError> {
    let raw = integer(payload, &signals[multiplexor])?;
    let refused = DecodeError::OutOfRange(signals[multiplexor].name);
    let page = usize::try_from(raw).map_err(|_| refused)?;
    page_window(signals, first, stride, page).map(|page| (raw, page)).ok_or(refused)
}

fn page_window(
    signals: &'static [SignalInfo],
    first: usize,
    stride: usize,
    page: usize,
) -> Option<&'static [SignalInfo]> {
    let start = page.checked_mul(stride)?.checked_add(first)?;
    signals.get(start..start.checked_add(stride)?)
}

/// Protects a filled payload and makes the frame.
pub(crate) fn seal(mut payload: Payload, message: &MessageInfo, counter: u8) -> Frame {
    e2e::protect(&mut payload[..message.length], message.e2e_data_id, counter);
    Frame::sealed(message.id, message.length, payload)
}

/// Judges a frame as this message; its payload and alive counter when it is one, undamaged.
///
/// The BRS and ESI flags are not judged: they tell how the frame was sent, not what it says.
pub(crate) fn open<'a>(
    frame: &'a Frame,
    message: &MessageInfo,
) -> Result<(&'a Payload, u8), DecodeError> {
    check_shape(frame, message)?;
    let counter = e2e::check(frame.data(), message.e2e_data_id).ok_or(DecodeError::Crc)?;
    Ok((frame.payload(), counter))
}

fn check_shape(frame: &Frame, message: &MessageInfo) -> Result<(), DecodeError> {
    let flags = frame.flags();
    if !flags.is_extended || frame.id() != message.id {
        return Err(DecodeError::UnknownId);
    }
    if !flags.is_fd || flags.is_rtr || flags.is_error {
        return Err(DecodeError::WrongFlags);
    }
    if frame.data().len() != message.length {
        return Err(DecodeError::WrongLength);
    }
    Ok(())
}
