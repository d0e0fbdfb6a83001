//! The bits of one frame, with the stuff bits this very frame needs.

use crate::frame::{FD_LENGTHS, Frame, FrameFlags};

/// Acknowledge slot and delimiter, end of frame, and the intermission before the next frame.
const TAIL_BITS: u64 = 1 + 1 + 7 + 3;
const CRC_DELIMITER_BITS: u64 = 1;
const CLASSIC_CRC_BITS: u32 = 15;
/// Polynomial of the classic CRC, x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const CLASSIC_CRC: u32 = 0x4599;
/// From the start of a classic frame to its length code: SOF, identifier, RTR, IDE, r0.
const CLASSIC_HEAD_BITS: u64 = 1 + 11 + 3;
/// From the start of an FD frame to its BRS bit: SOF, identifier, RRS, IDE, FDF, res, BRS.
const FD_HEAD_BITS: u64 = 1 + 11 + 5;
/// What the extended format adds to either: SRR and 18 more bits of identifier, and with classic
/// frames r1; the FD format has its FDF and res bits there in both formats.
const EXTENSION_BITS: u64 = 1 + 18;
const CLASSIC_R1_BITS: u64 = 1;
const ESI_BITS: u64 = 1;
const LENGTH_CODE_BITS: u64 = 4;
/// After this many equal bits the sender inserts one of the other level.
const STUFF_RUN: u32 = 5;
/// FD payloads up to this length have the short CRC.
const SHORT_CRC_LENGTH: usize = 16;
/// Stuff count, CRC and fixed stuff bits: 4 + 17 + 6 and 4 + 21 + 7.
const SHORT_CRC_BITS: u64 = 27;
const LONG_CRC_BITS: u64 = 32;

/// Bits of a frame from its start to the end of the intermission, by the rate they are sent at.
///
/// The rate changes inside two bits, at the sample points of BRS and of the CRC delimiter. What one
/// of them gains the other loses, so BRS counts here as slow and the delimiter as fast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBits {
    /// At the rate of arbitration.
    pub nominal: u64,
    /// At the rate of the data phase.
    pub fast: u64,
}

impl FrameBits {
    /// The bits of a frame. An error frame has none: it is a report of the driver, not traffic.
    pub fn of(frame: &Frame) -> Self {
        let flags = frame.flags();
        if flags.is_error {
            return Self::default();
        }
        let mut stream = Stream::default();
        put_arbitration(&mut stream, frame);
        if !flags.is_fd {
            put_data(&mut stream, frame);
            stream.put(stream.crc, CLASSIC_CRC_BITS);
            let stuff_after_crc = u64::from(stream.run == STUFF_RUN);
            let nominal = stream.count + stuff_after_crc + CRC_DELIMITER_BITS + TAIL_BITS;
            return Self { nominal, fast: 0 };
        }
        stream.put(u32::from(flags.brs), 1);
        let head = stream.count;
        stream.put(u32::from(flags.esi), 1);
        put_data(&mut stream, frame);
        // A fixed stuff bit follows the data, so a run that ends there needs no other.
        let rest = stream.count - head + fd_crc_bits(frame.length()) + CRC_DELIMITER_BITS;
        Self::split(flags, head, rest)
    }

    /// The most bits that any frame with these flags and this length has: a stuff bit after the
    /// first five bits and after every four from then on.
    ///
    /// For classic frames these are the 55 + 10 n and 80 + 10 n bits of n data bytes in
    /// \[Davis et al. 2007, Eqs. 2 and 3\] (see [`worst_responses`](super::worst_responses)).
    pub fn most(flags: FrameFlags, length: usize) -> Self {
        if flags.is_error {
            return Self::default();
        }
        let extension = if flags.is_extended { EXTENSION_BITS } else { 0 };
        let data = if flags.is_rtr { 0 } else { 8 * length as u64 };
        if !flags.is_fd {
            let r1 = if flags.is_extended { CLASSIC_R1_BITS } else { 0 };
            let head = CLASSIC_HEAD_BITS + extension + r1 + LENGTH_CODE_BITS;
            let stuffed = head + data + u64::from(CLASSIC_CRC_BITS);
            let nominal = stuffed + (stuffed - 1) / 4 + CRC_DELIMITER_BITS + TAIL_BITS;
            return Self { nominal, fast: 0 };
        }
        let head = FD_HEAD_BITS + extension;
        let stuffed = head + ESI_BITS + LENGTH_CODE_BITS + data;
        // A run that ends with BRS is broken after it, at the other rate; one that ends with the
        // data by the fixed stuff bit.
        let (head_stuff, stuff) = ((head - 2) / 4, (stuffed - 2) / 4);
        let rest = stuffed - head + stuff - head_stuff + fd_crc_bits(length) + CRC_DELIMITER_BITS;
        Self::split(flags, head + head_stuff, rest)
    }

    fn split(flags: FrameFlags, head: u64, rest: u64) -> Self {
        if flags.brs {
            Self { nominal: head + TAIL_BITS, fast: rest }
        } else {
            Self { nominal: head + rest + TAIL_BITS, fast: 0 }
        }
    }
}

/// Stuff count, CRC and fixed stuff bits of an FD frame.
fn fd_crc_bits(length: usize) -> u64 {
    if length <= SHORT_CRC_LENGTH { SHORT_CRC_BITS } else { LONG_CRC_BITS }
}

