//! One table per record: the Rust struct, its protobuf encoding and its descriptor.
//!
//! [`message!`] and [`choices!`] take a record's fields once, with their numbers and sentences,
//! and make from them the struct, the encoder, the decoder and the protobuf descriptor that goes
//! into the MCAP schema. There is no `.proto` file and no second list of fields to keep in step.
//!
//! Rust types map to protobuf as follows: `u8`, `u16`, `u32` to `uint32`; `u64` to `uint64`;
//! `i32`, `i64` to `int32`, `int64`; `bool`, `f32`, `f64` to `bool`, `float`, `double`; `String` to
//! `string`; [`Snapshot`](crate::Snapshot) to `bytes`; arrays of numbers to packed repeated fields;
//! lists and vectors of records to repeated messages. As in proto3, a zero is not written.

use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};

use crate::wire::{DecodeError, Input, WireType};

/// A record with a protobuf form.
pub(crate) trait Message: Default {
    /// Full protobuf name, package first.
    const NAME: &'static str;

    /// Adds this message's file, after those it needs.
    fn describe(files: &mut Files);
    /// Appends the fields that are not zero.
    fn encode(&self, out: &mut Vec<u8>);
    /// Takes the fields found in `input` over into `self`.
    fn merge(&mut self, input: Input<'_>) -> Result<(), DecodeError>;

    /// The message of these bytes.
    fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut message = Self::default();
        message.merge(Input::new(bytes))?;
        Ok(message)
    }

    /// The encoded `FileDescriptorSet` an MCAP schema record holds.
    fn descriptor_set() -> Vec<u8> {
        let mut files = Files::default();
        Self::describe(&mut files);
        files.into_bytes()
    }
}

/// A Rust type that can be a field.
pub(crate) trait Field {
    /// The field's protobuf type, and the files it needs.
    fn shape(files: &mut Files) -> Shape;
    /// Appends the field, unless it has its default value.
    fn put(&self, number: u32, out: &mut Vec<u8>);
    /// Takes one occurrence of the field.
    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError>;
}

/// A field's protobuf type.
pub(crate) struct Shape {
    pub(crate) label: Label,
    pub(crate) kind: Type,
    /// Full name of the message or enum with a leading dot; empty for scalars.
    pub(crate) type_name: String,
    /// File that defines it; empty for scalars.
    pub(crate) file: String,
}

impl Shape {
    pub(crate) const fn scalar(kind: Type) -> Self {
        Self { label: Label::Optional, kind, type_name: String::new(), file: String::new() }
    }

    pub(crate) fn named(kind: Type, name: &str) -> Self {
        Self { label: Label::Optional, kind, type_name: format!(".{name}"), file: file_name(name) }
    }

    pub(crate) fn repeated(self) -> Self {
        Self { label: Label::Repeated, ..self }
    }
}

/// A field of a record's table: name, number, protobuf type.
pub(crate) type FieldRow = (&'static str, i32, fn(&mut Files) -> Shape);

/// The descriptor files collected so far, each after those it imports.
#[derive(Default)]
pub(crate) struct Files(FileDescriptorSet);

impl Files {
    fn contains(&self, name: &str) -> bool {
        self.0.file.iter().any(|file| file.name() == name)
    }

    /// Adds the file of one message.
    pub(crate) fn add_message(&mut self, full_name: &str, fields: &[FieldRow]) {
        if self.contains(&file_name(full_name)) {
            return;
        }
        let (package, name) = split_name(full_name);
        let mut dependency = Vec::new();
        let mut described = Vec::new();
        for (field, number, shape) in fields {
            let shape = shape(self);
            if !shape.file.is_empty() && !dependency.contains(&shape.file) {
                dependency.push(shape.file.clone());
            }
            described.push(field_descriptor(field, *number, &shape));
        }
        self.0.file.push(FileDescriptorProto {
            dependency,
            message_type: vec![DescriptorProto {
                name: Some(name.into()),
                field: described,
                ..DescriptorProto::default()
            }],
            ..file(full_name, package)
        });
    }

    /// Adds the file of one enum.
    pub(crate) fn add_enum(&mut self, full_name: &str, variants: &[(&str, i32)]) {
        if self.contains(&file_name(full_name)) {
            return;
        }
        let (package, name) = split_name(full_name);
        let prefix = upper_snake(name);
        let value = variants
            .iter()
            .map(|(variant, number)| EnumValueDescriptorProto {
                name: Some(format!("{prefix}_{}", upper_snake(variant))),
                number: Some(*number),
                options: None,
            })
            .collect();
        self.0.file.push(FileDescriptorProto {
            enum_type: vec![EnumDescriptorProto {
                name: Some(name.into()),
                value,
                ..EnumDescriptorProto::default()
            }],
            ..file(full_name, package)
        });
    }

    /// Adds a file made elsewhere.
    pub(crate) fn add_file(&mut self, file: FileDescriptorProto) {
        self.0.file.push(file);
    }

    /// The encoded `FileDescriptorSet`.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        prost::Message::encode_to_vec(&self.0)
    }
}

