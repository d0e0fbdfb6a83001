//! A node on the UDP bus that answers every frame, to be met by python-can.
//!
//! It prints `listening GROUP PORT`, then answers each frame it hears until its standard input
//! ends: an `EgoState` with the `Actuation` of its tick, anything else with a copy whose lowest
//! identifier bit is flipped. At the end it prints its counts. `tests/interop` drives it.

use platoon_dbc::{Actuation, Bus, Frame, Message, PortLease, Udp, UdpOptions};
use std::io::Read as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

static STOP: AtomicBool = AtomicBool::new(false);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let lease = PortLease::acquire(Udp::FIRST_PORT)?;
    let group = Udp::group_of_bus(0);
    let mut bus = Udp::join(UdpOptions { group, port: lease.port(), tag: "truck0" })?;
    println!("listening {group} {}", lease.port());
    std::thread::spawn(|| {
        // The end of the input, however it comes, is the sign to stop.
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        STOP.store(true, Ordering::Relaxed);
    });
    let mut counter = 0;
    while !STOP.load(Ordering::Relaxed) {
        bus.wait(Duration::from_millis(20))?;
        while let Some(received) = bus.receive()? {
            assert!(received.stamp_ns > 0, "the kernel stamps every datagram");
            bus.send(&answer(&received.frame, &mut counter)?)?;
        }
    }
    println!("{:?}", bus.counts());
    Ok(())
}

fn answer(frame: &Frame, counter: &mut u8) -> Result<Frame, Box<dyn std::error::Error>> {
    if let Ok((Message::EgoState(state), _)) = Message::decode(frame) {
        *counter = counter.wrapping_add(1);
        let command =
            Actuation { answers_tick: state.tick, force_n: -250.5, ..Actuation::default() };
        return Ok(command.encode(*counter)?);
    }
    let (id, flags) = (frame.id() ^ 1, frame.flags());
    if flags.is_rtr {
        return Ok(Frame::remote(id, flags.is_extended, frame.length())?);
    }
    Ok(Frame::new(id, flags, frame.data())?)
}
