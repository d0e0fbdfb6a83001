//! Writes the Rust code of a contract. The code calls `codec.rs` for everything that computes.

use super::layout::Pages;
use super::model::{Contract, Field, FieldKind, Message};
use super::names;
use super::signal::Signal;
use super::tables;
use std::fmt::Write as _;

/// The whole file.
pub(crate) fn code(contract: &Contract) -> String {
    let mut out = tables::enumerations_code(contract);
    for (index, message) in contract.messages.iter().enumerate() {
        out += &struct_code(message);
        out += &constants_code(index, message);
        out += &impl_code(index, message);
        out += &default_code(message);
        out += &tables::signals_code(message);
    }
    out += &message_enum_code(contract);
    out += &tables::messages_code(contract);
    out
}

fn struct_code(message: &Message) -> String {
    let Message { type_name, comment, sender, id, length, cycle_time_ms, .. } = message;
    let mut out = format!(
        "/// {comment}\n///\n\
         /// Sent by {sender} as 0x{id:08X}, {length} bytes, every {cycle_time_ms} ms.\n///\n\
         /// | signal | bits | factor | range | unit |\n/// |---|---|---|---|---|\n"
    );
    let one_page = message.pages.as_ref().map_or(message.signals.len(), |p| p.first + p.stride);
    for signal in &message.signals[..one_page] {
        let Signal { name, start_bit, size, factor, min, max, unit, .. } = signal;
        let sign = if signal.signed { "i" } else { "u" };
        let _ = writeln!(
            out,
            "/// | {name} | {start_bit}..{}, {sign}{size} | {factor} | {min} to {max} | {unit} |",
            start_bit + size
        );
    }
    let _ = write!(
        out,
        "#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]\n\
         pub struct {type_name} {{\n"
    );
    for field in &message.fields {
        let comment = field_comment(message, field);
        let _ = writeln!(out, "/// {comment}\npub {}: {},", field.name, field_type(field));
    }
    out + "}\n\n"
}

/// A paged field speaks for all pages, so the page number leaves its comment; a series has those
/// of its first and last.
fn field_comment(message: &Message, field: &Field) -> String {
    let comment = &message.signals[field.signal].comment;
    if let Some(count) = field.series {
        let last = &message.signals[field.signal + count - 1].comment;
        return format!("First: {comment} Last: {last}");
    }
    if field.is_paged { comment.replace("slot 0", "the slot") } else { comment.clone() }
}

fn field_type(field: &Field) -> String {
    if let Some(count) = field.series {
        return format!("[f64; {count}]");
    }
    match &field.kind {
        FieldKind::Physical => "f64".into(),
        FieldKind::Integer(name) => (*name).into(),
        FieldKind::Enumeration(name) => name.clone(),
        FieldKind::Reading => "Reading<f64>".into(),
        FieldKind::IntegerReading(name) => format!("Reading<{name}>"),
    }
}

fn constants_code(index: usize, message: &Message) -> String {
    let Message { type_name, id, length, cycle_time_ms, .. } = message;
    let mut out = format!(
        "impl {type_name} {{\n\
         /// 29-bit identifier.\npub const ID: u32 = 0x{id:08X};\n\
         /// Payload length in bytes.\npub const LENGTH: usize = {length};\n\
         /// Cycle time of the DBC, milliseconds.\n\
         pub const CYCLE_TIME_MS: u32 = {cycle_time_ms};\n\
         /// The message's row in [`MESSAGES`].\npub const INDEX: usize = {index};\n"
    );
    if let Some(data_id) = message.protection.data_id() {
        let _ = writeln!(
            out,
            "/// Data ID of the E2E protection.\npub const E2E_DATA_ID: u16 = 0x{data_id:04X};"
        );
    }
    if let Some(counter) = message.counter {
        let max = message.signals[counter].raw_max;
        let _ = writeln!(
            out,
            "/// Largest value of the alive counter; 0 follows.\npub const COUNTER_MAX: u8 = {max};"
        );
    }
    out + "}\n\n"
}

