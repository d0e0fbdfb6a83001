//! `rehearse --capture`: the whole of a run only around what is worth a look.
//!
//! Everything is recorded while the run is on, since what happens cannot be known before; the merge
//! then keeps full rate around the events that were asked for, and of the rest what curves and the
//! scene need. A span kept begins with the ECUs' snapshot before it, so that it replays.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use controller_rt::SNAPSHOT_PERIOD_NS;
use traces::{
    Focus, GuardReason, Reader, Record, TickOutcome, TickRecord, Topic, TruckTruth, TruthRecord,
};

use crate::cli::CaptureArgs;

/// Metadata record of a merged run that was kept whole in spans only.
pub const CAPTURE: &str = "platoon.capture";
/// Outside the spans, least bench time between two ticks of an ECU or two decoded messages of one
/// kind \[ns\].
const REST_PERIOD_NS: u64 = 100_000_000;
/// Events told one by one.
const TOLD_MAX: usize = 5;

/// What makes a moment worth keeping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trigger {
    /// `miss`: a command came late, or a tick was passed over.
    Miss,
    /// `qp-fail`: a QP reached its iteration cap or had no feasible point.
    QpFail,
    /// `guard`: the guard changed a command.
    Guard,
    /// `clearance<M`: a truck is nearer to an obstacle than this \[m\].
    Clearance(f64),
    /// `error>M`: a truck is further from its place behind the truck ahead than this \[m\].
    Error(f64),
}

impl FromStr for Trigger {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let metres = |text: &str| {
            let number: Option<f64> = text.trim().parse().ok();
            number.filter(|metres| metres.is_finite() && *metres >= 0.0)
        };
        let known = match word.trim() {
            "miss" => Some(Self::Miss),
            "qp-fail" => Some(Self::QpFail),
            "guard" => Some(Self::Guard),
            word => match word.split_once(['<', '>']) {
                Some(("clearance", limit)) if word.contains('<') => {
                    metres(limit).map(Self::Clearance)
                }
                Some(("error", limit)) if word.contains('>') => metres(limit).map(Self::Error),
                _ => None,
            },
        };
        known
            .ok_or_else(|| "give miss, qp-fail, guard, clearance<METRES or error>METRES".to_owned())
    }
}

impl fmt::Display for Trigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Miss => write!(f, "miss"),
            Self::QpFail => write!(f, "qp-fail"),
            Self::Guard => write!(f, "guard"),
            Self::Clearance(limit_m) => write!(f, "clearance<{limit_m}"),
            Self::Error(limit_m) => write!(f, "error>{limit_m}"),
        }
    }
}

impl Trigger {
    /// Whether it is so in a tick; `None` when ticks do not tell.
    fn of_tick(self, tick: &TickRecord) -> Option<bool> {
        match self {
            Self::Miss => Some(tick.missed || tick.skipped > 0),
            Self::QpFail => {
                Some(matches!(tick.outcome, TickOutcome::IterationCap | TickOutcome::Infeasible))
            }
            // Before and after its mission an ECU sends what the guard makes of nothing.
            Self::Guard => {
                Some(!matches!(tick.guard_reason, GuardReason::None | GuardReason::NoMission))
            }
            Self::Clearance(_) | Self::Error(_) => None,
        }
    }

    /// Whether it is so of a truck in the world; `None` when the world does not tell.
    fn of_truck(self, truck: &TruckTruth) -> Option<bool> {
        match self {
            Self::Clearance(limit_m) => Some(truck.obstacle_clearance_m < limit_m),
            Self::Error(limit_m) => Some(truck.predecessor_error_m.abs() > limit_m),
            Self::Miss | Self::QpFail | Self::Guard => None,
        }
    }
}

/// The beginning of something that was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Event {
    time_ns: u64,
    truck: u8,
    trigger: Trigger,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time_s = 1e-9 * self.time_ns as f64;
        write!(f, "{} of truck {} at {time_s:.3} s", self.trigger, self.truck)
    }
}

