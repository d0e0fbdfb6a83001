//! What each truck's bus has to carry, and whether a real one could.
//!
//! A virtual bus has no bit time and hides overload. The plan takes the worst case: every frame
//! with the most stuff bits it can need, every obstacle in sight, any phasing between messages.

use bench_sim::Scenario;
use platoon_dbc::bus_time::{self, BusTiming, Stream, Urgency};
use platoon_dbc::{FrameFlags, MessageInfo, Profile, V2vTrajectory, V2vTrajectoryOut};

/// Share of a bus that may be planned for; above, a retransmission or two upset the rest.
const PLANNED_PERCENT_MAX: f64 = 80.0;
/// Longest base step of the rig, within which it delivers V2V messages \[ns\].
const RIG_STEP_NS: u64 = 1_000_000;
/// How often the rig tells a mission while a number in it moves \[ns\].
const MOVING_MISSION_PERIOD_NS: u64 = 20 * NS_PER_MS;
/// The node of a DBC that is the ECU; every other one is played by the rig.
const ECU: &str = "Ecu";

const NS_PER_MS: u64 = 1_000_000;
const NS_PER_S: u64 = 1_000_000_000;

/// The traffic of every truck's bus.
#[derive(Debug, Clone)]
pub struct BusPlan {
    profile: Profile,
    /// What such a bus carries in this run.
    messages: Vec<&'static MessageInfo>,
    /// Per truck.
    trucks: Vec<Vec<PlannedStream>>,
}

/// A message that one sender repeats, and how regularly.
#[derive(Debug, Clone, Copy)]
pub struct PlannedStream {
    /// The message.
    pub message: &'static MessageInfo,
    /// Time from one to the next \[ns\]; each must be through before the next is due.
    pub period_ns: u64,
    /// How late one may be queued \[ns\].
    pub jitter_ns: u64,
    /// Least time between two of them \[ns\]; 0 when only the jitter limits it.
    pub distance_ns: u64,
}

/// What a plan comes to at certain bit rates.
#[derive(Debug, Clone)]
pub struct BusFit {
    /// Worst-case share of each truck's bus.
    pub load_percent: Vec<f64>,
    /// For every message the longest time from queueing to arrival on any bus \[ns\]; `None` when
    /// there is no bound.
    pub responses: Vec<(&'static MessageInfo, Option<u64>)>,
    /// Whether every bus has room to spare and every message arrives before the next of its kind.
    pub fits: bool,
}

impl BusPlan {
    /// The traffic of a scenario, carried as a profile says, at a loop rate; `announces` when
    /// trucks tell each other their plans.
    pub fn of(scenario: &Scenario, profile: Profile, rate_hz: u32, announces: bool) -> Self {
        let is_plan = |id| [V2vTrajectory::ID, V2vTrajectoryOut::ID].contains(&id);
        let carried = profile.messages().iter().filter(|m| announces || !is_plan(m.id));
        let messages: Vec<_> = carried.collect();
        let traffic = Traffic::new(scenario, &messages, rate_hz);
        let trucks = (0..scenario.platoon.trucks).map(|truck| traffic.of_truck(truck)).collect();
        Self { profile, trucks, messages }
    }

    /// Whether its frames are FD frames, with a data phase of their own.
    pub fn is_fd(&self) -> bool {
        frame_flags(self.profile).is_fd
    }

    /// The streams of every truck's bus.
    pub fn trucks(&self) -> &[Vec<PlannedStream>] {
        &self.trucks
    }

    /// The streams of one truck's bus with the longest times their frames take.
    pub fn streams(&self, truck: usize, timing: BusTiming) -> Vec<Stream> {
        let flags = frame_flags(self.profile);
        let stream = |planned: &PlannedStream| Stream {
            urgency: Urgency::of_id(planned.message.id, flags.is_extended),
            duration_ns: timing.frame_time_ns_max(flags, planned.message.length),
            period_ns: planned.period_ns,
            jitter_ns: planned.jitter_ns,
            distance_ns: planned.distance_ns,
        };
        self.trucks[truck].iter().map(stream).collect()
    }

    /// What the plan comes to at these bit rates.
    pub fn at(&self, timing: BusTiming) -> BusFit {
        let mut fit = BusFit {
            load_percent: Vec::new(),
            responses: self.messages.iter().map(|&message| (message, Some(0))).collect(),
            fits: true,
        };
        for (truck, planned) in self.trucks.iter().enumerate() {
            let streams = self.streams(truck, timing);
            let load_percent = 100.0 * bus_time::load(&streams);
            fit.fits &= load_percent <= PLANNED_PERCENT_MAX;
            fit.load_percent.push(load_percent);
            let worst = bus_time::worst_responses(&streams, timing.bit_time_ns());
            for (planned, worst_ns) in planned.iter().zip(worst) {
                fit.fits &= worst_ns.is_some_and(|worst_ns| worst_ns <= planned.period_ns);
                fit.note(planned.message, worst_ns);
            }
        }
        fit
    }

