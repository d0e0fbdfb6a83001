//! Worst response times against emulated ones: whatever the phasing, jitter and length of the
//! frames, none may take longer than the bound; and bounds that nothing comes near are no use.

use std::collections::BTreeMap;

use bench_sim::Scenario;
use platoon::bus_plan::BusPlan;
use platoon_dbc::Profile;
use platoon_dbc::bus_time::{Arbiter, BusTiming, Request, Stream, Urgency, load, worst_responses};

use crate::random::Random;

const MS: u64 = 1_000_000;
/// Where the phasing that is meant to be bad comes together \[ns\].
const MEETING_NS: u64 = 10 * MS;
/// How long frames are queued in one trial \[ns\].
const HORIZON_NS: u64 = 60 * MS;
/// Frames of one trial that may wait: far more than any plan brings.
const WAITING_MAX: usize = 4096;

/// Streams on one bus, their bounds, and the longest response seen of each.
struct Contest {
    streams: Vec<Stream>,
    bounds_ns: Vec<Option<u64>>,
    longest_ns: Vec<u64>,
}

impl Contest {
    fn new(streams: Vec<Stream>, timing: BusTiming) -> Self {
        let bounds_ns = worst_responses(&streams, timing.bit_time_ns());
        let longest_ns = vec![0; streams.len()];
        Self { streams, bounds_ns, longest_ns }
    }

    /// Plays one phasing; panics when a frame takes longer than its bound.
    fn play(&mut self, random: &mut Random) {
        let mut queue =
            if random.below(2) == 0 { self.any_phasing(random) } else { self.bad_phasing(random) };
        queue.sort_by_key(|request| request.time_ns);
        let mut wire = Arbiter::new(WAITING_MAX);
        for request in queue {
            while let Some(done) = wire.advance(request.time_ns) {
                self.note(done.request.cargo, done.response_ns());
            }
            wire.request(request).expect("room for what a plan brings");
        }
        while let Some(done) = wire.advance(u64::MAX) {
            self.note(done.request.cargo, done.response_ns());
        }
    }

    fn note(&mut self, stream: usize, response_ns: u64) {
        self.longest_ns[stream] = self.longest_ns[stream].max(response_ns);
        if let Some(bound_ns) = self.bounds_ns[stream] {
            let own = &self.streams[stream];
            assert!(response_ns <= bound_ns, "{response_ns} > {bound_ns}: {own:?} in {self:#?}");
        }
    }

    /// Any phase and any jitter for every stream.
    fn any_phasing(&self, random: &mut Random) -> Vec<Request<usize>> {
        (0..self.streams.len()).flat_map(|index| self.scattered(index, random)).collect()
    }

    /// All that may go before some stream comes together with it, as densely as it can, just after
    /// the longest of the less urgent has begun.
    fn bad_phasing(&self, random: &mut Random) -> Vec<Request<usize>> {
        let level = self.streams[random.below(self.streams.len())].urgency;
        let is_full = random.below(4) > 0;
        let mut queue = Vec::new();
        for (index, stream) in self.streams.iter().enumerate() {
            if stream.urgency > level {
                queue.extend(self.scattered(index, random));
            } else {
                for number in 0.. {
                    let since_ns = (number * stream.period_ns)
                        .saturating_sub(stream.jitter_ns)
                        .max(number * stream.distance_ns);
                    if since_ns > HORIZON_NS {
                        break;
                    }
                    queue.push(self.request(index, MEETING_NS + since_ns, is_full, random));
                }
            }
        }
        let below = (0..self.streams.len()).filter(|&i| self.streams[i].urgency > level);
        if let Some(blocking) = below.max_by_key(|&i| self.streams[i].duration_ns) {
            // Alone of its kind: the others could be too close to it.
            queue.retain(|request| request.cargo != blocking);
            queue.push(self.request(blocking, MEETING_NS - 1, true, random));
        }
        queue
    }

    /// One stream with any phase, each frame as late as its jitter allows or less.
    fn scattered(&self, index: usize, random: &mut Random) -> Vec<Request<usize>> {
        let stream = &self.streams[index];
        // It began long enough before for anything that may still be late from then.
        let began_ns = (stream.jitter_ns / stream.period_ns + 1) * stream.period_ns;
        let phase_ns = random.up_to(stream.period_ns);
        let always_late = random.below(3) == 0;
        let (mut queue, mut last_ns) = (Vec::new(), None);
        for number in 0.. {
            let due_ns = phase_ns + number * stream.period_ns;
            if due_ns > began_ns + HORIZON_NS {
                break;
            }
            let late_ns =
                if always_late { stream.jitter_ns } else { random.up_to(stream.jitter_ns) };
            let earliest_ns = last_ns.map_or(0, |last_ns| last_ns + stream.distance_ns);
            let queued_ns = (due_ns + late_ns).max(earliest_ns);
            last_ns = Some(queued_ns);
            if let Some(time_ns) = queued_ns.checked_sub(began_ns) {
                queue.push(self.request(index, time_ns, false, random));
            }
        }
        queue
    }

