//! Decoded signals: one protobuf message per message of `platoon.dbc` and of `j1939.dbc`.
//!
//! The descriptors are made from the tables of `platoon_dbc`, so the DBCs stay the only place that
//! lists signals. Field `i + 1` is signal `i`, named in snake case. A signal with factor 1 and
//! offset 0 is an integer field, any other a `double` in its DBC unit; one with a value table
//! also has a string field `<name>_text` with number `i + 1001`. Signals of a multiplexed page
//! are `optional`: a frame sets those of the page it carries.
//!
//! A J1939 signal that its sender does not have is no number: its field is `optional` and stays
//! unset, and the reason, `error` or `not available`, stands in its text field or, when its value
//! table has nothing else, in the string field `<name>_status` with number `i + 2001`.

use std::collections::BTreeMap;

use platoon_dbc::{Frame, MessageInfo, Reading, SignalInfo};
use prost_types::field_descriptor_proto::Type;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, OneofDescriptorProto,
};

use crate::schema::{Files, Shape, field_descriptor, file_name};
use crate::wire::{self, WireType, put_tag, put_varint};

/// What separates a signal's field number from that of its text, and of its status.
const TEXT_NUMBER: u32 = 1000;
const STATUS_NUMBER: u32 = 2000;

/// How a signal's value is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Unsigned,
    Signed,
    Physical,
}

impl Kind {
    fn of(signal: &SignalInfo) -> Self {
        if signal.factor != 1.0 || signal.offset != 0.0 {
            Self::Physical
        } else if signal.signed {
            Self::Signed
        } else {
            Self::Unsigned
        }
    }

    const fn protobuf(self, bits: u32) -> Type {
        match self {
            Self::Unsigned if bits <= 32 => Type::Uint32,
            Self::Unsigned => Type::Uint64,
            Self::Signed if bits <= 32 => Type::Sint32,
            Self::Signed => Type::Sint64,
            Self::Physical => Type::Double,
        }
    }
}

/// Messages of the two DBCs are told apart by their package.
fn package(message: &MessageInfo) -> &'static str {
    if message.is_fd { "platoon.dbc" } else { "platoon.j1939" }
}

/// The schema name of a message's decoded form.
pub(crate) fn schema_name(message: &MessageInfo) -> String {
    format!("{}.{}", package(message), message.name)
}

/// The encoded `FileDescriptorSet` of a message's decoded form.
pub(crate) fn descriptor_set(message: &MessageInfo) -> Vec<u8> {
    let mut described =
        DescriptorProto { name: Some(message.name.into()), ..DescriptorProto::default() };
    for (signal, number) in message.signals.iter().zip(1..) {
        add_signal(&mut described, signal, number);
    }
    let mut files = Files::default();
    files.add_file(FileDescriptorProto {
        name: Some(file_name(&schema_name(message))),
        package: Some(package(message).into()),
        syntax: Some("proto3".into()),
        message_type: vec![described],
        ..FileDescriptorProto::default()
    });
    files.into_bytes()
}

fn add_signal(described: &mut DescriptorProto, signal: &SignalInfo, number: i32) {
    let name = snake_case(signal.name);
    let kind = Kind::of(signal).protobuf(signal.size);
    let mut fields = vec![field_descriptor(&name, number, &Shape::scalar(kind))];
    if let Some((suffix, distance)) = text_field(signal) {
        let (name, number) = (format!("{name}_{suffix}"), number + distance as i32);
        fields.push(field_descriptor(&name, number, &Shape::scalar(Type::String)));
    }
    for mut field in fields {
        if is_optional(signal) {
            make_optional(described, &mut field);
        }
        described.field.push(field);
    }
}

/// Suffix and distance of the string field beside a signal, if it has one.
fn text_field(signal: &SignalInfo) -> Option<(&'static str, u32)> {
    let is_code = |raw: i64| signal.reading(raw).value().is_none();
    match signal.values {
        [] => None,
        values if values.iter().all(|(raw, _)| is_code(*raw)) => Some(("status", STATUS_NUMBER)),
        _ => Some(("text", TEXT_NUMBER)),
    }
}

/// Whether a frame of the message may say nothing of the signal.
fn is_optional(signal: &SignalInfo) -> bool {
    signal.multiplexed.is_some() || signal.codes.is_some()
}

/// proto3 `optional`: the field alone in a oneof of its own.
fn make_optional(described: &mut DescriptorProto, field: &mut FieldDescriptorProto) {
    field.proto3_optional = Some(true);
    field.oneof_index = Some(described.oneof_decl.len() as i32);
    let name = Some(format!("_{}", field.name()));
    described.oneof_decl.push(OneofDescriptorProto { name, options: None });
}

/// What a channel of decoded signals says about them: units and comments by field name.
pub(crate) fn channel_metadata(message: &MessageInfo) -> BTreeMap<String, String> {
    let mut metadata = BTreeMap::from([
        ("message".to_owned(), message.name.to_owned()),
        ("id".to_owned(), format!("0x{:08X}", message.id)),
        ("comment".to_owned(), message.comment.to_owned()),
    ]);
    for signal in message.signals {
        let name = snake_case(signal.name);
        if !signal.unit.is_empty() {
            metadata.insert(format!("{name}.unit"), signal.unit.to_owned());
        }
    }
    metadata
}

/// Which message of a DBC a frame is; `None` when it is none.
pub(crate) fn message(frame: &Frame) -> Option<&'static MessageInfo> {
    // Judges the frame's kind and length; there is nothing to visit yet.
    platoon_dbc::decode_signals(frame, &mut |_, _, _| {})
}

