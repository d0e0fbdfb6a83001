//! One suite of claims that every bus must meet.

use platoon_dbc::{
    Actuation, Backend, Bus, Frame, FrameFlags, Loopback, PortLease, Received, SocketCan, Udp,
    UdpOptions,
};
use std::time::Duration;

/// Long enough for any delivery on one machine; reached only when a frame is lost.
const PATIENCE: Duration = Duration::from_secs(5);

/// Two nodes of a new, otherwise silent bus, and what keeps it alive.
struct Pair {
    here: Box<dyn Bus>,
    there: Box<dyn Bus>,
    _lease: Option<PortLease>,
}

/// The same, with the first node hearing itself.
fn echoing_udp() -> Pair {
    let lease = PortLease::acquire(46_100).expect("a free port");
    let join = |tag| {
        let options = UdpOptions { group: Udp::group_of_bus(4), port: lease.port(), tag };
        Udp::join(options).expect("multicast on the loopback interface")
    };
    let (here, there) = (Box::new(join("here").with_echo()), Box::new(join("there")));
    Pair { here, there, _lease: Some(lease) }
}

fn echoing_socketcan() -> Pair {
    let open = || SocketCan::open("vcan0").expect("vcan0 is up");
    let here = open().with_echo().expect("the kernel echoes");
    Pair { here: Box::new(here), there: Box::new(open()), _lease: None }
}

fn loopback() -> Pair {
    let (here, there) = Loopback::pair("loopback0", 4096);
    Pair { here: Box::new(here), there: Box::new(there), _lease: None }
}

fn udp() -> Pair {
    let lease = PortLease::acquire(46_100).expect("a free port");
    let join = |tag| {
        let options = UdpOptions { group: Udp::group_of_bus(0), port: lease.port(), tag };
        Box::new(Udp::join(options).expect("multicast on the loopback interface"))
    };
    Pair { here: join("here"), there: join("there"), _lease: Some(lease) }
}

fn socketcan() -> Pair {
    let open = || Box::new(SocketCan::open("vcan0").expect("vcan0 is up"));
    Pair { here: open(), there: open(), _lease: None }
}

fn emulated() -> Pair {
    let (here, there) = crate::emulated::pair();
    Pair { here, there, _lease: None }
}

