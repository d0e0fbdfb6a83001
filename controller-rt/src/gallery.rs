//! The worst misses of a run, with what is known of each.

use serde::{Deserialize, Serialize};
use traces::MissCause;

use crate::inquest::{Finding, Work};
use crate::laps::PhaseTimes;
use crate::pacer::Slot;

/// How many are kept.
pub const GALLERY_SIZE: usize = 8;

/// The worst misses so far, worst first; allocates nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Gallery {
    worst: [Option<Exhibit>; GALLERY_SIZE],
}

#[derive(Debug, Clone, Copy)]
struct Exhibit {
    slot: Slot,
    times: PhaseTimes,
    work: Work,
    finding: Finding,
}

impl Gallery {
    /// Keeps a tick that missed its deadline if it is among the worst.
    pub fn consider(&mut self, slot: &Slot, times: &PhaseTimes, work: Work, finding: &Finding) {
        if finding.miss == MissCause::None {
            return;
        }
        let (slot, times, finding) = (*slot, *times, *finding);
        let mut rest = Some(Exhibit { slot, times, work, finding });
        for place in &mut self.worst {
            let late_ns = |exhibit: &Option<Exhibit>| exhibit.map_or(0, |e| e.finding.late_ns);
            if late_ns(place) < late_ns(&rest) {
                core::mem::swap(place, &mut rest);
            }
        }
    }

    /// For the report; allocates.
    #[must_use]
    pub fn misses(&self) -> Vec<Miss> {
        self.worst.iter().flatten().map(Exhibit::miss).collect()
    }
}

/// One missed deadline. Times of the timeline count from the instant the tick was due.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Miss {
    /// Number of the tick.
    pub tick: u32,
    /// Bench time \[s\].
    pub time_s: f64,
    /// How long after the deadline the last frame was sent \[µs\].
    pub late_us: f64,
    /// The cause: a word of [`MissCause::word`].
    pub cause: String,
    /// Name of each phase that took place and when it ended \[µs\] after due.
    pub timeline_us: Vec<(String, f64)>,
    /// Frames taken from the bus.
    pub frames: u32,
    /// Iterations of the QP solver; none when no QP was solved.
    pub qp_iterations: Option<u32>,
    /// Time the thread waited for a CPU before its first instruction \[µs\].
    pub run_delay_wake_us: f64,
    /// The same between that and the last frame \[µs\].
    pub run_delay_us: f64,
    /// CPU time used \[µs\]; 0 when nobody knows.
    pub cpu_us: f64,
    /// How long the sentinel saw the machine stand still meanwhile \[µs\].
    pub standstill_us: f64,
    /// Handing the tick before to the recorder \[µs\].
    pub record_before_us: f64,
    /// Page faults served without I/O.
    pub minor_faults: u64,
    /// Page faults that read from a disk.
    pub major_faults: u64,
    /// Times the CPU was taken from the thread.
    pub involuntary_switches: u64,
}

impl Exhibit {
    fn miss(&self) -> Miss {
        let Self { slot, times, work, finding } = self;
        let us = |ns: u64| ns as f64 / 1e3;
        let during = &finding.during;
        Miss {
            tick: slot.number,
            time_s: slot.time_ns as f64 * 1e-9,
            late_us: us(finding.late_ns),
            cause: finding.miss.word().to_owned(),
            timeline_us: timeline_us(times),
            frames: work.frames,
            qp_iterations: work.iterations,
            run_delay_wake_us: us(finding.before.run_delay_ns),
            run_delay_us: us(during.run_delay_ns),
            cpu_us: us(during.cpu_ns),
            standstill_us: us(finding.standstill_ns),
            record_before_us: us(finding.record_before_ns),
            minor_faults: during.minor_faults,
            major_faults: during.major_faults,
            involuntary_switches: during.involuntary_switches,
        }
    }
}

/// When each phase ended \[µs\]; the whole tick is not one.
fn timeline_us(times: &PhaseTimes) -> Vec<(String, f64)> {
    let mut end_ns = 0;
    let took_place = times.named().into_iter().filter(|(name, _)| *name != "total");
    took_place
        .filter_map(|(name, took_ns)| {
            end_ns += took_ns?;
            Some((name.to_owned(), end_ns as f64 / 1e3))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn miss(gallery: &mut Gallery, number: u32, late_ns: u64) {
        let slot = Slot { number, has_deadline: true, ..Slot::default() };
        let times = PhaseTimes { wake_ns: 100_000, send_ns: late_ns, ..PhaseTimes::default() };
        let finding = Finding { miss: MissCause::Law, late_ns, ..Finding::default() };
        gallery.consider(&slot, &times, Work::default(), &finding);
    }

    #[test]
    fn the_worst_are_kept_worst_first() {
        let mut gallery = Gallery::default();
        for number in 0..100 {
            // Every lateness from 1 to 100 µs, in no order.
            miss(&mut gallery, number, 1_000 * u64::from(number * 37 % 100 + 1));
        }
        let late_us: Vec<f64> = gallery.misses().iter().map(|miss| miss.late_us).collect();
        assert_eq!(late_us, [100.0, 99.0, 98.0, 97.0, 96.0, 95.0, 94.0, 93.0]);
    }

    #[test]
    fn a_tick_in_time_is_no_exhibit_and_a_late_one_has_its_timeline() {
        let mut gallery = Gallery::default();
        let (slot, times) = (Slot::default(), PhaseTimes::default());
        gallery.consider(&slot, &times, Work::default(), &Finding::default());
        assert!(gallery.misses().is_empty());
        miss(&mut gallery, 7, 2_000);
        let shown = gallery.misses().remove(0);
        let ends: Vec<(&str, f64)> =
            shown.timeline_us.iter().map(|(name, end_us)| (name.as_str(), *end_us)).collect();
        let expected = [
            ("wake", 100.0),
            ("drain", 100.0),
            ("observe", 100.0),
            ("guard", 100.0),
            ("send", 102.0),
        ];
        assert_eq!((shown.cause.as_str(), ends), ("law", expected.to_vec()));
    }
}
