//! The confusion matrix: what the ECU's own record says to every fault, counted.

use std::collections::BTreeMap;

use serde::Serialize;
use traces::{MissCause, TickRecord};

use super::kind::{Answer, Kind};
use super::strikes::Strike;
use crate::cli::Word;

/// Share of the attributed that must be right.
pub const RIGHT_SHARE_MIN: f64 = 0.95;
/// Share of the lost that may be unattributed.
pub const UNATTRIBUTED_SHARE_MAX: f64 = 0.10;

/// One kind of fault, and what was said to it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The kind.
    pub kind: Kind,
    /// Rate of the loop \[Hz\].
    pub rate_hz: u32,
    /// Ticks of the run.
    pub ticks: usize,
    /// Faults injected.
    pub faults: usize,
    /// Faults by answer, in the words of [`Answer::word`].
    pub answers: BTreeMap<String, usize>,
    /// Faults with the right answer.
    pub right: usize,
    /// Faults with an answer at all: a cause, or a stale tick where that is the right one.
    pub attributed: usize,
    /// Faults that cost a slot for which no cause was found.
    pub unattributed: usize,
    /// Lost slots that no fault explains, by the cause given: what the machine did meanwhile.
    pub elsewhere: BTreeMap<String, usize>,
    /// Causes given, anywhere in the run, that the tick's own record does not bear out.
    pub unfounded: usize,
}

/// A tick that lost its own slot or slots before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Loss {
    from_ns: u64,
    to_ns: u64,
    cause: MissCause,
}

impl Row {
    /// Judges a run: its strikes, and every tick of it after the first strike was due, in order.
    pub fn judge(kind: Kind, rate_hz: u32, strikes: &[Strike], ticks: &[TickRecord]) -> Self {
        let period_ns = 1_000_000_000 / u64::from(rate_hz);
        let losses: Vec<Loss> = ticks.iter().flat_map(|tick| losses(tick, period_ns)).collect();
        let mut row = Self {
            kind,
            rate_hz,
            ticks: ticks.len(),
            faults: strikes.len(),
            answers: BTreeMap::new(),
            right: 0,
            attributed: 0,
            unattributed: 0,
            elsewhere: BTreeMap::new(),
            unfounded: unfounded(ticks, period_ns),
        };
        for strike in strikes {
            row.count(answer(kind, strike, &losses, ticks, period_ns));
        }
        let is_explained =
            |loss: &Loss| strikes.iter().any(|strike| touches(strike, loss, period_ns));
        for loss in losses.iter().filter(|loss| !is_explained(loss)) {
            *row.elsewhere.entry(loss.cause.word().to_owned()).or_default() += 1;
        }
        row
    }

    fn count(&mut self, answer: Answer) {
        *self.answers.entry(answer.word().to_owned()).or_default() += 1;
        self.right += usize::from(self.kind.right().contains(&answer));
        match answer {
            Answer::Lost(MissCause::Unattributed | MissCause::None) => self.unattributed += 1,
            Answer::Lost(_) | Answer::Stale => self.attributed += 1,
            Answer::Nothing => (),
        }
    }

    /// Right answers among the attributed.
    pub fn right_share(&self) -> f64 {
        self.right as f64 / self.attributed.max(1) as f64
    }

    /// Unattributed among those that showed at all.
    pub fn unattributed_share(&self) -> f64 {
        self.unattributed as f64 / (self.attributed + self.unattributed).max(1) as f64
    }

    /// Whether it is as good as is asked: most causes right, few missing, none without evidence. A
    /// kind that never showed has proven nothing.
    pub fn is_good(&self) -> bool {
        let is_proven = self.kind == Kind::Undisturbed
            || (self.attributed > 0
                && self.right_share() >= RIGHT_SHARE_MIN
                && self.unattributed_share() <= UNATTRIBUTED_SHARE_MAX);
        is_proven && self.unfounded == 0
    }
}

/// What was lost at a tick: slots before it, the tick itself, or both.
fn losses(tick: &TickRecord, period_ns: u64) -> impl Iterator<Item = Loss> {
    let due_ns = tick.due_ns();
    let skipped = (tick.skipped > 0).then(|| Loss {
        from_ns: due_ns.saturating_sub(u64::from(tick.skipped) * period_ns),
        to_ns: due_ns,
        cause: tick.skip_cause,
    });
    let missed = tick.missed.then(|| Loss {
        from_ns: due_ns,
        to_ns: due_ns + u64::from(tick.total_ns),
        cause: tick.miss_cause,
    });
    skipped.into_iter().chain(missed)
}