macro_rules! conformance {
    ($($claim:ident),* $(,)?) => {
        mod on_loopback { $(#[test] fn $claim() { super::$claim(super::loopback()); })* }
        mod on_udp { $(#[test] fn $claim() { super::$claim(super::udp()); })* }
        // One vcan0 for all: run with --test-threads=1.
        mod on_socketcan { $(
            #[test]
            #[ignore = "needs interface vcan0: a kernel with CAN, and vcan0 up with MTU 72"]
            fn $claim() { super::$claim(super::socketcan()); }
        )* }
    };
}

conformance!(
    every_kind_of_frame_arrives_unchanged_and_in_order,
    a_node_does_not_hear_itself,
    an_empty_bus_returns_at_once,
    waiting_ends_when_a_frame_comes,
    both_directions_work_at_once,
    counts_match_the_traffic,
    a_slow_reader_loses_frames_only_by_count,
    a_message_survives_the_bus,
    stamps_do_not_go_back,
);

/// What an emulated bus keeps of the suite: it reorders by urgency, echoes, and takes its time.
mod on_emulated {
    macro_rules! conformance {
        ($($claim:ident),* $(,)?) => {
            $(#[test] fn $claim() { super::$claim(super::emulated()); })*
        };
    }

    conformance!(
        an_empty_bus_returns_at_once,
        waiting_ends_when_a_frame_comes,
        a_message_survives_the_bus,
        stamps_do_not_go_back,
        an_echo_has_the_time_at_which_others_received_the_frame,
        only_the_node_that_asked_hears_itself,
    );
}

fn receive(bus: &mut dyn Bus) -> Received {
    loop {
        if let Some(received) = bus.receive().expect("the bus is up") {
            return received;
        }
        assert!(bus.wait(PATIENCE).expect("the bus is up"), "a frame was lost");
    }
}

pub(crate) fn all_kinds() -> Vec<Frame> {
    let classic = FrameFlags::default();
    let extended = FrameFlags { is_extended: true, ..classic };
    let fd = FrameFlags { is_fd: true, ..classic };
    let brs = FrameFlags { brs: true, ..fd };
    let esi = FrameFlags { esi: true, is_extended: true, ..brs };
    let bytes: Vec<u8> = (1..=64).collect();
    let mut frames = Vec::new();
    for length in 0..=8 {
        frames.push(Frame::new(0x7FF, classic, &bytes[..length]).expect("valid"));
        frames.push(Frame::new(0x1FFF_FFFF, extended, &bytes[..length]).expect("valid"));
        frames.push(Frame::remote(0x001, false, length).expect("valid"));
    }
    for length in [0, 1, 8, 12, 16, 20, 24, 32, 48, 64] {
        for flags in [fd, brs, esi] {
            frames.push(Frame::new(0x123, flags, &bytes[..length]).expect("valid"));
        }
    }
    frames
}

fn numbered(number: u32) -> Frame {
    let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::default() };
    Frame::new(0x18FF_1080, flags, &number.to_le_bytes()).expect("valid")
}

fn every_kind_of_frame_arrives_unchanged_and_in_order(mut pair: Pair) {
    let frames = all_kinds();
    for frame in &frames {
        pair.here.send(frame).expect("room");
    }
    for frame in &frames {
        assert_eq!(receive(&mut *pair.there).frame, *frame);
    }
    assert_eq!(pair.there.receive(), Ok(None));
}

fn a_node_does_not_hear_itself(mut pair: Pair) {
    pair.here.send(&numbered(1)).expect("room");
    receive(&mut *pair.there);
    assert_eq!(pair.here.receive(), Ok(None));
}

fn an_empty_bus_returns_at_once(mut pair: Pair) {
    for _ in 0..3 {
        assert_eq!(pair.here.receive(), Ok(None));
        assert_eq!(pair.here.wait(Duration::ZERO), Ok(false));
        assert_eq!(pair.here.wait(Duration::from_millis(2)), Ok(false));
    }
}

fn waiting_ends_when_a_frame_comes(pair: Pair) {
    let Pair { mut here, mut there, _lease } = pair;
    let sender = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(5));
        here.send(&numbered(7)).expect("room");
        here
    });
    assert_eq!(there.wait(PATIENCE), Ok(true));
    assert_eq!(receive(&mut *there).frame, numbered(7));
    drop(sender.join().expect("the sender ends"));
}

fn both_directions_work_at_once(mut pair: Pair) {
    for number in 0..50 {
        pair.here.send(&numbered(number)).expect("room");
        pair.there.send(&numbered(1000 + number)).expect("room");
    }
    for number in 0..50 {
        assert_eq!(receive(&mut *pair.there).frame, numbered(number));
        assert_eq!(receive(&mut *pair.here).frame, numbered(1000 + number));
    }
}

fn counts_match_the_traffic(mut pair: Pair) {
    for number in 0..20 {
        pair.here.send(&numbered(number)).expect("room");
        receive(&mut *pair.there);
    }
    assert_eq!(pair.here.receive(), Ok(None));
    let (here, there) = (pair.here.counts(), pair.there.counts());
    assert_eq!((here.sent, here.received, there.sent, there.received), (20, 0, 0, 20));
    assert_eq!((here.send_full, here.send_failed, there.receive_overflow), (0, 0, 0));
    assert_eq!((there.malformed, there.foreign, there.own_echo), (0, 0, 0));
    let echoes = if pair.here.backend() == Backend::Udp { 20 } else { 0 };
    assert_eq!(here.own_echo, echoes);
}

fn a_slow_reader_loses_frames_only_by_count(mut pair: Pair) {
    let flood = 50_000;
    let mut taken = 0_u64;
    for number in 0..flood {
        taken += u64::from(pair.here.send(&numbered(number)).is_ok());
    }
    let mut last = None;
    let mut seen = 0_u64;
    while let Some(received) = pair.there.receive().expect("the bus is up") {
        let number = u32::from_le_bytes(*received.frame.data().first_chunk().expect("4 bytes"));
        assert!(last < Some(number), "order");
        last = Some(number);
        seen += 1;
    }
    // The kernel tells what it dropped with the next frame it delivers.
    pair.here.send(&numbered(flood)).expect("room again");
    receive(&mut *pair.there);
    let (here, there) = (pair.here.counts(), pair.there.counts());
    assert_eq!(here.sent + here.send_full, u64::from(flood) + 1);
    assert_eq!(here.sent, taken + 1);
    assert_eq!(there.received, seen + 1);
    assert_eq!(there.received + there.receive_overflow, here.sent);
    assert!(here.send_full + there.receive_overflow > 0, "the flood was no flood");
}

fn a_message_survives_the_bus(mut pair: Pair) {
    let sent = Actuation { force_n: -1234.5, steering_rad: 0.01, ..Actuation::default() };
    pair.here.send(&sent.encode(42).expect("in range")).expect("room");
    let (seen, counter) = Actuation::decode(&receive(&mut *pair.there).frame).expect("undamaged");
    assert_eq!((seen, counter), (sent, 42));
}

fn stamps_do_not_go_back(mut pair: Pair) {
    let mut last = 0;
    for number in 0..10 {
        pair.here.set_bench_time(1_000_000 * u64::from(number + 1));
        pair.here.send(&numbered(number)).expect("room");
        let stamp_ns = receive(&mut *pair.there).stamp_ns;
        assert!(stamp_ns >= last && stamp_ns > 0, "{stamp_ns} after {last}");
        last = stamp_ns;
    }
}

macro_rules! echo_conformance {
    ($($claim:ident),* $(,)?) => {
        mod echo_on_udp { $(#[test] fn $claim() { super::$claim(super::echoing_udp()); })* }
        mod echo_on_socketcan { $(
            #[test]
            #[ignore = "needs interface vcan0: a kernel with CAN, and vcan0 up with MTU 72"]
            fn $claim() { super::$claim(super::echoing_socketcan()); }
        )* }
    };
}

echo_conformance!(
    what_was_sent_comes_back_as_own_and_unchanged,
    own_frames_stand_where_they_were_between_those_of_others,
    an_echo_has_the_time_at_which_others_received_the_frame,
    only_the_node_that_asked_hears_itself,
);

fn what_was_sent_comes_back_as_own_and_unchanged(mut pair: Pair) {
    assert!(pair.here.echoes() && !pair.there.echoes());
    let frames = all_kinds();
    for frame in &frames {
        pair.here.send(frame).expect("room");
    }
    for frame in &frames {
        let echo = receive(&mut *pair.here);
        assert_eq!((echo.frame, echo.own), (*frame, true));
        assert!(echo.stamp_ns > 0);
    }
    let (counts, sent) = (pair.here.counts(), frames.len() as u64);
    assert_eq!((counts.sent, counts.own_echo, counts.received), (sent, sent, 0));
}

fn own_frames_stand_where_they_were_between_those_of_others(mut pair: Pair) {
    let mut sent = Vec::new();
    for number in 0..100 {
        pair.here.send(&numbered(number)).expect("room");
        sent.push((numbered(number), true));
        if number % 3 == 0 {
            pair.there.send(&numbered(1000 + number)).expect("room");
            sent.push((numbered(1000 + number), false));
        }
    }
    for expected in sent {
        let seen = receive(&mut *pair.here);
        assert_eq!((seen.frame, seen.own), expected);
    }
}

fn an_echo_has_the_time_at_which_others_received_the_frame(mut pair: Pair) {
    for number in 0..20 {
        pair.here.send(&numbered(number)).expect("room");
        let (echo, seen) = (receive(&mut *pair.here), receive(&mut *pair.there));
        assert_eq!(echo.frame, seen.frame);
        // A datagram is stamped once per socket that gets it, a CAN frame once for all.
        if pair.here.backend() != Backend::Udp {
            assert_eq!(echo.stamp_ns, seen.stamp_ns);
        }
    }
}

fn only_the_node_that_asked_hears_itself(mut pair: Pair) {
    pair.there.send(&numbered(1)).expect("room");
    let heard = receive(&mut *pair.here);
    assert_eq!((heard.frame, heard.own), (numbered(1), false));
    assert_eq!(pair.there.receive(), Ok(None));
}

#[test]
fn the_loopback_bus_has_no_echo() {
    let mut pair = loopback();
    pair.here.send(&numbered(1)).expect("room");
    assert!(!pair.here.echoes() && !receive(&mut *pair.there).own);
    assert_eq!(pair.here.receive(), Ok(None));
}

#[test]
fn an_interface_that_carries_no_can_is_refused_with_a_remedy() {
    // Without CAN in the kernel the reason is another one, and so is the remedy.
    let refusal = SocketCan::open("lo").expect_err("no CAN interface").to_string();
    let remedy =
        if platoon_dbc::probe::kernel_has_can() { "name a vcan" } else { "use the udp bus" };
    assert!(refusal.starts_with("interface lo: ") && refusal.contains(remedy), "{refusal}");
}

#[test]
#[ignore = "needs interfaces vcan1 up with MTU 16 and vcan2 down with MTU 72"]
fn an_interface_in_no_state_for_the_contract_is_refused_with_a_remedy() {
    for (interface, remedy) in [
        ("vcan1", "ip link set vcan1 mtu 72"),
        ("vcan2", "ip link set vcan2 up"),
        ("vcan9", "there is none of this name"),
    ] {
        let refusal = SocketCan::open(interface).expect_err("unfit").to_string();
        assert!(refusal.contains(interface) && refusal.contains(remedy), "{refusal}");
    }
}

#[test]
fn buses_that_share_a_port_do_not_hear_each_other() {
    let lease = PortLease::acquire(46_100).expect("a free port");
    let join = |bus| {
        let options = UdpOptions { group: Udp::group_of_bus(bus), port: lease.port(), tag: "" };
        Udp::join(options).expect("multicast on the loopback interface")
    };
    let (mut rig, mut ecu, mut other) = (join(0), join(0), join(1));
    rig.send(&numbered(1)).expect("room");
    receive(&mut ecu);
    assert_eq!(other.receive(), Ok(None));
}

#[test]
fn three_nodes_of_a_group_all_hear_each_other() {
    let lease = PortLease::acquire(46_100).expect("a free port");
    let mut nodes = [(); 3].map(|()| {
        let options = UdpOptions { group: Udp::group_of_bus(2), port: lease.port(), tag: "" };
        Udp::join(options).expect("multicast on the loopback interface")
    });
    for sender in 0..3 {
        nodes[sender].send(&numbered(sender as u32)).expect("room");
        for (index, node) in nodes.iter_mut().enumerate().filter(|(index, _)| *index != sender) {
            assert_eq!(receive(node).frame, numbered(sender as u32), "node {index}");
        }
    }
}

#[test]
fn datagrams_that_are_no_frame_are_counted_and_skipped() {
    let lease = PortLease::acquire(46_100).expect("a free port");
    let group = Udp::group_of_bus(3);
    let join = || {
        let options = UdpOptions { group, port: lease.port(), tag: "" };
        Udp::join(options).expect("multicast on the loopback interface")
    };
    let (mut here, mut there) = (join(), join());
    let stranger = std::net::UdpSocket::bind("127.0.0.1:0").expect("a free port");
    rustix::net::sockopt::set_ip_multicast_if(&stranger, &std::net::Ipv4Addr::LOCALHOST)
        .expect("the loopback interface");
    for datagram in [&b""[..], b"hello", &[0xFF; 2000], &[0x81; 100]] {
        stranger.send_to(datagram, (group, lease.port())).expect("sent");
    }
    here.send(&numbered(9)).expect("room");
    assert_eq!(receive(&mut there).frame, numbered(9));
    assert_eq!((there.counts().malformed, there.counts().received), (4, 1));
}
