//! The socketcand protocol as its clients speak it: ASCII elements `< word word ... >` over TCP.
//!
//! The reference is `doc/protocol.md` of linux-can/socketcand, and what python-can's client and
//! SavvyCAN really send and read. Where they differ from it or from each other:
//!
//! - A frame has at most 8 bytes in the reference. Here one may have up to 64: more than 8 make it
//!   a CAN FD frame with bit rate switch, both ways. Both clients read such frames with all bytes,
//!   but do not know that they are FD.
//! - The length of `send` is decimal in SavvyCAN and hexadecimal in python-can. The number of
//!   bytes that follow decides; the length must be right in one of the two.
//! - SavvyCAN marks a 29-bit identifier with bit 31, and prints it and bytes from 0x80 on with the
//!   sign extended: `ffffffff98ff1080`. Both are understood.
//! - Remote frames cannot be said in this protocol and are left out.

use std::io::Write;

use platoon_dbc::{Frame, FrameFlags, Received};

/// Longest element \[bytes\]: a `send` of 64 bytes as SavvyCAN writes them has about 1.1 kB.
const ELEMENT_MAX: usize = 2048;
/// Most bytes of a classic frame.
const CLASSIC_BYTES_MAX: usize = 8;
/// Most bytes of any frame.
const FRAME_BYTES_MAX: usize = 64;
/// Largest 11-bit and 29-bit identifiers.
const STANDARD_MAX: u32 = 0x7FF;
const EXTENDED_MAX: u32 = 0x1FFF_FFFF;
/// Marks a 29-bit identifier in the kernel's identifier word, and in what SavvyCAN sends.
const EXTENDED_FLAG: u32 = 0x8000_0000;
/// Digits from which an identifier is a 29-bit one, however small.
const EXTENDED_DIGITS: usize = 8;

const NS_PER_S: u64 = 1_000_000_000;
const NS_PER_US: u64 = 1_000;

/// What a client asks for.
#[derive(Debug, Clone, PartialEq)]
pub enum Command<'a> {
    /// Choose the bus; the first thing every client does.
    Open(&'a str),
    /// From now on, pass on every frame.
    RawMode,
    /// From now on, pass on nothing.
    BcmMode,
    /// Answer with the same words.
    Echo,
    /// Put a frame on the bus.
    Send(Frame),
}

/// Why an element is no command of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Malformed {
    /// The first word, or a word too many.
    Unknown,
    /// A `send` without identifier or length.
    Send,
    /// Not an identifier.
    Identifier,
    /// Not a byte.
    Byte,
    /// The length does not fit the bytes, or no frame has this length.
    Length,
    /// An element without end.
    TooLong,
}

impl Malformed {
    /// The reason in the words of the answer; the first is the reference's own.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Unknown => "unknown command",
            Self::Send => "syntax: send ID LENGTH BYTE BYTE ..., in hexadecimal",
            Self::Identifier => "syntax: the identifier is no hexadecimal number of 29 bits",
            Self::Byte => "syntax: a byte is no hexadecimal number from 0 to FF",
            Self::Length => "syntax: the length is not that of the data, or no CAN frame has it",
            Self::TooLong => "command too long",
        }
    }
}

impl<'a> Command<'a> {
    /// Reads what stands between `<` and `>`.
    pub fn parse(element: &'a str) -> Result<Self, Malformed> {
        let mut words = element.split_ascii_whitespace();
        let command = match words.next() {
            Some("open") => words.next().map(Command::Open),
            Some("rawmode") => Some(Command::RawMode),
            Some("bcmmode") => Some(Command::BcmMode),
            Some("echo") => Some(Command::Echo),
            Some("send") => return frame(words).map(Command::Send),
            _ => None,
        };
        command.filter(|_| words.next().is_none()).ok_or(Malformed::Unknown)
    }
}

/// The frame of a `send`: identifier, length, bytes.
fn frame<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Frame, Malformed> {
    let (id, length) = words.next().zip(words.next()).ok_or(Malformed::Send)?;
    let (id, is_extended) = identifier(id)?;
    let mut bytes = [0; FRAME_BYTES_MAX];
    let mut count = 0;
    for word in words {
        *bytes.get_mut(count).ok_or(Malformed::Length)? = byte(word)?;
        count += 1;
    }
    let says = |radix| usize::from_str_radix(length, radix) == Ok(count);
    if !says(16) && !says(10) {
        return Err(Malformed::Length);
    }
    let is_fd = count > CLASSIC_BYTES_MAX;
    let flags = FrameFlags { is_extended, is_fd, brs: is_fd, ..FrameFlags::default() };
    Frame::new(id, flags, &bytes[..count]).map_err(|_| Malformed::Length)
}

