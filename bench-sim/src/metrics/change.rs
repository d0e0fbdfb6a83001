//! How long the trucks take to settle after a change of the roster.
//!
//! A change lasts from its event until everything it moves has got there; changes that overlap
//! count as one. Settled is who is within all bands (position, speed, lateral) until the next
//! change begins.

use crate::scenario::Event;

/// The changes of a scenario, and where the run is among them.
#[derive(Debug, Clone, Default)]
pub(super) struct Changes {
    /// Beginning and end of each \[ns\], in order, apart from one another.
    spans: Vec<(u64, u64)>,
    begun: usize,
}

/// What one truck's settling comes to.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Settling {
    longest_ns: u64,
    outside: bool,
    failed: bool,
}

/// Where an instant lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Before the first change, or while one is going on.
    Unjudged,
    /// This long after the end of a change \[ns\].
    After(u64),
}

impl Changes {
    pub(super) fn new(events: &[Event]) -> Self {
        let ns = |time_s: f64| (time_s * 1e9) as u64;
        let mut spans: Vec<(u64, u64)> = Vec::new();
        for event in events.iter().filter(|event| event.at_s > 0.0) {
            let (begin_ns, end_ns) = (ns(event.at_s), ns(event.until_s()));
            match spans.last_mut().filter(|span| begin_ns <= span.1) {
                Some(span) => span.1 = span.1.max(end_ns),
                None => spans.push((begin_ns, end_ns)),
            }
        }
        Self { spans, begun: 0 }
    }

    /// Where this instant lies; instants come in order.
    pub(super) fn phase(&mut self, time_ns: u64) -> Phase {
        while self.spans.get(self.begun).is_some_and(|span| time_ns >= span.0) {
            self.begun += 1;
        }
        match self.begun.checked_sub(1).map(|newest| self.spans[newest].1) {
            Some(end_ns) if time_ns >= end_ns => Phase::After(time_ns - end_ns),
            _ => Phase::Unjudged,
        }
    }
}

impl Settling {
    /// Takes in whether the truck is outside of a band at an instant.
    pub(super) fn sample(&mut self, phase: Phase, outside: bool) {
        match phase {
            Phase::After(since_ns) => {
                self.outside = outside;
                if outside {
                    self.longest_ns = self.longest_ns.max(since_ns);
                }
            }
            // The next change found it outside.
            Phase::Unjudged => self.failed |= core::mem::take(&mut self.outside),
        }
    }

    /// The longest time after a change \[s\]; `None` when it did not settle before the next one.
    pub(super) fn finish_s(&self) -> Option<f64> {
        (!self.failed && !self.outside).then_some(self.longest_ns as f64 * 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn settle(outside: impl Fn(u64) -> bool) -> Option<f64> {
        let event = |at_s, over_s| Event { at_s, over_s, ..Event::default() };
        let events = [event(0.0, 0.0), event(10.0, 5.0), event(12.0, 8.0), event(40.0, 2.0)];
        let mut changes = Changes::new(&events);
        let mut settling = Settling::default();
        for second in 0..60 {
            settling.sample(changes.phase(second * S), outside(second));
        }
        settling.finish_s()
    }

    #[test]
    fn changes_that_overlap_are_one_and_before_the_first_nothing_counts() {
        let mut changes = Changes::new(&[
            Event { at_s: 10.0, over_s: 5.0, ..Event::default() },
            Event { at_s: 12.0, over_s: 8.0, ..Event::default() },
        ]);
        let phases = [5, 10, 17, 20, 23].map(|second| changes.phase(second * S));
        let after = |s: u64| Phase::After(s * S);
        assert_eq!(phases[..3], [Phase::Unjudged; 3]);
        assert_eq!(phases[3..], [after(0), after(3)]);
    }

    #[test]
    fn the_longest_settling_counts() {
        assert_eq!(settle(|_| false), Some(0.0));
        assert_eq!(settle(|second| second < 26 || (40..45).contains(&second)), Some(5.0));
    }

    #[test]
    fn who_is_outside_when_the_next_change_begins_or_the_run_ends_never_settled() {
        assert_eq!(settle(|second| (30..42).contains(&second)), None);
        assert_eq!(settle(|second| second == 59), None);
    }
}
