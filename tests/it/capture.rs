//! `--capture`: full rate around what was asked for, and enough of the rest to look at.

use traces::{Record, Topic};

use crate::bench;

/// Bench time \[ms\] of what is kept of the recorded topics that `wants` names.
fn kept_ms(run: &bench::Run, wants: fn(Topic) -> bool) -> Vec<u64> {
    let messages = run.trace().filter(|message| message.channel.kind.is_some_and(wants));
    let record = |message: traces::Message| match message.record().expect("it decodes") {
        Record::Frame(frame) => frame.time_ns,
        Record::Tick(tick) => tick.time_ns,
        _ => message.time_ns(),
    };
    messages.map(|message| record(message) / 1_000_000).collect()
}

#[test]
fn a_captured_run_is_whole_around_the_event_and_replays_there() {
    let arguments = ["--rate-hz", "50", "--duration-s", "25", "--capture", "miss,clearance<2"];
    let run = bench::rehearse_virtually("capture", &arguments);
    assert!(run.stdout.contains("captured at full rate"), "{}", run.stdout);
    let notes = run.trace().metadata()["platoon.capture"].clone();
    let (from_s, until_s) = notes["spans_s"].split_once('-').expect("one span");
    let ms = |text: &str| (1e3 * text.parse::<f64>().expect("seconds")).round() as u64;
    let (from_ms, until_ms) = (ms(from_s), ms(until_s));
    assert_eq!(from_ms % 10_000, 0, "it begins with a snapshot: {notes:?}");
    assert!(from_ms >= 10_000, "nothing is nearer than two metres in the first ten seconds");

    let frames_ms = kept_ms(&run, |topic| topic == Topic::Frames(1));
    assert!(frames_ms.iter().all(|time_ms| (from_ms..=until_ms).contains(time_ms)));
    let ticks_ms = kept_ms(&run, |topic| topic == Topic::Tick(1));
    let (whole, rest): (Vec<u64>, Vec<u64>) =
        ticks_ms.iter().partition(|time_ms| (from_ms..=until_ms).contains(time_ms));
    let end_ms = 25_000.min(until_ms);
    let due = (end_ms - from_ms) / 20;
    assert!((due..=due + 1).contains(&(whole.len() as u64)), "{} of {due} ticks", whole.len());
    assert!(rest.windows(2).all(|pair| pair[1] - pair[0] >= 100), "one of five ticks elsewhere");
    assert!(rest.len() as u64 >= from_ms / 101, "{} ticks elsewhere", rest.len());
    assert!(run.truth().len() > 2_490, "the world is whole");

    let path = run.out();
    let path = path.to_str().expect("the place of the tests is UTF-8");
    let replayed = bench::platoon("capture-replay", &["replay", path]);
    replayed.expect_code(0);
    assert!(replayed.stdout.contains("identical: all"), "{}", replayed.stdout);
}

#[test]
fn what_is_no_event_is_refused_with_those_there_are() {
    let end = bench::platoon("capture-what", &["rehearse", "--capture", "miss,clearance>2"]);
    end.expect_code(2);
    assert!(end.stderr.contains("clearance<METRES"), "{}", end.stderr);
}