fn file(full_name: &str, package: &str) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(file_name(full_name)),
        package: Some(package.into()),
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    }
}

/// The file a type lives in. Google's own types keep their well-known files.
pub(crate) fn file_name(full_name: &str) -> String {
    let path = full_name.replace('.', "/");
    if full_name.starts_with("google.protobuf.") {
        return format!("{}.proto", path.to_lowercase());
    }
    format!("{path}.proto")
}

pub(crate) fn split_name(full_name: &str) -> (&str, &str) {
    full_name.rsplit_once('.').unwrap_or(("", full_name))
}

pub(crate) fn field_descriptor(name: &str, number: i32, shape: &Shape) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.into()),
        json_name: Some(name.into()),
        number: Some(number),
        label: Some(shape.label as i32),
        r#type: Some(shape.kind as i32),
        type_name: (!shape.type_name.is_empty()).then(|| shape.type_name.clone()),
        ..FieldDescriptorProto::default()
    }
}

/// `NotFinite` becomes `NOT_FINITE`.
fn upper_snake(name: &str) -> String {
    let mut out = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !out.is_empty() {
            out.push('_');
        }
        out.extend(letter.to_uppercase());
    }
    out
}

/// Shape of an enum field; used by [`choices!`].
pub(crate) fn enum_shape(files: &mut Files, name: &str, variants: &[(&str, i32)]) -> Shape {
    files.add_enum(name, variants);
    Shape::named(Type::Enum, name)
}

/// Declares a record: struct, protobuf encoding and descriptor from one table of fields.
macro_rules! message {
    (
        $(#[$meta:meta])*
        $vis:vis struct $Name:ident = $full:literal {
            $( $(#[$field_meta:meta])* $number:literal $field:ident : $kind:ty, )*
        }
    ) => {
        $(#[$meta])*
        $vis struct $Name {
            $( $(#[$field_meta])* pub $field: $kind, )*
        }

        impl $crate::schema::Message for $Name {
            const NAME: &'static str = $full;

            fn describe(files: &mut $crate::schema::Files) {
                files.add_message($full, &[
                    $( (
                        stringify!($field),
                        $number,
                        <$kind as $crate::schema::Field>::shape,
                    ), )*
                ]);
            }

            fn encode(&self, out: &mut Vec<u8>) {
                $( $crate::schema::Field::put(&self.$field, $number, out); )*
            }

            fn merge(
                &mut self,
                mut input: $crate::wire::Input<'_>,
            ) -> Result<(), $crate::wire::DecodeError> {
                while !input.is_empty() {
                    let (number, wire) = input.tag()?;
                    match number {
                        $( $number => {
                            $crate::schema::Field::get(
                                &mut self.$field, number, wire, &mut input,
                            )?;
                        } )*
                        _ => input.skip(wire)?,
                    }
                }
                Ok(())
            }
        }
    };
}
pub(crate) use message;

/// Makes a record usable as a field of another record.
macro_rules! message_field {
    ($($Name:ty),* $(,)?) => {$(
        impl $crate::schema::Field for $Name {
            fn shape(files: &mut $crate::schema::Files) -> $crate::schema::Shape {
                $crate::fields::nested::shape::<$Name>(files)
            }
            fn put(&self, number: u32, out: &mut Vec<u8>) {
                $crate::fields::nested::put(self, number, out);
            }
            fn get(
                &mut self,
                number: u32,
                wire: $crate::wire::WireType,
                input: &mut $crate::wire::Input<'_>,
            ) -> Result<(), $crate::wire::DecodeError> {
                $crate::fields::nested::get(self, number, wire, input)
            }
        }
    )*};
}
pub(crate) use message_field;

/// Declares an enum that is also a protobuf enum; the first variant is number 0.
macro_rules! choices {
    (
        $(#[$meta:meta])*
        $vis:vis enum $Name:ident = $full:literal {
            $( $(#[$variant_meta:meta])* $Variant:ident = $number:literal, )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
        $vis enum $Name {
            $( $(#[$variant_meta])* $Variant = $number, )*
        }

        impl $Name {
            /// Every variant, in order of its number.
            pub const ALL: &[Self] = &[ $( Self::$Variant, )* ];
        }

        impl $crate::schema::Field for $Name {
            fn shape(files: &mut $crate::schema::Files) -> $crate::schema::Shape {
                $crate::schema::enum_shape(
                    files, $full, &[ $( (stringify!($Variant), $number), )* ],
                )
            }

            fn put(&self, number: u32, out: &mut Vec<u8>) {
                $crate::schema::Field::put(&(*self as u32), number, out);
            }

            fn get(
                &mut self,
                number: u32,
                wire: $crate::wire::WireType,
                input: &mut $crate::wire::Input<'_>,
            ) -> Result<(), $crate::wire::DecodeError> {
                let mut raw = 0u32;
                $crate::schema::Field::get(&mut raw, number, wire, input)?;
                *self = match raw {
                    $( $number => Self::$Variant, )*
                    _ => return Err($crate::wire::DecodeError::OutOfRange),
                };
                Ok(())
            }
        }
    };
}
pub(crate) use choices;
