//! Decoded signals: one protobuf message per message of `platoon.dbc`.
//!
//! The descriptors are made from [`platoon_dbc::MESSAGES`], so the DBC stays the only place that
//! lists signals. Field `i + 1` is signal `i`, named in snake case. A signal with factor 1 and
//! offset 0 is an integer field, any other a `double` in its DBC unit; one with a value table
//! also has a string field `<name>_text` with number `i + 1001`. Signals of a multiplexed page
//! are `optional`: a frame sets those of the page it carries.

use std::collections::BTreeMap;

use platoon_dbc::{Frame, MESSAGES, MessageInfo, SignalInfo};
use prost_types::field_descriptor_proto::Type;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, OneofDescriptorProto,
};

use crate::schema::{Files, Shape, field_descriptor, file_name};
use crate::wire::{self, WireType, put_tag, put_varint};

const PACKAGE: &str = "platoon.dbc";
/// What separates a signal's field number from that of its text.
const TEXT_NUMBER: u32 = 1000;

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

/// The schema name of a message's decoded form.
pub(crate) fn schema_name(message: &MessageInfo) -> String {
    format!("{PACKAGE}.{}", message.name)
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
        package: Some(PACKAGE.into()),
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
    if !signal.values.is_empty() {
        let shape = Shape::scalar(Type::String);
        let number = number + TEXT_NUMBER as i32;
        fields.push(field_descriptor(&format!("{name}_text"), number, &shape));
    }
    for mut field in fields {
        if signal.multiplexed.is_some() {
            make_optional(described, &mut field);
        }
        described.field.push(field);
    }
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

/// Which of [`MESSAGES`] a frame is; `None` when it is none of the contract.
pub(crate) fn index(frame: &Frame) -> Option<usize> {
    // Judges the frame's kind and length; there is nothing to visit yet.
    let message = platoon_dbc::decode_signals(frame, &mut |_, _, _| {})?;
    MESSAGES.iter().position(|other| other.id == message.id)
}

/// Appends the signals of a frame that is the message at `index` as protobuf.
pub(crate) fn encode(index: usize, frame: &Frame, out: &mut Vec<u8>) {
    let signals = MESSAGES[index].signals;
    let mut cursor = 0;
    platoon_dbc::decode_signals(frame, &mut |signal, raw, physical| {
        // Signals are visited in the order of the table.
        while !std::ptr::eq(&raw const signals[cursor], signal) {
            cursor += 1;
        }
        put_signal(signal, cursor as u32 + 1, raw, physical, out);
    });
}

fn put_signal(signal: &SignalInfo, number: u32, raw: i64, physical: f64, out: &mut Vec<u8>) {
    if let Some(text) = signal.value_text(raw) {
        let number = number + TEXT_NUMBER;
        wire::put_delimited(out, number, |out| out.extend_from_slice(text.as_bytes()));
    }
    if raw == 0 && physical == 0.0 && signal.multiplexed.is_none() {
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

    #[test]
    fn field_names_are_in_snake_case() {
        assert_eq!(snake_case("E2eCrc"), "e2e_crc");
        assert_eq!(snake_case("PositionX_3"), "position_x_3");
    }

    #[test]
    fn field_names_of_a_message_are_unique() {
        for message in MESSAGES {
            let mut names: Vec<_> = message.signals.iter().map(|s| snake_case(s.name)).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), message.signals.len(), "{}", message.name);
        }
    }

    #[test]
    fn a_frame_of_no_known_message_has_no_signals() {
        let frame = Frame::new(0x123, platoon_dbc::FrameFlags::default(), &[1]).expect("valid");
        assert_eq!(index(&frame), None);
    }

    #[test]
    fn every_message_of_the_contract_encodes() {
        for (number, message) in MESSAGES.iter().enumerate() {
            let flags = platoon_dbc::FrameFlags {
                is_extended: true,
                is_fd: true,
                brs: true,
                ..platoon_dbc::FrameFlags::default()
            };
            for byte in [0, 1, 0x55, 0xff] {
                let data = vec![byte; message.length];
                let frame = Frame::new(message.id, flags, &data).expect("valid");
                assert_eq!(index(&frame), Some(number), "{}", message.name);
                let mut bytes = Vec::new();
                encode(number, &frame, &mut bytes);
                assert!(byte == 0 || !bytes.is_empty(), "{}", message.name);
            }
        }
    }
}
