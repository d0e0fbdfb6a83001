//! What the generator understands of a DBC, and what it refuses of its messages.

use super::layout::{self, Pages, Protection, RESERVED};
use super::names;
use super::signal::{self, Signal};
use can_dbc::{AttributeValue, Dbc, Message as DbcMessage, MessageId};

/// Indices in the customary value list of `VFrameFormat`.
const J1939_PG: i64 = 3;
const EXTENDED_CAN_FD: i64 = 15;
/// Payload lengths of CAN FD above the classic eight bytes, ISO 11898-1.
const FD_LENGTHS: [u64; 7] = [12, 16, 20, 24, 32, 48, 64];
/// First parameter group of Proprietary B; the groups below are SAE's.
const PROPRIETARY_B: u32 = 0xFF00;

/// A whole DBC, judged fit for code generation.
pub(crate) struct Contract {
    pub(crate) messages: Vec<Message>,
    pub(crate) enumerations: Vec<Enumeration>,
}

/// One message.
pub(crate) struct Message {
    /// Name in the DBC, and as a Rust type.
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) id: u32,
    pub(crate) length: u64,
    pub(crate) is_fd: bool,
    pub(crate) cycle_time_ms: u64,
    pub(crate) protection: Protection,
    pub(crate) sender: String,
    pub(crate) comment: String,
    /// Signals in every frame first, then page 0, page 1 and so on.
    pub(crate) signals: Vec<Signal>,
    /// Index of the alive counter in `signals`.
    pub(crate) counter: Option<usize>,
    /// Fields of the Rust struct; for a multiplexed message one field serves all pages.
    pub(crate) fields: Vec<Field>,
    pub(crate) pages: Option<Pages>,
}

/// One field of a message struct.
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: FieldKind,
    /// Index in `Message::signals`; for a paged field, that of page 0.
    pub(crate) signal: usize,
    /// Signals of a series, `Speed_0` to `Speed_20`, that make one array.
    pub(crate) series: Option<usize>,
    pub(crate) is_paged: bool,
}

