//! How a message is protected, and the one place that makes and checks every protection.

use crate::bits::Payload;
use crate::{checksum, e2e};

/// Protection of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protection {
    /// None, as for most parameter groups of J1939.
    None,
    /// AUTOSAR E2E Profile 5: see [`e2e`].
    E2eP05 {
        /// Data ID of the message, which is never sent.
        data_id: u16,
    },
    /// Counter and checksum of TSC1, SPN 4206 and 4207.
    Tsc1,
    /// Counter and checksum of XBR, SPN 3189 and 3188.
    Xbr,
    /// CRC-8/SAE-J1850 over the first seven bytes and the identifier, in the last byte.
    Crc8,
}

impl Protection {
    /// Writes the checksum into a payload whose counter is in place.
    pub(crate) fn seal(self, payload: &mut Payload, length: usize, id: u32) {
        match self {
            Self::None => {}
            Self::E2eP05 { data_id } => {
                let counter = payload[e2e::COUNTER_BYTE];
                e2e::protect(&mut payload[..length], data_id, counter);
            }
            Self::Tsc1 | Self::Xbr | Self::Crc8 => payload[7] = self.last_byte(payload, id),
        }
    }

    /// Whether the checksum of a payload is the right one.
    pub(crate) fn check(self, payload: &Payload, length: usize, id: u32) -> bool {
        match self {
            Self::None => true,
            Self::E2eP05 { data_id } => e2e::check(&payload[..length], data_id).is_some(),
            Self::Tsc1 | Self::Xbr | Self::Crc8 => payload[7] == self.last_byte(payload, id),
        }
    }

    /// The last byte of a classic frame as its protection wants it.
    fn last_byte(self, payload: &Payload, id: u32) -> u8 {
        let mut data = [0; 8];
        data.copy_from_slice(&payload[..8]);
        let counter = data[7] & 0x0F;
        match self {
            Self::Tsc1 => checksum::tsc1(&data, id) << 4 | counter,
            Self::Xbr => checksum::xbr(&data, id) << 4 | counter,
            Self::Crc8 => checksum::crc8(&data, id),
            Self::None | Self::E2eP05 { .. } => data[7],
        }
    }
}
