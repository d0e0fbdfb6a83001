//! A frame as levels on the wire, and back: ISO 11898-1:2015, section 10.4, taken literally.
//!
//! Written to be held against the counting in `bus_time`, with which it shares nothing: fields are
//! laid out first and stuffed afterwards, and checksums are remainders of a division of
//! polynomials when sending, and shift registers when receiving.

use platoon_dbc::{Frame, FrameFlags};

/// CRC-15: x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const CRC_15: (usize, u32) = (15, 0xC599);
/// CRC-17: x^17 + x^16 + x^14 + x^13 + x^11 + x^6 + x^4 + x^3 + x + 1.
const CRC_17: (usize, u32) = (17, 0x3_685B);
/// CRC-21: x^21 + x^20 + x^13 + x^11 + x^7 + x^4 + x^3 + 1.
const CRC_21: (usize, u32) = (21, 0x30_2899);

/// One bit: true is recessive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bit {
    pub(super) level: bool,
    /// Sent at the rate of the data phase.
    pub(super) is_fast: bool,
}

/// The frame as its sender puts it on the wire, from the start of frame to the intermission.
pub(super) fn lay_out(frame: &Frame) -> Vec<Bit> {
    let flags = frame.flags();
    let (head, data) = (head(frame), data(frame));
    let (mut levels, switch_at, crc_delimiter_at);
    if flags.is_fd {
        levels = stuffed(&[&head[..], &data].concat());
        // The position of the bit after BRS: that of the same prefix, stuffed alone.
        switch_at = if flags.brs { stuffed(&head).len() } else { usize::MAX };
        let stuff_bits = levels.len() - head.len() - data.len();
        // A run that ends with the data is broken by the fixed stuff bit.
        let checked = [levels.clone(), stuff_count(stuff_bits)].concat();
        let (crc, initial) =
            if frame.length() <= 16 { (CRC_17, 1 << 16) } else { (CRC_21, 1 << 20) };
        let tail = [stuff_count(stuff_bits), remainder(&checked, crc, initial)].concat();
        for nibble in tail.chunks(4) {
            levels.push(!levels.last().expect("not empty"));
            levels.extend(nibble);
        }
    } else {
        let plain = [head, data].concat();
        let crc = remainder(&plain, CRC_15, 0);
        levels = stuffed_to_the_end(&[plain, crc].concat());
        switch_at = usize::MAX;
    }
    crc_delimiter_at = levels.len();
    // CRC delimiter, acknowledged slot and its delimiter, end of frame, intermission.
    levels.extend([true, false, true]);
    levels.extend([true; 7 + 3]);
    let is_fast = |place| switch_at <= place && place <= crc_delimiter_at;
    levels.iter().enumerate().map(|(k, &level)| Bit { level, is_fast: is_fast(k) }).collect()
}

/// Start of frame to the last bit before the length code (classic), or to BRS (FD).
fn head(frame: &Frame) -> Vec<bool> {
    let flags = frame.flags();
    let id = frame.id();
    let mut bits = vec![false];
    if flags.is_extended {
        bits.extend(number(id >> 18, 11));
        bits.extend([true, true]); // SRR, IDE
        bits.extend(number(id & 0x3_FFFF, 18));
        bits.push(flags.is_rtr); // RTR, or RRS
    } else {
        bits.extend(number(id, 11));
        bits.extend([flags.is_rtr, false]); // RTR or RRS, IDE
    }
    match (flags.is_fd, flags.is_extended) {
        (true, _) => bits.extend([true, false, flags.brs]), // FDF, res, BRS
        (false, true) => bits.extend([false, false]),       // r1, r0
        (false, false) => bits.push(false),                 // r0
    }
    bits
}

/// ESI (FD), length code and data.
fn data(frame: &Frame) -> Vec<bool> {
    let mut bits = Vec::new();
    if frame.flags().is_fd {
        bits.push(frame.flags().esi);
    }
    let code = (0..16).find(|&code| length_of(code) == frame.length()).expect("a valid length");
    bits.extend(number(code, 4));
    bits.extend(frame.data().iter().flat_map(|&byte| number(u32::from(byte), 8)));
    bits
}

fn length_of(code: u32) -> usize {
    match code {
        0..=8 => code as usize,
        9..=12 => 4 * code as usize - 24,
        13..=15 => 16 * code as usize - 176,
        _ => unreachable!("four bits"),
    }
}

fn number(value: u32, size: u32) -> impl Iterator<Item = bool> {
    (0..size).rev().map(move |place| value >> place & 1 == 1)
}

