//! What a tick pays to hear: `cargo bench -p controller-rt`. Nanoseconds a drain of a loopback bus.

use controller_rt::parts::{Inbox, Picture};
use platoon_dbc::{Bus, Decoder, EgoState, Loopback, Profile, Vehicle};

#[path = "../law/benches/table/mod.rs"]
mod table;

const ROUNDS: u32 = 20_000;

fn main() {
    table::head();
    for waiting in [0, 1, 12, 128] {
        let (mut rig, mut ecu) = Loopback::pair("loopback0", 256);
        let mut inbox = Inbox::new(Decoder::new(Profile::Fd, Vehicle::default()));
        let mut picture = Picture::new(0);
        let (mut times, mut sent) = (Vec::new(), 0_u32);
        for _ in 0..ROUNDS {
            for _ in 0..waiting {
                sent += 1;
                let bench_time_ns = u64::from(sent) * 1_000_000;
                let ego = EgoState { tick: sent, bench_time_ns, ..EgoState::default() };
                rig.send(&ego.encode(sent as u8).expect("in range")).expect("there is room");
            }
            table::timed(&mut times, || inbox.drain(&mut ecu, &mut picture, 0, |_| ()));
        }
        table::row(&format!("{waiting} frames"), &mut times);
    }
}
