//! Vector's ASC log, as CANoe, CANalyzer and python-can read it. Channel i + 1 is truck i's bus.
//!
//! ```text
//!    0.001000 CANFD   1 Rx   18FF1080x                         EgoState 1 0 d 32 01 02 ...
//!    0.001000 1  0CF00400x       Rx   d 8 01 02 03 04 05 06 07 08
//! ```

use std::io::{self, Write};

use jiff::Timestamp;
use platoon_dbc::message_info;
use traces::FrameRecord;

/// Lengths that CAN FD can have, by their data length code [ISO 11898-1].
const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
/// Flags of a CAN FD line: format, bit rate switch, error state.
const FD_FLAG: u32 = 0x1000;
const BRS_FLAG: u32 = 0x2000;
const ESI_FLAG: u32 = 0x4000;

/// Writes what a log begins with; times are seconds since the start.
pub fn write_head(out: &mut impl Write, start_wall_ns: u64) -> io::Result<()> {
    let start = Timestamp::from_nanosecond(i128::from(start_wall_ns)).unwrap_or_default();
    let date = start.strftime("%a %b %d %I:%M:%S.%3f %p %Y").to_string().to_lowercase();
    let date = capitalised(&date);
    writeln!(out, "date {date}")?;
    writeln!(out, "base hex  timestamps absolute")?;
    writeln!(out, "internal events logged")?;
    writeln!(out, "Begin Triggerblock {date}")?;
    writeln!(out, "   0.000000 Start of measurement")
}

/// Day and month as ASC has them: `Tue Nov 14 10:13:20.000 pm 2023`.
fn capitalised(date: &str) -> String {
    let word = |word: &str| {
        let is_name = word.len() == 3 && word.bytes().all(|byte| byte.is_ascii_alphabetic());
        if is_name { word[..1].to_uppercase() + &word[1..] } else { word.to_owned() }
    };
    date.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

/// Writes what it ends with.
pub fn write_foot(out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "End TriggerBlock")
}

/// Writes one frame.
pub fn write(out: &mut impl Write, record: &FrameRecord) -> io::Result<()> {
    let (frame, flags) = (&record.frame, record.frame.flags());
    let (time_s, channel) = (record.time_ns as f64 * 1e-9, u32::from(record.bus) + 1);
    if flags.is_error {
        return writeln!(out, "{time_s:11.6} {channel}  ErrorFrame");
    }
    let direction = if record.tx { "Tx" } else { "Rx" };
    let id = format!("{:X}{}", frame.id(), if flags.is_extended { "x" } else { "" });
    if flags.is_fd {
        let name = message_info(frame.id()).map_or("", |info| info.name);
        let code = LENGTHS.iter().position(|length| *length == frame.length()).unwrap_or(0);
        let (brs, esi) = (u8::from(flags.brs), u8::from(flags.esi));
        write!(
            out,
            "{time_s:11.6} CANFD {channel:>3} {direction:<4} {id:>8}  {name:>32} {brs} {esi} \
             {code:x} {:>2}",
            frame.length()
        )?;
        write_bytes(out, frame.data())?;
        let bits = FD_FLAG + BRS_FLAG * u32::from(flags.brs) + ESI_FLAG * u32::from(flags.esi);
        return writeln!(
            out,
            " {:>8} {:>4} {bits:>8X} {:>8} {:>8} {:>8} {:>8} {:>8}",
            0, 0, 0, 0, 0, 0, 0
        );
    }
    write!(out, "{time_s:11.6} {channel}  {id:<15} {direction:<4} ")?;
    if flags.is_rtr {
        return writeln!(out, "r {:x}", frame.length());
    }
    write!(out, "d {:x}", frame.length())?;
    write_bytes(out, frame.data())?;
    writeln!(out)
}

fn write_bytes(out: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    bytes.iter().try_for_each(|byte| write!(out, " {byte:02X}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_date_is_written_as_vector_tools_write_it() {
        let mut out = Vec::new();
        write_head(&mut out, 1_700_000_000_000_000_000).expect("a vector takes it");
        let text = String::from_utf8(out).expect("ASCII");
        assert!(text.starts_with("date Tue Nov 14 10:13:20.000 pm 2023\n"), "{text}");
    }
}
