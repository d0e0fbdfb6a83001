//! What happens when an ECU dies or hangs, in virtual time: to its truck, and to those behind it.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use platoon::summary::{Summary, Verdict};
use traces::{TruckTruth, TruthRecord};

use crate::bench::{self, Run};

/// When the ECU of a follower dies \[s\]: every follower is in its lane then.
const DEATH_S: f64 = 20.0;
/// By when the rig must have noticed \[s\].
const NOTICED_S: f64 = DEATH_S + 0.1;
/// When the leader's dies \[s\]: on the line between the lanes, and at the end of its lane change.
const LEADER_DEATHS_S: [f64; 2] = [16.0, 20.0];
/// For how long the truck then coasts \[s\].
const COAST_S: f64 = 0.2;
/// What the brakes take to build up, several drive lags \[s\].
const BUILD_UP_S: f64 = 1.5;
/// How long these runs last \[s\], in the words of the command line.
const DURATION: &str = "60";
/// Time between two samples of the truth \[s\].
const SAMPLE_S: f64 = 0.01;

/// A run in which the ECU of one truck died.
struct Death {
    truck: usize,
    code: Option<i32>,
    summary: Summary,
    topics: BTreeMap<String, usize>,
    truth: Vec<TruthRecord>,
}

impl Death {
    fn of(truck: usize, at_s: f64) -> Self {
        let run = with_fault(&format!("faults-kill-{truck}"), DURATION, &kill(truck, at_s));
        Self {
            truck,
            code: run.code(),
            summary: run.summary(),
            topics: run.messages_by_topic(),
            truth: run.truth(),
        }
    }

