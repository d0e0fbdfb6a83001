//! Lines of Vector's ASC log; `src/export/asc.rs` shows them.

use platoon_dbc::{Frame, FrameFlags};

use super::candump::nanoseconds;
use super::{Line, Logged};

/// What the log's head said, and where its clock stands.
#[derive(Debug, Default)]
pub struct Head {
    is_decimal: bool,
    is_relative: bool,
    newest_ns: u64,
}

impl Head {
    /// Reads a line. Everything but frames belongs there, too: events, statistics, comments.
    pub fn line(&mut self, text: &str) -> Line {
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.first() == Some(&"base") {
            self.is_decimal = words.get(1) == Some(&"dec");
            self.is_relative = words.contains(&"relative");
        }
        let Some(time_ns) = words.first().and_then(|word| nanoseconds(word)) else {
            return Line::Other;
        };
        let time_ns = if self.is_relative { self.newest_ns + time_ns } else { time_ns };
        self.newest_ns = time_ns;
        let read =
            if words.get(1) == Some(&"CANFD") { self.fd(&words) } else { self.classic(&words) };
        match read {
            Some((interface, frame)) => Line::Frame(Logged { time_ns, interface, frame }),
            None => Line::Other,
        }
    }

    fn number(&self, text: &str) -> Option<u32> {
        u32::from_str_radix(text, if self.is_decimal { 10 } else { 16 }).ok()
    }

    fn identifier(&self, text: &str) -> Option<(u32, bool)> {
        match text.strip_suffix('x') {
            Some(extended) => Some((self.number(extended)?, true)),
            None => Some((self.number(text)?, false)),
        }
    }

    /// `time CANFD channel direction id [name] brs esi code length data ...`
    fn fd(&self, words: &[&str]) -> Option<(String, Frame)> {
        let (id, is_extended) = self.identifier(words.get(4)?)?;
        // A name stands there only where the log's maker knew one.
        let has_name = !matches!(*words.get(5)?, "0" | "1") || words.get(6)?.len() != 1;
        let rest = words.get(if has_name { 6 } else { 5 }..)?;
        let (brs, esi) = (rest.first()? == &"1", rest.get(1)? == &"1");
        let length: usize = rest.get(3)?.parse().ok()?;
        let data = self.bytes(rest.get(4..4 + length)?)?;
        let flags = FrameFlags { is_extended, is_fd: true, brs, esi, ..FrameFlags::default() };
        Some((words.get(2)?.to_string(), Frame::new(id, flags, &data).ok()?))
    }

    /// `time channel id direction d length data ...`
    fn classic(&self, words: &[&str]) -> Option<(String, Frame)> {
        let channel = words.get(1)?.to_string();
        let (id, is_extended) = self.identifier(words.get(2)?)?;
        let length = words.get(5).map_or(Some(0), |text| usize::from_str_radix(text, 16).ok());
        let frame = match *words.get(4)? {
            "r" => Frame::remote(id, is_extended, length.unwrap_or(0)),
            "d" => {
                let data = self.bytes(words.get(6..6 + length?)?)?;
                Frame::new(id, FrameFlags { is_extended, ..FrameFlags::default() }, &data)
            }
            _ => return None,
        };
        Some((channel, frame.ok()?))
    }

    fn bytes(&self, words: &[&str]) -> Option<Vec<u8>> {
        words.iter().map(|word| u8::try_from(self.number(word)?).ok()).collect()
    }
}

#[cfg(test)]
mod tests {
    use traces::FrameRecord;

    use super::*;

    #[test]
    fn what_is_exported_is_imported_as_it_was() {
        let classic = FrameFlags::default();
        let extended = FrameFlags { is_extended: true, ..classic };
        let fd = FrameFlags { is_fd: true, brs: true, ..extended };
        for frame in [
            Frame::new(0x7ff, classic, &[1, 2, 3]).expect("valid"),
            Frame::new(0x18ff_1080, extended, &[]).expect("valid"),
            Frame::new(0x18ff_1080, fd, &[0x1a; 64]).expect("valid"),
            Frame::new(0x123, FrameFlags { is_fd: true, ..classic }, &[1; 12]).expect("valid"),
            Frame::remote(0x123, false, 5).expect("valid"),
        ] {
            let time_ns = 12_345_678_000;
            let record = FrameRecord { bus: 1, time_ns, stamp_ns: 0, tick: 0, tx: true, frame };
            let mut text = Vec::new();
            crate::export::asc::write(&mut text, &record).expect("a vector takes it");
            let text = String::from_utf8(text).expect("ASCII");
            let expected = Logged { time_ns, interface: "2".to_owned(), frame };
            assert_eq!(Head::default().line(text.trim_end()), Line::Frame(expected), "{text}");
        }
    }

    #[test]
    fn what_is_no_frame_is_passed_over() {
        let mut head = Head::default();
        for text in [
            "date Tue Nov 14 10:13:20.000 pm 2023",
            "base dec  timestamps relative",
            "   0.000000 Start of measurement",
            "   0.001000 1  ErrorFrame",
            "   0.001000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
            "// a comment",
        ] {
            assert_eq!(head.line(text), Line::Other, "{text}");
        }
        assert!(head.is_decimal && head.is_relative);
    }
}