    /// The slowest common bit rates at which the plan fits.
    pub fn fitting_rate(&self) -> Option<BusTiming> {
        let rates = if self.is_fd() { &BusTiming::FD[..] } else { &BusTiming::CLASSIC };
        rates.iter().copied().find(|&timing| self.at(timing).fits)
    }
}

impl BusFit {
    fn note(&mut self, message: &MessageInfo, worst_ns: Option<u64>) {
        let known = self.responses.iter_mut().find(|(known, _)| known.id == message.id);
        if let Some((_, longest_ns)) = known {
            *longest_ns = longest_ns.zip(worst_ns).map(|(a, b)| a.max(b));
        }
    }
}

/// Flags of every frame of a profile.
fn frame_flags(profile: Profile) -> FrameFlags {
    let is_fd = profile == Profile::Fd;
    FrameFlags { is_extended: true, is_fd, brs: is_fd, ..FrameFlags::default() }
}

/// What decides how often messages come.
struct Traffic<'a> {
    scenario: &'a Scenario,
    /// For every truck the trucks it hears.
    sources: Vec<Vec<usize>>,
    /// Whether nobody's mission changes during the run.
    is_fixed: bool,
    messages: &'a [&'static MessageInfo],
    /// The loop's period \[ns\].
    tick_ns: u64,
    /// The cycle time by which the DBC means the loop's period \[ms\].
    tick_cycle_ms: u32,
}

impl<'a> Traffic<'a> {
    fn new(scenario: &'a Scenario, messages: &'a [&'static MessageInfo], rate_hz: u32) -> Self {
        let cycles_ms = messages.iter().map(|message| message.cycle_time_ms);
        Self {
            scenario,
            sources: scenario.v2v_sources(),
            is_fixed: scenario.events.iter().all(|event| event.at_s <= 0.0),
            messages,
            tick_ns: NS_PER_S / u64::from(rate_hz.max(1)),
            tick_cycle_ms: cycles_ms.filter(|&ms| ms > 0).min().unwrap_or(1),
        }
    }

    fn of_truck(&self, truck: usize) -> Vec<PlannedStream> {
        let heard = self.sources[truck].len();
        // It may see every obstacle and every truck ahead, as long as there are pages for them.
        let ahead = if self.is_fixed { truck } else { self.scenario.platoon.trucks - 1 };
        let seen = self.scenario.obstacles.len() + ahead;
        let has_ecu = self.scenario.has_ecu(truck);
        let sent = self.messages.iter().filter(|message| has_ecu || message.sender != ECU);
        let streams = sent.flat_map(|&message| {
            let (stream, count) = match message.name {
                name if name.starts_with("V2v") && message.sender != ECU => {
                    (self.relayed(message), heard)
                }
                name if name.starts_with("Obstacle") => (self.cyclic(message), seen.min(OBSTACLES)),
                name if name.starts_with("Mission") => (self.mission(message), 1),
                _ => (self.cyclic(message), 1),
            };
            std::iter::repeat_n(stream, count)
        });
        streams.collect()
    }

    /// A message sent by the clock, or at every tick of the loop.
    fn cyclic(&self, message: &'static MessageInfo) -> PlannedStream {
        let cycle_ns = u64::from(message.cycle_time_ms.max(1)) * NS_PER_MS;
        let is_every_tick = message.cycle_time_ms == self.tick_cycle_ms;
        let period_ns = if is_every_tick { self.tick_ns } else { cycle_ns.max(self.tick_ns) };
        // What is no whole number of ticks goes out with the tick after it.
        let grid_ns = if period_ns.is_multiple_of(self.tick_ns) { 0 } else { self.tick_ns };
        // A tick of an ECU may start up to half a period late, and is skipped beyond that.
        let late_ns = if message.sender == ECU { self.tick_ns / 2 } else { 0 };
        PlannedStream { message, period_ns, jitter_ns: grid_ns + late_ns, distance_ns: 0 }
    }

    /// The plan, which is told more often while a number in it moves.
    fn mission(&self, message: &'static MessageInfo) -> PlannedStream {
        let cyclic = self.cyclic(message);
        let period_ns = if self.is_fixed { cyclic.period_ns } else { MOVING_MISSION_PERIOD_NS };
        PlannedStream { period_ns: period_ns.max(self.tick_ns), ..cyclic }
    }

    /// A message of another truck, as the radio delivers it.
    fn relayed(&self, message: &'static MessageInfo) -> PlannedStream {
        let v2v = &self.scenario.v2v;
        let broadcast_ns = (u64::from(message.cycle_time_ms) * NS_PER_MS).max(self.tick_ns);
        let grid_ns = if broadcast_ns.is_multiple_of(self.tick_ns) { 0 } else { self.tick_ns };
        // The radio passes on every so many broadcasts.
        let period_ns = broadcast_ns * ((v2v.period_s * 1e9) as u64 / broadcast_ns).max(1);
        let spread_ns = ((v2v.delay_max_s - v2v.delay_min_s) * 1e9) as u64;
        // The delay falls by no more than its rate, so what was sent apart arrives apart.
        let apart_ns = ((1.0 - v2v.delay_rate_max) * period_ns as f64) as u64;
        PlannedStream {
            message,
            period_ns,
            jitter_ns: spread_ns + grid_ns + self.tick_ns + RIG_STEP_NS,
            distance_ns: apart_ns.saturating_sub(grid_ns + RIG_STEP_NS),
        }
    }
}

/// Most objects a truck's sensor reports: the pages of `Obstacle`.
const OBSTACLES: usize = bench_sim::scenario::OBSTACLES_MAX;

#[cfg(test)]
mod tests {
    use super::*;