    /// The killed truck between two bench times.
    fn between(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = (f64, &TruckTruth)> {
        self.truth
            .iter()
            .map(|truth| (truth.time_ns as f64 * 1e-9, &truth.trucks.as_slice()[self.truck]))
            .filter(move |(time_s, _)| (from_s..to_s).contains(time_s))
    }

    /// When it came to a standstill \[s\].
    fn standstill_s(&self) -> f64 {
        let standing = self.between(0.0, f64::INFINITY).find(|(_, t)| t.forward_mps == 0.0);
        standing.expect("it stops").0
    }
}

/// The deaths of the followers; each is run once, for all the tests that look at it.
static DEATHS: [LazyLock<Death>; 3] = [
    LazyLock::new(|| Death::of(1, DEATH_S)),
    LazyLock::new(|| Death::of(2, DEATH_S)),
    LazyLock::new(|| Death::of(3, DEATH_S)),
];

fn kill(truck: usize, at_s: f64) -> String {
    format!("kill-ecu@{at_s}:truck={truck}")
}

fn with_fault(name: &str, duration_s: &str, fault: &str) -> Run {
    let arguments =
        ["--seed", "1001", "--rate-hz", "100", "--duration-s", duration_s, "--fault", fault];
    bench::rehearse_virtually(name, &arguments)
}

/// Trucks whose ECU left a report.
fn reporting(summary: &Summary) -> Vec<usize> {
    summary.ecus.iter().map(|ecu| usize::from(ecu.truck)).collect()
}

/// A run goes on without the ECU that died.
fn ran_to_its_end(summary: &Summary) -> bool {
    let duration_s: f64 = DURATION.parse().expect("a number");
    (summary.duration_s - duration_s).abs() < 1e-6
}

fn lost_commands(summary: &Summary) -> Vec<u32> {
    summary.trucks.iter().map(|truck| truck.lost_commands).collect()
}

#[test]
fn a_dead_ecu_fails_the_run_and_is_named() {
    for death in DEATHS.iter().map(LazyLock::force) {
        let (truck, summary) = (death.truck, &death.summary);
        assert_eq!((death.code, summary.verdict), (Some(1), Verdict::Fail));
        assert!(ran_to_its_end(summary), "{} s", summary.duration_s);
        let others: Vec<usize> = (0..4).filter(|other| *other != truck).collect();
        assert_eq!(reporting(summary), others);
        let losses: Vec<u32> = (0..4).map(|other| u32::from(other == truck)).collect();
        assert_eq!(lost_commands(summary), losses);
        for word in [kill(truck, DEATH_S).as_str(), "1 ECU(s) ended without a report"] {
            assert!(summary.notes.iter().any(|note| note.contains(word)), "{:?}", summary.notes);
        }
    }
}

#[test]
fn a_dead_ecu_leaves_a_whole_trace() {
    for death in DEATHS.iter().map(LazyLock::force) {
        let complaints: Vec<_> =
            death.summary.notes.iter().filter(|note| note.contains("recording")).collect();
        assert!(complaints.is_empty(), "{complaints:?}");
        for truck in 0..4 {
            let ticks = death.topics[&format!("/ecu{truck}/tick")];
            let lived = if truck == death.truck { 2000 } else { 6000 };
            assert!((lived - 2..=lived + 2).contains(&ticks), "ECU {truck} ticked {ticks} times");
        }
    }
}

#[test]
fn a_truck_without_commands_coasts_within_a_tenth_of_a_second_and_then_brakes() {
    for death in DEATHS.iter().map(LazyLock::force) {
        let is_neutral = |t: &TruckTruth| t.force_command_n == 0.0 && t.steering_command_rad == 0.0;
        let mut coasting =
            death.between(DEATH_S, 30.0).skip_while(|(_, t)| !is_neutral(t)).peekable();
        let noticed_s = coasting.peek().expect("it coasts").0;
        let (braking_s, braking) = coasting.find(|(_, t)| !is_neutral(t)).expect("it brakes");
        assert!(noticed_s <= NOTICED_S + 1e-9, "truck {}: {noticed_s} s", death.truck);
        let coasted_s = braking_s - noticed_s;
        assert!((coasted_s - COAST_S).abs() <= SAMPLE_S, "truck {}: {coasted_s} s", death.truck);
        assert!(braking.force_command_n < 0.0 && braking.steering_command_rad == 0.0);
    }
}

#[test]
fn a_truck_without_commands_stops_at_four_metres_per_second_squared_and_stays() {
    for death in DEATHS.iter().map(LazyLock::force) {
        let standstill_s = death.standstill_s();
        let braking: Vec<_> = death
            .between(NOTICED_S + COAST_S + BUILD_UP_S, standstill_s)
            .map(|(time_s, truck)| (time_s, truck.forward_mps))
            .collect();
        // The speed at the last samples is no full sample's worth of braking.
        let window = 50;
        assert!(braking.len() > 2 * window, "truck {}: too short to judge", death.truck);
        for span in braking[..braking.len() - 1].windows(window) {
            let ((from_s, from_mps), (to_s, to_mps)) = (span[0], span[window - 1]);
            let decel_mps2 = (from_mps - to_mps) / (to_s - from_s);
            assert!(
                (decel_mps2 - 4.0).abs() <= 0.5,
                "truck {} at {from_s} s: {decel_mps2} m/s2",
                death.truck
            );
        }
        let mut standing = death.between(standstill_s, f64::INFINITY);
        let (_, first) = standing.next().expect("a standstill");
        let place = (first.x_m, first.y_m);
        assert!(
            standing.all(|(_, truck)| truck.forward_mps == 0.0 && (truck.x_m, truck.y_m) == place)
        );
    }
}

#[test]
fn a_truck_without_commands_straightens_its_wheels_and_keeps_its_lane() {
    for death in DEATHS.iter().map(LazyLock::force) {
        for (time_s, truck) in death.between(NOTICED_S + 1.0, f64::INFINITY) {
            assert!(truck.steering_rad.abs() < 1e-3, "{} rad at {time_s} s", truck.steering_rad);
            assert!(truck.y_m.abs() < 0.5, "truck {}: Y = {} m", death.truck, truck.y_m);
        }
    }
}

#[test]
fn nobody_hits_a_truck_that_stopped_because_its_ecu_died() {
    for death in DEATHS.iter().map(LazyLock::force) {
        for truck in &death.summary.trucks {
            let gap_m = truck.min_truck_gap_m.expect("four trucks have gaps");
            assert!(gap_m > 0.0, "ECU {} died: truck {} {gap_m} m", death.truck, truck.index);
        }
    }
}

#[test]
fn a_leader_that_dies_between_two_lanes_stops_and_is_reported() {
    for at_s in LEADER_DEATHS_S {
        let death = Death::of(0, at_s);
        let (_, dying) = death.between(at_s, at_s + 0.1).next().expect("it was alive");
        assert!((0.5..3.5).contains(&dying.y_m), "not between two lanes: Y = {} m", dying.y_m);
        assert_eq!((death.code, death.summary.verdict), (Some(1), Verdict::Fail));
        assert!(ran_to_its_end(&death.summary), "{} s", death.summary.duration_s);
        assert_eq!(reporting(&death.summary), [1, 2, 3]);
        assert_eq!(lost_commands(&death.summary)[0], 1);
        assert!(death.summary.criteria.iter().any(|criterion| !criterion.passed));
        assert!(death.topics["/ecu0/tick"] > 0);
        assert!(death.standstill_s() > at_s);
    }
}

#[test]
fn a_pause_of_fifty_milliseconds_costs_nothing() {
    let run = with_fault("faults-pause-50-ms", "110", "pause-ecu@20+0.05:truck=2");
    run.expect_code(0);
    let summary = run.summary();
    assert_eq!(lost_commands(&summary), [0; 4]);
    assert_eq!(reporting(&summary), [0, 1, 2, 3]);
}

#[test]
fn a_pause_of_half_a_second_is_noticed() {
    let run = with_fault("faults-pause-500-ms", DURATION, "pause-ecu@20+0.5:truck=2");
    run.expect_code(1);
    let summary = run.summary();
    assert_eq!(lost_commands(&summary), [0, 0, 1, 0]);
    assert_eq!(reporting(&summary), [0, 1, 2, 3], "it came back and ended in order");
    assert_eq!(summary.trucks[2].final_speed_mps, 0.0, "a truck that began to stop stays stopped");
    let refused = summary.nodes[2].ignored_while_stopping;
    assert!(refused > 3000, "{refused} commands refused after it came back");
}

#[test]
fn a_pause_shorter_than_the_coasting_is_noticed_and_survived() {
    let run = with_fault("faults-pause-200-ms", DURATION, "pause-ecu@20+0.2:truck=2");
    run.expect_code(1);
    let summary = run.summary();
    assert_eq!(lost_commands(&summary), [0, 0, 1, 0]);
    assert_eq!(summary.nodes[2].ignored_while_stopping, 0);
    assert!(summary.trucks[2].final_speed_mps > 10.0, "it drives on");
}
