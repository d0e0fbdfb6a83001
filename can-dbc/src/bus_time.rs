//! How long a frame would hold a real bus.
//!
//! A virtual bus has no bit rate, so whether a rehearsed traffic fits a real one must be computed.
//! The bits are counted as ISO 11898-1:2015 lays them out, with the stuff bits this very frame
//! needs; retransmissions and error frames are not modelled.

use crate::frame::Frame;

/// Bits after the CRC delimiter: acknowledge slot and delimiter, end of frame, intermission.
const TAIL_BITS: u64 = 1 + 1 + 7 + 3;
const CRC_DELIMITER_BITS: u64 = 1;
/// From the start of an extended FD frame to its BRS bit.
const EXTENDED_HEAD_BITS: u64 = 36;
const ESI_BITS: u64 = 1;
const LENGTH_CODE_BITS: u64 = 4;
/// After this many equal bits the sender inserts one of the other level.
const STUFF_RUN: u32 = 5;
/// FD payloads up to this length have the short CRC.
const SHORT_CRC_LENGTH: usize = 16;
/// Stuff count, CRC and fixed stuff bits: 4 + 17 + 6 and 4 + 21 + 7.
const SHORT_CRC_BITS: u64 = 27;
const LONG_CRC_BITS: u64 = 32;
/// Polynomial of the classic CRC, x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const CLASSIC_CRC: u32 = 0x4599;
/// Data lengths that the codes 9 to 15 stand for.
const FD_LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];
const NS_PER_S: u64 = 1_000_000_000;

/// Bit rates of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusTiming {
    /// Bit rate of arbitration, bit/s.
    pub nominal_hz: u64,
    /// Bit rate of the data phase of frames with bit rate switch, bit/s.
    pub data_hz: u64,
}

impl Default for BusTiming {
    /// 500 kbit/s and 2 Mbit/s, the usual pair of J1939-17 and J1939-22 and that of `platoon.dbc`.
    fn default() -> Self {
        Self { nominal_hz: 500_000, data_hz: 2_000_000 }
    }
}

impl BusTiming {
    /// Time on the bus of a frame including the intermission after it, nanoseconds.
    ///
    /// Error frames count as 0: they are reports of the driver and not traffic.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn frame_time_ns(&self, frame: &Frame) -> u64 {
        self.time_ns(FrameBits::of(frame))
    }

    /// The longest that any extended FD frame with bit rate switch and `length` data bytes takes,
    /// nanoseconds: with a stuff bit after five bits once and after every four from then on.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn frame_time_ns_max(&self, length: usize) -> u64 {
        let data = ESI_BITS + LENGTH_CODE_BITS + 8 * length as u64;
        let head_stuff = (EXTENDED_HEAD_BITS - 1) / 4;
        let stuff = (EXTENDED_HEAD_BITS + data - 1) / 4;
        self.time_ns(FrameBits {
            nominal: EXTENDED_HEAD_BITS + head_stuff + TAIL_BITS,
            fast: data + stuff - head_stuff + crc_bits(length) + CRC_DELIMITER_BITS,
        })
    }

    fn time_ns(&self, bits: FrameBits) -> u64 {
        bits.nominal * NS_PER_S / self.nominal_hz + bits.fast * NS_PER_S / self.data_hz
    }
}

/// Stuff count, CRC and fixed stuff bits of an FD frame.
fn crc_bits(length: usize) -> u64 {
    if length <= SHORT_CRC_LENGTH { SHORT_CRC_BITS } else { LONG_CRC_BITS }
}

/// Bits of a frame by the rate they are sent at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct FrameBits {
    nominal: u64,
    fast: u64,
}

