//! Writes the tables that tools read, and the enumerations.

use super::layout::Protection;
use super::model::{Contract, Enumeration, Message};
use super::names::constant_case;
use super::signal::{Codes, Signal};
use std::fmt::Write as _;

/// The enumerations of a contract; those of its elder are taken from there.
pub(crate) fn enumerations_code(contract: &Contract) -> String {
    let shared: Vec<_> = contract.enumerations.iter().filter(|e| e.is_shared).collect();
    let mut out = String::new();
    if !shared.is_empty() {
        let names: Vec<_> = shared.iter().map(|enumeration| enumeration.name.as_str()).collect();
        let _ = writeln!(out, "pub use crate::messages::{{{}}};\n", names.join(", "));
    }
    for enumeration in contract.enumerations.iter().filter(|e| !e.is_shared) {
        out += &enumeration_code(enumeration);
    }
    out
}

fn enumeration_code(enumeration: &Enumeration) -> String {
    let Enumeration { name, comment, variants, .. } = enumeration;
    let lines = |line: &dyn Fn(&(i64, String, String)) -> String| -> String {
        variants.iter().map(line).collect()
    };
    format!(
        "/// {comment}\n\
         #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]\n\
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

/// Name of the static with a message's signals.
pub(crate) fn signals_name(message: &Message) -> String {
    format!("{}_SIGNALS", constant_case(&message.name))
}

/// The static with a message's signals.
pub(crate) fn signals_code(message: &Message) -> String {
    let count = message.signals.len();
    let mut out = format!("static {}: [SignalInfo; {count}] = [\n", signals_name(message));
    for signal in &message.signals {
        let Signal { name, start_bit, size, signed, factor, offset, min, max, .. } = signal;
        let Signal { raw_min, raw_max, raw_start, unit, comment, spn, values, .. } = signal;
        let Signal { page, is_multiplexor, codes, .. } = signal;
        let codes = codes.as_ref().map_or("None".to_owned(), codes_code);
        let _ = writeln!(
            out,
            "SignalInfo {{ name: {name:?}, start_bit: {start_bit}, size: {size}, \
             byte_order: ByteOrder::LittleEndian, signed: {signed}, factor: {factor:?}, \
             offset: {offset:?}, min: {min:?}, max: {max:?}, raw_min: {raw_min}, \
             raw_max: {raw_max}, raw_start: {raw_start}, unit: {unit:?}, comment: {comment:?}, \
             spn: {spn:?}, values: &{values:?}, codes: {codes}, multiplexed: {page:?}, \
             is_multiplexor: {is_multiplexor} }},"
        );
    }
    out + "];\n\n"
}

fn codes_code(codes: &Codes) -> String {
    let Codes { error, not_available, not_available_from } = codes;
    format!(
        "Some(Codes {{ error: {error:?}, not_available: {not_available}, \
         not_available_from: {not_available_from} }})"
    )
}

/// The table over all messages.
pub(crate) fn messages_code(contract: &Contract) -> String {
    let mut out = String::from(
        "/// Every message of this DBC, for tools that show or convert signals.\n\
         pub static MESSAGES: &[MessageInfo] = &[\n",
    );
    for message in &contract.messages {
        let Message { name, id, length, is_fd, cycle_time_ms, sender, comment, .. } = message;
        let Message { counter, protection, pages, .. } = message;
        let pages = pages.as_ref().map_or(1, |pages| pages.count);
        let (signals, protection) = (signals_name(message), protection_code(*protection));
        let _ = writeln!(
            out,
            "MessageInfo {{ name: {name:?}, id: 0x{id:08X}, length: {length}, is_fd: {is_fd}, \
             cycle_time_ms: {cycle_time_ms}, protection: {protection}, counter: {counter:?}, \
             sender: {sender:?}, pages: {pages}, comment: {comment:?}, signals: &{signals} }},"
        );
    }
    out + "];\n"
}

fn protection_code(protection: Protection) -> String {
    match protection {
        Protection::None => "Protection::None".into(),
        Protection::E2eP05(data_id) => format!("Protection::E2eP05 {{ data_id: {data_id} }}"),
        Protection::Tsc1 => "Protection::Tsc1".into(),
        Protection::Xbr => "Protection::Xbr".into(),
        Protection::Crc8 => "Protection::Crc8".into(),
    }
}