/// What happened that was asked for, and what is kept of the run because of it.
#[derive(Debug, Default)]
pub struct Captured {
    events: Vec<Event>,
    spans: Vec<Range<u64>>,
}

impl Captured {
    /// Looks through what each process recorded. A part that cannot be read has no events; the
    /// merge says so.
    pub fn of(parts: &[PathBuf], asked: &CaptureArgs) -> Self {
        let mut search = Search::new(asked);
        parts.iter().for_each(|part| search.read(part));
        search.finish()
    }

    /// What the merge is to keep.
    pub fn focus(&self) -> Focus {
        Focus { spans: self.spans.clone(), period_ns: REST_PERIOD_NS }
    }

    /// The metadata record of the trace.
    pub fn metadata(&self, asked: &CaptureArgs) -> BTreeMap<String, String> {
        let s = |time_ns: u64| 1e-9 * time_ns as f64;
        let span = |span: &Range<u64>| format!("{:.3}-{:.3}", s(span.start), s(span.end));
        [
            ("asked", asked.to_string()),
            ("events", self.events.len().to_string()),
            ("spans_s", list(&self.spans, span)),
            ("spans_ns", list(&self.spans, |span| format!("{}-{}", span.start, span.end))),
            ("rest_period_ns", REST_PERIOD_NS.to_string()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }
}

fn list(spans: &[Range<u64>], told: impl Fn(&Range<u64>) -> String) -> String {
    spans.iter().map(told).collect::<Vec<_>>().join(", ")
}

impl fmt::Display for Captured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.events.is_empty() {
            return write!(f, "captured: nothing happened that --capture names");
        }
        let whole_s: f64 = self.spans.iter().map(|s| 1e-9 * (s.end - s.start) as f64).sum();
        let told = self.events.iter().take(TOLD_MAX).map(Event::to_string).collect::<Vec<_>>();
        write!(f, "captured at full rate: {whole_s:.1} s around {}", told.join(", "))?;
        match self.events.len() - told.len() {
            0 => Ok(()),
            more => write!(f, ", and {more} more"),
        }
    }
}

/// Goes through records in the order of each part.
struct Search<'a> {
    asked: &'a CaptureArgs,
    found: Captured,
    /// What is going on, by trigger and truck.
    going_on: BTreeSet<(usize, u8)>,
}

impl<'a> Search<'a> {
    fn new(asked: &'a CaptureArgs) -> Self {
        Self { asked, found: Captured::default(), going_on: BTreeSet::new() }
    }

    fn read(&mut self, part: &Path) {
        let Ok(reader) = Reader::open(part) else { return };
        let is_asked = |topic| matches!(topic, Topic::Truth | Topic::Tick(_));
        let reader = reader.with_channels(move |channel| channel.kind.is_some_and(is_asked));
        for message in reader {
            match message.record() {
                Ok(Record::Tick(tick)) => self.tick(&tick),
                Ok(Record::Truth(truth)) => self.truth(&truth),
                _ => {}
            }
        }
    }

    fn tick(&mut self, tick: &TickRecord) {
        self.note(tick.time_ns, tick.ecu, |trigger| trigger.of_tick(tick));
    }

    fn truth(&mut self, truth: &TruthRecord) {
        for (index, truck) in truth.trucks.iter().enumerate() {
            self.note(truth.time_ns, index as u8, |trigger| trigger.of_truck(truck));
        }
    }

    fn note(&mut self, time_ns: u64, truck: u8, is_so: impl Fn(Trigger) -> Option<bool>) {
        for (number, &trigger) in self.asked.capture.iter().enumerate() {
            match is_so(trigger) {
                Some(true) => {
                    self.keep_around(time_ns);
                    if self.going_on.insert((number, truck)) {
                        self.found.events.push(Event { time_ns, truck, trigger });
                    }
                }
                Some(false) => {
                    self.going_on.remove(&(number, truck));
                }
                None => {}
            }
        }
    }

