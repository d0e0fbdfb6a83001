//! What the generator understands of a DBC, and everything it refuses.

use super::names;
use can_dbc::{
    AttributeValue, ByteOrder, Dbc, Message as DbcMessage, MessageId, MultiplexIndicator,
    NumericValue, Signal as DbcSignal, ValueType,
};

/// First signals of every message, at bits 0..16 and 16..24: AUTOSAR E2E Profile 5, offset 0.
const E2E_SIGNALS: [(&str, u32, u32); 2] = [("E2eCrc", 0, 16), ("E2eCounter", 16, 8)];
/// Index of `ExtendedCAN_FD` in the customary value list of `VFrameFormat`.
const EXTENDED_CAN_FD: i64 = 15;
/// Payload lengths of CAN FD above the classic eight bytes, ISO 11898-1.
const FD_LENGTHS: [u64; 7] = [12, 16, 20, 24, 32, 48, 64];
/// An `f64` holds integers of this many bits exactly.
const F64_EXACT_BITS: u32 = 53;

/// A whole DBC, judged fit for code generation.
pub(crate) struct Contract {
    pub(crate) messages: Vec<Message>,
    pub(crate) enumerations: Vec<Enumeration>,
}

/// One message.
pub(crate) struct Message {
    pub(crate) name: String,
    pub(crate) id: u32,
    pub(crate) length: u64,
    pub(crate) cycle_time_ms: u64,
    pub(crate) e2e_data_id: u64,
    pub(crate) sender: String,
    pub(crate) comment: String,
    /// Signals in every frame first, then page 0, page 1 and so on.
    pub(crate) signals: Vec<Signal>,
    /// Fields of the Rust struct; for a multiplexed message one field serves all pages.
    pub(crate) fields: Vec<Field>,
    pub(crate) pages: Option<Pages>,
}

/// How a multiplexed message is cut into pages of equal content.
pub(crate) struct Pages {
    /// Index of the multiplexor and of the first paged signal in `Message::signals`.
    pub(crate) multiplexor: usize,
    pub(crate) first: usize,
    /// Signals per page, and number of pages.
    pub(crate) stride: usize,
    pub(crate) count: usize,
}

/// One signal, with its range both physical and raw.
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
    pub(crate) values: Vec<(i64, String)>,
    pub(crate) page: Option<u64>,
    pub(crate) is_multiplexor: bool,
}

/// One field of a message struct.
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: FieldKind,
    /// Index in `Message::signals`; for a paged field, that of page 0.
    pub(crate) signal: usize,
    pub(crate) is_paged: bool,
}

/// Rust type of a field.
pub(crate) enum FieldKind {
    Physical,
    Integer(&'static str),
    Enumeration(String),
}

/// A value table that became an enum.
#[derive(PartialEq)]
pub(crate) struct Enumeration {
    pub(crate) name: String,
    pub(crate) comment: String,
    /// Raw value, Rust name, description.
    pub(crate) variants: Vec<(i64, String, String)>,
}

impl Contract {
    /// Parses and judges a DBC text.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        let dbc = Dbc::try_from(text).map_err(|error| format!("not a DBC: {error}"))?;
        if !dbc.extended_multiplex.is_empty() {
            return Err("SG_MUL_VAL_: extended multiplexing is not generated; use M and mN".into());
        }
        if !dbc.signal_extended_value_type_list.is_empty() {
            return Err("SIG_VALTYPE_: float signals are not generated; scale an integer".into());
        }
        let mut contract = Self { messages: Vec::new(), enumerations: Vec::new() };
        for message in &dbc.messages {
            let read = contract.read_message(&dbc, message);
            let message = read.map_err(|why| format!("message {}: {why}", message.name))?;
            if let Some(twin) = contract
                .messages
                .iter()
                .find(|other| other.id == message.id || other.e2e_data_id == message.e2e_data_id)
            {
                let (name, twin) = (&message.name, &twin.name);
                return Err(format!("messages {twin} and {name} share an id or an E2EDataId"));
            }
            contract.messages.push(message);
        }
        if contract.messages.is_empty() {
            return Err("no BO_ message in it".into());
        }
        Ok(contract)
    }

