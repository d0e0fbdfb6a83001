//! The gallery of misses: the latest ticks of every ECU with what happened around them.

use serde::Serialize;
use traces::{MissCause, TickRecord};

use super::latency::Latency;

/// Phases of a tick in the order they happen, in the words of `summary.json`.
pub const PHASES: [&str; 7] = ["wake", "drain", "ucl", "lml_build", "qp", "guard", "send"];
/// Most events shown of a run.
const EVENTS_MAX: usize = 24;
/// Ticks shown before and after an event.
const AROUND: usize = 8;

/// When a tick happened and how long it took.
#[derive(Debug, Clone, Copy)]
struct Timed {
    time_ns: u64,
    tick: u32,
    skipped: u32,
    cause: MissCause,
    missed: bool,
    phases_ns: [u32; 7],
    total_ns: u32,
}

/// How late a tick was, and the ticks around it.
#[derive(Debug, Clone, Serialize)]
pub struct TimingEvent {
    ecu: u8,
    tick: u32,
    time_s: f64,
    /// Whether its command came late; otherwise only ticks before it were passed over.
    missed: bool,
    skipped: u32,
    cause: String,
    total_us: f64,
    around: Vec<Neighbour>,
}

/// A tick near an event.
#[derive(Debug, Clone, Serialize)]
struct Neighbour {
    tick: u32,
    skipped: u32,
    /// Duration of each phase \[µs\].
    phases_us: [f64; 7],
    total_us: f64,
}

/// Timing of every tick of one ECU.
#[derive(Debug, Clone, Default)]
pub struct TickTimes {
    ticks: Vec<Timed>,
}

impl TickTimes {
    /// Notes a tick.
    pub fn add(&mut self, tick: &TickRecord) {
        let phases_ns = [
            tick.wake_ns,
            tick.drain_ns.saturating_add(tick.observe_ns),
            tick.ucl_ns,
            tick.lml_build_ns,
            tick.qp_ns,
            tick.guard_ns,
            tick.send_ns,
        ];
        self.ticks.push(Timed {
            time_ns: tick.time_ns,
            tick: tick.tick,
            skipped: tick.skipped,
            cause: tick.miss_cause,
            missed: tick.missed,
            phases_ns,
            total_ns: tick.total_ns,
        });
    }

    /// The latencies of every phase and of the whole tick.
    pub fn latencies(&self, ecu: u8) -> Vec<Latency> {
        let phases = PHASES.iter().enumerate().map(|(index, phase)| {
            Latency::of(ecu, phase, self.ticks.iter().map(|t| t.phases_ns[index]).collect())
        });
        let whole = Latency::of(ecu, "total", self.ticks.iter().map(|t| t.total_ns).collect());
        phases.chain([whole]).flatten().collect()
    }

    /// Its misses and pauses, latest first.
    fn events(&self, ecu: u8) -> Vec<TimingEvent> {
        let is_late = |timed: &Timed| timed.missed || timed.skipped > 0;
        let places = 0..self.ticks.len();
        let mut late: Vec<usize> = places.filter(|place| is_late(&self.ticks[*place])).collect();
        late.sort_by_key(|place| std::cmp::Reverse(self.ticks[*place].total_ns));
        late.into_iter().take(EVENTS_MAX).map(|place| self.event(ecu, place)).collect()
    }

    fn event(&self, ecu: u8, place: usize) -> TimingEvent {
        let timed = &self.ticks[place];
        let from = place.saturating_sub(AROUND);
        let to = (place + AROUND + 1).min(self.ticks.len());
        let us = |ns: u32| 1e-3 * f64::from(ns);
        let neighbour = |near: &Timed| Neighbour {
            tick: near.tick,
            skipped: near.skipped,
            phases_us: near.phases_ns.map(us),
            total_us: us(near.total_ns),
        };
        TimingEvent {
            ecu,
            tick: timed.tick,
            time_s: 1e-9 * timed.time_ns as f64,
            missed: timed.missed,
            skipped: timed.skipped,
            cause: snake_case(&format!("{:?}", timed.cause)),
            total_us: us(timed.total_ns),
            around: self.ticks[from..to].iter().map(neighbour).collect(),
        }
    }
}

/// The latest events of all ECUs.
pub fn gallery(ecus: &[TickTimes]) -> Vec<TimingEvent> {
    let each = ecus.iter().enumerate().flat_map(|(ecu, times)| times.events(ecu as u8));
    let mut events: Vec<TimingEvent> = each.collect();
    events.sort_by(|a, b| b.total_us.total_cmp(&a.total_us));
    events.truncate(EVENTS_MAX);
    events
}

/// A variant's name as programs read it.
fn snake_case(name: &str) -> String {
    let mut words = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !words.is_empty() {
            words.push('_');
        }
        words.extend(letter.to_lowercase());
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gallery_has_the_latest_ticks_of_all_ecus_first() {
        let mut ecus = vec![TickTimes::default(), TickTimes::default()];
        for tick in 0..100u32 {
            let missed = tick == 50;
            let total_ns = if missed { 1_500_000 } else { 100_000 };
            let miss_cause = if missed { MissCause::Law } else { MissCause::None };
            ecus[0].add(&TickRecord {
                tick,
                missed,
                total_ns,
                miss_cause,
                ..TickRecord::default()
            });
            let (skipped, total_ns) = if tick == 3 { (2, 2_000_000) } else { (0, 100_000) };
            ecus[1].add(&TickRecord { tick, skipped, total_ns, ..TickRecord::default() });
        }
        let events = gallery(&ecus);
        let told: Vec<_> = events.iter().map(|e| (e.ecu, e.tick, e.cause.as_str())).collect();
        assert_eq!(told, [(1, 3, "none"), (0, 50, "law")]);
        assert_eq!(events[0].around.len(), 3 + 1 + AROUND, "the run began three ticks before");
        assert_eq!(events[1].around.len(), 2 * AROUND + 1);
    }
}
