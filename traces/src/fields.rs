//! The Rust types that can be fields of a record, and how each is written.

use prost_types::field_descriptor_proto::Type;

use crate::list::List;
use crate::memory::Snapshot;
use crate::schema::{Field, Files, Message, Shape};
use crate::wire::{self, DecodeError, Input, WireType};

fn expect_wire(number: u32, found: WireType, wanted: WireType) -> Result<(), DecodeError> {
    if found == wanted { Ok(()) } else { Err(DecodeError::WrongWireType(number)) }
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
                input.varint().and_then($from)
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
        wire::put_delimited(out, number, |out| self.iter().for_each(|value| value.put_value(out)));
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
        *self = core::str::from_utf8(bytes).map_err(|_| DecodeError::Malformed)?.into();
        Ok(())
    }
}

fn put_bytes(bytes: &[u8], number: u32, out: &mut Vec<u8>) {
    if !bytes.is_empty() {
        wire::put_delimited(out, number, |out| out.extend_from_slice(bytes));
    }
}

/// A byte string of at most `N` bytes is protobuf `bytes`.
impl<const N: usize> Field for Snapshot<N> {
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
