//! Lines of `candump -l`; `src/export/candump.rs` shows them.

use platoon_dbc::{Frame, FrameFlags};

use super::{Line, Logged};

/// Bits of an eight-digit identifier beyond those of the frame: an error frame's mark.
const ERROR_FLAG: u32 = 0x2000_0000;

/// Reads a line.
pub fn line(text: &str) -> Line {
    if text.trim().is_empty() {
        return Line::Other;
    }
    read(text).map_or(Line::Faulty, Line::Frame)
}

fn read(text: &str) -> Option<Logged> {
    let mut words = text.split_whitespace();
    let time = words.next()?.strip_prefix('(')?.strip_suffix(')')?;
    let interface = words.next()?.to_owned();
    let (id, rest) = words.next()?.split_once('#')?;
    Some(Logged { time_ns: nanoseconds(time)?, interface, frame: frame(id, rest)? })
}

/// Seconds with a decimal point, exactly: a double holds no nanoseconds since 1970.
pub fn nanoseconds(text: &str) -> Option<u64> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = fraction.get(..fraction.len().min(9))?;
    let nanos: u64 = format!("{digits:0<9}").parse().ok()?;
    seconds.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(nanos)
}

fn frame(id_text: &str, rest: &str) -> Option<Frame> {
    let id = u32::from_str_radix(id_text, 16).ok()?;
    let is_error = id_text.len() == 8 && id & ERROR_FLAG != 0;
    let is_extended = id_text.len() == 8 && !is_error;
    let id = if is_error { id & !ERROR_FLAG } else { id };
    if let Some(length) = rest.strip_prefix('R') {
        let length = if length.is_empty() { 0 } else { length.parse().ok()? };
        return Frame::remote(id, is_extended, length).ok();
    }
    let flags = FrameFlags { is_extended, is_error, ..FrameFlags::default() };
    let (flags, digits) = match rest.strip_prefix('#') {
        Some(fd) => {
            let bits = u8::from_str_radix(fd.get(..1)?, 16).ok()?;
            let (brs, esi) = (bits & 1 != 0, bits & 2 != 0);
            (FrameFlags { is_fd: true, brs, esi, ..flags }, fd.get(1..)?)
        }
        None => (flags, rest),
    };
    let bytes = digits.as_bytes().chunks(2).map(|pair| {
        u8::from_str_radix(std::str::from_utf8(pair).ok().filter(|pair| pair.len() == 2)?, 16).ok()
    });
    Frame::new(id, flags, &bytes.collect::<Option<Vec<u8>>>()?).ok()
}

#[cfg(test)]
mod tests {
    use traces::FrameRecord;

    use super::*;

    #[test]
    fn what_is_exported_is_imported_as_it_was() {
        let classic = FrameFlags::default();
        let extended = FrameFlags { is_extended: true, ..classic };
        let fd = FrameFlags { is_fd: true, brs: true, esi: true, ..extended };
        let error = FrameFlags { is_error: true, ..classic };
        for frame in [
            Frame::new(0x7ff, classic, &[1, 2, 3]).expect("valid"),
            Frame::new(0x18ff_1080, extended, &[]).expect("valid"),
            Frame::new(0x18ff_1080, fd, &[9; 64]).expect("valid"),
            Frame::new(0x4, error, &[0; 8]).expect("valid"),
            Frame::remote(0x123, false, 5).expect("valid"),
        ] {
            let record = FrameRecord { bus: 0, time_ns: 0, stamp_ns: 0, tick: 0, tx: true, frame };
            let mut text = Vec::new();
            crate::export::candump::write(&mut text, 1_700_000_000_123_456_000, "can7", &record)
                .expect("a vector takes it");
            let text = String::from_utf8(text).expect("ASCII");
            let (time_ns, interface) = (1_700_000_000_123_456_000, "can7".to_owned());
            assert_eq!(line(text.trim_end()), Line::Frame(Logged { time_ns, interface, frame }));
        }
    }

    #[test]
    fn nonsense_is_a_faulty_line() {
        for text in
            ["can0 123#", "(1.0) can0 123", "(x) can0 123#00", "(1.0) can0 123#0", "(1.0) can0 é#"]
        {
            assert_eq!(line(text), Line::Faulty, "{text}");
        }
        assert_eq!(line("  "), Line::Other);
    }
}