/// With a bit of the other level after every five equal ones, also the stuffed ones.
fn stuffed_to_the_end(bits: &[bool]) -> Vec<bool> {
    let mut out: Vec<bool> = Vec::new();
    let mut stuff_ended = 0;
    for &bit in bits {
        out.push(bit);
        let last = out.len().saturating_sub(5).max(stuff_ended);
        if out.len() - last == 5 && out[last..].iter().all(|&level| level == bit) {
            out.push(!bit);
            // The stuffed bit itself counts for the next run.
            stuff_ended = out.len() - 1;
        }
    }
    out
}

/// As far as another bit follows: no bit is stuffed after the last one.
fn stuffed(bits: &[bool]) -> Vec<bool> {
    let mut out = stuffed_to_the_end(&bits[..bits.len() - 1]);
    out.extend(bits.last());
    out
}

/// The number of stuffed bits modulo 8 as a Gray code, with even parity.
fn stuff_count(stuff_bits: usize) -> Vec<bool> {
    const GRAY: [u32; 8] = [0b000, 0b001, 0b011, 0b010, 0b110, 0b111, 0b101, 0b100];
    let code = GRAY[stuff_bits % 8];
    number((code << 1) | (code.count_ones() % 2), 4).collect()
}

/// What is left of the bits, after `initial` has been added to their beginning and as many zeros
/// as the checksum has bits to their end, when they are divided by the polynomial.
fn remainder(bits: &[bool], (size, polynomial): (usize, u32), initial: u32) -> Vec<bool> {
    let mut left: Vec<bool> = bits.iter().copied().chain(vec![false; size]).collect();
    for (place, bit) in number(initial, size as u32).enumerate() {
        left[place] ^= bit;
    }
    for start in 0..bits.len() {
        if left[start] {
            for (place, bit) in number(polynomial, size as u32 + 1).enumerate() {
                left[start + place] ^= bit;
            }
        }
    }
    left.split_off(bits.len())
}

/// Why a receiver refuses what it hears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    Stuff,
    Form,
    Crc,
    Early,
}

/// The frame that a receiver makes of the levels.
pub(super) fn read(bits: &[Bit]) -> Result<Frame, Refusal> {
    let mut ear = Ear::new(bits);
    let (id, flags) = read_head(&mut ear)?;
    let code = ear.number(4)?;
    if flags.is_fd {
        let length = length_of(code);
        let data = read_data(&mut ear, length)?;
        ear.check_fd_crc(length)?;
        ear.check_tail()?;
        return Frame::new(id, flags, &data).map_err(|_| Refusal::Form);
    }
    let length = length_of(code.min(8));
    let data = if flags.is_rtr { Vec::new() } else { read_data(&mut ear, length)? };
    let expected = ear.registers[0].value;
    if ear.number(15)? != expected {
        return Err(Refusal::Crc);
    }
    ear.skip_stuff()?;
    ear.check_tail()?;
    if code > 8 {
        return Err(Refusal::Form);
    }
    if flags.is_rtr {
        return Frame::remote(id, flags.is_extended, length).map_err(|_| Refusal::Form);
    }
    Frame::new(id, flags, &data).map_err(|_| Refusal::Form)
}

fn read_head(ear: &mut Ear<'_>) -> Result<(u32, FrameFlags), Refusal> {
    let mut flags = FrameFlags::default();
    if ear.bit()? {
        return Err(Refusal::Form);
    }
    let mut id = ear.number(11)?;
    let mut request = ear.bit()?;
    flags.is_extended = ear.bit()?;
    if flags.is_extended {
        if !request {
            return Err(Refusal::Form); // SRR is recessive
        }
        id = id << 18 | ear.number(18)?;
        request = ear.bit()?;
    }
    flags.is_fd = ear.bit()?;
    if flags.is_fd {
        let reserved = ear.bit()?;
        if request || reserved {
            return Err(Refusal::Form);
        }
        flags.brs = ear.bit()?;
        flags.esi = ear.bit()?;
    } else {
        flags.is_rtr = request;
        if flags.is_extended && ear.bit()? {
            return Err(Refusal::Form); // r0, sent dominant by everybody
        }
    }
    Ok((id, flags))
}

fn read_data(ear: &mut Ear<'_>, length: usize) -> Result<Vec<u8>, Refusal> {
    (0..length).map(|_| ear.number(8).map(|byte| byte as u8)).collect()
}

/// A checksum as the receiver runs it: a shift register with feedback.
struct Register {
    value: u32,
    size: usize,
    polynomial: u32,
}

impl Register {
    fn new((size, polynomial): (usize, u32), value: u32) -> Self {
        Self { value, size, polynomial }
    }