fn impl_code(index: usize, message: &Message) -> String {
    let Message { type_name, pages, counter, .. } = message;
    let signals = tables::signals_name(message);
    let encoded: String = message.fields.iter().map(|f| encode_line(message, f)).collect();
    let decoded: String = message
        .fields
        .iter()
        .filter(|field| !is_multiplexor(message, field))
        .map(|field| decode_line(field, pages))
        .collect();
    let (encode_page, decode_page, page_field) = page_code(message);
    let (parameter, put_counter, read_counter) = counter_code(*counter);
    let (result, made) = match counter {
        Some(_) => ("(Self, u8)", format!("(Self {{\n{page_field}{decoded}}}, counter)")),
        None => ("Self", format!("Self {{\n{page_field}{decoded}}}")),
    };
    let (frame_of, read) = match counter {
        Some(_) => (" and the alive `counter`", " and its alive counter"),
        None => ("", ""),
    };
    format!(
        "impl {type_name} {{\n\
         /// Makes the frame that carries this message{frame_of}.\n\
         ///\n/// # Errors\n/// A field is not a number or leaves its range.\n\
         pub fn encode(&self{parameter}) -> Result<Frame, EncodeError> {{\n\
         let s = &{signals};\nlet mut payload = codec::blank(&MESSAGES[{index}]);\n\
         {put_counter}{encode_page}{encoded}Ok(codec::seal(payload, &MESSAGES[{index}]))\n}}\n\n\
         /// Reads this message{read} out of a frame.\n\
         ///\n/// # Errors\n/// The frame is another message, damaged, or holds a refused value.\n\
         pub fn decode(frame: &Frame) -> Result<{result}, DecodeError> {{\n\
         let s = &{signals};\nlet payload = codec::open(frame, &MESSAGES[{index}])?;\n\
         {read_counter}{decode_page}Ok({made})\n}}\n}}\n\n"
    )
}

/// Parameter of `encode`, and the lines that write and read the alive counter.
fn counter_code(counter: Option<usize>) -> (&'static str, String, String) {
    counter.map_or_else(Default::default, |index| {
        (
            ", counter: u8",
            format!("codec::put_integer(&mut payload, &s[{index}], counter.into())?;\n"),
            format!("let counter = codec::integer(payload, &s[{index}])? as u8;\n"),
        )
    })
}

/// Lines that choose a page for writing and for reading, and the field that tells its number.
fn page_code(message: &Message) -> (String, String, String) {
    let Some(Pages { multiplexor, first, stride, .. }) = &message.pages else {
        return Default::default();
    };
    let page = message.fields.iter().find(|field| is_multiplexor(message, field));
    let page = page.map_or("", |field| field.name.as_str());
    (
        format!(
            "let page = codec::encode_page(s, {multiplexor}, {first}, {stride}, \
             self.{page}.into())?;\n"
        ),
        format!(
            "let (number, page) = codec::decode_page(payload, s, {multiplexor}, {first}, \
             {stride})?;\n"
        ),
        format!("{page}: number as _,\n"),
    )
}

fn is_multiplexor(message: &Message, field: &Field) -> bool {
    message.signals[field.signal].is_multiplexor
}

/// Where the field's signals are found: in the whole message or in the page chosen at run time.
fn signal_place(field: &Field, pages: &Option<Pages>) -> String {
    match pages {
        Some(pages) if field.is_paged => format!("&page[{}]", field.signal - pages.first),
        _ => match field.series {
            Some(count) => format!("&s[{}..{}]", field.signal, field.signal + count),
            None => format!("&s[{}]", field.signal),
        },
    }
}

fn encode_line(message: &Message, field: &Field) -> String {
    let (place, name) = (signal_place(field, &message.pages), &field.name);
    if field.series.is_some() {
        return format!("codec::put_series(&mut payload, {place}, &self.{name})?;\n");
    }
    let (put, value) = match field.kind {
        FieldKind::Physical => ("put_physical", format!("self.{name}")),
        FieldKind::Integer(_) => ("put_integer", format!("self.{name}.into()")),
        FieldKind::Enumeration(_) => ("put_integer", format!("self.{name}.raw().into()")),
        FieldKind::Reading => ("put_reading", format!("self.{name}")),
        FieldKind::IntegerReading(_) => ("put_reading", format!("self.{name}.map(f64::from)")),
    };
    format!("codec::{put}(&mut payload, {place}, {value})?;\n")
}

