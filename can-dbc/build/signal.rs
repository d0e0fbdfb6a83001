//! One signal: its scaling, its range both physical and raw, and the codes that are no value.

use super::model::integer;
use can_dbc::{
    ByteOrder, Dbc, Message as DbcMessage, MultiplexIndicator, NumericValue, Signal as DbcSignal,
    ValueType,
};

/// An `f64` holds integers of this many bits exactly.
const F64_EXACT_BITS: u32 = 53;
/// Descriptions of the codes that stand for no value.
const ERROR: &str = "error";
const NOT_AVAILABLE: &str = "not available";
const CODES: [&str; 2] = [ERROR, NOT_AVAILABLE];

/// One signal.
pub(crate) struct Signal {
    pub(crate) name: String,
    pub(crate) start_bit: u32,
    pub(crate) size: u32,
    pub(crate) signed: bool,
    pub(crate) factor: f64,
    pub(crate) offset: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) raw_min: i64,
    pub(crate) raw_max: i64,
    pub(crate) raw_start: i64,
    pub(crate) unit: String,
    pub(crate) comment: String,
    pub(crate) spn: Option<u32>,
    pub(crate) values: Vec<(i64, String)>,
    pub(crate) codes: Option<Codes>,
    /// The value table has rows that are no codes for no value.
    pub(crate) is_described: bool,
    pub(crate) page: Option<u64>,
    pub(crate) is_multiplexor: bool,
}

/// Raw values that stand for no value, in the manner of J1939.
pub(crate) struct Codes {
    /// What is sent for an error, when there is such a code.
    pub(crate) error: Option<i64>,
    /// What is sent when not available, and the first of the codes that say so.
    pub(crate) not_available: i64,
    pub(crate) not_available_from: i64,
}

impl Signal {
    /// Smallest Rust integer that holds every raw value.
    pub(crate) fn integer_type(&self) -> &'static str {
        match (self.signed, self.size) {
            (false, ..=8) => "u8",
            (false, ..=16) => "u16",
            (false, ..=32) => "u32",
            (false, _) => "u64",
            (true, ..=8) => "i8",
            (true, ..=16) => "i16",
            (true, ..=32) => "i32",
            (true, _) => "i64",
        }
    }
}

/// Reads and judges one signal.
pub(crate) fn read(dbc: &Dbc, message: &DbcMessage, signal: &DbcSignal) -> Result<Signal, String> {
    if signal.byte_order != ByteOrder::LittleEndian {
        return Err("Motorola byte order is not generated; use @1".into());
    }
    let size = u32::try_from(signal.size).unwrap_or(u32::MAX);
    let start_bit = u32::try_from(signal.start_bit).unwrap_or(u32::MAX);
    if size == 0 || u64::from(start_bit) + u64::from(size) > message.size * 8 {
        return Err(format!("bits {start_bit}|{size} leave the {} bytes", message.size));
    }
    let is_scaled = signal.factor != 1.0 || signal.offset != 0.0;
    if size > if is_scaled { F64_EXACT_BITS } else { 63 } {
        return Err(format!("{size} bits do not fit the codec's number"));
    }
    if !(signal.factor.is_finite() && signal.factor > 0.0 && signal.offset.is_finite()) {
        return Err(format!("factor {} and offset {}", signal.factor, signal.offset));
    }
    let (page, is_multiplexor) = match signal.multiplexer_indicator {
        MultiplexIndicator::Plain => (None, false),
        MultiplexIndicator::Multiplexor => (None, true),
        MultiplexIndicator::MultiplexedSignal(page) => (Some(page), false),
        MultiplexIndicator::MultiplexorAndMultiplexedSignal(_) => {
            return Err("nested multiplexing is not generated".into());
        }
    };
    let number = |name: &str| match dbc.resolved_signal_attribute(message.id, &signal.name, name) {
        None => Ok(0),
        Some(value) => integer(value).ok_or_else(|| format!("{name} is no integer")),
    };
    let values = dbc.value_descriptions_for_signal(message.id, &signal.name).unwrap_or_default();
    let comment = dbc.signal_comment(message.id, &signal.name).ok_or("it has no CM_")?;
    let mut read = Signal {
        name: signal.name.clone(),
        start_bit,
        size,
        signed: signal.value_type == ValueType::Signed,
        factor: signal.factor,
        offset: signal.offset,
        min: physical(&signal.min),
        max: physical(&signal.max),
        raw_min: 0,
        raw_max: 0,
        raw_start: number("GenSigStartValue")?,
        unit: signal.unit.clone(),
        comment: comment.to_owned(),
        spn: u32::try_from(number("SPN")?).ok().filter(|spn| *spn != 0),
        values: values.iter().map(|value| (value.id, value.description.clone())).collect(),
        codes: None,
        is_described: values.iter().any(|value| !CODES.contains(&value.description.as_str())),
        page,
        is_multiplexor,
    };
    set_raw_range(&mut read)?;
    read.codes = find_codes(&read)?;
    check_start(&read)?;
    Ok(read)
}