    fn shift(&mut self, bit: bool) {
        let out = self.value >> (self.size - 1) & 1 == 1;
        self.value = self.value << 1 & ((1 << self.size) - 1);
        if out != bit {
            self.value ^= self.polynomial & ((1 << self.size) - 1);
        }
    }
}

/// Hears bit by bit and drops what was stuffed.
struct Ear<'a> {
    bits: std::slice::Iter<'a, Bit>,
    last: bool,
    run: u32,
    stuff_bits: usize,
    /// CRC-15 over the bits meant, CRC-17 and CRC-21 over all bits heard.
    registers: [Register; 3],
}

impl<'a> Ear<'a> {
    fn new(bits: &'a [Bit]) -> Self {
        let registers = [
            Register::new(CRC_15, 0),
            Register::new(CRC_17, 1 << 16),
            Register::new(CRC_21, 1 << 20),
        ];
        Self { bits: bits.iter(), last: true, run: 0, stuff_bits: 0, registers }
    }

    fn raw(&mut self) -> Result<bool, Refusal> {
        self.bits.next().map(|bit| bit.level).ok_or(Refusal::Early)
    }

    /// The next bit that was meant.
    fn bit(&mut self) -> Result<bool, Refusal> {
        self.skip_stuff()?;
        let bit = self.raw()?;
        self.run = if bit == self.last { self.run + 1 } else { 1 };
        self.last = bit;
        self.registers.iter_mut().for_each(|register| register.shift(bit));
        Ok(bit)
    }

    fn number(&mut self, size: u32) -> Result<u32, Refusal> {
        (0..size).try_fold(0, |value, _| Ok(value << 1 | u32::from(self.bit()?)))
    }

    /// Drops the bit after five equal ones, if that is where we are.
    fn skip_stuff(&mut self) -> Result<(), Refusal> {
        if self.run < 5 {
            return Ok(());
        }
        let bit = self.raw()?;
        if bit == self.last {
            return Err(Refusal::Stuff);
        }
        (self.last, self.run) = (bit, 1);
        self.stuff_bits += 1;
        self.registers[1..].iter_mut().for_each(|register| register.shift(bit));
        Ok(())
    }

    /// Stuff count and checksum of an FD frame with its fixed stuff bits.
    fn check_fd_crc(&mut self, length: usize) -> Result<(), Refusal> {
        let short = length <= 16;
        let size = if short { 17 } else { 21 };
        let mut field = Vec::new();
        for place in 0..4 + size {
            if place % 4 == 0 {
                let fixed = self.raw()?;
                if fixed == self.last {
                    return Err(Refusal::Stuff);
                }
                self.last = fixed;
            }
            self.last = self.raw()?;
            field.push(self.last);
            if place < 4 {
                self.registers[1..].iter_mut().for_each(|register| register.shift(self.last));
            }
        }
        let value = |bits: &[bool]| bits.iter().fold(0, |all, &bit| all << 1 | u32::from(bit));
        let gray = value(&field[..3]);
        let count = gray ^ gray >> 1 ^ gray >> 2;
        let parity_is_even = field[..4].iter().filter(|&&bit| bit).count() % 2 == 0;
        if !parity_is_even || count as usize != self.stuff_bits % 8 {
            return Err(Refusal::Crc);
        }
        let expected = self.registers[if short { 1 } else { 2 }].value;
        if value(&field[4..]) == expected { Ok(()) } else { Err(Refusal::Crc) }
    }

    /// CRC delimiter, acknowledgement, end of frame, intermission, and nothing more.
    fn check_tail(&mut self) -> Result<(), Refusal> {
        let expected = [[true, false, true].as_slice(), &[true; 10]].concat();
        let heard: Vec<bool> = self.bits.by_ref().map(|bit| bit.level).collect();
        if heard == expected { Ok(()) } else { Err(Refusal::Form) }
    }
}

#[test]
fn the_checksums_are_those_of_can() {
    // Check values of "123456789" from the catalogue of Greg Cook, there with a register of zeros.
    let digits: Vec<bool> = b"123456789".iter().flat_map(|&byte| number(byte.into(), 8)).collect();
    for (crc, check) in [(CRC_15, 0x059E), (CRC_17, 0x0_4F03), (CRC_21, 0x0E_D841)] {
        let divided = remainder(&digits, crc, 0);
        assert_eq!(divided, number(check, crc.0 as u32).collect::<Vec<_>>());
        let mut register = Register::new(crc, 0);
        digits.iter().for_each(|&bit| register.shift(bit));
        assert_eq!(register.value, check);
    }
}
