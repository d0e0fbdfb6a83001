//! The checksums of classic frames: those of J1939 for TSC1 and XBR, and a CRC-8.
//!
//! J1939 protects TSC1 (SPN 4206 and 4207) and XBR (SPN 3189 and 3188) in their last byte: the
//! counter in its low half, and in its high half what is folded from a sum over the first seven
//! bytes, the counter and the four bytes of the identifier. Of the single bit errors in a TSC1 the
//! fold misses some: see `what_the_fold_of_tsc1_misses`.

use crc::{CRC_8_SAE_J1850, CRC_16_IBM_3740, Crc, Table};

/// Bytes of a classic frame that its checksum covers; the last one holds it.
const COVERED: usize = 7;

static CRC8: Crc<u8, Table<16>> = Crc::<u8, Table<16>>::new(&CRC_8_SAE_J1850);
static CRC16: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_IBM_3740);

/// SPN 4207, three bits, from the first seven bytes, the counter and the identifier.
pub(crate) fn tsc1(data: &[u8; 8], id: u32) -> u8 {
    let sum = sum(data, id);
    (((sum >> 6 & 3) + (sum >> 3) + sum) & 7) as u8
}

/// SPN 3188, four bits, from the first seven bytes, the counter and the identifier.
pub(crate) fn xbr(data: &[u8; 8], id: u32) -> u8 {
    let sum = sum(data, id);
    (((sum >> 4) + sum) & 15) as u8
}

/// CRC-8/SAE-J1850 over the first seven bytes and then the identifier, low byte first.
pub(crate) fn crc8(data: &[u8; 8], id: u32) -> u8 {
    let mut digest = CRC8.digest();
    digest.update(&data[..COVERED]);
    digest.update(&id.to_le_bytes());
    digest.finalize()
}

/// CRC-8/SAE-J1850 over two frames' data: which torque and which brake request are one command.
pub(crate) fn command_digest(torque: &[u8; 8], brake: &[u8; 8]) -> u8 {
    let mut digest = CRC8.digest();
    digest.update(torque);
    digest.update(brake);
    digest.finalize()
}

/// CRC-16/IBM-3740 over a frame's data: which VDC2 belongs to a navigation solution.
pub(crate) fn motion_digest(motion: &[u8]) -> u16 {
    CRC16.checksum(motion)
}

fn sum(data: &[u8; 8], id: u32) -> u32 {
    let counter = data[COVERED] & 0x0F;
    let bytes = data[..COVERED].iter().copied().chain([counter]).chain(id.to_le_bytes());
    bytes.map(u32::from).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ID: u32 = 0x0C00_002A;

    /// The message with one bit of it changed: of the data but not of the checksum, or of the id.
    fn flipped(data: [u8; 8], bit: usize) -> ([u8; 8], u32) {
        let (mut data, mut id) = (data, ID);
        match bit {
            0..60 => data[bit / 8] ^= 1 << (bit % 8),
            _ => id ^= 1 << (bit - 60),
        }
        (data, id)
    }

    fn patterns() -> impl Iterator<Item = [u8; 8]> {
        // Knuth's MMIX generator; its high bytes are random enough here.
        let next = |word: &u64| Some(word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        std::iter::successors(Some(1_u64), next).map(|word| word.to_be_bytes()).take(5_000)
    }

    #[test]
    fn the_crcs_have_the_check_values_of_their_catalogue() {
        assert_eq!(CRC8.checksum(b"123456789"), 0x4B);
        assert_eq!(motion_digest(b"123456789"), 0x29B1);
    }

    #[test]
    fn any_single_bit_error_changes_the_crc_and_the_checksum_of_xbr() {
        for data in patterns() {
            for bit in 0..60 + 29 {
                let (changed, id) = flipped(data, bit);
                if !(56..60).contains(&bit) {
                    assert_ne!(crc8(&changed, id), crc8(&data, ID), "{data:02X?} bit {bit}");
                }
                assert_ne!(xbr(&changed, id), xbr(&data, ID), "{data:02X?} bit {bit}");
            }
        }
    }

    /// A second bit of a byte, where its change carries the sum over a multiple of 256: then the
    /// three terms of the fold change by 2 + 1 - 3 = 0.
    #[test]
    fn what_the_fold_of_tsc1_misses() {
        let mut missed = 0;
        for data in patterns() {
            for bit in 0..60 + 29 {
                let (changed, id) = flipped(data, bit);
                if tsc1(&changed, id) == tsc1(&data, ID) {
                    let place = if bit < 60 { bit % 8 } else { (bit - 60) % 8 };
                    let carries = sum(&changed, id) >> 8 != sum(&data, ID) >> 8;
                    assert!(place == 1 && carries, "{data:02X?} bit {bit}");
                    missed += 1;
                }
            }
        }
        assert!(missed > 0, "the standard's formula is better than its name");
    }
}
