//! The protobuf wire format: tags, varints, fixed-width and length-delimited fields.
//!
//! Reference: <https://protobuf.dev/programming-guides/encoding/>. Only what our records need;
//! groups are skipped. Every read is bounded by the slice it is given and returns an error,
//! never a panic, on malformed bytes.

use thiserror::Error;

/// Nesting and group depth a reader follows before it gives up.
const DEPTH_MAX: u32 = 16;

/// Why bytes are not the message they claim to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum DecodeError {
    /// The bytes end inside a value.
    #[error("the message ends in the middle of a value")]
    Truncated,
    /// A varint runs past ten bytes, or a tag or wire type is not one of protobuf's.
    #[error("the message is not protobuf: bad varint, tag or wire type")]
    Malformed,
    /// A field has a wire type that does not fit its declared type.
    #[error("field {0} has a wire type that does not fit its declared type")]
    WrongWireType(u32),
    /// A number does not fit the field's type.
    #[error("a number in the message does not fit its field")]
    OutOfRange,
    /// A list or byte string is longer than the record can hold.
    #[error("a list in the message is longer than its record can hold")]
    TooLong,
    /// The CDR encapsulation or a string in it is not what the schema says.
    #[error("the message is not little-endian CDR of the expected layout")]
    NotCdr,
    /// The channel's schema is none of ours.
    #[error("the channel's schema is not one this crate records")]
    UnknownSchema,
}

/// How a value is laid out on the wire (the low three bits of a tag).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WireType {
    Varint,
    Fixed64,
    Length,
    GroupStart,
    GroupEnd,
    Fixed32,
}

impl WireType {
    fn from_tag(tag: u64) -> Result<Self, DecodeError> {
        Ok(match tag & 7 {
            0 => Self::Varint,
            1 => Self::Fixed64,
            2 => Self::Length,
            3 => Self::GroupStart,
            4 => Self::GroupEnd,
            5 => Self::Fixed32,
            _ => return Err(DecodeError::Malformed),
        })
    }

    const fn code(self) -> u64 {
        match self {
            Self::Varint => 0,
            Self::Fixed64 => 1,
            Self::Length => 2,
            Self::GroupStart => 3,
            Self::GroupEnd => 4,
            Self::Fixed32 => 5,
        }
    }
}

/// Appends a varint: seven bits per byte, least significant first.
pub(crate) fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Appends a field's tag: its number and wire type.
pub(crate) fn put_tag(out: &mut Vec<u8>, number: u32, wire: WireType) {
    put_varint(out, u64::from(number) << 3 | wire.code());
}

/// Appends a length-delimited field whose content `fill` writes.
pub(crate) fn put_delimited(out: &mut Vec<u8>, number: u32, fill: impl FnOnce(&mut Vec<u8>)) {
    put_tag(out, number, WireType::Length);
    let start = out.len();
    out.push(0); // room for the commonest length, one byte
    fill(out);
    let length = out.len() - start - 1;
    if length < 0x80 {
        out[start] = length as u8;
    } else {
        let mut prefix = Vec::with_capacity(10);
        put_varint(&mut prefix, length as u64);
        out.splice(start..=start, prefix);
    }
}

/// Maps a signed number to an unsigned one so that small magnitudes stay short.
pub(crate) const fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

/// A cursor over a message's bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Input<'a> {
    rest: &'a [u8],
}

impl<'a> Input<'a> {
    pub(crate) const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(crate) const fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Takes the next `count` bytes.
    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let (head, tail) = self.rest.split_at_checked(count).ok_or(DecodeError::Truncated)?;
        self.rest = tail;
        Ok(head)
    }

    /// Takes the next `N` bytes as an array.
    pub(crate) fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let (head, tail) = self.rest.split_first_chunk().ok_or(DecodeError::Truncated)?;
        self.rest = tail;
        Ok(*head)
    }

    /// Reads a varint.
    pub(crate) fn varint(&mut self) -> Result<u64, DecodeError> {
        let mut value = 0u64;
        for shift in (0..70).step_by(7) {
            let [byte] = self.array()?;
            if shift == 63 && byte > 1 {
                return Err(DecodeError::Malformed);
            }
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(DecodeError::Malformed)
    }

    /// Reads a field's number and wire type.
    pub(crate) fn tag(&mut self) -> Result<(u32, WireType), DecodeError> {
        let tag = self.varint()?;
        let number = u32::try_from(tag >> 3).map_err(|_| DecodeError::Malformed)?;
        if number == 0 {
            return Err(DecodeError::Malformed);
        }
        Ok((number, WireType::from_tag(tag)?))
    }

    /// Reads a length and the bytes it spans.
    pub(crate) fn delimited(&mut self) -> Result<Self, DecodeError> {
        let length = usize::try_from(self.varint()?).map_err(|_| DecodeError::Truncated)?;
        Ok(Self::new(self.take(length)?))
    }

    /// What is left.
    pub(crate) const fn remaining(&self) -> &'a [u8] {
        self.rest
    }

    /// Steps over a field nobody asked for.
    pub(crate) fn skip(&mut self, wire: WireType) -> Result<(), DecodeError> {
        let mut depth = 0u32;
        let mut wire = wire;
        loop {
            match wire {
                WireType::Varint => drop(self.varint()?),
                WireType::Fixed64 => drop(self.array::<8>()?),
                WireType::Fixed32 => drop(self.array::<4>()?),
                WireType::Length => drop(self.delimited()?),
                WireType::GroupStart if depth < DEPTH_MAX => depth += 1,
                WireType::GroupEnd if depth > 0 => depth -= 1,
                WireType::GroupStart | WireType::GroupEnd => return Err(DecodeError::Malformed),
            }
            if depth == 0 {
                return Ok(());
            }
            wire = self.tag()?.1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_round_trip_at_every_length() {
        for bits in 0..64 {
            for value in [1u64 << bits, (1u64 << bits) - 1, u64::MAX >> bits] {
                let mut bytes = Vec::new();
                put_varint(&mut bytes, value);
                let mut input = Input::new(&bytes);
                assert_eq!(input.varint(), Ok(value));
                assert!(input.is_empty());
            }
        }
    }

    #[test]
    fn zigzag_keeps_small_magnitudes_small() {
        assert_eq!([0, -1, 1, -2].map(zigzag), [0, 1, 2, 3]);
        assert_eq!([i64::MAX, i64::MIN].map(zigzag), [u64::MAX - 1, u64::MAX]);
    }

    #[test]
    fn long_contents_get_a_longer_length_prefix() {
        for length in [0usize, 1, 127, 128, 300, 20_000] {
            let mut bytes = Vec::new();
            put_delimited(&mut bytes, 3, |out| out.extend(std::iter::repeat_n(7, length)));
            let mut input = Input::new(&bytes);
            assert_eq!(input.tag(), Ok((3, WireType::Length)));
            assert_eq!(input.delimited().map(|inner| inner.remaining().len()), Ok(length));
            assert!(input.is_empty());
        }
    }

    #[test]
    fn an_endless_varint_is_refused() {
        assert_eq!(Input::new(&[0xff; 32]).varint(), Err(DecodeError::Malformed));
        assert_eq!(Input::new(&[0xff; 3]).varint(), Err(DecodeError::Truncated));
    }

    #[test]
    fn endless_groups_are_refused() {
        let bytes = [0x0b; 64]; // field 1, start of group, again and again
        let mut input = Input::new(&bytes);
        let (_, wire) = input.tag().expect("a tag");
        assert_eq!(input.skip(wire), Err(DecodeError::Malformed));
    }
}
