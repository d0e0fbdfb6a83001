//! A CAN frame as a bus tap or an ECU saw it, and its ROS 2 form.
//!
//! The message has the fields of ros2_socketcan's `FdFrame`, then those it lacks. `header.stamp`
//! is the kernel's receive stamp when there is one, else the message's log time, and
//! `header.frame_id` names the bus. It is the one place of that stamp: its nanoseconds are noise
//! that does not compress, and a second copy as the message's publish time would cost 3 MB a run.

use platoon_dbc::{Frame, FrameFlags};

use crate::cdr;
use crate::wire::DecodeError;

/// The `ros2msg` schema of `platoon_msgs/msg/CanFrame`.
pub(crate) const CAN_FRAME_DEFINITION: &str = "\
# A CAN or CAN FD frame, as ros2_socketcan_msgs/msg/FdFrame has it, and what that leaves out.
std_msgs/Header header  # stamp: kernel receive time, else log time; frame_id: the bus
uint32 id               # 11 or 29 bits, without flags
bool is_extended        # 29-bit identifier
bool is_error           # error frame: id holds the error class
uint8 len               # bytes of data, or those a remote request asks for
uint8[<=64] data
bool is_fd              # CAN FD format
bool brs                # bit rate switch
bool esi                # error state indicator
bool is_rtr             # remote request
bool tx                 # sent by the recording node
uint32 tick             # tick of the recording node
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

const SECOND_NS: u64 = 1_000_000_000;
/// Where `header.stamp` is in the CDR message: first behind the encapsulation header.
const STAMP: std::ops::Range<usize> = 4..12;

/// A frame on a bus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRecord {
    /// Bus it was on; bus i is truck i's.
    pub bus: u8,
    /// Bench time at which the recording node handled it \[ns\].
    pub time_ns: u64,
    /// The kernel's stamp (`CLOCK_REALTIME`) \[ns\]; 0 when there is none.
    pub stamp_ns: u64,
    /// Tick of the recording node that it belongs to.
    pub tick: u32,
    /// Whether the recording node sent it.
    pub tx: bool,
    /// The frame.
    pub frame: Frame,
}

impl FrameRecord {
    /// Appends the CDR message. `log_time_ns` stands in where there is no kernel stamp.
    pub(crate) fn encode(&self, log_time_ns: u64, out: &mut Vec<u8>) {
        let stamp_ns = if self.stamp_ns == 0 { log_time_ns } else { self.stamp_ns };
        let (frame, flags) = (&self.frame, self.frame.flags());
        let mut cdr = cdr::Writer::new(out);
        cdr.i32(seconds(stamp_ns));
        cdr.u32((stamp_ns % SECOND_NS) as u32);
        cdr.string(bus_name(self.bus, &mut [0; 6]));
        cdr.u32(frame.id());
        cdr.bool(flags.is_extended);
        cdr.bool(flags.is_error);
        cdr.u8(frame.length() as u8);
        cdr.bytes(frame.data());
        cdr.bool(flags.is_fd);
        cdr.bool(flags.brs);
        cdr.bool(flags.esi);
        cdr.bool(flags.is_rtr);
        cdr.bool(self.tx);
        cdr.u32(self.tick);
    }

    /// The record of a CDR message that was logged at `log_time_ns`; `start_wall_ns` is the log
    /// time of bench time 0.
    pub(crate) fn decode(
        bytes: &[u8],
        log_time_ns: u64,
        start_wall_ns: u64,
    ) -> Result<Self, DecodeError> {
        let mut cdr = cdr::Reader::new(bytes)?;
        let sec = u64::try_from(cdr.i32()?).map_err(|_| DecodeError::OutOfRange)?;
        let stamp_ns = sec * SECOND_NS + u64::from(cdr.u32()?);
        let bus = cdr.string()?.strip_prefix("bus").and_then(|bus| bus.parse().ok());
        let id = cdr.u32()?;
        let (is_extended, is_error) = (cdr.bool()?, cdr.bool()?);
        let len = usize::from(cdr.u8()?);
        let data = cdr.bytes()?;
        let (is_fd, brs, esi) = (cdr.bool()?, cdr.bool()?, cdr.bool()?);
        let (is_rtr, tx) = (cdr.bool()?, cdr.bool()?);
        let tick = cdr.u32()?;
        let flags = FrameFlags { is_extended, is_fd, brs, esi, is_rtr, is_error };
        let frame = match is_rtr {
            true if data.is_empty() => Frame::remote(id, is_extended, len),
            false if data.len() == len => Frame::new(id, flags, data),
            _ => return Err(DecodeError::NotCdr),
        };
        let frame = frame.map_err(|_| DecodeError::OutOfRange)?;
        Ok(Self {
            bus: bus.ok_or(DecodeError::NotCdr)?,
            time_ns: log_time_ns.saturating_sub(start_wall_ns),
            stamp_ns: if stamp_ns == log_time_ns { 0 } else { stamp_ns },
            tick,
            tx,
            frame,
        })
    }
}