fn decode_line(field: &Field, pages: &Option<Pages>) -> String {
    let (place, name) = (signal_place(field, pages), &field.name);
    if field.series.is_some() {
        return format!("{name}: codec::series(payload, {place})?,\n");
    }
    match &field.kind {
        FieldKind::Physical => format!("{name}: codec::physical(payload, {place})?,\n"),
        FieldKind::Integer(_) => format!("{name}: codec::integer(payload, {place})? as _,\n"),
        FieldKind::Enumeration(kind) => {
            format!("{name}: codec::described(payload, {place}, {kind}::from_raw)?,\n")
        }
        FieldKind::Reading => format!("{name}: codec::reading(payload, {place})?,\n"),
        FieldKind::IntegerReading(kind) => {
            format!("{name}: codec::reading(payload, {place})?.map(|value| value as {kind}),\n")
        }
    }
}

fn default_code(message: &Message) -> String {
    let started: String = message.fields.iter().map(|f| start_line(message, f)).collect();
    format!(
        "impl Default for {} {{\n\
         /// The start values of the DBC.\nfn default() -> Self {{ Self {{\n{started}}} }}\n}}\n\n",
        message.type_name
    )
}

fn start_line(message: &Message, field: &Field) -> String {
    let signal = &message.signals[field.signal];
    let (name, raw) = (&field.name, signal.raw_start);
    let start = raw as f64 * signal.factor + signal.offset;
    match &field.kind {
        FieldKind::Physical => match field.series {
            Some(count) => format!("{name}: [{start:?}; {count}],\n"),
            None => format!("{name}: {start:?},\n"),
        },
        FieldKind::Integer(_) => format!("{name}: {raw},\n"),
        FieldKind::Enumeration(kind) => {
            let variant = signal.values.iter().find(|(value, _)| *value == raw);
            let variant = variant.and_then(|(_, text)| names::variant(text));
            format!("{name}: {kind}::{},\n", variant.unwrap_or_default())
        }
        FieldKind::Reading | FieldKind::IntegerReading(_) => {
            format!("{name}: Reading::NotAvailable,\n")
        }
    }
}

/// The enum over all messages; where some have no alive counter, it is optional.
fn message_enum_code(contract: &Contract) -> String {
    let lines = |line: &dyn Fn(&Message) -> String| -> String {
        contract.messages.iter().map(line).collect()
    };
    let always_counts = contract.messages.iter().all(|message| message.counter.is_some());
    let counter_type = if always_counts { "u8" } else { "Option<u8>" };
    let decode_line = |message: &Message| {
        let name = &message.type_name;
        let made = match (message.counter, always_counts) {
            (None, _) => format!("|m| (Self::{name}(m), None)"),
            (Some(_), true) => format!("|(m, counter)| (Self::{name}(m), counter)"),
            (Some(_), false) => format!("|(m, counter)| (Self::{name}(m), Some(counter))"),
        };
        format!("{name}::ID => {name}::decode(frame).map({made}),\n")
    };
    let encode_line = |message: &Message| {
        let argument = if message.counter.is_some() { "counter" } else { "" };
        format!("Self::{}(message) => message.encode({argument}),\n", message.type_name)
    };
    format!(
        "/// Any message of this DBC.\n\
         #[derive(Clone, Copy, Debug, PartialEq)]\n\
         pub enum Message {{\n{variants}}}\n\n\
         impl Message {{\n\
         /// Reads whichever message the frame's identifier names, and its alive counter.\n\
         ///\n/// # Errors\n\
         /// `UnknownId` for an identifier outside the DBC, else as the message's `decode`.\n\
         pub fn decode(frame: &Frame) -> Result<(Self, {counter_type}), DecodeError> {{\n\
         match frame.id() {{\n{decodes}_ => Err(DecodeError::UnknownId),\n}}\n}}\n\n\
         /// Makes the frame that carries this message and the alive `counter`, if it has one.\n\
         ///\n/// # Errors\n/// A field is not a number or leaves its range.\n\
         pub fn encode(&self, counter: u8) -> Result<Frame, EncodeError> {{\n\
         match self {{\n{encodes}}}\n}}\n\n\
         /// The message's row in [`MESSAGES`].\n\
         pub const fn index(&self) -> usize {{\nmatch self {{\n{indices}}}\n}}\n}}\n\n",
        variants =
            lines(&|message| format!("/// {}\n{1}({1}),\n", message.comment, message.type_name)),
        decodes = lines(&decode_line),
        encodes = lines(&encode_line),
        indices = lines(&|message| format!("Self::{0}(_) => {0}::INDEX,\n", message.type_name)),
    )
}
