//! The V2V radio between the trucks: delayed, lossy, seeded.
//!
//! Truck i's ECU broadcasts; every other truck that listens to i has a link of its own with its
//! own delay and its own losses. A follower listens to the trucks that lead it, or that it follows,
//! at any time of the scenario.
//! A lost message is simply never delivered: the receiver's last one ages.

mod delay;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::noise::{Dice, Stream};
use crate::scenario::V2v;
use delay::{Delay, Measured};

/// Messages one link can have under way; a longer queue drops the newest and counts it.
const UNDER_WAY_MAX: usize = 256;

/// How much earlier than its period after the last one a radio passes a message on \[s\]: half of
/// what lies between two broadcasts of an ECU, so that one that comes a little early is not held
/// back for another 20 ms.
const PERIOD_TOLERANCE_S: f64 = 0.01;

/// What became of a broadcast.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Broadcast {
    /// On its way to every listener (or lost on some links).
    Sent,
    /// The radio's period has not gone by yet.
    Thinned,
    /// Generated later than now, or not after the last one: refused.
    Refused,
}

/// The delays and losses a channel really produced.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ChannelReport {
    /// Shortest measured delay, delivery minus generation \[s\]; `None` when nothing was delivered.
    pub delay_min_s: Option<f64>,
    /// Longest measured delay \[s\].
    pub delay_max_s: Option<f64>,
    /// Largest measured slope of the delay \[s/s\], over at least 0.25 s of generation time.
    pub max_abs_rate: Option<f64>,
    /// Messages delivered, over all links.
    pub delivered: u64,
    /// Messages lost on purpose, over all links.
    pub lost: u64,
    /// Messages dropped because a link's queue was full.
    pub overflowed: u64,
    /// Broadcasts refused because their generation time was impossible.
    pub refused: u64,
}

/// Every radio link of the platoon, carrying messages of type `M`.
#[derive(Debug, Clone)]
pub(crate) struct Channel<M> {
    links: Vec<Link<M>>,
    newest_ns: Vec<Option<u64>>,
    period_min_ns: u64,
    refused: u64,
}

#[derive(Debug, Clone)]
struct Link<M> {
    from: usize,
    to: usize,
    delay: Delay,
    loss: f64,
    loss_dice: Dice,
    under_way: VecDeque<UnderWay<M>>,
    measured: Measured,
    delivered: u64,
    lost: u64,
    overflowed: u64,
}

#[derive(Debug, Clone, Copy)]
struct UnderWay<M> {
    generated_ns: u64,
    due_ns: u64,
    message: M,
}

impl<M: Copy> Channel<M> {
    /// The links of trucks that listen to these sources each, every one of them seeded by itself.
    pub(crate) fn new(
        settings: &V2v,
        sources: &[Vec<usize>],
        base_step_ns: u64,
        seed: u64,
    ) -> Self {
        let listens = |(to, sources): (usize, &Vec<usize>)| -> Vec<(usize, usize)> {
            sources.iter().map(|&from| (from, to)).collect()
        };
        let mut links: Vec<(usize, usize)> = sources.iter().enumerate().flat_map(listens).collect();
        links.sort_unstable();
        let link = |ends| Link::new(settings, ends, base_step_ns, seed);
        Self {
            links: links.into_iter().map(link).collect(),
            newest_ns: vec![None; sources.len()],
            period_min_ns: ((settings.period_s - PERIOD_TOLERANCE_S) * 1e9) as u64,
            refused: 0,
        }
    }

    /// Truck `from` broadcasts a message it generated at `generated_ns`; it is now `now_ns`.
    pub(crate) fn broadcast(
        &mut self,
        from: usize,
        generated_ns: u64,
        now_ns: u64,
        message: M,
    ) -> Broadcast {
        if let Some(last_ns) = self.newest_ns[from]
            && generated_ns > last_ns
            && generated_ns - last_ns < self.period_min_ns
        {
            return Broadcast::Thinned;
        }
        let stale = self.newest_ns[from].is_some_and(|last_ns| generated_ns <= last_ns);
        if stale || generated_ns > now_ns {
            self.refused += 1;
            return Broadcast::Refused;
        }
        self.newest_ns[from] = Some(generated_ns);
        for link in self.links.iter_mut().filter(|link| link.from == from) {
            link.send(generated_ns, message);
        }
        Broadcast::Sent
    }