/// From the start of frame to the bit before BRS (FD) or before the length code (classic).
fn put_arbitration(stream: &mut Stream, frame: &Frame) {
    let flags = frame.flags();
    let (request, fd) = (u32::from(flags.is_rtr), u32::from(flags.is_fd));
    stream.put(0, 1);
    if flags.is_extended {
        stream.put(frame.id() >> 18, 11);
        stream.put(0b11, 2); // SRR, IDE
        stream.put(frame.id() & 0x3_FFFF, 18);
        stream.put(request, 1);
        stream.put(fd << 1, 2); // FDF and res, or r1 and r0
    } else {
        stream.put(frame.id(), 11);
        stream.put(request, 1);
        stream.put(0, 1); // IDE
        if flags.is_fd {
            stream.put(0b10, 2); // FDF, res
        } else {
            stream.put(0, 1); // r0
        }
    }
}

fn put_data(stream: &mut Stream, frame: &Frame) {
    let code = match FD_LENGTHS.iter().position(|length| *length == frame.length()) {
        Some(index) => 9 + index as u32,
        None => frame.length() as u32,
    };
    stream.put(code, LENGTH_CODE_BITS as u32);
    for byte in frame.data() {
        stream.put(u32::from(*byte), 8);
    }
}

/// Counts bits with the stuff bits they cause, and runs the classic CRC over them.
#[derive(Default)]
struct Stream {
    count: u64,
    last: u32,
    run: u32,
    crc: u32,
}

impl Stream {
    /// The low `size` bits of `value`, most significant first.
    fn put(&mut self, value: u32, size: u32) {
        for place in (0..size).rev() {
            self.put_bit(value >> place & 1);
        }
    }

    fn put_bit(&mut self, bit: u32) {
        // The stuff bit is due when a bit follows the run, and may begin the next run itself.
        if self.run == STUFF_RUN {
            self.count += 1;
            (self.last, self.run) = (1 - self.last, 1);
        }
        self.run = if bit == self.last { self.run + 1 } else { 1 };
        self.last = bit;
        self.count += 1;
        let feedback = (self.crc >> 14) ^ bit;
        self.crc = (self.crc << 1 & 0x7FFF) ^ if feedback == 1 { CLASSIC_CRC } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FD: FrameFlags =
        FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::CLASSIC };

    fn fd(length: usize, fill: u8) -> Frame {
        // An identifier that alternates enough to need no stuff bit.
        Frame::new(0x1555_5555, FD, &vec![fill; length]).expect("valid")
    }

    #[test]
    fn an_fd_frame_without_stuffing_has_the_bits_of_the_standard() {
        // 36 bits up to BRS and 12 after the CRC delimiter; ESI and DLC, data, CRC, delimiter.
        let expected = FrameBits { nominal: 48, fast: 5 + 256 + 32 + 1 };
        assert_eq!(FrameBits::of(&fd(32, 0x55)), expected);
        let expected = FrameBits { nominal: 48, fast: 5 + 128 + 27 + 1 };
        assert_eq!(FrameBits::of(&fd(16, 0x55)), expected);
    }

    #[test]
    fn the_longest_frames_have_the_bits_of_the_published_formulas() {
        let extended = FrameFlags { is_extended: true, ..FrameFlags::CLASSIC };
        for length in 0..=8 {
            let bits = |flags| FrameBits::most(flags, length);
            let davis = |constant| constant + 10 * length as u64;
            assert_eq!(bits(FrameFlags::CLASSIC), FrameBits { nominal: davis(55), fast: 0 });
            assert_eq!(bits(extended), FrameBits { nominal: davis(80), fast: 0 });
        }
        // 48 + 8 bits and 294 + 65 bits: 297 bits are stuffed, 36 of them before the switch.
        assert_eq!(FrameBits::most(FD, 32), FrameBits { nominal: 56, fast: 359 });
    }

    #[test]
    fn constant_data_is_stuffed_after_every_fifth_bit() {
        // DLC 1111 and then 512 ones: the run of five is complete after one data bit; each stuff
        // bit is a zero, and five ones follow until the next.
        let dull = FrameBits::of(&fd(64, 0xFF)).fast;
        let lively = FrameBits::of(&fd(64, 0x55)).fast;
        assert_eq!(dull - lively, 1 + (512 - 1 - 1) / 5);
    }

    #[test]
    fn the_classic_crc_is_that_of_can() {
        // CRC-15/CAN of "123456789" is 0x059E (catalogue of Greg Cook).
        let mut stream = Stream::default();
        for byte in b"123456789" {
            stream.put(u32::from(*byte), 8);
        }
        assert_eq!(stream.crc, 0x059E);
    }

    #[test]
    fn a_switch_of_rate_only_moves_bits() {
        let fast = fd(32, 0x33);
        let flags = FrameFlags { brs: false, ..fast.flags() };
        let slow = Frame::new(fast.id(), flags, fast.data()).expect("valid");
        let (fast, slow) = (FrameBits::of(&fast), FrameBits::of(&slow));
        assert_eq!(slow.fast, 0);
        // The BRS bit itself may begin or break a run.
        assert!(slow.nominal.abs_diff(fast.nominal + fast.fast) <= 1);
    }
}
