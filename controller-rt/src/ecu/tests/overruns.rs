//! What the loop does about overruns, and why it says they happened, on scripted clocks.

use super::*;

/// A thread that computes whenever its clock moves on.
struct Busy(Arc<BenchClock>);

impl Witness for Busy {
    fn thread(&self) -> Option<ThreadTotals> {
        Some(ThreadTotals { cpu_ns: self.0.now_ns(), ..ThreadTotals::default() })
    }

    fn standstill_ns(&self, _from_ns: u64, _to_ns: u64) -> u64 {
        0
    }
}

/// A run of so many published states in which one QP is slow: report, times the law was asked for,
/// frames sent.
pub(super) fn run_with(
    overruns: Overruns,
    ticks: u64,
    slow: Option<(u64, u64)>,
) -> (Report, Vec<u64>, Vec<Message>) {
    let clock = Arc::new(BenchClock::default());
    let slow = slow.map(|(at_ns, takes_ns)| (at_ns, takes_ns, Arc::clone(&clock)));
    let scripted = Scripted { slow, drift_n: 1.0, ..Scripted::default() };
    let asked_ns = Arc::clone(&scripted.asked_ns);
    let (rig, bus) = Loopback::pair("loopback0", 1024);
    let config = Config { overruns, ..Config::default() };
    let ecu = Ecu::new(config, Box::new(bus), Box::new(scripted), None)
        .witnessed_by(Box::new(Busy(Arc::clone(&clock))));
    let mut rig = Rig { bus: rig, counters: [0; 9] };
    rig.send(&mission(RunState::Running));
    rig.send(&ego(0));
    *clock.rig.lock().expect("not poisoned") = Some((rig, 1));
    clock.publishes.store(ticks, Ordering::Relaxed);
    let report = run(ecu, &*clock, &AtomicBool::new(false));
    let asked_ns = asked_ns.lock().expect("not poisoned").clone();
    let heard = core::mem::take(&mut *clock.heard.lock().expect("not poisoned"));
    (report, asked_ns, heard)
}

/// A QP at 1 s takes 4.7 ms.
const SLOW: Option<(u64, u64)> = Some((1_000 * MS, 4_700_000));

fn policy(policy: OnOverrun) -> Overruns {
    Overruns { policy, ..Overruns::default() }
}

/// Bench times \[ms\] from 999 ms on for which the law was asked.
fn asked_ms(asked_ns: &[u64], count: usize) -> Vec<u64> {
    asked_ns.iter().map(|ns| ns / MS).filter(|&ms| ms >= 999).take(count).collect()
}

#[test]
fn skip_sends_the_late_command_and_passes_over_what_is_past() {
    let (report, asked_ns, heard) = run_with(policy(OnOverrun::Skip), 1_100, SLOW);
    assert_eq!((report.misses, report.skipped, report.held_ticks), (1, 4, 0));
    assert_eq!(asked_ms(&asked_ns, 3), [999, 1_000, 1_005]);
    let late = commands(&heard).into_iter().find(|command| command.0 == 1_000);
    assert!(late.is_some_and(|command| command.1 == 2_000.0), "{late:?}");
}

#[test]
fn hold_sends_the_command_before_instead_of_the_late_one() {
    let (report, asked_ns, heard) = run_with(policy(OnOverrun::Hold), 1_100, SLOW);
    assert_eq!((report.misses, report.skipped, report.held_ticks), (1, 4, 1));
    assert_eq!(asked_ms(&asked_ns, 3), [999, 1_000, 1_005]);
    let forces: Vec<(u32, f64)> = commands(&heard)
        .into_iter()
        .filter(|command| (999..=1_005).contains(&command.0))
        .map(|command| (command.0, command.1))
        .collect();
    assert_eq!(forces, [(999, 1_999.0), (1_000, 1_999.0), (1_005, 2_001.0)]);
}

#[test]
fn abort_ends_the_run_when_more_slots_are_lost_than_allowed() {
    let run = |grace_ns, allowed| {
        let overruns = Overruns { policy: OnOverrun::Abort, grace_ns, allowed };
        let (report, asked_ns, _) = run_with(overruns, 1_100, SLOW);
        (report.ending, report.forgiven, asked_ns.last().map(|ns| ns / MS))
    };
    assert_eq!(run(0, 0), (Ending::Overrun, 0, Some(1_000)));
    assert_eq!(run(0, 4), (Ending::Overrun, 0, Some(1_005)), "one miss and four skipped");
    assert_eq!(run(0, 5).0, Ending::RigSilent);
    let (ending, forgiven, _) = run(1_500 * MS, 0);
    assert_eq!((ending, forgiven), (Ending::RigSilent, 5), "all within the startup grace");
}

#[test]
fn queue_makes_up_for_every_slot_in_a_bounded_burst() {
    let (report, asked_ns, _) = run_with(policy(OnOverrun::Queue), 1_100, SLOW);
    assert_eq!((report.misses, report.skipped), (4, 0), "the slots queued behind it are late too");
    assert_eq!(asked_ms(&asked_ns, 7), [999, 1_000, 1_001, 1_002, 1_003, 1_004, 1_005]);
    let (report, _, _) = run_with(policy(OnOverrun::Queue), 1_100, Some((1_000 * MS, 40 * MS)));
    let most = u64::from(QUEUE_SLOTS_MAX);
    assert_eq!(report.skipped, 39 - most, "a longer queue is cut");
}

#[test]
fn the_report_names_the_policy_and_shows_the_worst_miss() {
    let (report, ..) = run_with(policy(OnOverrun::Hold), 1_100, SLOW);
    assert_eq!(report.on_overrun, OnOverrun::Hold);
    let [worst] = report.worst_misses.as_slice() else { panic!("{:?}", report.worst_misses) };
    assert_eq!((worst.tick, worst.cause.as_str(), worst.late_us), (1_000, "law", 3_700.0));
    assert_eq!(worst.cpu_us, 4_700.0);
    let qp_end = worst.timeline_us.iter().find(|(name, _)| name == "qp");
    assert_eq!(qp_end.map(|(_, end_us)| *end_us), Some(4_700.0));
}

#[test]
fn without_a_witness_no_cause_is_claimed() {
    let clock = Arc::new(BenchClock::default());
    let scripted =
        Scripted { slow: Some((100 * MS, 4_700_000, Arc::clone(&clock))), ..Scripted::default() };
    let (mut rig, ecu) = ecu_with(scripted);
    rig.send(&mission(RunState::Running));
    rig.send(&ego(0));
    *clock.rig.lock().expect("not poisoned") = Some((rig, 1));
    clock.publishes.store(200, Ordering::Relaxed);
    let report = run(ecu, &*clock, &AtomicBool::new(false));
    assert_eq!(report.miss_causes["unattributed"], 1);
    assert_eq!(report.thread, None);
}
