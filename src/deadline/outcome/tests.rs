use vcan_setup::floor::Floor;

use super::*;
use crate::deadline::page;

use TimingVerdict::{Fail, Inconclusive, Pass};

/// A cell that came to this.
fn judged(subject: Subject, rate_hz: u32, load: Load, verdict: TimingVerdict) -> CellOutcome {
    let cell = Cell { subject, rate_hz, load, duration_s: 4.0 };
    let timed = Timed {
        ecus: Vec::new(),
        floor: Floor { cpus: Vec::new() },
        backend: "udp".into(),
        notes: Vec::new(),
        interrupted: false,
    };
    CellOutcome { verdict, ..CellOutcome::new(&cell, timed, "auto".into()) }
}

fn rates(verdicts: &[(u32, TimingVerdict)]) -> Option<u32> {
    highest(verdicts.iter().copied())
}

#[test]
fn the_highest_rate_passes_and_nothing_below_it_fails() {
    assert_eq!(rates(&[]), None);
    assert_eq!(rates(&[(100, Pass), (1000, Pass), (2000, Fail)]), Some(1000));
    assert_eq!(rates(&[(100, Pass), (1000, Fail), (2000, Pass)]), Some(100));
    assert_eq!(rates(&[(100, Fail), (1000, Pass)]), None);
    assert_eq!(rates(&[(100, Inconclusive), (1000, Pass)]), Some(1000), "the tighter one passes");
    assert_eq!(rates(&[(100, Pass), (1000, Inconclusive)]), Some(100));
    assert_eq!(rates(&[(2000, Pass), (100, Pass), (2000, Inconclusive)]), Some(100), "two loads");
}

#[test]
fn sustained_rates_are_told_by_load_and_under_every_one() {
    let cells = [
        judged(Subject::Bench, 1000, Load::Idle, Pass),
        judged(Subject::Bench, 2000, Load::Idle, Pass),
        judged(Subject::Bench, 1000, Load::Disk, Pass),
        judged(Subject::Bench, 2000, Load::Disk, Inconclusive),
        judged(Subject::Ecu, 5000, Load::Idle, Fail),
    ];
    let told: Vec<_> =
        sustained(&cells).into_iter().map(|s| (s.subject, s.load, s.rate_hz)).collect();
    assert_eq!(
        told,
        [
            (Subject::Bench, Some(Load::Idle), Some(2000)),
            (Subject::Bench, Some(Load::Disk), Some(1000)),
            (Subject::Bench, None, Some(1000)),
            (Subject::Ecu, Some(Load::Idle), None),
            (Subject::Ecu, Some(Load::Disk), None),
            (Subject::Ecu, None, None),
        ]
    );
}

#[test]
fn one_fail_fails_the_nominal_rate_and_only_passes_pass_it() {
    assert_eq!(worst_of(&[Pass, Inconclusive, Fail]), Fail);
    assert_eq!(worst_of(&[Pass, Inconclusive]), Inconclusive);
    assert_eq!(worst_of(&[Pass, Pass]), Pass);
    assert_eq!(worst_of(&[]), Inconclusive);
}

#[test]
fn the_table_has_every_cell_and_the_evidence_of_what_is_not_a_pass() {
    let cells = vec![
        judged(Subject::Bench, 1000, Load::Idle, Pass),
        judged(Subject::Bench, 1000, Load::Disk, Inconclusive),
        judged(Subject::Ecu, 5000, Load::Idle, Fail),
    ];
    let deadline = Deadline {
        version: String::new(),
        scenario: "obstacle-avoidance".into(),
        bus: Some("udp".into()),
        nominal_hz: 1000,
        verdict: Inconclusive,
        sustained: sustained(&cells),
        cells,
        faults: Vec::new(),
        elapsed_s: 12.0,
        environment: BTreeMap::new(),
    };
    let text = page::text(&deadline);
    for words in [
        "rig and ECUs over udp",
        "one ECU alone",
        "1000 Hz",
        "5000 Hz",
        "inconclusive",
        "0 of 0 slots lost: 0.000 to 100.000 % net of pauses, allowed 0.100 %",
        "rig and ECUs over udp, every load: sustains no rate for sure",
    ] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    let markdown = page::markdown(&deadline);
    assert_eq!(markdown.lines().filter(|line| line.contains(" Hz |")).count(), 3, "{markdown}");
    assert_eq!(markdown.matches("slots lost").count(), 2, "{markdown}");
    let json = serde_json::to_string(&deadline).expect("serialisable");
    assert_eq!(serde_json::from_str::<Deadline>(&json).expect("its own"), deadline);
}
