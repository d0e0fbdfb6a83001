//! What a loop pays to have something recorded: `cargo bench -p traces`. Nanoseconds a push, each
//! the mean of a few; the thread that writes is beside it, and has the pause between to keep up.

use std::thread;
use std::time::Duration;

use platoon_dbc::{Frame, FrameFlags};
use traces::{FrameRecord, Recorder, RecorderOptions, Source, TickRecord};

#[path = "../../controller-rt/law/benches/table/mod.rs"]
mod table;

const ROUNDS: usize = 2_000;
/// Between rounds; a push into a full ring would be a cheaper thing.
const PAUSE: Duration = Duration::from_millis(2);

fn main() {
    let path = std::env::temp_dir().join(format!("traces-bench-{}.mcap", std::process::id()));
    let options = RecorderOptions::new(Source::Ecu(0));
    let mut recorder = Recorder::start(&path, options).expect("the folder can be written");
    let extended = FrameFlags { is_extended: true, ..FrameFlags::default() };
    let frame = Frame::new(0x18FF_1080, extended, &[0; 8]).expect("29 bits, 8 bytes");
    let frame = FrameRecord { bus: 0, time_ns: 0, stamp_ns: 0, tick: 0, tx: true, frame };
    let (mut frames, mut ticks) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        table::timed_together(&mut frames, || recorder.push(frame));
        table::timed_together(&mut ticks, || recorder.push(TickRecord::default()));
        thread::sleep(PAUSE);
    }
    let finished = recorder.finish();
    std::fs::remove_file(&path).expect("it is ours");
    table::head();
    table::row("frame", &mut frames);
    table::row("tick", &mut ticks);
    let dropped = finished.dropped.total();
    println!("{} written, {dropped} dropped because their ring was full", finished.written);
}
