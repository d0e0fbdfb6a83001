//! The gateway on a UDP bus of its own, with clients of every kind.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use platoon_dbc::{Frame, FrameFlags, PortLease, Udp, UdpOptions};

use super::*;

/// Longer than any answer takes; reached only when one never comes.
const PATIENCE: Duration = Duration::from_secs(20);

/// A gateway for truck 2, another node on that bus, and what keeps the port.
struct Bench {
    gateway: Gateway,
    node: Udp,
    _lease: PortLease,
}

impl Bench {
    fn new() -> Self {
        let lease = PortLease::acquire(47_100).expect("a free port");
        let port = lease.port();
        let options = UdpOptions { group: Udp::group_of_bus(2), port, tag: "" };
        let node = Udp::join(options).expect("multicast on the loopback interface");
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let place = GatewayPlace { address, has_beacon: false };
        let buses = Buses::new(BusAddress::Udp { port }, vec![2]);
        let gateway = Gateway::start(place, buses).expect("a free port");
        Self { gateway, node, _lease: lease }
    }

    fn connect(&self) -> Guest {
        let stream = TcpStream::connect(self.gateway.address()).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket option");
        Guest { stream, text: String::new() }
    }

    fn finish(self) -> GatewayReport {
        self.gateway.finish().expect("it ran until now")
    }
}

/// A client as patient as the test.
struct Guest {
    stream: TcpStream,
    text: String,
}

impl Guest {
    fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).expect("connected");
    }

    /// The next element; empty when the gateway closed the connection.
    fn hear(&mut self) -> String {
        loop {
            if let Some(end) = self.text.find('>') {
                return self.text.drain(..=end).collect();
            }
            let mut bytes = [0; 1024];
            match self.stream.read(&mut bytes).expect("an answer in time") {
                0 => return std::mem::take(&mut self.text),
                count => self.text.push_str(std::str::from_utf8(&bytes[..count]).expect("ASCII")),
            }
        }
    }

    fn attach(&mut self) {
        assert_eq!(self.hear(), "< hi >");
        self.say("< open truck2 >");
        assert_eq!(self.hear(), "< ok >");
        self.say("< rawmode >");
        assert_eq!(self.hear(), "< ok >");
    }
}

fn numbered(number: u32) -> Frame {
    let flags = FrameFlags { is_extended: true, is_fd: true, brs: true, ..FrameFlags::default() };
    Frame::new(0x18FF_1080, flags, &[&number.to_be_bytes()[..], &[0; 28]].concat()).expect("valid")
}

fn receive(bus: &mut Udp) -> Frame {
    loop {
        if let Some(received) = bus.receive().expect("up") {
            return received.frame;
        }
        assert!(bus.wait(PATIENCE).expect("up"), "a frame was lost");
    }
}

#[test]
fn a_client_sees_the_frames_of_its_bus_and_sends_its_own() {
    let mut bench = Bench::new();
    let mut guest = bench.connect();
    guest.attach();
    for number in 0..300 {
        bench.node.send(&numbered(number)).expect("room");
    }
    for number in 0..300 {
        let heard = guest.hear();
        let (words, data) = (heard.split(' ').collect::<Vec<_>>(), format!("{number:08X}"));
        assert_eq!((words[1], words[2]), ("frame", "18FF1080"), "{heard}");
        assert!(words[3].contains('.') && words[4].starts_with(&data), "{heard}");
    }
    guest.say("< send 123 2 1 f1 >");
    let sent = receive(&mut bench.node);
    assert_eq!((sent.id(), sent.data(), sent.flags().is_fd), (0x123, &[1, 0xF1][..], false));
    let report = bench.finish();
    assert_eq!((report.clients, report.to_clients, report.from_clients), (1, 300, 1));
}

#[test]
fn two_clients_of_a_bus_hear_each_other_but_not_themselves() {
    let bench = Bench::new();
    let (mut one, mut other) = (bench.connect(), bench.connect());
    one.attach();
    other.attach();
    one.say("< send 10 0 >");
    assert!(other.hear().starts_with("< frame 010 "));
    one.say("< echo >");
    assert_eq!(one.hear(), "< echo >");
    assert_eq!(bench.finish().too_slow, 0);
}

#[test]
fn outside_of_raw_mode_nothing_is_passed_on() {
    let mut bench = Bench::new();
    let mut guest = bench.connect();
    guest.attach();
    guest.say("< bcmmode >");
    assert_eq!(guest.hear(), "< ok >");
    bench.node.send(&numbered(1)).expect("room");
    std::thread::sleep(Duration::from_millis(20));
    guest.say("< echo >");
    assert_eq!(guest.hear(), "< echo >");
    assert_eq!(bench.finish().too_slow, 0);
}

