//! How long each identifier can wait at worst.
//!
//! The analysis of Davis, Burns, Bril and Lukkien 2007, cited in full at [`worst_responses`]: every
//! instance within the busy period of a message's level is examined, because the first one need
//! not be the worst.
//!
//! ```text
//! busy    t    = B + sum over hp and m of n(t) C                                       [Eq. 10]
//! queue   w(q) = B + q C + sum over hp of n(w(q) + bit) C,    q = 0, 1, ...             [Eq. 12]
//! worst   R    = max over q of w(q) + C - a(q)
//! ```
//!
//! B is the longest frame that is less urgent (not to be interrupted once it is on its way), C the
//! own one, and bit the time within which frames still start together. Three things differ from
//! the paper:
//!
//! - R is counted from the queueing of the frame and not from the event before it: a jitter of
//!   100 ms is not the bus's doing. a(q) is the earliest that instance q can be queued.
//! - n(t), the most instances within a time t, is ceil((t + jitter) / period) as in the paper, but
//!   no more than ceil(t / distance) where a least distance between two of them is known (the
//!   event model of K. Richter, "Compositional scheduling analysis using standard event models",
//!   dissertation, TU Braunschweig, 2005). The n-th follows the first by no less than
//!   a(n) = max(n period - jitter, n distance).
//! - Other streams with the same identifier count as more urgent. In a first-in first-out queue
//!   only those queued before can go first, so this errs on the safe side.
//!
//! Offsets between streams are ignored: any phasing is thought possible. Errors on the bus are not
//! considered.

use super::Urgency;

/// A level that stays busy longer than this has no bound worth the name \[ns\].
const BUSY_MAX_NS: u64 = 60_000_000_000;

/// Frames of one kind that come again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Place in arbitration.
    pub urgency: Urgency,
    /// The longest of its frames \[ns\].
    pub duration_ns: u64,
    /// Mean time between two of them \[ns\]; not 0.
    pub period_ns: u64,
    /// How much later than its period says a frame may be queued \[ns\].
    pub jitter_ns: u64,
    /// Least time between the queueing of two frames \[ns\]; 0 when nothing but the jitter
    /// limits it.
    pub distance_ns: u64,
}

impl Stream {
    /// Share of the bus it takes.
    pub fn load(&self) -> f64 {
        self.duration_ns as f64 / self.period_ns as f64
    }

    /// The most frames queued within `span_ns`, its end not included.
    fn count_max(&self, span_ns: u64) -> u64 {
        let by_period = (span_ns + self.jitter_ns).div_ceil(self.period_ns);
        match self.distance_ns {
            0 => by_period,
            distance_ns => by_period.min(span_ns.div_ceil(distance_ns)),
        }
    }

    /// The least time between the queueing of one frame and that of the `number`-th after it.
    fn queued_ns(&self, number: u64) -> u64 {
        let by_period = (number * self.period_ns).saturating_sub(self.jitter_ns);
        by_period.max(number * self.distance_ns)
    }

    fn busy_ns(&self, span_ns: u64) -> u64 {
        self.count_max(span_ns).saturating_mul(self.duration_ns)
    }
}

/// Share of the bus that all streams take together; above 1 it cannot carry them.
pub fn load(streams: &[Stream]) -> f64 {
    streams.iter().map(Stream::load).sum()
}

/// For every stream the longest time from queueing a frame to the free bus after it \[ns\].
///
/// `None` for a stream that has no bound because it and the more urgent ones fill the bus.
/// `bit_ns` is one bit of arbitration. Offsets between streams are ignored, errors on the bus not
/// considered; streams of one identifier count as more urgent than each other.
///
/// The analysis of R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN)
/// schedulability analysis: Refuted, revisited and revised", Real-Time Systems 35(3), 239-272,
/// 2007, doi:10.1007/s11241-007-9012-7, with responses counted from queueing.
///
/// # Panics
/// If a period is 0.
pub fn worst_responses(streams: &[Stream], bit_ns: u64) -> Vec<Option<u64>> {
    (0..streams.len()).map(|index| Level::of(streams, index).worst_response_ns(bit_ns)).collect()
}

/// What one stream has to reckon with.
struct Level<'a> {
    own: &'a Stream,
    /// Those that go before it.
    before: Vec<&'a Stream>,
    blocking_ns: u64,
}