/// Rust type of a field.
pub(crate) enum FieldKind {
    Physical,
    Integer(&'static str),
    Enumeration(String),
    /// A value that may be an error or not available.
    Reading,
    IntegerReading(&'static str),
}

/// A value table that became an enum.
pub(crate) struct Enumeration {
    pub(crate) name: String,
    pub(crate) comment: String,
    /// Raw value, Rust name, description.
    pub(crate) variants: Vec<(i64, String, String)>,
    /// The elder contract has it already.
    pub(crate) is_shared: bool,
}

impl Contract {
    /// Parses and judges a DBC text.
    ///
    /// An enumeration that the `elder` contract has too must be the same there, and is shared.
    pub(crate) fn read(text: &str, elder: Option<&Self>) -> Result<Self, String> {
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
            contract.check_twins(&message)?;
            contract.messages.push(message);
        }
        if contract.messages.is_empty() {
            return Err("no BO_ message in it".into());
        }
        contract.share(elder)?;
        Ok(contract)
    }

    fn check_twins(&self, message: &Message) -> Result<(), String> {
        let data_id = message.protection.data_id();
        let is_twin = |other: &&Message| {
            other.id == message.id || (data_id.is_some() && other.protection.data_id() == data_id)
        };
        self.messages.iter().find(is_twin).map_or(Ok(()), |twin| {
            let (name, twin) = (&message.name, &twin.name);
            Err(format!("messages {twin} and {name} share an id or an E2EDataId"))
        })
    }

    fn share(&mut self, elder: Option<&Self>) -> Result<(), String> {
        let Some(elder) = elder else { return Ok(()) };
        for message in &self.messages {
            if elder.messages.iter().any(|other| other.id == message.id) {
                return Err(format!("message {}: its id is taken by another DBC", message.name));
            }
        }
        for enumeration in &mut self.enumerations {
            let twin = elder.enumerations.iter().find(|other| other.name == enumeration.name);
            if twin.is_some_and(|twin| twin.variants != enumeration.variants) {
                return Err(format!("value table {} differs from another DBC's", enumeration.name));
            }
            enumeration.is_shared = twin.is_some();
        }
        Ok(())
    }

    fn read_message(&mut self, dbc: &Dbc, message: &DbcMessage) -> Result<Message, String> {
        let MessageId::Extended(id) = message.id else {
            return Err("the id has 11 bits; add 0x80000000 for a 29-bit one".into());
        };
        let is_fd = read_format(dbc, message)?;
        let read = |signal| {
            signal::read(dbc, message, signal)
                .map_err(|why| format!("signal {}: {why}", signal.name))
        };
        let mut signals = message.signals.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        signals.sort_by_key(|signal| (signal.page, signal.start_bit));
        if !is_fd && id >> 8 & 0xFFFF < PROPRIETARY_B {
            check_numbers(&signals)?;
        }
        let protection = Protection::read(dbc, message.id, is_fd)?;
        layout::check(&signals, protection)?;
        let pages = layout::find_pages(&signals)?;
        let fields = self.fields(&message.name, &signals, pages.as_ref())?;
        Ok(Message {
            name: message.name.clone(),
            type_name: names::type_name(&message.name),
            id,
            length: message.size,
            is_fd,
            cycle_time_ms: positive(dbc, message.id, "GenMsgCycleTime")?,
            protection,
            sender: message.transmitter.clone().ok_or("it has no transmitter")?,
            comment: dbc.message_comment(message.id).ok_or("it has no CM_")?.to_owned(),
            counter: layout::find_counter(&signals),
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
        let mut next = 0;
        for (index, signal) in signals.iter().enumerate().take(last) {
            if index < next {
                continue;
            }
            let series = layout::series(&signals[index..last])?;
            next = index + series.unwrap_or(1);
            if RESERVED.contains(&signal.name.as_str()) {
                continue;
            }
            let base = match signal.page {
                Some(page) => layout::base_name(signal, page)?,
                // The multiplexor of Obstacle is ObstaclePage; as a field of Obstacle it is `page`.
                None if signal.is_multiplexor => {
                    signal.name.strip_prefix(message).unwrap_or(&signal.name)
                }
                None if series.is_some() => layout::base_name(signal, 0)?,
                None => &signal.name,
            };
            let suffix = names::unit_suffix(&signal.unit).ok_or_else(|| {
                format!("signal {}: no suffix for unit \"{}\"", signal.name, signal.unit)
            })?;
            fields.push(Field {
                name: names::snake_case(base) + suffix,
                kind: self.field_kind(message, base, signal)?,
                signal: index,
                series,
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
        let is_scaled = signal.factor != 1.0 || signal.offset != 0.0;
        if signal.codes.is_some() && !signal.is_described {
            return Ok(match is_scaled {
                true => FieldKind::Reading,
                false => FieldKind::IntegerReading(signal.integer_type()),
            });
        }
        // A single row names one special value of a number.
        if signal.values.len() > 1 {
            // `Kind_0` alone would be too common a name for a public type.
            let name =
                if signal.page.is_some() { format!("{message}{base}") } else { base.to_owned() };
            self.add_enumeration(&name, signal)?;
            return Ok(FieldKind::Enumeration(name));
        }
        Ok(if is_scaled { FieldKind::Physical } else { FieldKind::Integer(signal.integer_type()) })
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
        let (name, comment) = (name.to_owned(), signal.comment.clone());
        match self.enumerations.iter().find(|other| other.name == name) {
            Some(other) if other.variants == variants => Ok(()),
            Some(_) => Err(format!("two different value tables are called {name}")),
            None => {
                self.enumerations.push(Enumeration { name, comment, variants, is_shared: false });
                Ok(())
            }
        }
    }
}

/// Whether the message is CAN FD; the alternative is a J1939 parameter group of one classic frame.
fn read_format(dbc: &Dbc, message: &DbcMessage) -> Result<bool, String> {
    match attribute(dbc, message.id, "VFrameFormat")? {
        EXTENDED_CAN_FD if message.size <= 8 || FD_LENGTHS.contains(&message.size) => Ok(true),
        EXTENDED_CAN_FD => Err(format!("{} bytes is no CAN FD payload length", message.size)),
        J1939_PG if message.size == 8 => Ok(false),
        J1939_PG => Err(format!("{} bytes; a parameter group here has 8", message.size)),
        _ => Err("VFrameFormat must be ExtendedCAN_FD (15) or J1939PG (3)".into()),
    }
}

/// Every signal of SAE's parameter groups has its number.
fn check_numbers(signals: &[Signal]) -> Result<(), String> {
    let nameless = signals.iter().find(|signal| signal.spn.is_none());
    nameless.map_or(Ok(()), |signal| {
        Err(format!("signal {}: it has no SPN, and its group is not Proprietary B", signal.name))
    })
}

/// A number of 1 to 65535 that the message must have.
pub(crate) fn positive(dbc: &Dbc, id: MessageId, name: &str) -> Result<u64, String> {
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

/// An attribute's value as an integer, when it is one.
pub(crate) fn integer(value: &AttributeValue) -> Option<i64> {
    match value {
        AttributeValue::Uint(value) => i64::try_from(*value).ok(),
        AttributeValue::Int(value) => Some(*value),
        AttributeValue::Double(value) if value.fract() == 0.0 => Some(*value as i64),
        _ => None,
    }
}
