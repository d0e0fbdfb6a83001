//! The log format of can-utils' `candump -l`, which canplayer, python-can and SavvyCAN read.
//!
//! ```text
//! (1700000000.001000) truck0 18FF1080##1A0B1C2...   CAN FD: a digit of flags, 1 BRS, 2 ESI
//! (1700000000.001000) truck0 0CF00400#A0B1C2        classic
//! (1700000000.001000) truck0 0CF00400#R3            remote request
//! ```

use std::io::{self, Write};

use traces::FrameRecord;

/// Bit of the identifier by which SocketCAN tells an error frame.
const ERROR_FLAG: u32 = 0x2000_0000;

/// Writes one line.
pub fn write(
    out: &mut impl Write,
    wall_ns: u64,
    interface: &str,
    record: &FrameRecord,
) -> io::Result<()> {
    let (seconds, micros) = (wall_ns / 1_000_000_000, wall_ns / 1_000 % 1_000_000);
    let (frame, flags) = (&record.frame, record.frame.flags());
    write!(out, "({seconds:010}.{micros:06}) {interface} ")?;
    match (flags.is_error, flags.is_extended) {
        (true, _) => write!(out, "{:08X}#", frame.id() | ERROR_FLAG)?,
        (false, true) => write!(out, "{:08X}#", frame.id())?,
        (false, false) => write!(out, "{:03X}#", frame.id())?,
    }
    if flags.is_rtr {
        return writeln!(out, "R{}", frame.length());
    }
    if flags.is_fd {
        write!(out, "#{:X}", u8::from(flags.brs) | u8::from(flags.esi) << 1)?;
    }
    for byte in frame.data() {
        write!(out, "{byte:02X}")?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use platoon_dbc::{Frame, FrameFlags};

    use super::*;

    fn line(frame: Frame) -> String {
        let record = FrameRecord { bus: 3, time_ns: 0, stamp_ns: 0, tick: 0, tx: false, frame };
        let mut out = Vec::new();
        write(&mut out, 1_700_000_000_001_002_999, "truck3", &record).expect("a vector takes it");
        String::from_utf8(out).expect("ASCII")
    }

    #[test]
    fn every_kind_of_frame_is_written_as_candump_does() {
        let classic = FrameFlags::default();
        let extended = FrameFlags { is_extended: true, ..classic };
        let fd = FrameFlags { is_fd: true, brs: true, ..extended };
        let error = FrameFlags { is_error: true, ..classic };
        let new = |id, flags, data: &[u8]| line(Frame::new(id, flags, data).expect("valid"));
        let at = "(1700000000.001002) truck3 ";
        assert_eq!(new(0x12, classic, &[1, 0xAB]), format!("{at}012#01AB\n"));
        assert_eq!(new(0x18FF_1080, extended, &[]), format!("{at}18FF1080#\n"));
        assert_eq!(new(0x18FF_1080, fd, &[7; 12]), format!("{at}18FF1080##1{}\n", "07".repeat(12)));
        assert_eq!(new(4, error, &[0; 8]), format!("{at}20000004#0000000000000000\n"));
        let remote = Frame::remote(0x123, false, 5).expect("valid");
        assert_eq!(line(remote), format!("{at}123#R5\n"));
    }
}
