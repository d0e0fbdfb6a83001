//! End-to-end protection: AUTOSAR E2E Profile 5, and the supervision of its counter.
//!
//! After "Specification of E2E Protocol Protocol" (AUTOSAR FO PRS_E2EProtocol), Profile 5 with
//! offset 0: bytes 0 and 1 hold the CRC, low byte first; byte 2 holds the alive counter. The CRC
//! is CRC-16 with polynomial 0x1021 and start value 0xFFFF (CRC-16/IBM-3740, also called
//! CCITT-FALSE) over the data from byte 2 on and then over the message's Data ID, low byte first.
//! The Data ID is never sent: a frame that takes another message's place fails its CRC.

use crc::{CRC_16_IBM_3740, Crc, Table};
use serde::{Deserialize, Serialize};

/// Bytes taken by the protection at the start of the payload.
pub const HEADER_LENGTH: usize = 3;
/// Where the alive counter lies.
pub(crate) const COUNTER_BYTE: usize = 2;

/// Sixteen bytes per step: a 64-byte frame costs tens of nanoseconds.
static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_IBM_3740);

/// Writes counter and CRC into a payload of at least [`HEADER_LENGTH`] bytes.
///
/// # Panics
/// If `data` is shorter than [`HEADER_LENGTH`].
pub fn protect(data: &mut [u8], data_id: u16, counter: u8) {
    assert!(data.len() >= HEADER_LENGTH, "a protected payload holds its header");
    data[COUNTER_BYTE] = counter;
    let crc = checksum(data, data_id);
    data[..COUNTER_BYTE].copy_from_slice(&crc.to_le_bytes());
}

/// The counter of an undamaged payload; `None` when the CRC does not match.
pub fn check(data: &[u8], data_id: u16) -> Option<u8> {
    let (received, rest) = data.split_first_chunk::<COUNTER_BYTE>()?;
    let counter = *rest.first()?;
    (u16::from_le_bytes(*received) == checksum(data, data_id)).then_some(counter)
}

fn checksum(data: &[u8], data_id: u16) -> u16 {
    let mut digest = CRC.digest();
    digest.update(&data[COUNTER_BYTE..]);
    digest.update(&data_id.to_le_bytes());
    digest.finalize()
}

/// What a counter says about the frames before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The first frame seen.
    First,
    /// The next one in order.
    Ok,
    /// The same counter again: a repetition, or a sender that hangs.
    Repeated,
    /// This many frames are missing. A late frame looks like 254 missing ones.
    Lost(u8),
}

/// Watches the alive counter of one message from one sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Supervisor {
    last: Option<u8>,
    counts: SupervisorCounts,
}

/// Totals of a [`Supervisor`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SupervisorCounts {
    /// Frames judged, whatever the judgement.
    pub seen: u64,
    /// Frames that repeated the counter before them.
    pub repeated: u64,
    /// Frames missing in total.
    pub lost: u64,
}

impl Supervisor {
    /// A supervisor that has seen nothing.
    pub const fn new() -> Self {
        let counts = SupervisorCounts { seen: 0, repeated: 0, lost: 0 };
        Self { last: None, counts }
    }

    /// Judges the counter of a frame that passed its CRC.
    pub fn see(&mut self, counter: u8) -> Continuity {
        self.see_up_to(counter, u8::MAX)
    }

    /// Judges a counter that wraps from `counter_max`, one less than a power of two, to 0.
    pub fn see_up_to(&mut self, counter: u8, counter_max: u8) -> Continuity {
        let continuity = match self.last.replace(counter) {
            None => Continuity::First,
            Some(last) => match counter.wrapping_sub(last) & counter_max {
                0 => Continuity::Repeated,
                1 => Continuity::Ok,
                step => Continuity::Lost(step - 1),
            },
        };
        self.counts.seen += 1;
        match continuity {
            Continuity::Repeated => self.counts.repeated += 1,
            Continuity::Lost(missing) => self.counts.lost += u64::from(missing),
            Continuity::First | Continuity::Ok => {}
        }
        continuity
    }

    /// Totals so far.
    pub const fn counts(&self) -> SupervisorCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_specification_example_gives_its_crc() {
        let mut data = [0; 8];
        protect(&mut data, 0x1234, 0);
        assert_eq!(data, [0x1C, 0xCA, 0, 0, 0, 0, 0, 0]);
        assert_eq!(check(&data, 0x1234), Some(0));
    }

    #[test]
    fn any_single_bit_error_is_found() {
        let mut data = [0x5A; 64];
        protect(&mut data, 0xFF10, 200);
        for bit in 0..512 {
            let mut damaged = data;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(check(&damaged, 0xFF10), None, "bit {bit}");
        }
    }

    #[test]
    fn a_frame_in_another_messages_place_is_found() {
        let mut data = [0; 16];
        protect(&mut data, 0xFF11, 3);
        assert_eq!(check(&data, 0xFF16), None);
    }

    #[test]
    fn a_payload_without_room_for_the_header_is_refused() {
        for length in 0..HEADER_LENGTH {
            assert_eq!(check(&[0xFF; HEADER_LENGTH][..length], 0), None);
        }
    }

    #[test]
    fn the_supervisor_counts_across_the_wrap() {
        let mut supervisor = Supervisor::new();
        let seen = [254, 255, 0, 0, 3].map(|counter| supervisor.see(counter));
        use Continuity::{First, Lost, Ok, Repeated};
        assert_eq!(seen, [First, Ok, Ok, Repeated, Lost(2)]);
        let counts = supervisor.counts();
        assert_eq!((counts.seen, counts.repeated, counts.lost), (5, 1, 2));
    }

    #[test]
    fn a_short_counter_wraps_at_its_own_end() {
        let mut supervisor = Supervisor::new();
        let seen = [6, 7, 0, 0, 7].map(|counter| supervisor.see_up_to(counter, 7));
        use Continuity::{First, Lost, Ok, Repeated};
        assert_eq!(seen, [First, Ok, Ok, Repeated, Lost(6)]);
    }
}
