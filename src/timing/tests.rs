use vcan_setup::floor::CpuFloor;
use vcan_setup::realtime::Policy;

use super::*;

const QUIET: Share = Share { events: 0, trials: 10_000 };

fn slots(events: u64, trials: u64) -> Share {
    Share { events, trials }
}

/// Slots lost in runs of four.
fn in_fours(events: u64, trials: u64) -> Losses {
    Losses { slots: slots(events, trials), lapses: events.div_ceil(4) }
}

/// The verdict when so many of 400000 slots were lost, so many of them to the machine, and so many
/// surely to the program.
fn verdict(lost: u64, denied: u64, own: u64, machine: Share) -> TimingVerdict {
    let of_400_000 = |events| in_fours(events, 400_000);
    let (lost, denied, own) = (of_400_000(lost), of_400_000(denied), of_400_000(own));
    Account { lost, denied, own, certain: own, machine }.verdict()
}

#[test]
fn many_punctual_ticks_pass_and_many_late_ones_fail() {
    assert_eq!(verdict(3, 0, 0, QUIET), TimingVerdict::Pass);
    assert_eq!(verdict(8_000, 0, 0, QUIET), TimingVerdict::Fail);
}

#[test]
fn between_what_is_allowed_and_ten_times_that_losses_without_a_witness_decide_nothing() {
    assert_eq!(verdict(2_000, 0, 0, QUIET), TimingVerdict::Inconclusive);
    assert_eq!(verdict(2_000, 0, 2_000, QUIET), TimingVerdict::Fail, "unless they have one");
}

#[test]
fn a_late_machine_or_a_short_run_decides_nothing() {
    let late = slots(300, 10_000);
    assert_eq!(verdict(8_000, 0, 0, late), TimingVerdict::Inconclusive);
    let judged = |lost, machine| Account { lost, machine, ..Account::default() }.verdict();
    assert_eq!(judged(in_fours(0, 100), QUIET), TimingVerdict::Inconclusive);
    assert_eq!(judged(Losses::default(), Share::default()), TimingVerdict::Inconclusive);
}

#[test]
fn slots_that_the_machine_took_are_held_against_nobody_while_they_are_few() {
    let late = slots(300, 10_000);
    assert_eq!(verdict(4_000, 4_000, 0, late), TimingVerdict::Pass);
    assert_eq!(verdict(4_800, 4_000, 0, late), TimingVerdict::Inconclusive, "the rest is not few");
    assert_eq!(verdict(12_000, 12_000, 0, late), TimingVerdict::Inconclusive, "nor is the whole");
    assert_eq!(verdict(12_000, 12_000, 0, QUIET), TimingVerdict::Inconclusive, "nor sure a fail");
}

#[test]
fn what_the_program_loses_by_itself_fails_on_any_machine() {
    let late = slots(300, 10_000);
    let own = |own| verdict(12_000, 10_000, own, late);
    assert_eq!(own(1_600), TimingVerdict::Fail, "a stall of 3 ms in a thousand ticks");
    assert_eq!(own(400), TimingVerdict::Inconclusive);
}

#[test]
fn one_long_accident_fails_nobody() {
    let accident = |lapses| {
        let losses = Losses { slots: slots(170, 16_000), lapses };
        let account = Account { lost: losses, own: losses, certain: losses, ..Account::default() };
        Account { machine: QUIET, ..account }.verdict()
    };
    assert_eq!(accident(1), TimingVerdict::Inconclusive);
    assert_eq!(accident(2), TimingVerdict::Inconclusive);
    assert_eq!(accident(8), TimingVerdict::Fail);
}

/// What an ECU reports that lost these slots.
fn report(truck: u8, ticks: u64, lapses: &[(&str, u64, u64)]) -> Report {
    let lapses = lapses
        .iter()
        .map(|&(cause, times, slots)| (cause.to_owned(), controller_rt::Lapses { times, slots }));
    let mut report: Report = serde_json::from_value(serde_json::json!({
        "truck": truck, "rate_hz": 1000.0, "ending": "mission_ended", "ticks": ticks,
        "misses": 0, "skipped": 0, "dropped_records": 0, "recording_error": null,
        "realtime": null, "phase_us": {}, "miss_causes": {}, "skip_causes": {}, "guard": {},
        "qp": { "solves": 0, "failures": 0, "iterations_max": 0 },
        "received": controller_rt::InboxCounts::default(),
        "sent": controller_rt::OutboxCounts::default(), "receive_overflow": 0,
    }))
    .expect("a report");
    report.lapses = lapses.collect();
    report
}

fn judged(ecus: &[Report]) -> Timing {
    Timing::new(ecus, &Floor { cpus: Vec::new() }, 1_000_000, (0.0, "auto".into()))
}