/// An encoded record for another log time; none when its stamp is the kernel's, so that it stays.
pub(crate) fn restamped(bytes: &[u8], log_time_ns: u64, other_ns: u64) -> Option<Vec<u8>> {
    let stamp = bytes.get(STAMP)?;
    (stamp == encoded_stamp(log_time_ns)).then(|| {
        let mut bytes = bytes.to_vec();
        bytes[STAMP].copy_from_slice(&encoded_stamp(other_ns));
        bytes
    })
}

/// `header.stamp`: seconds, then nanoseconds.
fn encoded_stamp(stamp_ns: u64) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&seconds(stamp_ns).to_le_bytes());
    bytes[4..].copy_from_slice(&((stamp_ns % SECOND_NS) as u32).to_le_bytes());
    bytes
}

fn seconds(stamp_ns: u64) -> i32 {
    i32::try_from(stamp_ns / SECOND_NS).unwrap_or(i32::MAX)
}

/// `bus<i>`, without allocating.
fn bus_name(bus: u8, text: &mut [u8; 6]) -> &str {
    let mut len = 3;
    text[..3].copy_from_slice(b"bus");
    for power in [100, 10, 1] {
        if bus >= power || power == 1 {
            text[len] = b'0' + bus / power % 10;
            len += 1;
        }
    }
    core::str::from_utf8(&text[..len]).expect("letters and digits are ASCII")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(record: FrameRecord) -> FrameRecord {
        let start = 1_700_000_000 * SECOND_NS;
        let log = start + record.time_ns;
        let mut bytes = Vec::new();
        record.encode(log, &mut bytes);
        FrameRecord::decode(&bytes, log, start).expect("decodes")
    }

    fn record(frame: Frame) -> FrameRecord {
        FrameRecord { bus: 203, time_ns: 5_000_001, stamp_ns: 77, tick: 5, tx: true, frame }
    }

    #[test]
    fn another_log_time_is_what_encoding_for_it_gives() {
        let frame = Frame::new(0x123, FrameFlags::default(), &[1, 2]).expect("valid");
        for stamp_ns in [0, 77] {
            let record = FrameRecord { stamp_ns, ..record(frame) };
            let (log_time_ns, other_ns) = (5 * SECOND_NS + 1, 7 * SECOND_NS - 1);
            let encoded = |log_time_ns| {
                let mut bytes = Vec::new();
                record.encode(log_time_ns, &mut bytes);
                bytes
            };
            let other = restamped(&encoded(log_time_ns), log_time_ns, other_ns);
            assert_eq!(other, (stamp_ns == 0).then(|| encoded(other_ns)));
        }
        assert_eq!(restamped(&[0; 9], 0, 1), None, "too short to have a stamp");
    }

    #[test]
    fn frames_of_every_kind_survive_encoding() {
        let classic = FrameFlags::default();
        let fd = FrameFlags { is_fd: true, is_extended: true, brs: true, esi: true, ..classic };
        let error = FrameFlags { is_error: true, ..classic };
        for frame in [
            Frame::new(0x7ff, classic, &[1, 2, 3]).expect("valid"),
            Frame::new(0x18ff_1080, fd, &[9; 64]).expect("valid"),
            Frame::new(0x4, error, &[0; 8]).expect("valid"),
            Frame::remote(0x123, false, 5).expect("valid"),
        ] {
            assert_eq!(round_trip(record(frame)), record(frame));
        }
    }

    #[test]
    fn a_frame_without_kernel_stamp_stays_without() {
        let frame = Frame::new(1, FrameFlags::default(), &[]).expect("valid");
        let unstamped = FrameRecord { stamp_ns: 0, ..record(frame) };
        assert_eq!(round_trip(unstamped), unstamped);
    }

    #[test]
    fn bus_names_have_no_leading_zeros() {
        for bus in [0, 9, 10, 99, 100, 205, 255] {
            assert_eq!(bus_name(bus, &mut [0; 6]), format!("bus{bus}"));
        }
    }
}
