//! One table per record: the Rust struct, its protobuf encoding and its descriptor.
//!
//! [`message!`] and [`choices!`] take a record's fields once, with their numbers and sentences,
//! and make from them the struct, the encoder, the decoder and the protobuf descriptor that goes
//! into the MCAP schema. There is no `.proto` file and no second list of fields to keep in step.
//!
//! Rust types map to protobuf as follows: `u8`, `u16`, `u32` to `uint32`; `u64` to `uint64`;
//! `i32`, `i64` to `int32`, `int64`; `bool`, `f32`, `f64` to `bool`, `float`, `double`; `String` to `string`;
//! [`Snapshot`](crate::Snapshot) to `bytes`; arrays of numbers to packed repeated fields; lists
//! and vectors of records to repeated messages. As in proto3, a zero is not written.

use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};

use crate::list::List;
use crate::wire::{self, DecodeError, Input, WireType};

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
        Self {
            label: Label::Optional,
            kind,
            type_name: String::new(),
            file: String::new(),
        }
    }

    fn named(kind: Type, name: &str) -> Self {
        Self {
            label: Label::Optional,
            kind,
            type_name: format!(".{name}"),
            file: file_name(name),
        }
    }

    fn repeated(self) -> Self {
        Self {
            label: Label::Repeated,
            ..self
        }
    }
}

/// The descriptor files collected so far, each after those it imports.
#[derive(Default)]
pub(crate) struct Files(FileDescriptorSet);

impl Files {
    fn contains(&self, name: &str) -> bool {
        self.0.file.iter().any(|file| file.name() == name)
    }

    /// Adds the file of one message.
    pub(crate) fn add_message(
        &mut self,
        full_name: &str,
        fields: &[(&str, i32, fn(&mut Self) -> Shape)],
    ) {
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

fn expect_wire(number: u32, found: WireType, wanted: WireType) -> Result<(), DecodeError> {
    if found == wanted {
        Ok(())
    } else {
        Err(DecodeError::WrongWireType(number))
    }
}

/// A number that may stand in a packed list.
pub(crate) trait Scalar: Copy + Default + PartialEq {
    const KIND: Type;
    const WIRE: WireType;
    /// Whether this is the default, which is not written. A negative zero is not: its bits stay.
    fn is_default(self) -> bool;
    fn put_value(self, out: &mut Vec<u8>);
    fn get_value(input: &mut Input<'_>) -> Result<Self, DecodeError>;
}

macro_rules! varint_scalars {
    ($($rust:ty => $kind:ident, $to:expr, $from:expr;)*) => {$(
        impl Scalar for $rust {
            const KIND: Type = Type::$kind;
            const WIRE: WireType = WireType::Varint;
            fn is_default(self) -> bool {
                self == Self::default()
            }
            fn put_value(self, out: &mut Vec<u8>) {
                wire::put_varint(out, $to(self));
            }
            fn get_value(input: &mut Input<'_>) -> Result<Self, DecodeError> {
                $from(input.varint()?)
            }
        }
    )*};
}

fn narrow<T, U: TryFrom<T>>(value: T) -> Result<U, DecodeError> {
    U::try_from(value).map_err(|_| DecodeError::OutOfRange)
}

varint_scalars! {
    u8 => Uint32, u64::from, narrow;
    u16 => Uint32, u64::from, narrow;
    u32 => Uint32, u64::from, narrow;
    u64 => Uint64, core::convert::identity, Ok;
    i32 => Int32, |value| i64::from(value).cast_unsigned(), |raw: u64| narrow(raw.cast_signed());
    i64 => Int64, i64::cast_unsigned, |raw: u64| Ok(raw.cast_signed());
    bool => Bool, u64::from, |raw| Ok(raw != 0);
}

macro_rules! fixed_scalars {
    ($($rust:ty => $kind:ident, $wire:ident;)*) => {$(
        impl Scalar for $rust {
            const KIND: Type = Type::$kind;
            const WIRE: WireType = WireType::$wire;
            fn is_default(self) -> bool {
                self.to_bits() == 0
            }
            fn put_value(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
            fn get_value(input: &mut Input<'_>) -> Result<Self, DecodeError> {
                Ok(Self::from_le_bytes(input.array()?))
            }
        }
    )*};
}

fixed_scalars! {
    f32 => Float, Fixed32;
    f64 => Double, Fixed64;
}

macro_rules! scalar_fields {
    ($($rust:ty)*) => {$(
        impl Field for $rust {
            fn shape(_: &mut Files) -> Shape {
                Shape::scalar(<Self as Scalar>::KIND)
            }
            fn put(&self, number: u32, out: &mut Vec<u8>) {
                if !self.is_default() {
                    wire::put_tag(out, number, <Self as Scalar>::WIRE);
                    self.put_value(out);
                }
            }
            fn get(
                &mut self,
                number: u32,
                wire: WireType,
                input: &mut Input<'_>,
            ) -> Result<(), DecodeError> {
                expect_wire(number, wire, <Self as Scalar>::WIRE)?;
                *self = Self::get_value(input)?;
                Ok(())
            }
        }
    )*};
}

scalar_fields! { u8 u16 u32 u64 i32 i64 bool f32 f64 }

impl<S: Scalar, const N: usize> Field for [S; N] {
    fn shape(_: &mut Files) -> Shape {
        Shape::scalar(S::KIND).repeated()
    }

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        wire::put_delimited(out, number, |out| {
            self.iter().for_each(|value| value.put_value(out))
        });
    }

    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        expect_wire(number, wire, WireType::Length)?;
        let mut packed = input.delimited()?;
        let mut values = self.iter_mut();
        while !packed.is_empty() {
            *values.next().ok_or(DecodeError::TooLong)? = S::get_value(&mut packed)?;
        }
        Ok(())
    }
}

impl Field for String {
    fn shape(_: &mut Files) -> Shape {
        Shape::scalar(Type::String)
    }

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_bytes(self.as_bytes(), number, out);
    }

    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        expect_wire(number, wire, WireType::Length)?;
        let bytes = input.delimited()?.remaining();
        *self = core::str::from_utf8(bytes)
            .map_err(|_| DecodeError::Malformed)?
            .into();
        Ok(())
    }
}