/// Whether a loss is a strike's: it overlaps it, or begins within a period after it.
fn touches(strike: &Strike, loss: &Loss, period_ns: u64) -> bool {
    loss.to_ns >= strike.from_ns && loss.from_ns <= strike.to_ns + period_ns
}

/// The answer to one strike: the cause of the first slot it cost, or that it made a tick stale.
fn answer(
    kind: Kind,
    strike: &Strike,
    losses: &[Loss],
    ticks: &[TickRecord],
    period_ns: u64,
) -> Answer {
    if let Some(loss) = losses.iter().find(|loss| touches(strike, loss, period_ns)) {
        return Answer::Lost(loss.cause);
    }
    // Other faults delay the rig as well, which is not what they are judged by.
    let asks_for_stale = kind.right().contains(&Answer::Stale);
    let within = |tick: &&TickRecord| (strike.from_ns..=strike.to_ns).contains(&tick.due_ns());
    match ticks.iter().filter(within).any(|tick| tick.stale && asks_for_stale) {
        true => Answer::Stale,
        false => Answer::Nothing,
    }
}

/// Causes given that the records do not bear out.
fn unfounded(ticks: &[TickRecord], period_ns: u64) -> usize {
    let mut before = MissCause::None;
    let mut count = 0;
    for tick in ticks {
        let passed_on = |cause: MissCause| cause != MissCause::None && cause == before;
        // Slots may be passed over one by one, each by as little as nothing beyond what it may be
        // late; so there must be evidence for a skip, and for a miss enough of it.
        for (is_lost, cause, late_ns) in [
            (tick.skipped > 0, tick.skip_cause, 0),
            (tick.missed, tick.miss_cause, u64::from(tick.total_ns).saturating_sub(period_ns)),
        ] {
            let is_founded = passed_on(cause) || 2 * evidence_ns(tick, cause) > late_ns;
            count += usize::from(is_lost && cause != MissCause::Unattributed && !is_founded);
        }
        before = tick.miss_cause;
    }
    count
}

/// How much of a lateness the record of a tick lets a cause explain at most \[ns\].
fn evidence_ns(tick: &TickRecord, cause: MissCause) -> u64 {
    let sum = |parts: &[u32]| parts.iter().map(|part| u64::from(*part)).sum::<u64>();
    let wall_ns = u64::from(tick.total_ns).saturating_sub(tick.wake_ns.into());
    let off_cpu_ns = wall_ns.saturating_sub(sum(&[tick.cpu_ns, tick.run_delay_ns]));
    let computing_ns = [tick.observe_ns, tick.ucl_ns, tick.lml_build_ns, tick.qp_ns, tick.guard_ns];
    let when = |condition: bool, ns: u64| if condition { ns } else { 0 };
    match cause {
        MissCause::RunQueue => tick.run_delay_wake_ns.into(),
        MissCause::HostPause => u64::from(tick.sentinel_gap_ns) + off_cpu_ns,
        MissCause::CanWait => when(tick.voluntary_switches > 0, off_cpu_ns),
        MissCause::CanDrain => tick.drain_ns.into(),
        MissCause::Law => sum(&computing_ns),
        MissCause::QpIterations => when(tick.qp_iterations > 0, tick.qp_ns.into()),
        MissCause::PageFault => when(tick.minor_faults + tick.major_faults > 0, wall_ns),
        MissCause::Recorder => tick.record_before_ns.into(),
        MissCause::Preempted => tick.run_delay_ns.into(),
        MissCause::None | MissCause::Unattributed => 0,
    }
}