#[test]
fn a_stall_on_one_of_four_ecus_fails_although_together_they_lose_little() {
    let mut ecus: Vec<Report> = (0..4).map(|truck| report(truck, 8_000, &[])).collect();
    assert_eq!(judged(&ecus).verdict, TimingVerdict::Pass);
    ecus[1] = report(1, 8_000, &[("law", 8, 24)]);
    let timing = judged(&ecus);
    assert_eq!(timing.verdict, TimingVerdict::Fail);
    assert!(timing.lost_share.0 < LATE_SHARE_MAX, "all together: {timing:?}");
    let verdicts: Vec<_> = timing.ecus.iter().map(|ecu| ecu.verdict).collect();
    use TimingVerdict::{Fail, Pass};
    assert_eq!(verdicts, [Pass, Fail, Pass, Pass]);
}

#[test]
fn what_an_unseen_pause_could_have_been_is_not_held_against_the_program() {
    let single = [report(0, 8_000, &[("law", 40, 40)])];
    let late = CpuFloor {
        cpu: 0,
        policy: Policy::Fifo,
        priority: 81,
        refused: Vec::new(),
        lateness_ns: [vec![10_000; 9_900], vec![900_000; 100]].concat().into_iter().fold(
            Histogram::new(3).expect("three digits"),
            |mut lateness, ns| {
                lateness += ns;
                lateness
            },
        ),
        slept_through: 0,
    };
    let floor = Floor { cpus: vec![late] };
    let verdict = |ecus: &[Report], period_ns| {
        Timing::new(ecus, &floor, period_ns, (0.0, "auto".into())).verdict
    };
    assert_eq!(verdict(&single, 1_000_000), TimingVerdict::Inconclusive);
    let in_twos = [report(0, 8_000, &[("law", 10, 20)])];
    assert_eq!(verdict(&in_twos, 1_000_000), TimingVerdict::Fail);
    assert_eq!(verdict(&in_twos, 100_000), TimingVerdict::Inconclusive, "10 kHz");
    let in_sixes = [report(0, 8_000, &[("law", 10, 60)])];
    assert_eq!(verdict(&in_sixes, 100_000), TimingVerdict::Fail);
}

#[test]
fn short_runs_of_many_ecus_pass_together() {
    let ecus: Vec<Report> = (0..4).map(|truck| report(truck, 1_000, &[])).collect();
    let timing = judged(&ecus);
    assert_eq!(timing.verdict, TimingVerdict::Pass);
    assert_eq!(timing.ecus[0].verdict, TimingVerdict::Inconclusive, "1000 slots tell little");
}

#[test]
fn pauses_of_the_machine_cost_an_ecu_its_pass_only_when_they_are_many() {
    let paused = |slots| judged(&[report(0, 8_000, &[("host_pause", slots / 4, slots)])]);
    let few = paused(80);
    assert_eq!((few.verdict, few.lost, few.denied, few.own), (TimingVerdict::Pass, 80, 80, 0));
    assert!(few.net_share.1 < LATE_SHARE_MAX && few.lost_share.0 > LATE_SHARE_MAX, "{few:?}");
    assert_eq!(paused(400).verdict, TimingVerdict::Inconclusive);
}

#[test]
fn a_queue_that_nobody_explains_is_no_pause_of_the_machine() {
    let queued = judged(&[report(0, 8_000, &[("run_queue", 20, 80)])]);
    assert_eq!(queued.verdict, TimingVerdict::Inconclusive, "without a sentinel nobody knows");
    assert_eq!((queued.denied, queued.own, queued.lost), (0, 0, 80));
}

#[test]
fn strict_timing_makes_three_ends_of_one() {
    use TimingVerdict::{Fail, Inconclusive, Pass, Virtual};
    let end = |timing: TimingVerdict, behaviour| timing.strictly(behaviour).ok();
    assert_eq!(end(Pass, Verdict::Pass), Some(Verdict::Pass));
    assert_eq!(end(Virtual, Verdict::Pass), Some(Verdict::Pass));
    assert_eq!(end(Fail, Verdict::Pass), Some(Verdict::Fail));
    assert_eq!(end(Inconclusive, Verdict::Fail), Some(Verdict::Fail));
    assert_eq!(end(Inconclusive, Verdict::Pass), None);
}

#[test]
fn wilsons_interval_matches_the_published_example() {
    // 15 of 148: (0.0624, 0.1605) [R. G. Newcombe, Statistics in Medicine 17 (1998), table I].
    let (low, high) = Share { events: 15, trials: 148 }.interval();
    assert!((low - 0.0624).abs() < 1e-4 && (high - 0.1605).abs() < 1e-4, "{low} {high}");
}
