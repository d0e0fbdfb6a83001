//! What it costs to turn messages into protected frames and back: `cargo bench -p platoon-dbc`.
//! Nanoseconds a message, each the mean of a few calls.

use std::hint::black_box;

use platoon_dbc::{Actuation, Decoder, EgoState, Encoder, Frame, Message, Profile, Vehicle};

#[path = "../../controller-rt/law/benches/table/mod.rs"]
mod table;

const ROUNDS: usize = 20_000;

fn main() {
    table::head();
    for profile in [Profile::Fd, Profile::J1939] {
        let messages = [
            ("EgoState", Message::EgoState(EgoState::default())),
            ("Actuation", Message::Actuation(Actuation::default())),
        ];
        for (name, message) in messages {
            encode(profile, name, &message);
            decode(profile, name, &message);
        }
    }
}

/// Time of a clock that lets every rate of a profile send.
fn clock() -> impl FnMut() -> u64 {
    let mut now_ns = 0;
    move || {
        now_ns += 1_000_000_000;
        now_ns
    }
}

fn encode(profile: Profile, name: &str, message: &Message) {
    let (mut encoder, mut clock) = (Encoder::new(profile, Vehicle::default()), clock());
    let mut times = Vec::new();
    for _ in 0..ROUNDS {
        table::timed_together(&mut times, || {
            let emit = &mut |frame: &Frame| {
                black_box(frame);
            };
            encoder.encode(black_box(message), clock(), emit).expect("in range");
        });
    }
    table::row(&format!("{profile} {name} out"), &mut times);
}

/// Every frame of a message, each with its own alive counter.
fn decode(profile: Profile, name: &str, message: &Message) {
    let (mut encoder, mut clock) = (Encoder::new(profile, Vehicle::default()), clock());
    let mut decoder = Decoder::new(profile, Vehicle::default());
    let (mut times, mut frames) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        frames.clear();
        for _ in 0..table::AT_ONCE {
            let mut sent = Vec::new();
            let emit = &mut |frame: &Frame| sent.push(*frame);
            encoder.encode(message, clock(), emit).expect("in range");
            frames.push(sent);
        }
        let mut waiting = frames.iter();
        table::timed_together(&mut times, || {
            for frame in waiting.next().expect("as many as calls") {
                let _ = black_box(decoder.take(black_box(frame)));
            }
        });
    }
    table::row(&format!("{profile} {name} in"), &mut times);
}
