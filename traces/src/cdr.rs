//! Little-endian CDR as ROS 2 writes it: values aligned to their size, strings with a final NUL.
//!
//! Reference: OMG DDS-XTypes 1.3, section 7.4.1 (PLAIN_CDR); the four-byte encapsulation header
//! `00 01 00 00` says little-endian. Alignment counts from behind that header.

use crate::wire::DecodeError;

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Appends CDR values to a buffer.
pub(crate) struct Writer<'a> {
    out: &'a mut Vec<u8>,
    origin: usize,
}

impl<'a> Writer<'a> {
    /// Starts a message at the buffer's end.
    pub(crate) fn new(out: &'a mut Vec<u8>) -> Self {
        out.extend_from_slice(&ENCAPSULATION);
        let origin = out.len();
        Self { out, origin }
    }

    pub(crate) fn u8(&mut self, value: u8) {
        self.out.push(value);
    }

    pub(crate) fn bool(&mut self, value: bool) {
        self.u8(u8::from(value));
    }

    pub(crate) fn u32(&mut self, value: u32) {
        let padding = (self.out.len() - self.origin).wrapping_neg() % 4;
        self.out.extend_from_slice(&[0; 3][..padding]);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn i32(&mut self, value: i32) {
        self.u32(value.cast_unsigned());
    }

    /// A sequence of bytes: its length, then the bytes.
    pub(crate) fn bytes(&mut self, value: &[u8]) {
        self.u32(value.len() as u32);
        self.out.extend_from_slice(value);
    }

    /// A string: its length with the NUL, the text, the NUL.
    pub(crate) fn string(&mut self, value: &str) {
        self.u32(value.len() as u32 + 1);
        self.out.extend_from_slice(value.as_bytes());
        self.out.push(0);
    }
}

/// Reads CDR values off a slice.
pub(crate) struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Checks the encapsulation header.
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let body = bytes.strip_prefix(&ENCAPSULATION).ok_or(DecodeError::NotCdr)?;
        Ok(Self { body, at: 0 })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let end = self.at.checked_add(count).ok_or(DecodeError::Truncated)?;
        let taken = self.body.get(self.at..end).ok_or(DecodeError::Truncated)?;
        self.at = end;
        Ok(taken)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, DecodeError> {
        Ok(self.take(1)?[0])
    }

    pub(crate) fn bool(&mut self) -> Result<bool, DecodeError> {
        match self.u8()? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(DecodeError::NotCdr),
        }
    }

    pub(crate) fn u32(&mut self) -> Result<u32, DecodeError> {
        self.take(self.at.wrapping_neg() % 4)?;
        let bytes = self.take(4)?;
        Ok(u32::from_le_bytes(bytes.try_into().expect("four bytes were taken")))
    }

    pub(crate) fn i32(&mut self) -> Result<i32, DecodeError> {
        Ok(self.u32()?.cast_signed())
    }

    pub(crate) fn bytes(&mut self) -> Result<&'a [u8], DecodeError> {
        let count = self.u32()? as usize;
        self.take(count)
    }

    pub(crate) fn string(&mut self) -> Result<&'a str, DecodeError> {
        let text = self.bytes()?.strip_suffix(&[0]).ok_or(DecodeError::NotCdr)?;
        core::str::from_utf8(text).map_err(|_| DecodeError::NotCdr)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_aligned_from_behind_the_header() {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes);
        writer.bool(true);
        writer.u32(0x0403_0201);
        writer.string("ab");
        writer.u8(9);
        let expected =
            [0, 1, 0, 0, 1, 0, 0, 0, 1, 2, 3, 4, 3, 0, 0, 0, b'a', b'b', 0, 9].as_slice();
        assert_eq!(bytes, expected);
        let mut reader = Reader::new(&bytes).expect("a header");
        assert_eq!(reader.bool(), Ok(true));
        assert_eq!(reader.u32(), Ok(0x0403_0201));
        assert_eq!(reader.string(), Ok("ab"));
        assert_eq!(reader.u8(), Ok(9));
        assert_eq!(reader.u8(), Err(DecodeError::Truncated));
    }

    #[test]
    fn a_length_past_the_end_is_refused() {
        let bytes = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1];
        let mut reader = Reader::new(&bytes).expect("a header");
        assert_eq!(reader.bytes(), Err(DecodeError::Truncated));
    }
}
