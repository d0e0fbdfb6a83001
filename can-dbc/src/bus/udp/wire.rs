//! One frame as python-can's `udp_multicast` packs it: a msgpack map in one datagram.
//!
//! Written with the keys of python-can 4, in its order. Read in any order, with any integer
//! width, with unknown keys skipped and missing ones at python-can's defaults, because other
//! versions and other programs may send them so. What is no frame gives `None`, whatever its bytes.

use crate::frame::{Frame, FrameFlags};

/// Format bytes of msgpack (specification of 2017, "Formats").
mod format {
    pub(super) const FIXMAP: u8 = 0x80;
    pub(super) const FIXSTR: u8 = 0xA0;
    pub(super) const NIL: u8 = 0xC0;
    pub(super) const FALSE: u8 = 0xC2;
    pub(super) const TRUE: u8 = 0xC3;
    pub(super) const BIN8: u8 = 0xC4;
    pub(super) const FLOAT64: u8 = 0xCB;
    pub(super) const UINT32: u8 = 0xCE;
}

/// Entries of the map.
const ENTRIES: u8 = 11;
/// The longest datagram [`Packed`] writes has 251 bytes.
const CAPACITY: usize = 256;

/// What python-can shows as the channel of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tag {
    text: [u8; Self::CAPACITY],
    length: usize,
}

impl Tag {
    pub(super) const CAPACITY: usize = 15;

    /// `None` when the text is too long.
    pub(super) fn new(text: &str) -> Option<Self> {
        let mut tag = Self { text: [0; Self::CAPACITY], length: text.len() };
        tag.text.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        Some(tag)
    }
}

/// A frame packed into a datagram.
pub(super) struct Packed {
    buffer: [u8; CAPACITY],
    length: usize,
}

impl Packed {
    pub(super) fn of(frame: &Frame, tag: &Tag) -> Self {
        let flags = frame.flags();
        let mut packed = Self { buffer: [0; CAPACITY], length: 0 };
        packed.put(&[format::FIXMAP | ENTRIES]);
        packed.put_key("timestamp");
        // Whoever receives takes the kernel's time instead.
        packed.put(&[format::FLOAT64]);
        packed.put(&0_f64.to_be_bytes());
        packed.put_key("arbitration_id");
        packed.put(&[format::UINT32]);
        packed.put(&frame.id().to_be_bytes());
        packed.put_flag("is_extended_id", flags.is_extended);
        packed.put_flag("is_remote_frame", flags.is_rtr);
        packed.put_flag("is_error_frame", flags.is_error);
        packed.put_key("channel");
        match &tag.text[..tag.length] {
            [] => packed.put(&[format::NIL]),
            text => packed.put_text(text),
        }
        packed.put_key("dlc");
        // At most 64, and so a positive fixint.
        packed.put(&[frame.length() as u8]);
        packed.put_key("data");
        packed.put(&[format::BIN8, frame.data().len() as u8]);
        packed.put(frame.data());
        packed.put_flag("is_fd", flags.is_fd);
        packed.put_flag("bitrate_switch", flags.brs);
        packed.put_flag("error_state_indicator", flags.esi);
        packed
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    fn put(&mut self, bytes: &[u8]) {
        self.buffer[self.length..self.length + bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
    }

    /// A string shorter than 32 bytes.
    fn put_text(&mut self, text: &[u8]) {
        self.put(&[format::FIXSTR | text.len() as u8]);
        self.put(text);
    }

    fn put_key(&mut self, key: &str) {
        self.put_text(key.as_bytes());
    }

    fn put_flag(&mut self, key: &str, value: bool) {
        self.put_key(key);
        self.put(&[if value { format::TRUE } else { format::FALSE }]);
    }
}

/// What a datagram said so far; the defaults are python-can's.
struct Draft<'a> {
    id: Option<u32>,
    flags: FrameFlags,
    length: Option<u64>,
    data: &'a [u8],
}

/// The frame in a datagram, if it is one.
pub(super) fn unpack(datagram: &[u8]) -> Option<Frame> {
    let mut reader = Reader { rest: datagram };
    let Value::Map(entries) = reader.value()? else {
        return None;
    };
    let flags = FrameFlags { is_extended: true, ..FrameFlags::default() };
    let mut draft = Draft { id: None, flags, length: None, data: &[] };
    for _ in 0..entries {
        let Value::Bytes(key) = reader.value()? else {
            return None;
        };
        draft.read_entry(key, &mut reader)?;
    }
    if !reader.rest.is_empty() {
        return None;
    }
    draft.finish()
}

impl<'a> Draft<'a> {
    fn read_entry(&mut self, key: &[u8], reader: &mut Reader<'a>) -> Option<()> {
        let value = reader.value()?;
        match key {
            b"arbitration_id" => self.id = Some(u32::try_from(value.unsigned()?).ok()?),
            b"dlc" if !value.is_nil() => self.length = Some(value.unsigned()?),
            b"data" if !value.is_nil() => self.data = value.bytes()?,
            b"is_extended_id" => self.flags.is_extended = value.flag()?,
            b"is_remote_frame" => self.flags.is_rtr = value.flag()?,
            b"is_error_frame" => self.flags.is_error = value.flag()?,
            b"is_fd" => self.flags.is_fd = value.flag()?,
            b"bitrate_switch" => self.flags.brs = value.flag()?,
            b"error_state_indicator" => self.flags.esi = value.flag()?,
            // timestamp, channel, and what a later version may add.
            _ => reader.skip_content(value)?,
        }
        Some(())
    }