    fn read_message(&mut self, dbc: &Dbc, message: &DbcMessage) -> Result<Message, String> {
        let MessageId::Extended(id) = message.id else {
            return Err("the id has 11 bits; add 0x80000000 for a 29-bit one".into());
        };
        if message.size > 8 && !FD_LENGTHS.contains(&message.size) {
            return Err(format!("{} bytes is no CAN FD payload length", message.size));
        }
        if attribute(dbc, message.id, "VFrameFormat")? != EXTENDED_CAN_FD {
            return Err("VFrameFormat must be ExtendedCAN_FD (15)".into());
        }
        let mut signals = message
            .signals
            .iter()
            .map(|signal| {
                read_signal(dbc, message, signal)
                    .map_err(|why| format!("signal {}: {why}", signal.name))
            })
            .collect::<Result<Vec<_>, _>>()?;
        signals.sort_by_key(|signal| (signal.page, signal.start_bit));
        check_layout(&signals)?;
        let pages = find_pages(&signals)?;
        let fields = self.fields(&message.name, &signals, pages.as_ref())?;
        Ok(Message {
            name: message.name.clone(),
            id,
            length: message.size,
            cycle_time_ms: positive(dbc, message.id, "GenMsgCycleTime")?,
            e2e_data_id: positive(dbc, message.id, "E2EDataId")?,
            sender: message.transmitter.clone().ok_or("it has no transmitter")?,
            comment: dbc.message_comment(message.id).ok_or("it has no CM_")?.to_owned(),
            signals,
            fields,
            pages,
        })
    }

    fn fields(
        &mut self,
        message: &str,
        signals: &[Signal],
        pages: Option<&Pages>,
    ) -> Result<Vec<Field>, String> {
        let last = pages.map_or(signals.len(), |pages| pages.first + pages.stride);
        let mut fields = Vec::new();
        for (index, signal) in signals.iter().enumerate().take(last).skip(E2E_SIGNALS.len()) {
            let base = match signal.page {
                Some(page) => page_base_name(signal, page)?,
                // The multiplexor of Obstacle is ObstaclePage; as a field of Obstacle it is `page`.
                None if signal.is_multiplexor => {
                    signal.name.strip_prefix(message).unwrap_or(&signal.name)
                }
                None => &signal.name,
            };
            let suffix = names::unit_suffix(&signal.unit).ok_or_else(|| {
                format!("signal {}: no suffix for unit \"{}\"", signal.name, signal.unit)
            })?;
            fields.push(Field {
                name: names::snake_case(base) + suffix,
                kind: self.field_kind(message, base, signal)?,
                signal: index,
                is_paged: signal.page.is_some(),
            });
        }
        Ok(fields)
    }

    fn field_kind(
        &mut self,
        message: &str,
        base: &str,
        signal: &Signal,
    ) -> Result<FieldKind, String> {
        if !signal.values.is_empty() {
            // `Kind_0` alone would be too common a name for a public type.
            let name =
                if signal.page.is_some() { format!("{message}{base}") } else { base.to_owned() };
            self.add_enumeration(&name, signal)?;
            return Ok(FieldKind::Enumeration(name));
        }
        if signal.factor != 1.0 || signal.offset != 0.0 {
            return Ok(FieldKind::Physical);
        }
        Ok(FieldKind::Integer(match (signal.signed, signal.size) {
            (false, ..=8) => "u8",
            (false, ..=16) => "u16",
            (false, ..=32) => "u32",
            (false, _) => "u64",
            (true, ..=8) => "i8",
            (true, ..=16) => "i16",
            (true, ..=32) => "i32",
            (true, _) => "i64",
        }))
    }

    fn add_enumeration(&mut self, name: &str, signal: &Signal) -> Result<(), String> {
        let mut variants = Vec::new();
        for (raw, description) in &signal.values {
            let variant = names::variant(description).ok_or_else(|| {
                format!("signal {}: \"{description}\" makes no Rust name", signal.name)
            })?;
            variants.push((*raw, variant, description.clone()));
        }
        variants.sort();
        if !variants.iter().any(|(raw, ..)| *raw == signal.raw_start) {
            return Err(format!("signal {}: its start value has no description", signal.name));
        }
        let enumeration =
            Enumeration { name: name.to_owned(), comment: signal.comment.clone(), variants };
        match self.enumerations.iter().find(|other| other.name == name) {
            Some(other) if other.variants == enumeration.variants => Ok(()),
            Some(_) => Err(format!("two different value tables are called {name}")),
            None => {
                self.enumerations.push(enumeration);
                Ok(())
            }
        }
    }
}

fn read_signal(dbc: &Dbc, message: &DbcMessage, signal: &DbcSignal) -> Result<Signal, String> {
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
    let values = dbc.value_descriptions_for_signal(message.id, &signal.name).unwrap_or_default();
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
        raw_start: start_value(dbc, message.id, &signal.name)?,
        unit: signal.unit.clone(),
        comment: dbc.signal_comment(message.id, &signal.name).ok_or("it has no CM_")?.to_owned(),
        values: values.iter().map(|value| (value.id, value.description.clone())).collect(),
        page,
        is_multiplexor,
    };
    set_raw_range(&mut read)?;
    Ok(read)
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
    if !(signal.raw_min..=signal.raw_max).contains(&signal.raw_start) {
        return Err(format!("start value {} is out of range", signal.raw_start));
    }
    Ok(())
}