    /// Keeps what leads up to an instant, from the snapshot before on, and what follows.
    fn keep_around(&mut self, time_ns: u64) {
        let ns = |time_s: f64| (1e9 * time_s) as u64;
        let from_ns = time_ns.saturating_sub(ns(self.asked.capture_before));
        let start = from_ns / SNAPSHOT_PERIOD_NS * SNAPSHOT_PERIOD_NS;
        let end = time_ns.saturating_add(ns(self.asked.capture_after)).saturating_add(1);
        match self.found.spans.last_mut() {
            // Most of the time it goes on where it was a tick before.
            Some(last) if (last.start..=last.end).contains(&start) => last.end = last.end.max(end),
            _ => self.found.spans.push(start..end),
        }
    }

    fn finish(mut self) -> Captured {
        self.found.events.sort_by_key(|event| event.time_ns);
        self.found.spans.sort_by_key(|span| span.start);
        let mut spans: Vec<Range<u64>> = Vec::new();
        for span in self.found.spans {
            match spans.last_mut() {
                Some(last) if span.start <= last.end => last.end = last.end.max(span.end),
                _ => spans.push(span),
            }
        }
        Captured { spans, ..self.found }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn asked(words: &str) -> CaptureArgs {
        let words = words.split(',').map(|word| word.parse().expect("a word")).collect();
        CaptureArgs { capture: words, capture_before: 2.0, capture_after: 1.0 }
    }

    #[test]
    fn words_are_read_as_they_are_written_and_others_refused() {
        for word in ["miss", "qp-fail", "guard", "clearance<0.75", "error>1"] {
            assert_eq!(word.parse::<Trigger>().expect("known").to_string(), word);
        }
        for word in ["", "misses", "clearance>1", "error<1", "clearance<", "clearance<-1", "x<1"] {
            assert!(word.parse::<Trigger>().is_err(), "{word}");
        }
    }

    #[test]
    fn a_span_reaches_from_the_snapshot_before_an_event_to_some_time_behind_it() {
        let asked = asked("miss,qp-fail");
        let mut search = Search::new(&asked);
        let tick = |time_s: u64, ecu: u8, missed: bool| TickRecord {
            time_ns: time_s * S,
            ecu,
            missed,
            ..TickRecord::default()
        };
        for (time_s, missed) in [(11, false), (33, true), (34, true), (35, false), (75, true)] {
            search.tick(&tick(time_s, 1, missed));
        }
        search.tick(&TickRecord { outcome: TickOutcome::Infeasible, ..tick(35, 2, false) });
        let found = search.finish();
        assert_eq!(found.spans, [30 * S..36 * S + 1, 70 * S..76 * S + 1]);
        let told: Vec<String> = found.events.iter().map(Event::to_string).collect();
        let expected = [
            "miss of truck 1 at 33.000 s",
            "qp-fail of truck 2 at 35.000 s",
            "miss of truck 1 at 75.000 s",
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn the_world_tells_of_clearances_and_errors() {
        let asked = asked("clearance<1,error>0.5");
        let mut search = Search::new(&asked);
        let mut truth = TruthRecord { time_ns: 5 * S, ..TruthRecord::default() };
        for (obstacle_clearance_m, predecessor_error_m) in [(0.9, 0.0), (3.0, -0.6)] {
            let truck =
                TruckTruth { obstacle_clearance_m, predecessor_error_m, ..TruckTruth::default() };
            truth.trucks.push(truck).expect("room");
        }
        search.truth(&truth);
        search.tick(&TickRecord { time_ns: 5 * S, ..TickRecord::default() });
        search.truth(&TruthRecord { time_ns: 6 * S, ..truth });
        let found = search.finish();
        assert_eq!(found.events.len(), 2, "{found}");
        assert_eq!(found.spans.first(), Some(&(0..7 * S + 1)));
        assert_eq!(found.spans.len(), 1);
    }
}
