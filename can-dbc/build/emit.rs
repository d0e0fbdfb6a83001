//! Writes the Rust code of a contract. The code calls `codec.rs` for everything that computes.

use super::model::{Contract, Enumeration, Field, FieldKind, Message, Pages, Signal};
use super::names::constant_case;
use std::fmt::Write as _;

/// The whole `messages.rs`.
pub(crate) fn code(contract: &Contract) -> String {
    let mut out = String::from("// Generated from platoon.dbc by can-dbc/build. Do not edit.\n\n");
    for enumeration in &contract.enumerations {
        out += &enumeration_code(enumeration);
    }
    for (index, message) in contract.messages.iter().enumerate() {
        out += &struct_code(message);
        out += &impl_code(index, message);
        out += &signals_code(message);
    }
    out += &message_enum_code(contract);
    out += &table_code(contract);
    out
}

fn enumeration_code(enumeration: &Enumeration) -> String {
    let Enumeration { name, comment, variants } = enumeration;
    let lines = |line: &dyn Fn(&(i64, String, String)) -> String| -> String {
        variants.iter().map(line).collect()
    };
    format!(
        "/// {comment}\n\
         #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]\n\
         #[repr(u8)]\n\
         pub enum {name} {{\n{declared}}}\n\
         impl {name} {{\n\
         /// The value on the bus.\n\
         pub const fn raw(self) -> u8 {{ self as u8 }}\n\
         /// The value with this raw number, if the DBC has one.\n\
         pub const fn from_raw(raw: i64) -> Option<Self> {{ match raw {{\n{from}_ => None }} }}\n\
         /// The value's description in the DBC.\n\
         pub const fn text(self) -> &'static str {{ match self {{\n{text}}} }}\n\
         }}\n\n",
        declared = lines(&|(raw, variant, text)| format!("/// {text:?}.\n{variant} = {raw},\n")),
        from = lines(&|(raw, variant, _)| format!("{raw} => Some(Self::{variant}),\n")),
        text = lines(&|(_, variant, text)| format!("Self::{variant} => {text:?},\n")),
    )
}

fn struct_code(message: &Message) -> String {
    let Message { name, comment, sender, id, length, cycle_time_ms, .. } = message;
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
    let _ = write!(out, "#[derive(Clone, Copy, Debug, PartialEq)]\npub struct {name} {{\n");
    for field in &message.fields {
        let comment = field_comment(message, field);
        let _ = writeln!(out, "/// {comment}\npub {}: {},", field.name, field_type(field));
    }
    out + "}\n\n"
}

/// A paged field speaks for all pages, so the page number leaves its comment.
fn field_comment(message: &Message, field: &Field) -> String {
    let comment = &message.signals[field.signal].comment;
    if field.is_paged { comment.replace("slot 0", "the slot") } else { comment.clone() }
}

fn field_type(field: &Field) -> &str {
    match &field.kind {
        FieldKind::Physical => "f64",
        FieldKind::Integer(name) => name,
        FieldKind::Enumeration(name) => name,
    }
}

