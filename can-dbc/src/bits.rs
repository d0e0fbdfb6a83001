//! Little-endian bit fields (DBC byte order `@1`) in a 64-byte payload.

use crate::frame::Frame;

/// Payload buffer of a frame.
pub(crate) type Payload = [u8; Frame::CAPACITY];

/// Bytes of the window that a field of up to 64 bits, starting anywhere in a byte, fits in.
const WINDOW: usize = size_of::<u128>();

/// The field's low 64 bits, zero-extended.
pub(crate) fn get(payload: &Payload, start_bit: u32, size: u32) -> u64 {
    let (first, shift) = window(start_bit);
    ((load(payload, first) >> shift) & mask(size)) as u64
}

/// The field as a two's complement number.
pub(crate) fn get_signed(payload: &Payload, start_bit: u32, size: u32) -> i64 {
    let unused = 64 - size;
    ((get(payload, start_bit, size) << unused) as i64) >> unused
}

/// Clears the field, then writes the low `size` bits of `raw` into it.
pub(crate) fn put(payload: &mut Payload, start_bit: u32, size: u32, raw: u64) {
    let (first, shift) = window(start_bit);
    let mask = mask(size);
    let kept = load(payload, first) & !(mask << shift);
    let word = kept | ((u128::from(raw) & mask) << shift);
    payload[first..first + WINDOW].copy_from_slice(&word.to_le_bytes());
}

/// First byte of the window and the field's shift in it; near the end the window moves back.
fn window(start_bit: u32) -> (usize, u32) {
    let first = (start_bit as usize / 8).min(Frame::CAPACITY - WINDOW);
    (first, start_bit - 8 * first as u32)
}

fn mask(size: u32) -> u128 {
    (1 << size) - 1
}

fn load(payload: &Payload, first: usize) -> u128 {
    let mut window = [0; WINDOW];
    window.copy_from_slice(&payload[first..first + WINDOW]);
    u128::from_le_bytes(window)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bit by bit, the way the DBC defines it.
    fn put_slowly(payload: &mut Payload, start_bit: u32, size: u32, raw: u64) {
        for bit in 0..size {
            let (byte, place) = ((start_bit + bit) as usize / 8, (start_bit + bit) % 8);
            payload[byte] &= !(1 << place);
            payload[byte] |= ((raw >> bit) as u8 & 1) << place;
        }
    }

    #[test]
    fn every_field_of_every_size_is_where_the_dbc_says() {
        for size in 1..=64 {
            for start_bit in 0..=512 - size {
                for fill in [0x00, 0xFF] {
                    let raw = 0x9E37_79B9_7F4A_7C15_u64.rotate_left(start_bit) >> (64 - size);
                    let (mut fast, mut slow) = ([fill; 64], [fill; 64]);
                    put(&mut fast, start_bit, size, raw);
                    put_slowly(&mut slow, start_bit, size, raw);
                    assert_eq!(fast, slow, "start {start_bit} size {size}");
                    assert_eq!(get(&fast, start_bit, size), raw);
                }
            }
        }
    }

    #[test]
    fn a_signed_field_extends_its_sign() {
        let mut payload = [0; 64];
        put(&mut payload, 5, 18, (-131_072_i64) as u64);
        assert_eq!(get_signed(&payload, 5, 18), -131_072);
        put(&mut payload, 5, 18, 131_071);
        assert_eq!(get_signed(&payload, 5, 18), 131_071);
    }
}
