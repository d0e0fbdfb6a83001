//! The count of bits against frames that are really laid out, bit by bit.

mod wire;

use crate::random::Random;
use platoon_dbc::bus_time::{BusTiming, FrameBits};
use platoon_dbc::{Frame, FrameFlags};

const FRAMES: usize = 100_000;

/// A frame of any kind that CAN knows. Data and identifiers of few distinct bits are frequent,
/// because only they need much stuffing.
fn any_frame(random: &mut Random) -> Frame {
    let flags = FrameFlags {
        is_extended: random.below(2) == 0,
        is_fd: random.below(2) == 0,
        ..FrameFlags::default()
    };
    let id = dull(random) & if flags.is_extended { 0x1FFF_FFFF } else { 0x7FF };
    if !flags.is_fd && random.below(8) == 0 {
        return Frame::remote(id, flags.is_extended, random.below(9)).expect("valid");
    }
    const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
    let length = LENGTHS[random.below(if flags.is_fd { 16 } else { 9 })];
    let (brs, esi) = (random.below(2) == 0, random.below(2) == 0);
    let flags = if flags.is_fd { FrameFlags { brs, esi, ..flags } } else { flags };
    let mut data = [0; 64];
    for word in data.chunks_exact_mut(4) {
        word.copy_from_slice(&dull(random).to_be_bytes());
    }
    Frame::new(id, flags, &data[..length]).expect("valid")
}

/// Any bits, or long runs of equal ones.
fn dull(random: &mut Random) -> u32 {
    match random.below(4) {
        0 => 0,
        1 => u32::MAX << random.below(32),
        2 => 0x0F83_E0F8_u32.rotate_left(random.below(10) as u32),
        _ => random.next() as u32,
    }
}

#[test]
fn the_count_equals_the_bits_of_100_000_frames_laid_out_one_by_one() {
    let mut random = Random::new(1);
    for _ in 0..FRAMES {
        let frame = any_frame(&mut random);
        let bits = wire::lay_out(&frame);
        let fast = bits.iter().filter(|bit| bit.is_fast).count() as u64;
        let counted = FrameBits { nominal: bits.len() as u64 - fast, fast };
        assert_eq!(FrameBits::of(&frame), counted, "{frame:?}");
        assert_eq!(wire::read(&bits), Ok(frame), "{bits:?}");
    }
}

#[test]
fn a_flipped_bit_is_never_read_as_another_frame() {
    let mut random = Random::new(2);
    for _ in 0..FRAMES / 100 {
        let frame = any_frame(&mut random);
        let mut bits = wire::lay_out(&frame);
        // Before the acknowledgement: after it nothing tells one frame from another.
        let place = random.below(bits.len() - 12);
        bits[place].level ^= true;
        assert!(wire::read(&bits).is_err(), "bit {place} of {frame:?}");
    }
}

#[test]
fn no_frame_is_longer_than_the_longest_of_its_kind() {
    let mut random = Random::new(3);
    let timings = BusTiming::CLASSIC.into_iter().chain(BusTiming::FD);
    for timing in timings {
        for _ in 0..FRAMES / 10 {
            let frame = any_frame(&mut random);
            let longest_ns = timing.frame_time_ns_max(frame.flags(), frame.length());
            assert!(timing.frame_time_ns(&frame) <= longest_ns, "{frame:?} at {timing}");
        }
    }
}

#[test]
fn classic_frames_have_the_bits_that_canbusload_counts() {
    // By cfl_exact of canframelen.c in can-utils, at commit 95aae6b (M. Sojka, Czech Technical
    // University in Prague), which counts from the start of frame to the end of the intermission.
    let vectors: [(u32, bool, &[u8], u64); 10] = [
        (0x000, false, &[], 53),
        (0x7FF, false, &[0xFF; 8], 126),
        (0x078, false, &[0x3C; 8], 131),
        (0x123, false, &[0x11, 0x22, 0x33], 72),
        (0x0CF0_04FE, true, &[0xF0, 0x7D, 0x84, 0xB1, 0x13, 0x00, 0xF4, 0x84], 136),
        (0x18FE_F1FE, true, &[0xFF, 0x00, 0xD2, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], 143),
        (0x1FFF_FFFF, true, &[0xFF; 8], 149),
        (0x0000_0000, true, &[0x00; 8], 150),
        (0x18FF_1080, true, &[0, 1, 2, 3, 4, 5, 6, 7], 145),
        (0x1F07_C1F0, true, &[0xF8, 0x7C, 0x1F, 0x07, 0xC1, 0xF0, 0x7C, 0x1F], 150),
    ];
    for (id, is_extended, data, bits) in vectors {
        let frame =
            Frame::new(id, FrameFlags { is_extended, ..FrameFlags::CLASSIC }, data).expect("valid");
        assert_eq!(FrameBits::of(&frame), FrameBits { nominal: bits, fast: 0 }, "{frame:?}");
    }
}