/// An identifier, and whether it has 29 bits.
fn identifier(word: &str) -> Result<(u32, bool), Malformed> {
    let number = u64::from_str_radix(word, 16).map_err(|_| Malformed::Identifier)?;
    let has_sign = number >> 32 == u64::from(u32::MAX);
    let low = number as u32;
    let is_flagged = low & EXTENDED_FLAG != 0;
    let id = low & !EXTENDED_FLAG;
    if (number >> 32 != 0 && !(has_sign && is_flagged)) || id > EXTENDED_MAX {
        return Err(Malformed::Identifier);
    }
    let is_extended = is_flagged || id > STANDARD_MAX || word.len() >= EXTENDED_DIGITS;
    Ok((id, is_extended))
}

fn byte(word: &str) -> Result<u8, Malformed> {
    let number = u64::from_str_radix(word, 16).map_err(|_| Malformed::Byte)?;
    let has_sign = number >> 7 == u64::MAX >> 7;
    u8::try_from(number).or(if has_sign { Ok(number as u8) } else { Err(Malformed::Byte) })
}

/// Appends a frame as a client reads it; nothing for what the protocol has no words for.
pub fn write_frame(out: &mut Vec<u8>, received: &Received) {
    let (frame, flags) = (&received.frame, received.frame.flags());
    if flags.is_rtr {
        return;
    }
    let (seconds, us) = (received.stamp_ns / NS_PER_S, received.stamp_ns % NS_PER_S / NS_PER_US);
    let written = match (flags.is_error, flags.is_extended) {
        (true, _) => write!(out, "< error {:03X} {seconds}.{us:06} ", frame.id()),
        (_, true) => write!(out, "< frame {:08X} {seconds}.{us:06} ", frame.id()),
        (_, false) => write!(out, "< frame {:03X} {seconds}.{us:06} ", frame.id()),
    };
    written.expect("a vector takes everything");
    if !flags.is_error {
        for byte in frame.data() {
            write!(out, "{byte:02X}").expect("a vector takes everything");
        }
        out.push(b' ');
    }
    out.push(b'>');
}

/// Cuts what a client sends into elements.
#[derive(Debug, Default)]
pub struct Splitter {
    /// What came of the element that is not complete yet, without its `<`.
    begun: Option<Vec<u8>>,
}

