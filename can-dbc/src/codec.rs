//! What the generated messages call: scaling, range checks, sealing and opening of frames.
//!
//! Scaling is done in `f64` with the quotient rounded to the nearest integer, ties to even, so a
//! decoded value is at most half a factor away from the one encoded. Nothing is ever clipped: what
//! does not fit is refused by name.

use crate::bits::{self, Payload};
use crate::catalogue::{MessageInfo, SignalInfo};
use crate::frame::Frame;
use crate::reading::Reading;

/// Why a message was not encoded. Carries the name of the signal in the DBC, or of the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The value is NaN.
    #[error("{0} is not a number")]
    NotANumber(&'static str),
    /// The value leaves the DBC's range.
    #[error("{0} is out of the range the DBC allows")]
    OutOfRange(&'static str),
    /// The profile has no frames for the message.
    #[error("the profile {0} does not carry this message; the profile fd does")]
    NotInProfile(&'static str),
}

/// Why a frame was not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The identifier is not in the DBC, or not the one of the message asked for.
    #[error("the identifier is not the expected one")]
    UnknownId,
    /// Not a data frame of the message's format: extended, and CAN FD or classic.
    #[error("not an extended data frame of the message's format")]
    WrongFlags,
    /// The payload length differs from the DBC.
    #[error("the payload length differs from the DBC")]
    WrongLength,
    /// The checksum does not match.
    #[error("the checksum does not match")]
    Crc,
    /// The signal's value leaves the DBC's range or has no meaning in its value table.
    #[error("{0} is out of the range the DBC allows")]
    OutOfRange(&'static str),
}

/// A payload before any signal is in it: unused bits are 0, in classic J1939 frames 1.
pub(crate) fn blank(message: &MessageInfo) -> Payload {
    let mut payload = [0; Frame::CAPACITY];
    if !message.is_fd {
        payload[..message.length].fill(0xFF);
    }
    payload
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

/// Writes a series of scaled signals.
pub(crate) fn put_series<const N: usize>(
    payload: &mut Payload,
    signals: &[SignalInfo],
    values: &[f64; N],
) -> Result<(), EncodeError> {
    signals.iter().zip(values).try_for_each(|(signal, &value)| put_physical(payload, signal, value))
}

/// Writes a scaled signal or the code that stands for no value.
pub(crate) fn put_reading(
    payload: &mut Payload,
    signal: &SignalInfo,
    reading: Reading<f64>,
) -> Result<(), EncodeError> {
    let code = match reading {
        Reading::Value(value) => return put_physical(payload, signal, value),
        Reading::Error => signal.codes.and_then(|codes| codes.error),
        Reading::NotAvailable => signal.codes.map(|codes| codes.not_available),
    };
    let raw = code.ok_or(EncodeError::OutOfRange(signal.name))?;
    bits::put(payload, signal.start_bit, signal.size, raw as u64);
    Ok(())
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
    integer(payload, signal).map(|raw| raw as f64 * signal.factor + signal.offset)
}

/// Reads a series of scaled signals.
pub(crate) fn series<const N: usize>(
    payload: &Payload,
    signals: &[SignalInfo],
) -> Result<[f64; N], DecodeError> {
    let mut values = [0.0; N];
    for (value, signal) in values.iter_mut().zip(signals) {
        *value = physical(payload, signal)?;
    }
    Ok(values)
}

/// Reads a scaled signal that may have no value.
pub(crate) fn reading(payload: &Payload, signal: &SignalInfo) -> Result<Reading<f64>, DecodeError> {
    let raw = signal.read(payload);
    if raw < signal.raw_min {
        return Err(DecodeError::OutOfRange(signal.name));
    }
    Ok(signal.reading(raw))
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
pub(crate) fn seal(mut payload: Payload, message: &MessageInfo) -> Frame {
    message.protection.seal(&mut payload, message.length, message.id);
    Frame::sealed(message.id, message.is_fd, message.length, payload)
}

/// Judges a frame as this message; its payload when it is one, undamaged.
///
/// The BRS and ESI flags are not judged: they tell how the frame was sent, not what it says.
pub(crate) fn open<'a>(
    frame: &'a Frame,
    message: &MessageInfo,
) -> Result<&'a Payload, DecodeError> {
    check_shape(frame, message)?;
    let payload = frame.payload();
    let is_whole = message.protection.check(payload, message.length, message.id);
    if is_whole { Ok(payload) } else { Err(DecodeError::Crc) }
}

/// Judges identifier, format and length of a frame as those of this message.
pub(crate) fn check_shape(frame: &Frame, message: &MessageInfo) -> Result<(), DecodeError> {
    let flags = frame.flags();
    if !flags.is_extended || frame.id() != message.id {
        return Err(DecodeError::UnknownId);
    }
    if flags.is_fd != message.is_fd || flags.is_rtr || flags.is_error {
        return Err(DecodeError::WrongFlags);
    }
    if frame.data().len() != message.length {
        return Err(DecodeError::WrongLength);
    }
    Ok(())
}
