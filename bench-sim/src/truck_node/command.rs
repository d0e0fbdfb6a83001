//! Which command a truck obeys, and what it does when none comes any more.
//!
//! ```text
//! following --(100 ms without a command)--> coasting --(0.2 s)--> stopping
//!     ^                                         |
//!     +-----------(a command came)--------------+
//! ```
//!
//! Coasting: steering straight, no force. Stopping: steering straight, braking at 4 m/s² to a
//! standstill and holding there; a truck that has begun to stop no longer listens.
//!
//! The age of a command is counted in rig ticks processed after draining, not by a clock: when the
//! whole machine pauses, rig and ECU pause together and nobody is declared dead. A wake-up that has
//! to catch up counts for at most 10 ms.

use platoon_dbc::{Actuation, CommandGrain};

use super::NodeCounts;
use crate::truck::{Command, Truck};

/// Age at which a command counts as lost \[ns\].
const LOST_NS: u64 = 100_000_000;
/// Most that one wake-up ages a command \[ns\].
const AGE_PER_WAKE_MAX_NS: u64 = 10_000_000;
/// How long a truck without commands coasts before it brakes \[ns\].
const COAST_NS: u64 = 200_000_000;
/// How hard it then brakes \[m/s²\].
const STOP_DECEL_MPS2: f64 = 4.0;

/// Strongest brake of the actuators \[N\].
const FORCE_MIN_N: f64 = -34_000.0;
/// Strongest drive of the actuators \[N\].
const FORCE_MAX_N: f64 = 20_000.0;
/// Furthest the road wheels turn, 10 degrees \[rad\].
const STEER_MAX_RAD: f64 = 0.174_532_925_199_432_95;

/// Where the truck's commands come from now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Following,
    Coasting { left_ns: u64 },
    Stopping,
}

/// What the ECU asked for, over the run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct CommandRange {
    /// Least and greatest force asked for \[N\].
    pub(crate) force_n: Option<(f64, f64)>,
    /// Largest |road-wheel angle| asked for \[rad\].
    pub(crate) steer_rad: f64,
    /// Fastest change of the force \[N/s\], resolution of the bus taken off.
    pub(crate) force_rate_nps: f64,
    /// Fastest change of the steering angle \[rad/s\], likewise.
    pub(crate) steer_rate_radps: f64,
}

/// A command that came, before it is clipped.
#[derive(Debug, Clone, Copy)]
struct Answer {
    asked: Command,
    /// The tick it answers.
    answers: u32,
    /// The tick it came at.
    tick: u32,
    /// When it came to the bus \[ns\], on the bus's clock; 0 when nobody knows.
    stamp_ns: u64,
}

/// The command a truck obeys.
#[derive(Debug, Clone)]
pub(crate) struct CommandWatch {
    tick_period_s: f64,
    grain: CommandGrain,
    newest: Command,
    answer: Option<Answer>,
    /// Whether that one skipped ticks, or answered an old one or the same as the one before.
    is_irregular: bool,
    age_ns: u64,
    mode: Mode,
    range: CommandRange,
}

impl CommandWatch {
    /// A watch that has seen nothing; its first command is due within the time limit.
    ///
    /// `grain` is how coarse commands are on this bus.
    pub(crate) fn new(tick_period_ns: u64, grain: CommandGrain) -> Self {
        Self {
            tick_period_s: tick_period_ns as f64 * 1e-9,
            grain,
            newest: Command::default(),
            answer: None,
            is_irregular: false,
            age_ns: 0,
            mode: Mode::Following,
            range: CommandRange::default(),
        }
    }

