//! Which parts of a run a merged trace keeps whole.
//!
//! In the spans of a [`Focus`] everything is kept. Elsewhere the world, the scene and gap markers
//! are, ticks and decoded signals are thinned, and the frames and snapshots, by far the most of a
//! trace, are left out. Messages keep their numbers, so a reader sees the gaps.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::topic::Topic;

/// Spans of bench time that are kept whole, and what remains of the rest.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Focus {
    /// The spans \[ns\], earliest first, none overlapping.
    pub spans: Vec<Range<u64>>,
    /// Elsewhere, least bench time between two ticks of an ECU, and between two decoded messages of
    /// one kind on one bus \[ns\].
    pub period_ns: u64,
}

impl Focus {
    /// Whether all of this instant of bench time \[ns\] is kept.
    #[must_use]
    pub fn holds(&self, time_ns: u64) -> bool {
        let behind = self.spans.partition_point(|span| span.start <= time_ns);
        self.spans[..behind].last().is_some_and(|span| time_ns < span.end)
    }
}

/// Decides message by message, in the order of the merge.
#[derive(Debug, Default)]
pub(crate) struct Sieve {
    focus: Option<Focus>,
    /// Bench time from which the next tick of an ECU is kept \[ns\].
    due_ns: BTreeMap<Topic, u64>,
}

impl Sieve {
    pub(crate) fn new(focus: Option<Focus>) -> Self {
        Self { focus, due_ns: BTreeMap::new() }
    }

    /// The period that this instant's messages are thinned to \[ns\]; `None` when all are kept.
    pub(crate) fn period_ns(&self, time_ns: u64) -> Option<u64> {
        let focus = self.focus.as_ref().filter(|focus| !focus.holds(time_ns))?;
        Some(focus.period_ns)
    }

    /// Whether a recorded message is kept.
    pub(crate) fn keeps(&mut self, topic: Topic, time_ns: u64) -> bool {
        let Some(period_ns) = self.period_ns(time_ns) else { return true };
        match topic {
            Topic::Truth | Topic::Dropped(_) => true,
            Topic::Frames(_) | Topic::Rx(_) | Topic::Memory(_) => false,
            Topic::Tick(_) => {
                let due_ns = self.due_ns.entry(topic).or_default();
                let is_due = time_ns >= *due_ns;
                if is_due {
                    *due_ns = time_ns.saturating_add(period_ns);
                }
                is_due
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn spans_are_kept_whole_and_the_rest_is_thinned() {
        let focus = Focus { spans: vec![10 * MS..20 * MS, 40 * MS..50 * MS], period_ns: 10 * MS };
        let mut sieve = Sieve::new(Some(focus));
        let mut kept = |topic| (0..60).filter(|ms| sieve.keeps(topic, ms * MS)).count();
        assert_eq!(kept(Topic::Frames(0)), 20);
        assert_eq!(kept(Topic::Memory(0)), 20);
        assert_eq!(kept(Topic::Tick(0)), 20 + 4, "one of 0-9, two of 20-39, one of 50-59");
        assert_eq!(kept(Topic::Truth), 60);
    }

    #[test]
    fn without_a_focus_all_is_kept() {
        assert!(Sieve::default().keeps(Topic::Frames(3), 5));
    }
}