    /// Whether anybody has ever broadcast here.
    pub(crate) fn has_carried(&self) -> bool {
        self.newest_ns.iter().any(Option::is_some)
    }

    /// Hands every message that is due at `now_ns` to `receive(to, message)`, oldest first on each
    /// link.
    pub(crate) fn deliver(&mut self, now_ns: u64, mut receive: impl FnMut(usize, &M)) {
        for link in &mut self.links {
            while let Some(message) = link.next_due(now_ns) {
                receive(link.to, &message);
            }
        }
    }

    /// The delay of the newest message delivered from one truck to another \[s\].
    pub(crate) fn newest_delay_s(&self, from: usize, to: usize) -> Option<f64> {
        let link = self.links.iter().find(|link| link.from == from && link.to == to)?;
        link.measured.newest_ns.map(seconds)
    }

    /// What the channel really did so far.
    pub(crate) fn report(&self) -> ChannelReport {
        let links = &self.links;
        let lows = links.iter().filter_map(|link| link.measured.range_ns.map(|r| r.0));
        let highs = links.iter().filter_map(|link| link.measured.range_ns.map(|r| r.1));
        let rates = links.iter().filter_map(|link| link.measured.rate_max);
        ChannelReport {
            delay_min_s: lows.min().map(seconds),
            delay_max_s: highs.max().map(seconds),
            max_abs_rate: rates.max_by(f64::total_cmp),
            delivered: links.iter().map(|link| link.delivered).sum(),
            lost: links.iter().map(|link| link.lost).sum(),
            overflowed: links.iter().map(|link| link.overflowed).sum(),
            refused: self.refused,
        }
    }
}

impl<M: Copy> Link<M> {
    fn new(settings: &V2v, (from, to): (usize, usize), base_step_ns: u64, seed: u64) -> Self {
        let delay_dice = Dice::new(seed, Stream::Delay { from, to });
        Self {
            from,
            to,
            delay: Delay::new(settings, base_step_ns, delay_dice),
            loss: settings.loss,
            loss_dice: Dice::new(seed, Stream::Loss { from, to }),
            under_way: VecDeque::with_capacity(UNDER_WAY_MAX),
            measured: Measured::new(),
            delivered: 0,
            lost: 0,
            overflowed: 0,
        }
    }

    fn send(&mut self, generated_ns: u64, message: M) {
        let due_ns = generated_ns + self.delay.at(generated_ns);
        if self.loss_dice.uniform() < self.loss {
            self.lost += 1;
        } else if self.under_way.len() == UNDER_WAY_MAX {
            self.overflowed += 1;
        } else {
            self.under_way.push_back(UnderWay { generated_ns, due_ns, message });
        }
    }

    /// The oldest message if it is due; a link's delay changes slower than time, so messages never
    /// overtake one another.
    fn next_due(&mut self, now_ns: u64) -> Option<M> {
        let first = *self.under_way.front()?;
        if first.due_ns > now_ns {
            return None;
        }
        self.under_way.pop_front();
        self.measured.take(first.generated_ns, now_ns);
        self.delivered += 1;
        Some(first.message)
    }
}

fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_NS: u64 = 1_000_000;

    fn settings() -> V2v {
        V2v { delay_min_s: 0.015, delay_max_s: 0.150, ..V2v::default() }
    }

    /// To, from, generated at, delivered at.
    type Delivery = (usize, usize, u64, u64);

    /// Runs a channel for `seconds`, every truck broadcasting each 20 ms.
    fn run(settings: &V2v, seed: u64, seconds: u64) -> (Channel<(usize, u64)>, Vec<Delivery>) {
        let sources = [vec![], vec![0], vec![0, 1], vec![2, 0]];
        let mut channel = Channel::new(settings, &sources, STEP_NS, seed);
        let mut log = Vec::new();
        for step in 0..seconds * 1000 {
            let now_ns = step * STEP_NS;
            if step % 20 == 0 {
                for truck in 0..4 {
                    channel.broadcast(truck, now_ns, now_ns, (truck, now_ns));
                }
            }
            let later_ns = now_ns + STEP_NS;
            channel.deliver(later_ns, |to, &(from, at)| log.push((to, from, at, later_ns)));
        }
        (channel, log)
    }

    #[test]
    fn measured_delays_keep_their_bounds_and_their_rate() {
        for seed in 0..20 {
            let (channel, log) = run(&settings(), seed, 110);
            let report = channel.report();
            let (low, high) = (report.delay_min_s.expect("low"), report.delay_max_s.expect("high"));
            assert!((0.015 - 1e-12..0.03).contains(&low), "{low}");
            assert!(high <= 0.150 + 1e-12 && high > 0.135, "{high}");
            let rate = report.max_abs_rate.expect("rate");
            assert!(rate <= 0.2 + 1e-12 && rate > 0.15, "{rate}");
            let shortest = log.iter().map(|&(_, _, at, when)| when - at).min();
            assert_eq!(shortest.map(seconds), Some(low));
        }
    }

    #[test]
    fn every_truck_hears_its_sources_only() {
        let (_, log) = run(&settings(), 3, 5);
        let mut pairs: Vec<_> = log.iter().map(|&(to, from, ..)| (to, from)).collect();
        pairs.sort_unstable();
        pairs.dedup();
        assert_eq!(pairs, [(1, 0), (2, 0), (2, 1), (3, 0), (3, 2)]);
    }

    #[test]
    fn messages_of_a_link_arrive_in_order_and_links_differ() {
        let (_, log) = run(&settings(), 4, 60);
        let of = |to, from| log.iter().filter(move |l| (l.0, l.1) == (to, from));
        for (to, from) in [(1, 0), (2, 0), (2, 1), (3, 0), (3, 2)] {
            assert!(of(to, from).zip(of(to, from).skip(1)).all(|(a, b)| a.2 < b.2));
        }
        let delays = |to, from| -> Vec<u64> { of(to, from).map(|l| l.3 - l.2).collect() };
        assert_ne!(delays(2, 0), delays(3, 0));
    }

    #[test]
    fn a_seed_repeats_and_another_differs() {
        assert_eq!(run(&settings(), 9, 10).1, run(&settings(), 9, 10).1);
        assert_ne!(run(&settings(), 9, 10).1, run(&settings(), 10, 10).1);
    }

    #[test]
    fn no_added_delay_means_the_next_base_step() {
        let none = V2v { delay_min_s: 0.0, delay_max_s: 0.0, ..settings() };
        let (channel, _) = run(&none, 1, 5);
        let report = channel.report();
        assert_eq!((report.delay_min_s, report.delay_max_s), (Some(0.001), Some(0.001)));
        assert_eq!(report.max_abs_rate, Some(0.0));
    }

    #[test]
    fn loss_takes_its_share_and_leaves_the_delays_alone() {
        let (lossless, _) = run(&settings(), 5, 100);
        let (lossy, log) = run(&V2v { loss: 0.3, ..settings() }, 5, 100);
        let report = lossy.report();
        let share = report.lost as f64 / (report.lost + report.delivered) as f64;
        assert!((share - 0.3).abs() < 0.02, "{share}");
        assert!(report.delay_max_s <= lossless.report().delay_max_s);
        assert_eq!(log.len() as u64, report.delivered);
    }

    #[test]
    fn a_slower_radio_thins_the_broadcasts() {
        let (channel, _) = run(&V2v { period_s: 0.1, ..settings() }, 5, 100);
        let expected = 5 * 1000;
        assert!(channel.report().delivered.abs_diff(expected) < 20);
    }

    #[test]
    fn impossible_generation_times_are_refused() {
        let mut channel = Channel::new(&settings(), &[vec![], vec![0]], STEP_NS, 1);
        assert_eq!(channel.broadcast(0, 2, 1, ()), Broadcast::Refused);
        assert_eq!(channel.broadcast(0, 100, 100, ()), Broadcast::Sent);
        assert_eq!(channel.broadcast(0, 100, 200, ()), Broadcast::Refused);
        assert_eq!(channel.report().refused, 2);
    }
}