    /// Takes in a command that passed its end-to-end checks and came to the bus at `stamp_ns`;
    /// `tick` is the newest one published.
    pub(crate) fn accept(
        &mut self,
        message: &Actuation,
        (tick, stamp_ns): (u32, u64),
        counts: &mut NodeCounts,
    ) {
        let older = self.answer.is_some_and(|last| message.answers_tick < last.answers);
        if older || message.answers_tick > tick {
            counts.out_of_order += 1;
            return;
        }
        counts.late += u64::from(message.answers_tick < tick);
        if self.mode == Mode::Stopping {
            counts.ignored_while_stopping += 1;
            return;
        }
        let asked = Command { force_n: message.force_n, steer_rad: message.steering_rad };
        self.measure(&Answer { asked, answers: message.answers_tick, tick, stamp_ns });
        self.newest = Command {
            force_n: asked.force_n.clamp(FORCE_MIN_N, FORCE_MAX_N),
            steer_rad: asked.steer_rad.clamp(-STEER_MAX_RAD, STEER_MAX_RAD),
        };
        let clipped = (asked.force_n - self.newest.force_n).abs() > self.grain.force_n
            || (asked.steer_rad - self.newest.steer_rad).abs() > self.grain.steering_rad;
        counts.out_of_range += u64::from(clipped);
        counts.accepted += 1;
        self.age_ns = 0;
        self.mode = Mode::Following;
    }

    /// Counts a wake-up that integrates `span_ns` after draining; true when the command is lost
    /// with it.
    pub(crate) fn age(&mut self, span_ns: u64) -> bool {
        self.age_ns += span_ns.min(AGE_PER_WAKE_MAX_NS);
        let lost = self.mode == Mode::Following && self.age_ns >= LOST_NS;
        if lost {
            self.mode = Mode::Coasting { left_ns: COAST_NS };
        }
        lost
    }

    /// What the actuators are asked for during the next step.
    pub(crate) fn command(&mut self, truck: &Truck, step_ns: u64) -> Command {
        match self.mode {
            Mode::Following => self.newest,
            Mode::Coasting { left_ns } => {
                self.mode = match left_ns.saturating_sub(step_ns) {
                    0 => Mode::Stopping,
                    left_ns => Mode::Coasting { left_ns },
                };
                Command::default()
            }
            Mode::Stopping => {
                // The brake does what the resistances leave to do.
                let resistance_n = truck.resistance_n(truck.state().forward_mps);
                let force_n = (resistance_n - STOP_DECEL_MPS2 * truck.mass_kg()).min(0.0);
                Command { force_n, steer_rad: 0.0 }
            }
        }
    }

    /// What the ECU asked for so far.
    pub(crate) fn range(&self) -> &CommandRange {
        &self.range
    }

