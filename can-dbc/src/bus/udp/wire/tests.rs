use super::*;

/// `msgpack.packb` of python-can 4.6.1's `pack_message` for
/// `Message(timestamp=1.5, arbitration_id=0x18FF1080, data=b"\x01\x02", is_fd=True,
/// bitrate_switch=True)`.
const PYTHON_CAN: &[u8] = b"\x8b\xa9timestamp\xcb\x3f\xf8\x00\x00\x00\x00\x00\x00\
    \xaearbitration_id\xce\x18\xff\x10\x80\xaeis_extended_id\xc3\xafis_remote_frame\xc2\
    \xaeis_error_frame\xc2\xa7channel\xc0\xa3dlc\x02\xa4data\xc4\x02\x01\x02\xa5is_fd\xc3\
    \xaebitrate_switch\xc3\xb5error_state_indicator\xc2";

const NO_TAG: &str = "";

fn fd_frame(data: &[u8]) -> Frame {
    let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::default() };
    Frame::new(0x18FF_1080, flags, data).expect("valid")
}

fn packed(frame: &Frame, tag: &str) -> Vec<u8> {
    Packed::of(frame, &Tag::new(tag).expect("short")).bytes().to_vec()
}

/// A small seeded generator (SplitMix64, Steele et al. 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }
}

#[test]
fn a_frame_is_packed_as_python_can_packs_it() {
    let mut expected = PYTHON_CAN.to_vec();
    // Ours says 0 for the time, which receivers replace.
    expected[12..20].fill(0);
    assert_eq!(packed(&fd_frame(&[1, 2]), NO_TAG), expected);
    assert_eq!(unpack(PYTHON_CAN), Some(fd_frame(&[1, 2])));
}

#[test]
fn the_longest_frame_with_the_longest_tag_fits() {
    let frame = fd_frame(&[0xEE; 64]);
    let datagram = packed(&frame, "fifteen-letters");
    assert!(datagram.len() <= CAPACITY);
    assert_eq!(unpack(&datagram), Some(frame));
    assert!(Tag::new("sixteen letters!").is_none());
}

#[test]
fn every_kind_of_frame_round_trips() {
    let classic = FrameFlags::default();
    let error = FrameFlags { is_error: true, ..classic };
    for frame in [
        Frame::new(0x7FF, classic, &[]).expect("valid"),
        Frame::new(0x044, error, &[0; 8]).expect("valid"),
        Frame::remote(0x1FFF_FFFF, true, 8).expect("valid"),
        fd_frame(&[3; 48]),
    ] {
        assert_eq!(unpack(&packed(&frame, "truck0")), Some(frame));
    }
}

#[test]
fn keys_may_come_in_any_order_with_any_width_and_unknown_ones_between() {
    let datagram = b"\x87\
        \xa4data\xc5\x00\x02\x01\x02\
        \xa6future\x82\xa1a\x93\x01\xcb\x00\x00\x00\x00\x00\x00\x00\x00\xc0\xa1b\xd6\x01abcd\
        \xd9\x05is_fd\xc3\
        \xaearbitration_id\xcf\x00\x00\x00\x00\x18\xff\x10\x80\
        \xaebitrate_switch\xc3\
        \xa7channel\xa5can12\
        \xa3dlc\xd1\x00\x02";
    assert_eq!(unpack(datagram), Some(fd_frame(&[1, 2])));
}

#[test]
fn missing_keys_take_python_cans_defaults() {
    let datagram = b"\x81\xaearbitration_id\x05";
    let extended = FrameFlags { is_extended: true, ..FrameFlags::default() };
    assert_eq!(unpack(datagram), Frame::new(5, extended, &[]).ok());
}

#[test]
fn contradictions_are_no_frames() {
    for datagram in [
        &b"\x80"[..],
        b"\x82\xaearbitration_id\x05\xa3dlc\x03",
        b"\x81\xaearbitration_id\xff",
        b"\x81\xaearbitration_id\xc3",
        b"\x82\xaearbitration_id\x05\xa5is_fd\x01",
        b"\x81\xaearbitration_id\xce\xff\xff\xff\xff",
        b"\x81\xaearbitration_id\x05trailing",
        b"\x82\xaearbitration_id\x05\xa4data\xc4\x09123456789",
    ] {
        assert_eq!(unpack(datagram), None, "{datagram:?}");
    }
}

#[test]
fn every_truncation_is_no_frame() {
    for length in 0..PYTHON_CAN.len() {
        assert_eq!(unpack(&PYTHON_CAN[..length]), None, "{length} bytes");
    }
}

#[test]
fn promised_lengths_far_beyond_the_datagram_end_at_once() {
    for head in [&b"\xdf\xff\xff\xff\xff"[..], b"\xdd\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"] {
        assert_eq!(unpack(head), None);
        let mut nested = b"\x81\xa1x".to_vec();
        nested.extend_from_slice(head);
        nested.extend_from_slice(&[0x91; 900]);
        assert_eq!(unpack(&nested), None);
    }
}

#[test]
fn no_bytes_make_it_panic_and_what_it_takes_repacks_the_same() {
    let mut random = Random(20_261_122);
    let mut taken = 0;
    for round in 0..200_000 {
        let mut datagram = if round % 2 == 0 {
            (0..random.next() % 300).map(|_| random.next() as u8).collect()
        } else {
            PYTHON_CAN.to_vec()
        };
        if round % 2 == 1 {
            for _ in 0..=random.next() % 3 {
                let place = random.next() as usize % datagram.len();
                datagram[place] = random.next() as u8;
            }
        }
        if let Some(frame) = unpack(&datagram) {
            taken += 1;
            assert_eq!(unpack(&packed(&frame, NO_TAG)), Some(frame));
        }
    }
    // Some damage hits only the timestamp or the data: the test reaches the far end.
    assert!(taken > 1000, "{taken}");
}