fn impl_code(index: usize, message: &Message) -> String {
    let Message { name, id, length, cycle_time_ms, e2e_data_id, pages, .. } = message;
    let signals = signals_name(message);
    let reads_payload = |field: &Field| !is_multiplexor(message, field);
    let encoded: String = message.fields.iter().map(|f| encode_line(message, f)).collect();
    let decoded: String =
        message.fields.iter().filter(|f| reads_payload(f)).map(|f| decode_line(f, pages)).collect();
    let started: String = message.fields.iter().map(|f| start_line(message, f)).collect();
    let (encode_page, decode_page, page_field) = match pages {
        None => (String::new(), String::new(), String::new()),
        Some(Pages { multiplexor, first, stride, .. }) => {
            let page = &message.fields.iter().find(|f| is_multiplexor(message, f));
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
    };
    format!(
        "impl {name} {{\n\
         /// 29-bit identifier.\npub const ID: u32 = 0x{id:08X};\n\
         /// Payload length in bytes.\npub const LENGTH: usize = {length};\n\
         /// Cycle time of the DBC, milliseconds.\n\
         pub const CYCLE_TIME_MS: u32 = {cycle_time_ms};\n\
         /// Data ID of the E2E protection.\npub const E2E_DATA_ID: u16 = 0x{e2e_data_id:04X};\n\
         /// The message's row in [`MESSAGES`].\n\
         pub const INDEX: usize = {index};\n\n\
         /// Makes the protected frame that carries this message and the alive `counter`.\n\
         ///\n/// # Errors\n/// A field is not a number or leaves its range.\n\
         pub fn encode(&self, counter: u8) -> Result<Frame, EncodeError> {{\n\
         let s = &{signals};\nlet mut payload = [0; Frame::CAPACITY];\n{encode_page}{encoded}\
         Ok(codec::seal(payload, &MESSAGES[{index}], counter))\n}}\n\n\
         /// Reads this message and its alive counter out of a frame.\n\
         ///\n/// # Errors\n/// The frame is another message, damaged, or holds a refused value.\n\
         pub fn decode(frame: &Frame) -> Result<(Self, u8), DecodeError> {{\n\
         let s = &{signals};\nlet (payload, counter) = codec::open(frame, &MESSAGES[{index}])?;\n\
         {decode_page}Ok((Self {{\n{page_field}{decoded}}}, counter))\n}}\n}}\n\n\
         impl Default for {name} {{\n\
         /// The start values of the DBC.\nfn default() -> Self {{ Self {{\n{started}}} }}\n}}\n\n"
    )
}

fn is_multiplexor(message: &Message, field: &Field) -> bool {
    message.signals[field.signal].is_multiplexor
}

/// Where the field's signal is found: in the whole message or in the page chosen at run time.
fn signal_place(field: &Field, pages: &Option<Pages>) -> String {
    match pages {
        Some(pages) if field.is_paged => format!("&page[{}]", field.signal - pages.first),
        _ => format!("&s[{}]", field.signal),
    }
}

fn encode_line(message: &Message, field: &Field) -> String {
    let (place, name) = (signal_place(field, &message.pages), &field.name);
    match field.kind {
        FieldKind::Physical => {
            format!("codec::put_physical(&mut payload, {place}, self.{name})?;\n")
        }
        FieldKind::Integer(_) => {
            format!("codec::put_integer(&mut payload, {place}, self.{name}.into())?;\n")
        }
        FieldKind::Enumeration(_) => {
            format!("codec::put_integer(&mut payload, {place}, self.{name}.raw().into())?;\n")
        }
    }
}

fn decode_line(field: &Field, pages: &Option<Pages>) -> String {
    let (place, name) = (signal_place(field, pages), &field.name);
    match &field.kind {
        FieldKind::Physical => format!("{name}: codec::physical(payload, {place})?,\n"),
        FieldKind::Integer(_) => format!("{name}: codec::integer(payload, {place})? as _,\n"),
        FieldKind::Enumeration(kind) => {
            format!("{name}: codec::described(payload, {place}, {kind}::from_raw)?,\n")
        }
    }
}

fn start_line(message: &Message, field: &Field) -> String {
    let signal = &message.signals[field.signal];
    let (name, raw) = (&field.name, signal.raw_start);
    match &field.kind {
        FieldKind::Physical => {
            format!("{name}: {:?},\n", raw as f64 * signal.factor + signal.offset)
        }
        FieldKind::Integer(_) => format!("{name}: {raw},\n"),
        FieldKind::Enumeration(kind) => {
            let variant = signal.values.iter().find(|(value, _)| *value == raw);
            let variant = variant.and_then(|(_, text)| super::names::variant(text));
            format!("{name}: {kind}::{},\n", variant.unwrap_or_default())
        }
    }
}

fn signals_name(message: &Message) -> String {
    format!("{}_SIGNALS", constant_case(&message.name))
}

fn signals_code(message: &Message) -> String {
    let count = message.signals.len();
    let mut out = format!("static {}: [SignalInfo; {count}] = [\n", signals_name(message));
    for signal in &message.signals {
        let Signal { name, start_bit, size, signed, factor, offset, min, max, .. } = signal;
        let Signal { raw_min, raw_max, raw_start, unit, comment, values, .. } = signal;
        let Signal { page, is_multiplexor, .. } = signal;
        let _ = writeln!(
            out,
            "SignalInfo {{ name: {name:?}, start_bit: {start_bit}, size: {size}, \
             byte_order: ByteOrder::LittleEndian, signed: {signed}, factor: {factor:?}, \
             offset: {offset:?}, min: {min:?}, max: {max:?}, raw_min: {raw_min}, \
             raw_max: {raw_max}, raw_start: {raw_start}, unit: {unit:?}, comment: {comment:?}, \
             values: &{values:?}, multiplexed: {page:?}, is_multiplexor: {is_multiplexor} }},"
        );
    }
    out + "];\n\n"
}

fn message_enum_code(contract: &Contract) -> String {
    let lines = |line: &dyn Fn(&str, &Message) -> String| -> String {
        contract.messages.iter().map(|message| line(&message.name, message)).collect()
    };
    format!(
        "/// Any message of the contract.\n\
         #[derive(Clone, Copy, Debug, PartialEq)]\n\
         pub enum Message {{\n{variants}}}\n\n\
         impl Message {{\n\
         /// Reads whichever message the frame's identifier names, and its alive counter.\n\
         ///\n/// # Errors\n\
         /// `UnknownId` for an identifier outside the contract, else as the message's `decode`.\n\
         pub fn decode(frame: &Frame) -> Result<(Self, u8), DecodeError> {{\n\
         match frame.id() {{\n{decodes}_ => Err(DecodeError::UnknownId),\n}}\n}}\n\n\
         /// Makes the protected frame that carries this message and the alive `counter`.\n\
         ///\n/// # Errors\n/// A field is not a number or leaves its range.\n\
         pub fn encode(&self, counter: u8) -> Result<Frame, EncodeError> {{\n\
         match self {{\n{encodes}}}\n}}\n\n\
         /// The message's row in [`MESSAGES`].\n\
         pub const fn index(&self) -> usize {{\nmatch self {{\n{indices}}}\n}}\n}}\n\n",
        variants = lines(&|name, message| format!("/// {}\n{name}({name}),\n", message.comment)),
        decodes = lines(&|name, _| format!(
            "{name}::ID => {name}::decode(frame).map(|(m, counter)| (Self::{name}(m), counter)),\n"
        )),
        encodes = lines(&|name, _| format!("Self::{name}(message) => message.encode(counter),\n")),
        indices = lines(&|name, _| format!("Self::{name}(_) => {name}::INDEX,\n")),
    )
}

fn table_code(contract: &Contract) -> String {
    let mut out = String::from(
        "/// Every message of the contract, for tools that show or convert signals.\n\
         pub static MESSAGES: &[MessageInfo] = &[\n",
    );
    for message in &contract.messages {
        let Message { name, id, length, cycle_time_ms, e2e_data_id, sender, comment, .. } = message;
        let (signals, pages) =
            (signals_name(message), message.pages.as_ref().map_or(1, |p| p.count));
        let _ = writeln!(
            out,
            "MessageInfo {{ name: {name:?}, id: 0x{id:08X}, length: {length}, \
             cycle_time_ms: {cycle_time_ms}, e2e_data_id: 0x{e2e_data_id:04X}, \
             sender: {sender:?}, pages: {pages}, comment: {comment:?}, signals: &{signals} }},"
        );
    }
    out + "];\n"
}