fn put_bytes(bytes: &[u8], number: u32, out: &mut Vec<u8>) {
    if !bytes.is_empty() {
        wire::put_delimited(out, number, |out| out.extend_from_slice(bytes));
    }
}

/// A byte string of at most `N` bytes is protobuf `bytes`.
impl<const N: usize> Field for crate::memory::Snapshot<N> {
    fn shape(_: &mut Files) -> Shape {
        Shape::scalar(Type::Bytes)
    }

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_bytes(self.as_bytes(), number, out);
    }

    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        expect_wire(number, wire, WireType::Length)?;
        let bytes = input.delimited()?.remaining();
        *self = Self::new(bytes).ok_or(DecodeError::TooLong)?;
        Ok(())
    }
}

/// Shape, put and get of one message inside another.
pub(crate) mod nested {
    use super::{DecodeError, Files, Input, Message, Shape, Type, WireType, expect_wire, wire};

    pub(crate) fn shape<M: Message>(files: &mut Files) -> Shape {
        M::describe(files);
        Shape::named(Type::Message, M::NAME)
    }

    pub(crate) fn put<M: Message>(message: &M, number: u32, out: &mut Vec<u8>) {
        wire::put_delimited(out, number, |out| message.encode(out));
    }

    pub(crate) fn get<M: Message>(
        message: &mut M,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        expect_wire(number, wire, WireType::Length)?;
        message.merge(input.delimited()?)
    }
}

impl<M: Message + Copy, const N: usize> Field for List<M, N> {
    fn shape(files: &mut Files) -> Shape {
        nested::shape::<M>(files).repeated()
    }

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        self.iter().for_each(|row| nested::put(row, number, out));
    }

    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        let mut row = M::default();
        nested::get(&mut row, number, wire, input)?;
        self.push(row).map_err(|_| DecodeError::TooLong)
    }
}

impl<M: Message> Field for Vec<M> {
    fn shape(files: &mut Files) -> Shape {
        nested::shape::<M>(files).repeated()
    }

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        self.iter().for_each(|row| nested::put(row, number, out));
    }

    fn get(
        &mut self,
        number: u32,
        wire: WireType,
        input: &mut Input<'_>,
    ) -> Result<(), DecodeError> {
        let mut row = M::default();
        nested::get(&mut row, number, wire, input)?;
        self.push(row);
        Ok(())
    }
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
                $crate::schema::nested::shape::<$Name>(files)
            }
            fn put(&self, number: u32, out: &mut Vec<u8>) {
                $crate::schema::nested::put(self, number, out);
            }
            fn get(
                &mut self,
                number: u32,
                wire: $crate::wire::WireType,
                input: &mut $crate::wire::Input<'_>,
            ) -> Result<(), $crate::wire::DecodeError> {
                $crate::schema::nested::get(self, number, wire, input)
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