#[test]
fn malformed_commands_are_answered_counted_and_survived() {
    let mut bench = Bench::new();
    let mut guest = bench.connect();
    assert_eq!(guest.hear(), "< hi >");
    for (said, answer) in [
        ("< rawmode >", "< error open a bus first >"),
        ("< send 123 0 >", "< error open a bus first >"),
        ("< statistics 100 >", "< error unknown command >"),
        ("<>", "< error unknown command >"),
        ("rubbish without end \n\n< open truck2 >", "< ok >"),
        ("< open truck2 >", "< error a bus is open already >"),
        ("< send 123 3 1 2 >", "< error syntax: the length is not"),
        ("< send 12 1 1FF >", "< error syntax: a byte is no"),
    ] {
        guest.say(said);
        let heard = guest.hear();
        assert!(heard.starts_with(answer), "{said}: {heard}");
    }
    guest.say(&format!("< send {} >", "0 ".repeat(100_000)));
    assert_eq!(guest.hear(), "< error command too long >");
    guest.say("< send 123 0 >");
    assert_eq!(receive(&mut bench.node).id(), 0x123);
    let report = bench.finish();
    assert_eq!((report.malformed, report.from_clients, report.too_slow), (5, 1, 0));
}

#[test]
fn a_bus_that_is_not_there_is_refused_and_those_that_are_are_named() {
    let bench = Bench::new();
    for name in ["truck0", "truck", "vcan0", "../truck2", ""] {
        let mut guest = bench.connect();
        assert_eq!(guest.hear(), "< hi >");
        guest.say(&format!("< open {name} >"));
        let answer = guest.hear();
        if name.is_empty() {
            assert_eq!(answer, "< error unknown command >");
        } else {
            assert_eq!(answer, "< error could not open bus: there is truck2 >");
            assert_eq!(guest.hear(), "", "the connection stays open");
        }
    }
    assert_eq!(bench.finish().too_slow, 0);
}

#[test]
fn a_client_that_does_not_read_is_dropped_and_the_others_are_not() {
    let mut bench = Bench::new();
    let (mut sleeper, mut reader) = (bench.connect(), bench.connect());
    sleeper.attach();
    reader.attach();
    let mut number = 0;
    let seen = AtomicUsize::new(0);
    // Far more than fits the buffers between the bus and the sleeper, at the pace of the reader.
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| {
            while reader.hear().starts_with("< frame ") {
                seen.fetch_add(1, Ordering::Relaxed);
            }
        });
        while number < 60_000 {
            for _ in 0..200 {
                bench.node.send(&numbered(number)).expect("room");
                number += 1;
            }
            while seen.load(Ordering::Relaxed) + 400 < number as usize && !reading.is_finished() {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        while seen.load(Ordering::Relaxed) < number as usize && !reading.is_finished() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let report = bench.gateway.finish().expect("it ran until now");
        assert_eq!(report.too_slow, 1, "{report}");
        reading.join().expect("no panic");
    });
    assert_eq!(seen.into_inner(), number as usize, "frames the reader saw");
}

#[test]
fn a_crowd_that_comes_and_goes_leaves_the_gateway_as_it_was() {
    let mut bench = Bench::new();
    for _ in 0..3 {
        let mut crowd: Vec<Guest> = (0..20).map(|_| bench.connect()).collect();
        for guest in &mut crowd[..15] {
            guest.attach();
        }
        crowd[15].say("< open tru");
        bench.node.send(&numbered(7)).expect("room");
        for guest in &mut crowd[..15] {
            assert!(guest.hear().starts_with("< frame 18FF1080 "));
        }
    }
    let mut last = bench.connect();
    last.attach();
    let report = bench.finish();
    assert_eq!((report.clients, report.refused, report.to_clients), (61, 0, 45));
}

#[test]
fn more_clients_than_there_is_room_for_are_told_so() {
    let bench = Bench::new();
    let mut crowd: Vec<Guest> = (0..CLIENTS_MAX).map(|_| bench.connect()).collect();
    for guest in &mut crowd {
        assert_eq!(guest.hear(), "< hi >");
    }
    assert_eq!(bench.connect().hear(), "< error too many clients >");
    assert_eq!(bench.finish().refused, 1);
}

#[test]
fn a_port_in_use_is_refused_with_a_remedy() {
    let bench = Bench::new();
    let place = GatewayPlace { address: bench.gateway.address(), has_beacon: false };
    let refusal = Gateway::start(place, Buses::new(BusAddress::Loopback, Vec::new()));
    let refusal = refusal.expect_err("the port is taken");
    assert_eq!(refusal.exit_code(), std::process::ExitCode::from(3));
    let line = refusal.to_string();
    assert!(line.contains("--socketcand 127.0.0.1:") && line.contains("choose another"), "{line}");
}