    fn request(
        &self,
        index: usize,
        time_ns: u64,
        is_full: bool,
        random: &mut Random,
    ) -> Request<usize> {
        let Stream { urgency, duration_ns, .. } = self.streams[index];
        let shorter_ns =
            if is_full || random.below(2) == 0 { 0 } else { random.up_to(duration_ns / 2) };
        let duration_ns = duration_ns - shorter_ns;
        Request { time_ns, node: 0, urgency, duration_ns, cargo: index }
    }

    /// Bound over longest response seen, of every identifier that was seen and has a bound.
    fn ratios(&self) -> Vec<f64> {
        let mut worst: BTreeMap<Urgency, (Option<u64>, u64)> = BTreeMap::new();
        for ((stream, bound_ns), longest_ns) in
            self.streams.iter().zip(&self.bounds_ns).zip(&self.longest_ns)
        {
            let of_identifier = worst.entry(stream.urgency).or_insert((Some(0), 0));
            of_identifier.0 = of_identifier.0.zip(*bound_ns).map(|(a, b)| a.max(b));
            of_identifier.1 = of_identifier.1.max(*longest_ns);
        }
        let seen = worst.into_values().filter(|(_, longest_ns)| *longest_ns > 0);
        seen.filter_map(|(bound_ns, longest_ns)| Some(bound_ns? as f64 / longest_ns as f64))
            .collect()
    }
}

impl std::fmt::Debug for Contest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.streams.iter().zip(&self.bounds_ns)).finish()
    }
}

/// What the fullest bus of the main scenario carries.
fn planned(profile: Profile, rate_hz: u32) -> Contest {
    let scenario = Scenario::load("obstacle-avoidance", &[]).expect("built in");
    let plan = BusPlan::of(&scenario, profile, rate_hz, false);
    let fullest = plan.trucks().len() - 1;
    Contest::new(plan.streams(fullest, profile.timing()), profile.timing())
}

/// A set of messages nobody planned; not all of it need fit the bus.
fn any_set(random: &mut Random) -> Contest {
    const PERIODS_MS: [u64; 7] = [1, 2, 5, 10, 20, 50, 100];
    let timings = [BusTiming::classic(500_000), BusTiming::fd(500_000, 2_000_000)];
    let timing = timings[random.below(timings.len())];
    let identifiers = 1 + random.below(12);
    let stream = |random: &mut Random| {
        let period_ns = PERIODS_MS[random.below(PERIODS_MS.len())] * MS;
        Stream {
            // Some have an identifier in common.
            urgency: Urgency::of_id(random.below(identifiers) as u32, false),
            duration_ns: 100_000 + random.up_to(300_000),
            period_ns,
            jitter_ns: if random.below(2) == 0 { 0 } else { random.up_to(2 * period_ns) },
            distance_ns: if random.below(2) == 0 { 0 } else { random.up_to(period_ns / 2) },
        }
    };
    let mut streams: Vec<Stream> = (0..1 + random.below(12)).map(|_| stream(random)).collect();
    while load(&streams) > 1.1 {
        streams.pop();
    }
    Contest::new(streams, timing)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Plays `trials` phasings, and returns the median of bound over longest response of the plans.
fn play(trials: usize, seed: u64) -> f64 {
    let mut random = Random::new(seed);
    let mut plans =
        [(Profile::Fd, 1000), (Profile::J1939, 100)].map(|(profile, hz)| planned(profile, hz));
    let (mut set, mut any) = (any_set(&mut random), Vec::new());
    for trial in 0..trials {
        match trial % 4 {
            0 => plans[0].play(&mut random),
            1 => plans[1].play(&mut random),
            _ => set.play(&mut random),
        }
        if trial % 40 == 0 {
            any.extend(set.ratios());
            set = any_set(&mut random);
        }
    }
    let ratios: Vec<f64> = plans.iter().flat_map(Contest::ratios).collect();
    println!("bound over longest response of the plans: {ratios:.3?}");
    println!("its median over {} identifiers of any sets: {:.3}", any.len(), median(any));
    median(ratios)
}

#[test]
fn no_emulated_response_is_longer_than_its_bound_in_10_000_phasings() {
    let median = play(10_000, 1);
    assert!(median < 1.1, "the bounds are {median} times what is ever seen");
}

#[test]
#[ignore = "a million phasings take minutes: ./test.sh --long"]
fn heavy_no_emulated_response_is_longer_than_its_bound_in_1_000_000_phasings() {
    let median = play(1_000_000, 2);
    assert!(median < 1.1, "the bounds are {median} times what is ever seen");
}

#[test]
fn the_most_urgent_message_reaches_its_bound() {
    for (profile, rate_hz) in [(Profile::Fd, 1000), (Profile::J1939, 100)] {
        let mut contest = planned(profile, rate_hz);
        let most_urgent = (0..contest.streams.len())
            .min_by_key(|&index| contest.streams[index].urgency)
            .expect("not empty");
        let mut random = Random::new(3);
        (0..2000).for_each(|_| contest.play(&mut random));
        let bound_ns = contest.bounds_ns[most_urgent].expect("bounded");
        // What blocks it began a nanosecond before.
        assert_eq!(contest.longest_ns[most_urgent], bound_ns - 1, "{profile}");
    }
}
