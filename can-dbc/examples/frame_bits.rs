//! Tells how many bits a frame has, one frame and one answer per line, so that other tools' counts
//! can be held against ours.
//!
//! ```text
//! 123#112233          -> 72 0
//! 18FF112A##5001122   -> 50 59
//! ```
//!
//! Frames are written as candump writes them (`ID#DATA`, `ID#R` and a length, `ID##` and a digit
//! of flags and DATA; three digits of identifier or eight); the answer is the number of bits at
//! the rate of arbitration and at that of the data phase. `tests/interop` drives it.

use platoon_dbc::bus_time::FrameBits;
use platoon_dbc::{Frame, FrameFlags};
use std::io::{BufRead, Write as _};

/// Flags of an FD frame as candump writes them.
const BRS: u32 = 0x1;
const ESI: u32 = 0x2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let frame = parse(line.trim()).map_err(|why| format!("{line}: {why}"))?;
        let bits = FrameBits::of(&frame);
        writeln!(out, "{} {}", bits.nominal, bits.fast)?;
    }
    Ok(())
}

fn parse(text: &str) -> Result<Frame, Box<dyn std::error::Error>> {
    let (id, rest) = text.split_once('#').ok_or("no # in it")?;
    let flags = FrameFlags { is_extended: id.len() == 8, ..FrameFlags::default() };
    let id = u32::from_str_radix(id, 16)?;
    if let Some(length) = rest.strip_prefix('R') {
        let length = if length.is_empty() { 0 } else { length.parse()? };
        return Ok(Frame::remote(id, flags.is_extended, length)?);
    }
    let Some(fd) = rest.strip_prefix('#') else {
        return Ok(Frame::new(id, flags, &bytes(rest)?)?);
    };
    let (digit, data) = fd.split_at_checked(1).ok_or("no flags")?;
    let digit = u32::from_str_radix(digit, 16)?;
    let flags = FrameFlags { is_fd: true, brs: digit & BRS != 0, esi: digit & ESI != 0, ..flags };
    Ok(Frame::new(id, flags, &bytes(data)?)?)
}

fn bytes(text: &str) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    (0..text.len())
        .step_by(2)
        .map(|at| Ok(u8::from_str_radix(text.get(at..at + 2).ok_or("half a byte")?, 16)?))
        .collect()
}
