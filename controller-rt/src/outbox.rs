//! From the ECU onto the bus: commands, broadcasts, status. Nothing is ever sent twice.

use law::dmpc::Plan;
use platoon_dbc::{
    Actuation, ActuationStatus, Bus, EcuMode, EcuStatus, EgoState, Encoder, Message, V2vOut,
    V2vTrajectoryOut,
};
use serde::{Deserialize, Serialize};

/// Bench time between two `V2vOut` \[ns\].
pub const BROADCAST_PERIOD_NS: u64 = 20_000_000;
/// Time between two `EcuStatus` \[ns\]: of the clock before the run, of the bench in it.
pub const STATUS_PERIOD_NS: u64 = 100_000_000;
/// Largest miss count `EcuStatus` can carry (24 bits).
const MISSES_MAX: u64 = 0xFF_FFFF;

/// Frames sent and not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct OutboxCounts {
    /// Frames the bus took.
    pub sent: u64,
    /// Frames the bus refused; the next cycle has newer data, so none is retried.
    pub send_errors: u64,
    /// Messages that could not be encoded: a value was not a number or out of the DBC's range.
    pub encode_errors: u64,
}

/// What `EcuStatus` tells besides the mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health {
    /// Identifier of the gain in use.
    pub gain_id: u8,
    /// Ticks run.
    pub ticks: u64,
    /// Deadlines missed.
    pub misses: u64,
    /// Slots skipped.
    pub skipped: u64,
}

/// The sending side of an ECU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outbox {
    state: OutboxState,
    next_status_ns: u64,
    counts: OutboxCounts,
}

/// The part of the outbox that later frames depend on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OutboxState {
    encoder: Encoder,
    broadcast_sequence: u16,
    plan_sequence: u16,
    next_broadcast_ns: u64,
}

impl Outbox {
    /// An outbox that has sent nothing.
    #[must_use]
    pub fn new(encoder: Encoder) -> Self {
        Self {
            state: OutboxState {
                encoder,
                broadcast_sequence: 0,
                plan_sequence: 0,
                next_broadcast_ns: 0,
            },
            next_status_ns: 0,
            counts: OutboxCounts::default(),
        }
    }

    /// Totals so far.
    #[must_use]
    pub const fn counts(&self) -> OutboxCounts {
        self.counts
    }

    /// Counters and due times, for a snapshot.
    #[must_use]
    pub const fn state(&self) -> OutboxState {
        self.state
    }

    /// Continues from a snapshot.
    pub fn restore(&mut self, state: OutboxState) {
        self.state = state;
    }

    /// Sends this tick's command.
    pub fn command(
        &mut self,
        bus: &mut dyn Bus,
        now_ns: u64,
        answers_tick: u32,
        (force_n, steering_rad): (f64, f64),
        actuation_status: ActuationStatus,
    ) {
        let command = Actuation { answers_tick, force_n, steering_rad, actuation_status };
        self.send(bus, &Message::Actuation(command), now_ns);
    }

    /// Sends the truck's state to the other trucks when 20 ms of bench time have passed.
    pub fn broadcast(
        &mut self,
        bus: &mut dyn Bus,
        now_ns: u64,
        ego: &EgoState,
        intended_accel_mps2: f64,
    ) {
        if now_ns < self.state.next_broadcast_ns {
            return;
        }
        // On the grid of multiples, so that periods that do not divide 20 ms do not drift.
        self.state.next_broadcast_ns = (now_ns / BROADCAST_PERIOD_NS + 1) * BROADCAST_PERIOD_NS;
        let sequence = self.state.broadcast_sequence;
        self.state.broadcast_sequence = sequence.wrapping_add(1);
        let state = V2vOut {
            sequence,
            generation_time_ns: ego.bench_time_ns,
            position_x_m: ego.position_x_m,
            position_y_m: ego.position_y_m,
            heading_rad: ego.heading_rad,
            speed_mps: ego.speed_forward_mps,
            yaw_rate_radps: ego.yaw_rate_radps,
            accel_mps2: ego.accel_forward_mps2,
            intended_accel_mps2,
        };
        self.send(bus, &Message::V2vOut(state), now_ns);
    }

    /// Sends the trajectory the truck plans to the other trucks.
    ///
    /// Its positions stay here: whoever hears it integrates the speeds ([`Plan::from_speeds`]).
    pub fn announce(&mut self, bus: &mut dyn Bus, now_ns: u64, plan: &Plan) {
        let sequence = self.state.plan_sequence;
        self.state.plan_sequence = sequence.wrapping_add(1);
        let trajectory = V2vTrajectoryOut {
            sequence,
            generation_time_ns: plan.start_ns,
            position_x_m: plan.x_m[0],
            speed_mps: plan.speed_mps,
        };
        self.send(bus, &Message::V2vTrajectoryOut(trajectory), now_ns);
    }

    /// Sends the ECU's status when 100 ms have passed.
    pub fn status(&mut self, bus: &mut dyn Bus, now_ns: u64, mode: EcuMode, health: Health) {
        if now_ns >= self.next_status_ns {
            self.status_now(bus, now_ns, mode, health);
        }
    }