    fn finish(self) -> Option<Frame> {
        let length = match self.length {
            Some(length) => usize::try_from(length).ok()?,
            None => self.data.len(),
        };
        Frame::build(self.id?, self.flags, length, self.data).ok()
    }
}

/// One msgpack value, as far as frames need them; containers give their number of entries only.
#[derive(Clone, Copy)]
enum Value<'a> {
    Nil,
    Flag(bool),
    Unsigned(u64),
    Bytes(&'a [u8]),
    Array(u32),
    Map(u32),
    /// A negative number, a float or an extension: nothing a frame holds.
    Other,
}

impl<'a> Value<'a> {
    fn is_nil(&self) -> bool {
        matches!(self, Value::Nil)
    }

    fn flag(self) -> Option<bool> {
        if let Value::Flag(flag) = self { Some(flag) } else { None }
    }

    fn unsigned(self) -> Option<u64> {
        if let Value::Unsigned(number) = self { Some(number) } else { None }
    }

    fn bytes(self) -> Option<&'a [u8]> {
        if let Value::Bytes(bytes) = self { Some(bytes) } else { None }
    }
}

/// Reads msgpack values off the front of a datagram.
struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(taken)
    }

    /// A big-endian number of `width` bytes, at most eight.
    fn number(&mut self, width: usize) -> Option<u64> {
        Some(self.take(width)?.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn bytes(&mut self, width: usize) -> Option<Value<'a>> {
        let length = usize::try_from(self.number(width)?).ok()?;
        Some(Value::Bytes(self.take(length)?))
    }

    fn other(&mut self, length: usize) -> Option<Value<'a>> {
        self.take(length).map(|_| Value::Other)
    }

    fn value(&mut self) -> Option<Value<'a>> {
        let format = self.number(1)? as u8;
        Some(match format {
            0x00..=0x7F => Value::Unsigned(u64::from(format)),
            0x80..=0x8F => Value::Map(u32::from(format & 0x0F)),
            0x90..=0x9F => Value::Array(u32::from(format & 0x0F)),
            0xA0..=0xBF => Value::Bytes(self.take(usize::from(format & 0x1F))?),
            0xC0 => Value::Nil,
            0xC1 => return None,
            0xC2 | 0xC3 => Value::Flag(format == format::TRUE),
            // bin and str of 8, 16 and 32 bits
            0xC4..=0xC6 => self.bytes(1 << (format - 0xC4))?,
            0xD9..=0xDB => self.bytes(1 << (format - 0xD9))?,
            // ext with a length and a type byte, then its data
            0xC7..=0xC9 => {
                let length = usize::try_from(self.number(1 << (format - 0xC7))?).ok()?;
                self.other(length.checked_add(1)?)?
            }
            0xCA => self.other(4)?,
            0xCB => self.other(8)?,
            0xCC..=0xCF => Value::Unsigned(self.number(1 << (format - 0xCC))?),
            0xD0..=0xD3 => self.signed(1 << (format - 0xD0))?,
            // fixext: a type byte and 1, 2, 4, 8 or 16 bytes
            0xD4..=0xD8 => self.other(1 + (1 << (format - 0xD4)))?,
            0xDC | 0xDD => Value::Array(u32::try_from(self.number(2 << (format - 0xDC))?).ok()?),
            0xDE | 0xDF => Value::Map(u32::try_from(self.number(2 << (format - 0xDE))?).ok()?),
            0xE0..=0xFF => Value::Other,
        })
    }

    fn signed(&mut self, width: usize) -> Option<Value<'a>> {
        let number = self.number(width)?;
        let is_negative = number >> (8 * width - 1) != 0;
        Some(if is_negative { Value::Other } else { Value::Unsigned(number) })
    }

    /// Skips what is inside a container. Every value takes a byte at least, so this ends.
    fn skip_content(&mut self, container: Value<'a>) -> Option<()> {
        let values_in = |value| match value {
            Value::Array(count) => u64::from(count),
            Value::Map(count) => 2 * u64::from(count),
            _ => 0,
        };
        let mut pending = values_in(container);
        while pending > 0 {
            pending = pending - 1 + values_in(self.value()?);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests;