    fn obstacle_avoidance() -> Scenario {
        Scenario::load("obstacle-avoidance", &[]).expect("built in")
    }

    fn fits(profile: Profile, rate_hz: u32) -> bool {
        BusPlan::of(&obstacle_avoidance(), profile, rate_hz, false).at(profile.timing()).fits
    }

    #[test]
    fn the_plan_of_the_fd_profile_fits_at_1_khz_and_not_at_2_khz() {
        assert!(fits(Profile::Fd, 1000));
        assert!(!fits(Profile::Fd, 2000));
    }

    #[test]
    fn a_faster_bus_carries_what_a_slower_one_cannot() {
        let plan = BusPlan::of(&obstacle_avoidance(), Profile::Fd, 2000, false);
        let rates = plan.fitting_rate().expect("the fastest ones are fast enough");
        assert_eq!(rates.to_string(), "1M/5M");
        assert!(plan.at(rates).fits && !plan.at(BusTiming::fd(500_000, 5_000_000)).fits);
        let plan = BusPlan::of(&obstacle_avoidance(), Profile::Fd, 10_000, false);
        assert_eq!(plan.fitting_rate(), None);
    }

    #[test]
    fn announced_plans_cost_each_bus_a_share_and_fit_at_1_khz() {
        let fit = |announces| {
            BusPlan::of(&obstacle_avoidance(), Profile::Fd, 1000, announces)
                .at(Profile::Fd.timing())
        };
        let (without, with) = (fit(false), fit(true));
        assert!(with.fits);
        assert_eq!((without.responses.len(), with.responses.len()), (7, 9));
        for (without, with) in without.load_percent.iter().zip(&with.load_percent) {
            assert!((0.3..5.0).contains(&(with - without)), "{without} {with}");
        }
    }

    #[test]
    fn overload_is_told_and_leaves_the_urgent_their_bound() {
        let plan = BusPlan::of(&obstacle_avoidance(), Profile::Fd, 2000, false);
        let fit = plan.at(Profile::Fd.timing());
        assert!(fit.load_percent.iter().all(|&percent| percent > 100.0));
        let response = |name| fit.responses.iter().find(|(m, _)| m.name == name).expect(name).1;
        assert!(response("EgoState").is_some());
        assert_eq!((response("Actuation"), response("EcuStatus")), (None, None));
    }

    #[test]
    fn a_truck_hears_the_leader_and_its_predecessor_and_sees_those_ahead() {
        let plan = BusPlan::of(&obstacle_avoidance(), Profile::Fd, 1000, false);
        let count = |truck: usize, name: &str| {
            plan.trucks()[truck].iter().filter(|planned| planned.message.name == name).count()
        };
        let heard: Vec<_> = (0..4).map(|truck| count(truck, "V2vState")).collect();
        let seen: Vec<_> = (0..4).map(|truck| count(truck, "Obstacle")).collect();
        assert_eq!((heard, seen), (vec![0, 1, 2, 2], vec![2, 3, 4, 5]));
    }
}