    /// Sends the ECU's status at once, as on a change of mode.
    pub fn status_now(&mut self, bus: &mut dyn Bus, now_ns: u64, mode: EcuMode, health: Health) {
        self.next_status_ns = now_ns.saturating_add(STATUS_PERIOD_NS);
        let status = EcuStatus {
            ecu_mode: mode,
            gain_id: health.gain_id,
            tick_count: u32::try_from(health.ticks).unwrap_or(u32::MAX),
            misses: health.misses.min(MISSES_MAX) as u32,
            skipped: u16::try_from(health.skipped).unwrap_or(u16::MAX),
        };
        self.send(bus, &Message::EcuStatus(status), now_ns);
    }

    fn send(&mut self, bus: &mut dyn Bus, message: &Message, now_ns: u64) {
        let counts = &mut self.counts;
        let encoded =
            self.state.encoder.encode(message, now_ns, &mut |frame| match bus.send(frame) {
                Ok(()) => counts.sent += 1,
                Err(_) => counts.send_errors += 1,
            });
        self.counts.encode_errors += u64::from(encoded.is_err());
    }
}

#[cfg(test)]
mod tests {
    use platoon_dbc::{Loopback, Profile, Vehicle};

    use super::*;

    const MS: u64 = 1_000_000;

    fn outbox() -> Outbox {
        Outbox::new(Encoder::new(Profile::Fd, Vehicle::default()))
    }

    fn received(bus: &mut Loopback) -> Vec<(Message, u8)> {
        let frames = std::iter::from_fn(|| bus.receive().expect("up"));
        frames.map(|received| Message::decode(&received.frame).expect("sound")).collect()
    }

    #[test]
    fn a_broadcast_goes_out_every_20_ms_of_bench_time_at_any_rate() {
        for period_ms in [1, 2, 3, 7, 10, 20] {
            let (mut rig, mut ecu) = Loopback::pair("loopback0", 256);
            let mut outbox = outbox();
            for n in 0..2_000 / period_ms {
                let now_ns = n * period_ms * MS;
                outbox.broadcast(&mut ecu, now_ns, &EgoState::default(), 0.0);
            }
            let sent = received(&mut rig);
            assert_eq!(sent.len(), 100, "{period_ms} ms");
            for (n, (message, counter)) in sent.iter().enumerate() {
                let Message::V2vOut(state) = message else { panic!("{message:?}") };
                assert_eq!((usize::from(state.sequence), usize::from(*counter)), (n, n));
            }
        }
    }

    #[test]
    fn an_announced_plan_reaches_the_listener_within_millimetres() {
        let (mut rig, mut ecu) = Loopback::pair("loopback0", 4);
        let mut outbox = outbox();
        // As hard as a truck can, then steady: its true positions, not the trapezoid's.
        let mut plan = Plan::steady(7 * MS, 1_234.567_89, 15.0);
        for k in 1..plan.x_m.len() {
            let t = 0.1 * k as f64;
            let (grows_s, rest_s) = (t.min(1.3), (t - 1.3).max(0.0));
            plan.speed_mps[k] = 15.0 + 3.4 * grows_s;
            plan.x_m[k] = plan.x_m[0] + 15.0 * t + 1.7 * grows_s * grows_s + 3.4 * 1.3 * rest_s;
        }
        outbox.announce(&mut ecu, 8 * MS, &plan);
        let Message::V2vTrajectoryOut(heard) = received(&mut rig)[0].0 else { panic!("sent") };
        let heard =
            Plan::from_speeds(heard.generation_time_ns, heard.position_x_m, &heard.speed_mps);
        assert_eq!(heard.start_ns, plan.start_ns);
        for k in 0..plan.x_m.len() {
            assert!((heard.x_m[k] - plan.x_m[k]).abs() < 3e-3, "{k}");
            assert!((heard.speed_mps[k] - plan.speed_mps[k]).abs() <= 1.001e-3, "{k}");
        }
    }

    #[test]
    fn status_goes_out_every_100_ms_and_saturates() {
        let (mut rig, mut ecu) = Loopback::pair("loopback0", 256);
        let mut outbox = outbox();
        let health = Health { gain_id: 1, ticks: u64::MAX, misses: u64::MAX, skipped: u64::MAX };
        for now_ms in 5_000..6_000 {
            outbox.status(&mut ecu, now_ms * MS, EcuMode::Running, health);
        }
        let sent = received(&mut rig);
        assert_eq!(sent.len(), 10);
        let Message::EcuStatus(status) = sent[9].0 else { panic!("{:?}", sent[9]) };
        assert_eq!((status.misses, status.skipped), (0xFF_FFFF, u16::MAX));
    }

    #[test]
    fn errors_are_counted_and_not_retried() {
        let (rig, mut ecu) = Loopback::pair("loopback0", 1);
        let mut outbox = outbox();
        for _ in 0..3 {
            outbox.command(&mut ecu, 0, 1, (0.0, 0.0), ActuationStatus::Solved);
        }
        outbox.command(&mut ecu, 0, 1, (f64::NAN, 0.0), ActuationStatus::Solved);
        let expected = OutboxCounts { sent: 1, send_errors: 2, encode_errors: 1 };
        assert_eq!(outbox.counts(), expected);
        drop(rig);
    }
}