/// Appends the signals of a frame that is this message as protobuf.
pub(crate) fn encode(message: &MessageInfo, frame: &Frame, out: &mut Vec<u8>) {
    let signals = message.signals;
    let mut cursor = 0;
    platoon_dbc::decode_signals(frame, &mut |signal, raw, reading| {
        // Signals are visited in the order of the table.
        while !std::ptr::eq(&raw const signals[cursor], signal) {
            cursor += 1;
        }
        put_signal(signal, cursor as u32 + 1, raw, reading, out);
    });
}

fn put_signal(
    signal: &SignalInfo,
    number: u32,
    raw: i64,
    reading: Reading<f64>,
    out: &mut Vec<u8>,
) {
    let text = match reading {
        Reading::Value(_) => signal.value_text(raw),
        Reading::Error => Some("error"),
        Reading::NotAvailable => Some("not available"),
    };
    if let (Some(text), Some((_, distance))) = (text, text_field(signal)) {
        wire::put_delimited(out, number + distance, |out| out.extend_from_slice(text.as_bytes()));
    }
    let Reading::Value(physical) = reading else {
        return;
    };
    if raw == 0 && physical == 0.0 && !is_optional(signal) {
        return; // proto3's default
    }
    match Kind::of(signal) {
        Kind::Unsigned => {
            put_tag(out, number, WireType::Varint);
            put_varint(out, raw.cast_unsigned());
        }
        Kind::Signed => {
            put_tag(out, number, WireType::Varint);
            put_varint(out, wire::zigzag(raw));
        }
        Kind::Physical => {
            put_tag(out, number, WireType::Fixed64);
            out.extend_from_slice(&physical.to_le_bytes());
        }
    }
}

/// `PositionX_3` becomes `position_x_3`, `E2eCrc` becomes `e2e_crc`.
fn snake_case(name: &str) -> String {
    let mut out = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !out.is_empty() && !out.ends_with('_') {
            out.push('_');
        }
        out.extend(letter.to_lowercase());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_messages() -> impl Iterator<Item = &'static MessageInfo> {
        platoon_dbc::MESSAGES.iter().chain(platoon_dbc::j1939::MESSAGES)
    }

    #[test]
    fn field_names_are_in_snake_case() {
        assert_eq!(snake_case("E2eCrc"), "e2e_crc");
        assert_eq!(snake_case("PositionX_3"), "position_x_3");
    }

    #[test]
    fn field_names_of_a_message_are_unique() {
        for message in all_messages() {
            let mut names: Vec<_> = message.signals.iter().map(|s| snake_case(s.name)).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), message.signals.len(), "{}", message.name);
        }
    }

    #[test]
    fn a_frame_of_no_known_message_has_no_signals() {
        let frame = Frame::new(0x123, platoon_dbc::FrameFlags::default(), &[1]).expect("valid");
        assert!(message(&frame).is_none());
    }

    #[test]
    fn every_message_of_every_profile_encodes() {
        for info in all_messages() {
            let flags = platoon_dbc::FrameFlags {
                is_extended: true,
                is_fd: info.is_fd,
                ..platoon_dbc::FrameFlags::default()
            };
            for byte in [0, 1, 0x55, 0xff] {
                let data = vec![byte; info.length];
                let frame = Frame::new(info.id, flags, &data).expect("valid");
                assert_eq!(message(&frame).map(|message| message.name), Some(info.name));
                let mut bytes = Vec::new();
                encode(info, &frame, &mut bytes);
                assert!(byte == 0 || !bytes.is_empty(), "{}", info.name);
            }
        }
    }

    /// Fields of the encoded message: their numbers, and strings among them.
    fn fields(info: &MessageInfo, data: &[u8]) -> Vec<(u32, Option<String>)> {
        let flags =
            platoon_dbc::FrameFlags { is_extended: true, ..platoon_dbc::FrameFlags::default() };
        let frame = Frame::new(info.id, flags, data).expect("valid");
        let (mut bytes, mut fields) = (Vec::new(), Vec::new());
        encode(info, &frame, &mut bytes);
        let mut left = bytes.as_slice();
        while !left.is_empty() {
            let (number, wire) = prost::encoding::decode_key(&mut left).expect("a key");
            let mut text = String::new();
            if wire == prost::encoding::WireType::LengthDelimited {
                let context = prost::encoding::DecodeContext::default();
                prost::encoding::string::merge(wire, &mut text, &mut left, context).expect("text");
            } else {
                let context = prost::encoding::DecodeContext::default();
                prost::encoding::skip_field(wire, number, &mut left, context).expect("a field");
            }
            fields.push((number, Some(text).filter(|text| !text.is_empty())));
        }
        fields
    }

    #[test]
    fn what_is_not_available_is_no_number_and_says_so() {
        let vdc2 = platoon_dbc::message_info(platoon_dbc::j1939::Vdc2::ID).expect("known");
        let status = |number, text: &str| (number, Some(text.to_owned()));
        // Angle and turns not available, sensor of an unknown kind, yaw rate in error, the rest 0.
        let found = fields(vdc2, &[0xff, 0xff, 0xff, 0x00, 0xfe, 0, 0, 0]);
        let codes = ["not available", "not available", "not available", "error"];
        let expected = [
            status(2001, codes[0]),
            status(2002, codes[1]),
            status(1003, codes[2]),
            status(2004, codes[3]),
            (5, None),
            (6, None),
        ];
        assert_eq!(found, expected);
    }
}