impl<'a> Level<'a> {
    fn of(streams: &'a [Stream], index: usize) -> Self {
        let own = &streams[index];
        let others = || streams.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, s)| s);
        let less_urgent = others().filter(|other| other.urgency > own.urgency);
        Self {
            own,
            before: others().filter(|other| other.urgency <= own.urgency).collect(),
            blocking_ns: less_urgent.map(|other| other.duration_ns).max().unwrap_or(0),
        }
    }

    fn worst_response_ns(&self, bit_ns: u64) -> Option<u64> {
        let load = self.own.load() + self.before.iter().map(|other| other.load()).sum::<f64>();
        if load >= 1.0 {
            return None;
        }
        let instances = self.own.count_max(self.busy_period_ns()?);
        let mut worst_ns = 0;
        let mut wait_ns = 0;
        for number in 0..instances {
            wait_ns = self.queueing_ns(number, wait_ns, bit_ns)?;
            let done_ns = wait_ns + self.own.duration_ns;
            worst_ns = worst_ns.max(done_ns.saturating_sub(self.own.queued_ns(number)));
        }
        Some(worst_ns)
    }

    /// How long frames of this level or a more urgent one can keep the bus without a pause.
    fn busy_period_ns(&self) -> Option<u64> {
        let everyone = || self.before.iter().copied().chain([self.own]);
        let start_ns = self.blocking_ns + everyone().map(|s| s.duration_ns).sum::<u64>();
        grow(start_ns, |span_ns| {
            self.blocking_ns + everyone().map(|s| s.busy_ns(span_ns)).sum::<u64>()
        })
    }

    /// How long instance `number` of the busy period waits from its start on; at least as long as
    /// the one before.
    fn queueing_ns(&self, number: u64, least_ns: u64, bit_ns: u64) -> Option<u64> {
        let own_ns = self.blocking_ns + number * self.own.duration_ns;
        grow(least_ns.max(own_ns), |wait_ns| {
            own_ns + self.before.iter().map(|s| s.busy_ns(wait_ns + bit_ns)).sum::<u64>()
        })
    }
}

/// The least fixed point at or above `start_ns` of a function that never falls; none within bounds.
fn grow(start_ns: u64, next: impl Fn(u64) -> u64) -> Option<u64> {
    let mut at_ns = start_ns;
    while at_ns <= BUSY_MAX_NS {
        let next_ns = next(at_ns);
        if next_ns <= at_ns {
            return Some(at_ns);
        }
        at_ns = next_ns;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn stream(id: u32, duration_us: u64, period_us: u64) -> Stream {
        Stream {
            urgency: Urgency::of_id(id, false),
            duration_ns: 1000 * duration_us,
            period_ns: 1000 * period_us,
            jitter_ns: 0,
            distance_ns: 0,
        }
    }

    fn milliseconds(worst: &[Option<u64>]) -> Vec<f64> {
        worst.iter().map(|ns| ns.map_or(f64::NAN, |ns| ns as f64 / MS as f64)).collect()
    }

    #[test]
    fn the_example_that_refuted_the_first_analysis_comes_out_as_published() {
        // Davis et al. 2007, section 3.2: the first instance of C takes 3 ms, the second 3.5 ms.
        let set = [stream(1, 1000, 2500), stream(2, 1000, 3500), stream(3, 1000, 3500)];
        assert_eq!(milliseconds(&worst_responses(&set, 8000)), [2.0, 3.0, 3.5]);
    }

    #[test]
    fn the_most_urgent_waits_for_the_longest_other_frame_and_itself() {
        let set = [stream(1, 200, 1000), stream(2, 400, 50_000), stream(3, 300, 50_000)];
        assert_eq!(worst_responses(&set, 2000)[0], Some(600_000));
    }

    #[test]
    fn jitter_lets_frames_queue_up_and_a_distance_thins_them() {
        let urgent = Stream { jitter_ns: 10 * MS, ..stream(1, 500, 10_000) };
        let set = |distance_ns| [Stream { distance_ns, ..urgent }, stream(2, 400, 10_000)];
        // Two urgent frames at once, unless they are a millisecond apart.
        let [together, apart] = [0, MS].map(|distance_ns| worst_responses(&set(distance_ns), 2000));
        assert_eq!(together, [Some(1_400_000), Some(1_400_000)]);
        assert_eq!(apart, [Some(900_000), Some(900_000)]);
    }

    #[test]
    fn streams_of_one_identifier_wait_for_each_other() {
        let set = [stream(5, 100, 10_000); 4];
        assert_eq!(worst_responses(&set, 2000), [Some(400_000); 4]);
    }

    #[test]
    fn what_fills_the_bus_leaves_no_bound_to_the_less_urgent() {
        let set = [stream(1, 500, 1000), stream(2, 500, 1000), stream(3, 100, 100_000)];
        assert!((load(&set) - 1.001).abs() < 1e-12);
        assert_eq!(worst_responses(&set, 2000), [Some(1_000_000), None, None]);
        let overload = [stream(1, 3000, 1000), stream(2, 100, 1000)];
        assert_eq!(worst_responses(&overload, 2000), [None, None]);
    }

    #[test]
    fn a_level_that_hardly_ever_ends_has_no_bound() {
        let nearly =
            [Stream { duration_ns: 999_999, ..stream(1, 0, 1000) }, stream(2, 100, 1_000_000_000)];
        assert!(load(&nearly) < 1.0);
        assert_eq!(worst_responses(&nearly, 2000)[1], None);
    }
}
