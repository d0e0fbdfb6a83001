//! What a loop pays to have something recorded: `cargo bench -p traces`. Nanoseconds a push, each
//! the mean of a few; the thread that writes is beside it.

use platoon_dbc::{Frame, FrameFlags};
use traces::{FrameRecord, Recorder, RecorderOptions, Source, TickRecord};

#[path = "../../controller-rt/law/benches/table/mod.rs"]
mod table;

const ROUNDS: usize = 5_000;

fn main() {
    let path = std::env::temp_dir().join(format!("traces-bench-{}.mcap", std::process::id()));
    let options = RecorderOptions::new(Source::Ecu(0));
    let mut recorder = Recorder::start(&path, options).expect("the folder can be written");
    let frame = Frame::new(0x18FF_1080, FrameFlags::default(), &[0; 8]).expect("valid");
    let frame = FrameRecord { bus: 0, time_ns: 0, stamp_ns: 0, tick: 0, tx: true, frame };
    let (mut frames, mut ticks) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        table::timed_together(&mut frames, || recorder.push(frame));
        table::timed_together(&mut ticks, || recorder.push(TickRecord::default()));
    }
    let finished = recorder.finish();
    std::fs::remove_file(&path).expect("it is ours");
    table::head();
    table::row("frame", &mut frames);
    table::row("tick", &mut ticks);
    let dropped = finished.dropped.total();
    println!("{} written, {dropped} dropped because their ring was full", finished.written);
}