impl Splitter {
    /// Hands over every element that these bytes complete. What stands between elements is
    /// skipped, as the reference does; a `<` begins a new one even inside another.
    pub fn feed(&mut self, bytes: &[u8], mut take: impl FnMut(Result<&str, Malformed>)) {
        for &byte in bytes {
            match (byte, &mut self.begun) {
                (b'<', _) => self.begun = Some(Vec::new()),
                (b'>', Some(element)) => {
                    take(std::str::from_utf8(element).map_err(|_| Malformed::Unknown));
                    self.begun = None;
                }
                (_, Some(element)) if element.len() == ELEMENT_MAX => {
                    take(Err(Malformed::TooLong));
                    self.begun = None;
                }
                (_, Some(element)) => element.push(byte),
                (_, None) => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(element: &str) -> Result<Frame, Malformed> {
        Command::parse(element).map(|command| match command {
            Command::Send(frame) => frame,
            other => panic!("{other:?} is no send"),
        })
    }

    fn with(id: u32, is_extended: bool, data: &[u8]) -> Frame {
        let is_fd = data.len() > 8;
        let flags = FrameFlags { is_extended, is_fd, brs: is_fd, ..FrameFlags::default() };
        Frame::new(id, flags, data).expect("valid")
    }

    #[test]
    fn the_commands_of_the_reference_are_understood() {
        assert_eq!(Command::parse(" open truck0 "), Ok(Command::Open("truck0")));
        assert_eq!(Command::parse("open truck0"), Ok(Command::Open("truck0")));
        assert_eq!(Command::parse(" rawmode "), Ok(Command::RawMode));
        assert_eq!(Command::parse(" bcmmode "), Ok(Command::BcmMode));
        assert_eq!(Command::parse(" echo "), Ok(Command::Echo));
        assert_eq!(sent(" send 123 0 "), Ok(with(0x123, false, &[])));
        assert_eq!(sent(" send 1AAAAAAA 2 1 f1 "), Ok(with(0x1AAA_AAAA, true, &[1, 0xF1])));
    }

    #[test]
    fn python_can_and_savvycan_are_both_understood() {
        let sixteen: Vec<u8> = (0..16).map(|i| 0x78 + i).collect();
        let hex = |byte: &u8| format!("{byte:x}");
        let signed = |byte: &u8| format!("{:x}", i64::from(*byte as i8));
        let python = sixteen.iter().map(hex).collect::<Vec<_>>().join(" ");
        let savvy = sixteen.iter().map(signed).collect::<Vec<_>>().join(" ");
        let expected = Ok(with(0x18FF_102A, true, &sixteen));
        assert_eq!(sent(&format!(" send 18FF102A 10 {python} ")), expected);
        assert_eq!(sent(&format!(" send ffffffff98ff102a 16 {savvy} ")), expected);
        assert_eq!(sent(" send 00000010 1 0 "), Ok(with(0x10, true, &[0])));
        assert_eq!(sent(" send 10 1 0 "), Ok(with(0x10, false, &[0])));
    }

    #[test]
    fn what_makes_no_frame_is_refused_with_a_reason() {
        for (element, reason) in [
            ("send", Malformed::Send),
            ("send 123", Malformed::Send),
            ("send 20000000 0", Malformed::Identifier),
            ("send 1ffffffffff 0", Malformed::Identifier),
            ("send xyz 0", Malformed::Identifier),
            ("send 123 1 100", Malformed::Byte),
            ("send 123 1 -1", Malformed::Byte),
            ("send 123 1 g", Malformed::Byte),
            ("send 123 2 1", Malformed::Length),
            ("send 123 9 1 2 3 4 5 6 7 8 9", Malformed::Length),
            ("send 123 -1", Malformed::Length),
        ] {
            assert_eq!(sent(element), Err(reason), "{element}");
        }
        let bytes = "0 ".repeat(65);
        assert_eq!(sent(&format!("send 123 65 {bytes}")), Err(Malformed::Length));
        for element in ["", "open", "open a b", "rawmode now", "add 1 0 123 0", "Open truck0"] {
            assert_eq!(Command::parse(element), Err(Malformed::Unknown), "{element}");
        }
    }

    #[test]
    fn frames_are_written_as_the_reference_does() {
        let written = |frame| {
            let mut out = Vec::new();
            write_frame(&mut out, &Received { frame, stamp_ns: 23_424_242_999, own: false });
            String::from_utf8(out).expect("ASCII")
        };
        assert_eq!(
            written(with(0x123, false, &[0x1A, 0x22, 0x03, 0x44])),
            "< frame 123 23.424242 1A220344 >"
        );
        assert_eq!(written(with(0x12, true, &[])), "< frame 00000012 23.424242  >");
        let error = FrameFlags { is_error: true, ..FrameFlags::default() };
        let error = Frame::new(0x40, error, &[0; 8]).expect("valid");
        assert_eq!(written(error), "< error 040 23.424242 >");
        assert_eq!(written(Frame::remote(0x12, false, 3).expect("valid")), "");
        assert_eq!(written(with(1, false, &[0xFF; 64])).len(), 31 - 8 + 128 + 2 - 1);
    }

    fn elements(pieces: &[&[u8]]) -> Vec<Result<String, Malformed>> {
        let (mut splitter, mut found) = (Splitter::default(), Vec::new());
        for piece in pieces {
            splitter.feed(piece, |element| found.push(element.map(str::to_owned)));
        }
        found
    }

    #[test]
    fn elements_are_found_however_the_bytes_come() {
        let whole = [Ok(" echo ".to_owned()), Ok(" rawmode ".to_owned())];
        assert_eq!(elements(&[b"< echo >< rawmode >"]), whole);
        assert_eq!(elements(&[b"noise\n< ec", b"ho >\r\n<", b" rawmode ", b">"]), whole);
        assert_eq!(elements(&[b"< send 1 < echo >> < rawmode >"]), whole);
    }

    #[test]
    fn endless_and_binary_elements_are_reported_and_the_next_is_found() {
        let endless = [b"<".as_slice(), &[b'x'; 10_000], b"> < echo >"].concat();
        assert_eq!(elements(&[&endless]), [Err(Malformed::TooLong), Ok(" echo ".to_owned())]);
        let binary = [b"<\xFF\xFE>".as_slice(), b"< echo >"].concat();
        assert_eq!(elements(&[&binary]), [Err(Malformed::Unknown), Ok(" echo ".to_owned())]);
    }
}