impl FrameBits {
    fn of(frame: &Frame) -> Self {
        let flags = frame.flags();
        if flags.is_error {
            return Self::default();
        }
        let mut stream = Stream::default();
        put_arbitration(&mut stream, frame);
        if !flags.is_fd {
            put_data(&mut stream, frame);
            stream.put(stream.crc, 15);
            let stuff_after_crc = u64::from(stream.run == STUFF_RUN);
            let nominal = stream.count + stuff_after_crc + CRC_DELIMITER_BITS + TAIL_BITS;
            return Self { nominal, fast: 0 };
        }
        stream.put(u32::from(flags.brs), 1);
        let head = stream.count;
        stream.put(u32::from(flags.esi), 1);
        put_data(&mut stream, frame);
        // A fixed stuff bit follows the data, so a run that ends there needs no other.
        let crc = if frame.length() <= SHORT_CRC_LENGTH { SHORT_CRC_BITS } else { LONG_CRC_BITS };
        let rest = stream.count - head + crc + CRC_DELIMITER_BITS;
        if flags.brs {
            Self { nominal: head + TAIL_BITS, fast: rest }
        } else {
            Self { nominal: head + rest + TAIL_BITS, fast: 0 }
        }
    }
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
    stream.put(code, 4);
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
    use crate::frame::FrameFlags;

    const CLASSIC: FrameFlags = FrameFlags {
        is_extended: false,
        is_fd: false,
        brs: false,
        esi: false,
        is_rtr: false,
        is_error: false,
    };

    fn fd(length: usize, fill: u8) -> Frame {
        let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..CLASSIC };
        // An identifier that alternates enough to need no stuff bit.
        Frame::new(0x1555_5555, flags, &vec![fill; length]).expect("valid")
    }

    #[test]
    fn an_fd_frame_without_stuffing_has_the_bits_of_the_standard() {
        // 36 bits up to BRS and 12 after the CRC delimiter; ESI and DLC, data, CRC, delimiter.
        let expected = FrameBits { nominal: 48, fast: 5 + 256 + 32 + 1 };
        assert_eq!(FrameBits::of(&fd(32, 0x55)), expected);
        let expected = FrameBits { nominal: 48, fast: 5 + 128 + 27 + 1 };
        assert_eq!(FrameBits::of(&fd(16, 0x55)), expected);
        assert_eq!(BusTiming::default().frame_time_ns(&fd(32, 0x55)), 96_000 + 147_000);
    }

    #[test]
    fn no_frame_takes_longer_than_the_worst_case() {
        let timing = BusTiming::default();
        // 48 + 8 bits at 500 kbit/s and 294 + 66 bits at 2 Mbit/s.
        assert_eq!(timing.frame_time_ns_max(32), 112_000 + 180_000);
        for length in [0, 3, 8, 12, 16, 32, 64] {
            for fill in 0..=255 {
                let frame = fd(length, fill);
                assert!(timing.frame_time_ns(&frame) <= timing.frame_time_ns_max(length));
            }
        }
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
    fn classic_frames_stay_within_the_known_bounds() {
        // Eight bytes: 111 bits unstuffed with 11-bit identifiers and at most 135; 131 and 160
        // with 29 bits (Davis, Burns, Bril, Lukkien 2007).
        for fill in 0..=255 {
            for (extended, bounds) in [(false, 111..=135), (true, 131..=160)] {
                let flags = FrameFlags { is_extended: extended, ..CLASSIC };
                let frame = Frame::new(0x2AA, flags, &[fill; 8]).expect("valid");
                let bits = FrameBits::of(&frame).nominal;
                assert!(bounds.contains(&bits), "{fill:02X} {extended}: {bits}");
            }
        }
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
    fn the_traffic_of_one_truck_fits_at_1_khz_and_not_at_2_khz() {
        use crate::{Actuation, EcuStatus, EgoState, Mission, Obstacle, V2vOut, V2vState};
        let timing = BusTiming::default();
        let cost = |frame: Result<Frame, _>| timing.frame_time_ns(&frame.expect("in range"));
        let load_percent = |loop_hz: u64| {
            let looped = cost(EgoState::default().encode(1)) + cost(Actuation::default().encode(1));
            let radio = 2 * cost(V2vState::default().encode(1)) + cost(V2vOut::default().encode(1));
            let obstacles = 8 * cost(Obstacle::default().encode(1));
            let slow =
                10 * cost(EcuStatus::default().encode(1)) + cost(Mission::default().encode(1));
            let ns = looped * loop_hz + radio * 50 + obstacles * 20 + slow;
            ns as f64 * 100.0 / NS_PER_S as f64
        };
        assert!((50.0..65.0).contains(&load_percent(1000)));
        assert!(load_percent(2000) > 90.0);
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