fn check_start(signal: &Signal) -> Result<(), String> {
    match &signal.codes {
        Some(codes) if !signal.is_described && signal.raw_start != codes.not_available => {
            Err(format!("its start value must be {}, {NOT_AVAILABLE}", codes.not_available))
        }
        Some(_) if !signal.is_described => Ok(()),
        _ if (signal.raw_min..=signal.raw_max).contains(&signal.raw_start) => Ok(()),
        _ => Err(format!("start value {} is out of range", signal.raw_start)),
    }
}

/// Raw limits from the physical ones, cut to what the bits can hold.
fn set_raw_range(signal: &mut Signal) -> Result<(), String> {
    let (low, high) = if signal.signed {
        (-(1_i64 << (signal.size - 1)), (1_i64 << (signal.size - 1)) - 1)
    } else {
        (0, i64::MAX >> (63 - signal.size))
    };
    // A limit is a multiple of the factor in decimal, not in binary: allow for its last digit.
    let slack = 1e-6;
    let raw_of = |limit: f64| (limit - signal.offset) / signal.factor;
    signal.raw_min = (raw_of(signal.min) - slack).ceil() as i64;
    signal.raw_max = (raw_of(signal.max) + slack).floor() as i64;
    // [0|0] is the DBC way to say that no range is given.
    if signal.min == 0.0 && signal.max == 0.0 {
        (signal.raw_min, signal.raw_max) = (low, high);
    }
    if signal.raw_min < low || signal.raw_max > high || signal.raw_min > signal.raw_max {
        let (min, max, size) = (signal.min, signal.max, signal.size);
        return Err(format!("range [{min}|{max}] does not fit {size} bits at this factor"));
    }
    // So that what decodes also encodes, the limits are at least those of the raw range.
    let physical_of = |raw: i64| raw as f64 * signal.factor + signal.offset;
    signal.min = signal.min.min(physical_of(signal.raw_min));
    signal.max = signal.max.max(physical_of(signal.raw_max));
    Ok(())
}

/// The codes in a signal's value table; they must be where J1939 has them.
///
/// J1939-71 keeps the top byte 0xFF of a number of whole bytes for "not available" and 0xFE for
/// errors, and the last two values of shorter ones.
fn find_codes(signal: &Signal) -> Result<Option<Codes>, String> {
    let code = |text| signal.values.iter().find(|(_, other)| other == text).map(|(raw, _)| *raw);
    let Some(not_available) = code(NOT_AVAILABLE) else { return Ok(None) };
    if signal.signed || signal.size > 32 {
        return Err("codes for no value need an unsigned number of at most 32 bits".into());
    }
    let all_ones = (1 << signal.size) - 1;
    let step = if signal.size.is_multiple_of(8) { 1 << (signal.size - 8) } else { 1 };
    let (from, error) = (all_ones + 1 - step, code(ERROR));
    let error_is_right = error.is_none_or(|error| (from - step..from).contains(&error));
    let range_is_right = signal.is_described || signal.raw_max < from - step;
    if not_available != all_ones || !error_is_right || !range_is_right {
        return Err(format!(
            "\"{NOT_AVAILABLE}\" must be {all_ones}, \"{ERROR}\" {} and values below both",
            from - step
        ));
    }
    Ok(Some(Codes { error, not_available, not_available_from: from }))
}

fn physical(value: &NumericValue) -> f64 {
    match value {
        NumericValue::Uint(value) => *value as f64,
        NumericValue::Int(value) => *value as f64,
        NumericValue::Double(value) => *value,
    }
}