    /// Widens the range by one command, before it is clipped.
    ///
    /// The time between two commands is the longest of three: between the ticks they answer,
    /// between the ticks they came at, and between their arrivals on the bus. An ECU that skipped a
    /// tick may move twice as far; one that goes on while the rig stands still answers the same
    /// state again and again. After a pause the ECU's own count of elapsed ticks may be one more
    /// than is seen here, because a slot can begin half a period late and see the next state
    /// already, or a state that is a tick old; so an irregular answer and the one behind it are
    /// given one tick more. Where the bus carries the force less often than commands, either force
    /// may be older than its command by what is held beyond a tick.
    fn measure(&mut self, now: &Answer) {
        let Command { force_n, steer_rad } = now.asked;
        let (low_n, high_n) = self.range.force_n.unwrap_or((force_n, force_n));
        self.range.force_n = Some((low_n.min(force_n), high_n.max(force_n)));
        self.range.steer_rad = self.range.steer_rad.max(steer_rad.abs());
        let Some(last) = self.answer.replace(*now) else { return };
        let apart_ns = match last.stamp_ns {
            0 => 0,
            last_ns => now.stamp_ns.saturating_sub(last_ns),
        };
        let apart_s = apart_ns as f64 * 1e-9;
        let answered = now.answers - last.answers;
        let came = now.tick.saturating_sub(last.tick);
        let ticks = answered.max(came).max((apart_s / self.tick_period_s) as u32).max(1);
        let was_irregular = self.is_irregular;
        self.is_irregular = ticks > 1 || answered == 0 || now.answers < now.tick;
        let uncertain = u32::from(self.is_irregular || was_irregular);
        let span_s = f64::from(ticks.saturating_add(uncertain)) * self.tick_period_s;
        // A little more than the resolution, for the rounding of the subtraction itself.
        let beyond = |change: f64, lsb: f64| (change.abs() - 1.000_001 * lsb).max(0.0);
        let held_s = (self.grain.force_hold_ns as f64 * 1e-9 - self.tick_period_s).max(0.0);
        let force = beyond(force_n - last.asked.force_n, self.grain.force_n) / (span_s + held_s);
        let steer = beyond(steer_rad - last.asked.steer_rad, self.grain.steering_rad) / span_s;
        self.range.force_rate_nps = self.range.force_rate_nps.max(force);
        self.range.steer_rate_radps = self.range.steer_rate_radps.max(steer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truck::TruckParameters;
    use platoon_dbc::ActuationStatus;

    const MS: u64 = 1_000_000;
    const FD: CommandGrain = CommandGrain { force_n: 0.1, steering_rad: 1e-6, force_hold_ns: 0 };

    fn actuation(answers_tick: u32, force_n: f64, steering_rad: f64) -> Actuation {
        let actuation_status = ActuationStatus::Solved;
        Actuation { answers_tick, force_n, steering_rad, actuation_status }
    }

    #[test]
    fn a_command_is_lost_exactly_at_a_hundred_milliseconds() {
        let mut watch = CommandWatch::new(MS, FD);
        watch.accept(&actuation(0, 100.0, 0.0), (0, 0), &mut NodeCounts::default());
        assert_eq!((1..=200).find(|_| watch.age(MS)), Some(100));
        assert_eq!((0..200).find(|_| watch.age(MS)), None, "noticed twice");
    }

    #[test]
    fn a_pause_of_the_whole_machine_is_no_dead_ecu() {
        let mut watch = CommandWatch::new(MS, FD);
        assert!(!watch.age(3_000 * MS));
        assert!(!watch.age(500 * MS));
    }

    #[test]
    fn without_commands_the_truck_straightens_coasts_and_stops_at_four() {
        let mut truck = Truck::new(TruckParameters::default(), 0.0, 0.0, 18.0);
        let mut watch = CommandWatch::new(MS, FD);
        watch.accept(&actuation(0, 5_000.0, 0.05), (0, 0), &mut NodeCounts::default());
        let (mut braking_from, mut stopped_at) = (None, None);
        let mut decel_mps2 = 0.0;
        for ms in 0..8_000 {
            watch.age(MS);
            let command = watch.command(&truck, MS);
            if ms >= 100 {
                assert_eq!(command.steer_rad, 0.0);
            }
            if command.force_n < 0.0 {
                braking_from.get_or_insert(ms);
            }
            truck.step(&command, 1e-3);
            if ms == 3_000 {
                decel_mps2 = -truck.acceleration().forward_mps2;
            }
            if truck.state().forward_mps == 0.0 {
                stopped_at.get_or_insert(ms);
            }
        }
        assert_eq!(braking_from, Some(299));
        assert!((decel_mps2 - 4.0).abs() < 0.01, "{decel_mps2}");
        assert!(stopped_at.is_some_and(|ms| (4_500..5_500).contains(&ms)), "{stopped_at:?}");
        assert_eq!(watch.mode, Mode::Stopping);
    }

    #[test]
    fn a_coasting_truck_listens_again_and_a_stopping_one_does_not() {
        let truck = Truck::new(TruckParameters::default(), 0.0, 0.0, 18.0);
        let mut counts = NodeCounts::default();
        let mut watch = CommandWatch::new(MS, FD);
        let silence = |watch: &mut CommandWatch| (0..10).any(|_| watch.age(10 * MS));
        assert!(silence(&mut watch));
        assert_eq!(watch.command(&truck, MS), Command::default());
        watch.accept(&actuation(3, 700.0, 0.01), (3, 0), &mut counts);
        assert_eq!(watch.command(&truck, MS).force_n, 700.0);
        assert!(silence(&mut watch));
        for _ in 0..200 {
            assert_eq!(watch.command(&truck, MS).force_n, 0.0);
        }
        watch.accept(&actuation(4, 700.0, 0.01), (4, 0), &mut counts);
        assert!(watch.command(&truck, MS).force_n < -20_000.0);
        assert_eq!((counts.accepted, counts.ignored_while_stopping), (1, 1));
    }

    #[test]
    fn commands_outside_the_actuators_are_clipped_counted_and_remembered() {
        let truck = Truck::new(TruckParameters::default(), 0.0, 0.0, 18.0);
        let mut counts = NodeCounts::default();
        let mut watch = CommandWatch::new(MS, FD);
        watch.accept(&actuation(0, -50_000.0, 0.3), (0, 0), &mut counts);
        let obeyed = watch.command(&truck, MS);
        assert_eq!((obeyed.force_n, obeyed.steer_rad), (FORCE_MIN_N, STEER_MAX_RAD));
        assert_eq!(counts.out_of_range, 1);
        assert_eq!(watch.range().force_n, Some((-50_000.0, -50_000.0)));
        watch.accept(&actuation(1, 20_000.0, 0.174_533), (1, 0), &mut counts);
        assert_eq!(counts.out_of_range, 1);
    }

    /// Takes in commands (tick answered, force) that came a tick apart, the last at `stamp_ms`;
    /// returns how many were late.
    fn take(watch: &mut CommandWatch, tick: u32, stamp_ms: u64, commands: &[(u32, f64)]) -> u64 {
        let mut counts = NodeCounts::default();
        let first_ms = stamp_ms + 1 - commands.len() as u64;
        for (stamp_ms, &(answers, force_n)) in (first_ms..).zip(commands) {
            let came = (tick, stamp_ms * MS);
            watch.accept(&actuation(answers, force_n, 0.0), came, &mut counts);
        }
        counts.late
    }

    #[test]
    fn rates_are_measured_over_the_ticks_between_commands() {
        let mut watch = CommandWatch::new(MS, FD);
        let mut late = 0;
        for (answers, tick, force_n) in [(1, 1, 0.0), (2, 2, 57.6), (4, 4, 172.8), (4, 6, 288.0)] {
            late += take(&mut watch, tick, tick.into(), &[(answers, force_n)]);
        }
        let rate = watch.range().force_rate_nps;
        assert!(rate <= 57_600.0 && rate > 57_400.0, "{rate}");
        assert_eq!(late, 1);
        take(&mut watch, 7, 7, &[(7, 600.0)]);
        assert!(watch.range().force_rate_nps > 57_600.0);
    }

    #[test]
    fn a_pause_of_the_machine_does_not_look_like_a_fast_actuator() {
        // Thirteen ticks passed in the ECU, which answers the state of the twelfth.
        let mut watch = CommandWatch::new(MS, FD);
        take(&mut watch, 1, 1, &[(1, 0.0)]);
        take(&mut watch, 13, 13, &[(13, 13.0 * 57.6)]);
        assert!(watch.range().force_rate_nps <= 57_600.0, "{}", watch.range().force_rate_nps);
    }

    #[test]
    fn an_ecu_that_goes_on_while_the_rig_stands_still_does_not_look_fast() {
        let mut watch = CommandWatch::new(MS, FD);
        take(&mut watch, 5, 5, &[(5, 0.0)]);
        let held: Vec<(u32, f64)> = (1..=10).map(|n| (6, f64::from(n) * 57.6)).collect();
        take(&mut watch, 6, 15, &held);
        // It skipped two slots of that pause, too.
        take(&mut watch, 6, 18, &[(6, 13.0 * 57.6)]);
        assert!(watch.range().force_rate_nps <= 57_600.0, "{}", watch.range().force_rate_nps);
        take(&mut watch, 6, 19, &[(6, 20.0 * 57.6)]);
        assert!(watch.range().force_rate_nps > 57_600.0, "as far in one slot as in seven");
    }

    #[test]
    fn the_slot_after_a_pause_may_begin_late_and_see_the_next_state_already() {
        // The ECU's slots are 1, 6 and 8; that of tick 6 began late enough to answer tick 7.
        let mut watch = CommandWatch::new(MS, FD);
        take(&mut watch, 1, 1, &[(1, 0.0)]);
        take(&mut watch, 7, 7, &[(7, 5.0 * 57.6)]);
        take(&mut watch, 8, 8, &[(8, 7.0 * 57.6)]);
        assert!(watch.range().force_rate_nps <= 57_600.0, "{}", watch.range().force_rate_nps);
        take(&mut watch, 9, 9, &[(9, 9.0 * 57.6)]);
        assert!(watch.range().force_rate_nps > 115_000.0, "once is enough");
    }

    #[test]
    fn an_arrival_that_nobody_knows_excuses_nothing() {
        let mut watch = CommandWatch::new(MS, FD);
        take(&mut watch, 1, 0, &[(1, 0.0)]);
        take(&mut watch, 2, 1_000_000, &[(2, 576.0)]);
        assert!(watch.range().force_rate_nps > 57_600.0, "{}", watch.range().force_rate_nps);
    }

    #[test]
    fn a_bus_clock_that_is_set_forward_by_years_is_survived() {
        let mut watch = CommandWatch::new(MS, FD);
        take(&mut watch, 1, 1, &[(1, 0.0)]);
        take(&mut watch, 2, u64::MAX / MS, &[(2, 57.6)]);
        assert!(watch.range().force_rate_nps < 1.0, "{}", watch.range().force_rate_nps);
    }

    #[test]
    fn a_command_at_its_rate_limit_passes_after_rounding_on_the_bus() {
        let mut watch = CommandWatch::new(MS, FD);
        for tick in 0..2_000 {
            let (force_n, steering_rad) =
                (57.6 * f64::from(tick % 300), 3e-4 * f64::from(tick % 300));
            let sent = actuation(tick, force_n + 0.049, steering_rad + 4.9e-7);
            let (received, _) = Actuation::decode(&sent.encode(0).expect("fits")).expect("whole");
            if tick % 300 == 0 {
                watch.answer = None;
            }
            watch.accept(&received, (tick, 0), &mut NodeCounts::default());
        }
        let range = watch.range();
        assert!(range.force_rate_nps <= 57_600.0 && range.force_rate_nps > 57_300.0);
        assert!(range.steer_rate_radps <= 0.3 && range.steer_rate_radps > 0.298);
    }

    #[test]
    fn answers_out_of_order_or_from_the_future_are_refused() {
        let mut counts = NodeCounts::default();
        let mut watch = CommandWatch::new(MS, FD);
        watch.accept(&actuation(5, 1.0, 0.0), (5, 0), &mut counts);
        watch.accept(&actuation(4, 2.0, 0.0), (5, 0), &mut counts);
        watch.accept(&actuation(7, 3.0, 0.0), (6, 0), &mut counts);
        assert_eq!((counts.accepted, counts.out_of_order), (1, 2));
        watch.accept(&actuation(5, 1.0, 0.0), (6, 0), &mut counts);
        assert_eq!((counts.accepted, counts.late), (2, 1));
    }

    #[test]
    fn a_force_that_the_bus_carries_every_other_tick_has_had_two_ticks_to_change() {
        let coarse = CommandGrain { force_n: 25.0, steering_rad: 1e-5, force_hold_ns: 20 * MS };
        let rate = |grain: CommandGrain, forces: &[f64]| {
            let mut watch = CommandWatch::new(10 * MS, grain);
            for (tick, force_n) in (0..).zip(forces) {
                let came = (tick, u64::from(tick) * 10 * MS);
                watch.accept(&actuation(tick, *force_n, 0.0), came, &mut NodeCounts::default());
            }
            watch.range().force_rate_nps
        };
        let stairs = [0.0, 0.0, -1152.0, -1152.0, -2304.0, -2304.0];
        assert!((rate(coarse, &stairs) - (1152.0 - 25.0) / 0.02).abs() < 1.0);
        assert!(rate(FD, &stairs) > 115_000.0);
        // A jump that needs more than what was held is still too fast.
        assert!(rate(coarse, &[0.0, 0.0, 0.0, 0.0, 0.0, -2304.0]) > 100_000.0);
    }
}