/// Prints the matrix and what it comes to.
pub fn print(rows: &[Row]) {
    let heads: String = Answer::ALL.iter().map(|answer| format!(" {:>5}", answer.head())).collect();
    anstream::println!("{:15}{heads}  {:>7} {:>6}  elsewhere", "fault", "right %", "? %");
    for row in rows {
        let count = |answer: &Answer| row.answers.get(answer.word()).copied().unwrap_or(0);
        let cells: String = Answer::ALL
            .iter()
            .map(|answer| match count(answer) {
                0 => format!(" {:>5}", "."),
                count => format!(" {count:>5}"),
            })
            .collect();
        let shares = match row.kind {
            Kind::Undisturbed => format!("{:>7} {:>6}", "", ""),
            _ => {
                let (right, missing) = (row.right_share(), row.unattributed_share());
                format!("{:>7.1} {:>6.1}", 100.0 * right, 100.0 * missing)
            }
        };
        let elsewhere: Vec<String> =
            row.elsewhere.iter().map(|(word, count)| format!("{word} {count}")).collect();
        anstream::println!("{:15}{cells}  {shares}  {}", row.kind.word(), elsewhere.join(", "));
    }
    let unfounded: usize = rows.iter().map(|row| row.unfounded).sum();
    anstream::println!("causes given without evidence in the tick's record: {unfounded}");
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// A run of so many punctual ticks at 1 kHz, the first due at 10 ms.
    fn run(ticks: u64) -> Vec<TickRecord> {
        let tick = |n: u64| TickRecord {
            tick: n as u32,
            time_ns: n * MS,
            due_offset_ns: 10 * MS as i64,
            total_ns: 100_000,
            ..TickRecord::default()
        };
        (0..ticks).map(tick).collect()
    }

    fn strike(from_us: u64, to_us: u64) -> Strike {
        Strike { from_ns: 1_000 * from_us, to_ns: 1_000 * to_us }
    }

    fn judge(kind: Kind, strikes: &[Strike], ticks: &[TickRecord]) -> Row {
        Row::judge(kind, 1_000, strikes, ticks)
    }

    #[test]
    fn a_loss_under_a_strike_answers_it_and_one_far_away_is_the_machines() {
        let mut ticks = run(60);
        for (n, skipped) in [(20, 2), (40, 1)] {
            ticks[n].skipped = skipped;
            ticks[n].skip_cause = MissCause::RunQueue;
            ticks[n].run_delay_wake_ns = 2_400_000;
        }
        let row = judge(Kind::RunQueueHog, &[strike(27_800, 30_300)], &ticks);
        assert_eq!((row.right, row.attributed, row.unattributed), (1, 1, 0));
        assert_eq!(row.elsewhere, BTreeMap::from([("run_queue".to_owned(), 1)]));
        assert!(row.is_good(), "{row:?}");
    }

    #[test]
    fn the_first_loss_of_a_strike_counts_and_those_that_follow_from_it_do_not() {
        let mut ticks = run(60);
        ticks[20].missed = true;
        ticks[20].total_ns = 2_600_000;
        ticks[20].miss_cause = MissCause::Unattributed;
        ticks[22].skipped = 1;
        ticks[22].skip_cause = MissCause::Law;
        let row = judge(Kind::LongLaw, &[strike(30_050, 32_550)], &ticks);
        assert_eq!((row.right, row.attributed, row.unattributed), (0, 0, 1));
        assert!(row.elsewhere.is_empty());
        assert!(!row.is_good());
    }

    #[test]
    fn a_late_frame_is_answered_by_a_stale_tick() {
        let mut ticks = run(60);
        ticks[20].stale = true;
        let strikes = [strike(29_500, 30_300), strike(40_500, 41_300)];
        let row = judge(Kind::LateFrame, &strikes, &ticks);
        assert_eq!((row.right, row.attributed, row.answers["nothing"]), (1, 1, 1));
        let row = judge(Kind::LongLaw, &strikes, &ticks);
        assert_eq!(row.answers["nothing"], 2, "stale ticks answer no other kind");
    }

    #[test]
    fn a_kind_that_never_shows_proves_nothing() {
        assert!(!judge(Kind::LongLaw, &[strike(30_050, 32_550)], &run(60)).is_good());
        assert!(judge(Kind::Undisturbed, &[], &run(60)).is_good());
    }

    #[test]
    fn a_cause_that_the_record_does_not_bear_out_is_unfounded() {
        let late = |cause| {
            let mut ticks = run(3);
            ticks[1] = TickRecord {
                missed: true,
                total_ns: 3_000_000,
                cpu_ns: 3_000_000,
                lml_build_ns: 2_900_000,
                miss_cause: cause,
                ..ticks[1]
            };
            ticks
        };
        let unfounded = |cause| judge(Kind::Undisturbed, &[], &late(cause)).unfounded;
        assert_eq!(unfounded(MissCause::Law), 0);
        assert_eq!(unfounded(MissCause::Unattributed), 0, "nothing is claimed");
        for cause in [
            MissCause::RunQueue,
            MissCause::HostPause,
            MissCause::CanWait,
            MissCause::CanDrain,
            MissCause::QpIterations,
            MissCause::PageFault,
            MissCause::Recorder,
            MissCause::Preempted,
        ] {
            assert_eq!(unfounded(cause), 1, "{cause:?}");
        }
        let mut ticks = late(MissCause::Law);
        (ticks[2].skipped, ticks[2].skip_cause) = (1, MissCause::Law);
        assert_eq!(judge(Kind::Undisturbed, &[], &ticks).unfounded, 0, "passed on");
    }
}