/// E2E header in place, nothing overlapping.
fn check_layout(signals: &[Signal]) -> Result<(), String> {
    for (index, (name, start_bit, size)) in E2E_SIGNALS.into_iter().enumerate() {
        let fits = signals.get(index).is_some_and(|signal| {
            signal.name == name && (signal.start_bit, signal.size) == (start_bit, size)
        });
        if !fits {
            return Err(format!("{name} must be at {start_bit}|{size} (E2E Profile 5, offset 0)"));
        }
    }
    for (index, signal) in signals.iter().enumerate() {
        let end_bit = signal.start_bit + signal.size;
        if let Some(other) = signals[index + 1..].iter().find(|other| {
            let shares_frame = signal.page.is_none() || other.page == signal.page;
            let other_end_bit = other.start_bit + other.size;
            shares_frame && other.start_bit < end_bit && signal.start_bit < other_end_bit
        }) {
            return Err(format!("signals {} and {} overlap", signal.name, other.name));
        }
    }
    Ok(())
}

/// Cuts sorted signals into pages, which must be 0, 1, 2... and alike but for their suffix.
fn find_pages(signals: &[Signal]) -> Result<Option<Pages>, String> {
    let Some(first) = signals.iter().position(|signal| signal.page.is_some()) else {
        return Ok(None);
    };
    let multiplexor = signals.iter().position(|signal| signal.is_multiplexor);
    let multiplexor = multiplexor.ok_or("it has mN signals but no multiplexor M")?;
    let paged = &signals[first..];
    let stride = paged.iter().filter(|signal| signal.page == paged[0].page).count();
    for (index, signal) in paged.iter().enumerate() {
        let page = (index / stride) as u64;
        let model = &paged[index % stride];
        let alike = signal.page == Some(page)
            && page_base_name(signal, page)? == page_base_name(model, 0)?
            && (signal.start_bit, signal.size, signal.signed)
                == (model.start_bit, model.size, model.signed)
            && (signal.factor, signal.offset, &signal.unit, &signal.values)
                == (model.factor, model.offset, &model.unit, &model.values);
        if !alike {
            return Err(format!("signal {}: pages must be alike and count from 0", signal.name));
        }
    }
    let count = paged.len() / stride;
    if !paged.len().is_multiple_of(stride) || signals[multiplexor].raw_max + 1 != count as i64 {
        return Err(format!("the multiplexor's range must be its {count} whole pages"));
    }
    Ok(Some(Pages { multiplexor, first, stride, count }))
}

/// `Kind_3` of page 3 is the page's `Kind`.
fn page_base_name(signal: &Signal, page: u64) -> Result<&str, String> {
    let suffix = format!("_{page}");
    let base = signal.name.strip_suffix(suffix.as_str());
    base.ok_or_else(|| format!("signal {}: in page {page} it must end in {suffix}", signal.name))
}

fn start_value(dbc: &Dbc, id: MessageId, signal: &str) -> Result<i64, String> {
    match dbc.resolved_signal_attribute(id, signal, "GenSigStartValue") {
        None => Ok(0),
        Some(value) => integer(value).ok_or_else(|| "GenSigStartValue is no integer".into()),
    }
}

fn positive(dbc: &Dbc, id: MessageId, name: &str) -> Result<u64, String> {
    let value = attribute(dbc, id, name)?;
    u64::try_from(value)
        .ok()
        .filter(|value| (1..=65_535).contains(value))
        .ok_or_else(|| format!("{name} {value} must be 1 to 65535"))
}

fn attribute(dbc: &Dbc, id: MessageId, name: &str) -> Result<i64, String> {
    let value = dbc.resolved_message_attribute(id, name);
    value.and_then(integer).ok_or_else(|| format!("attribute {name} is missing or no integer"))
}

fn integer(value: &AttributeValue) -> Option<i64> {
    match value {
        AttributeValue::Uint(value) => i64::try_from(*value).ok(),
        AttributeValue::Int(value) => Some(*value),
        AttributeValue::Double(value) if value.fract() == 0.0 => Some(*value as i64),
        _ => None,
    }
}

fn physical(value: &NumericValue) -> f64 {
    match value {
        NumericValue::Uint(value) => *value as f64,
        NumericValue::Int(value) => *value as f64,
        NumericValue::Double(value) => *value,
    }
}
