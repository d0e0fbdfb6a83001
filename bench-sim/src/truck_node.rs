//! The rig's node on one truck's CAN bus: gateway, sensors, radio and actuators of that truck.
//!
//! It protects and sends what the rig publishes, checks what the ECU sends (identifier, length,
//! CRC, counter, order, range), and counts whatever is wrong. A frame that fails a check has no
//! effect.

mod command;
mod tap;
#[cfg(test)]
mod tests;

use platoon_dbc::{
    Bus, CommandGrain, Decoder, EcuMode, Encoder, Frame, Heard, Message, Profile, Received,
    Refusal, Vehicle,
};
use serde::{Deserialize, Serialize};
use traces::FrameRecord;

pub(crate) use command::{CommandRange, CommandWatch};
pub(crate) use tap::Tap;
use tap::Waiting;

/// Frames of others, and as many echoes, read from one bus per wake-up; the rest waits for the
/// next one.
const DRAIN_MAX: usize = 256;

/// What happened on one truck's bus, as the rig saw it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NodeCounts {
    /// Commands accepted.
    pub accepted: u64,
    /// Commands accepted or refused that answer an older tick than the newest published.
    pub late: u64,
    /// Commands clipped because they ask for more than the actuators can do.
    pub out_of_range: u64,
    /// Commands refused because they answer a tick before the last one, or one not yet published.
    pub out_of_order: u64,
    /// Commands refused because the truck was already stopping.
    pub ignored_while_stopping: u64,
    /// How often no command came for 100 ms.
    pub lost_commands: u32,
    /// Frames whose CRC was wrong.
    pub bad_crc: u64,
    /// Frames of the contract with the wrong length, flags, or a value outside the DBC.
    pub malformed: u64,
    /// Frames that are not the ECU's to send, or not of the contract at all.
    pub unknown: u64,
    /// Frames refused because they repeated their counter.
    pub repeated: u64,
    /// Jumps of a counter.
    pub counter_jumps: u64,
    /// Frames that the jumps say are missing.
    pub missing: u64,
    /// Failed attempts to read the bus.
    pub receive_failed: u64,
    /// Wake-ups that left frames unread.
    pub drain_cut: u64,
    /// Frames the bus did not take.
    pub send_failed: u64,
    /// Messages not sent because a value does not fit its signal.
    pub not_encodable: u64,
    /// Frames sent whose echo did not come back; recorded, without a kernel's time, when that was
    /// given up.
    pub unechoed: u64,
    /// Frames of the time before the run that the recording had no room for.
    pub unrecorded: u64,
}

/// The rig's attachment to the bus of one truck.
pub(crate) struct TruckNode {
    truck: usize,
    bus: Box<dyn Bus>,
    waiting: Waiting,
    encoder: Encoder,
    decoder: Decoder,
    grain: CommandGrain,
    /// Whether an ECU is at the other end. A scripted truck has none, and its bus is silent.
    pub(crate) has_ecu: bool,
    /// The command this truck obeys.
    pub(crate) watch: CommandWatch,
    /// The mode its ECU last reported.
    pub(crate) ecu_mode: Option<EcuMode>,
    /// What happened on its bus.
    pub(crate) counts: NodeCounts,
}

impl TruckNode {
    pub(crate) fn new(truck: usize, bus: Box<dyn Bus>, tick_period_ns: u64) -> Self {
        let (profile, vehicle) = (Profile::default(), Vehicle::default());
        Self {
            truck,
            waiting: Waiting::new(bus.echoes()),
            bus,
            encoder: Encoder::new(profile, vehicle),
            decoder: Decoder::new(profile, vehicle),
            has_ecu: true,
            watch: CommandWatch::new(tick_period_ns, profile.command_grain(&vehicle)),
            grain: profile.command_grain(&vehicle),
            ecu_mode: None,
            counts: NodeCounts::default(),
        }
    }

    /// Speaks another profile from now on.
    pub(crate) fn speak(&mut self, profile: Profile, vehicle: Vehicle) {
        self.encoder = Encoder::new(profile, vehicle);
        self.decoder = Decoder::new(profile, vehicle);
        self.grain = profile.command_grain(&vehicle);
    }

    /// The bus of this truck.
    pub(crate) fn bus(&self) -> &dyn Bus {
        &*self.bus
    }

    /// Forgets what came before the run.
    pub(crate) fn begin(&mut self, tick_period_ns: u64) {
        let unrecorded = self.counts.unrecorded;
        self.counts = NodeCounts { unrecorded, ..NodeCounts::default() };
        self.watch = CommandWatch::new(tick_period_ns, self.grain);
        self.bus.begin();
    }

    /// Tells the bus how late it is \[ns of bench time\].
    pub(crate) fn service(&mut self, time_ns: u64) {
        self.bus.set_bench_time(time_ns);
    }

    /// Tells the bus that bench time has come to its end.
    pub(crate) fn end(&mut self) {
        self.bus.end();
    }

    /// Counts a wake-up that integrates `span_ns` after draining.
    pub(crate) fn age(&mut self, span_ns: u64) {
        let lost = self.has_ecu && self.watch.age(span_ns);
        self.counts.lost_commands += u32::from(lost);
    }

    /// Notes what the actuators do, for the profiles that publish it.
    pub(crate) fn note_actuators(&mut self, force_n: f64, steering_rad: f64) {
        self.encoder.note_actuators(force_n, steering_rad);
    }

    /// Puts the frames of a message on the bus.
    pub(crate) fn send(&mut self, message: &Message, tap: &mut Tap) {
        if !self.has_ecu {
            return;
        }
        self.bus.set_bench_time(tap.time_ns);
        let mut encoder = self.encoder;
        let encoded =
            encoder.encode(message, tap.time_ns, &mut |frame| self.send_frame(frame, tap));
        self.encoder = encoder;
        self.counts.not_encodable += u64::from(encoded.is_err());
    }

    fn send_frame(&mut self, frame: &Frame, tap: &mut Tap) {
        if self.bus.send(frame).is_ok() {
            self.sent(frame, tap);
        } else {
            self.counts.send_failed += 1;
        }
    }

    /// Reads the bus and acts on every frame that passes its checks; what is for the truck's radio
    /// goes to `radio`.
    pub(crate) fn drain(&mut self, tap: &mut Tap, mut radio: impl FnMut(&Message)) {
        self.waiting.looked(tap.time_ns);
        while let Some(frame) = self.waiting.overdue() {
            self.unechoed(frame, tap);
        }
        let (mut heard, mut echoed) = (0, 0);
        while heard < DRAIN_MAX && echoed < DRAIN_MAX {
            let Some(received) = self.receive() else { return };
            if received.own {
                echoed += 1;
                self.echoed(&received, tap);
                continue;
            }
            heard += 1;
            let record = tap.record(self.truck, false, received.stamp_ns, received.frame);
            self.record(record, tap);
            match self.check(&received.frame) {
                Some(Message::Actuation(command)) => {
                    let came = (tap.tick, received.stamp_ns);
                    self.watch.accept(&command, came, &mut self.counts);
                }
                Some(Message::EcuStatus(status)) => self.ecu_mode = Some(status.ecu_mode),
                Some(for_radio) => radio(&for_radio),
                None => {}
            }
        }
        self.counts.drain_cut += 1;
    }

    /// Whether an echo is still to come.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Records the frames whose echo has not come, at the end of a run.
    pub(crate) fn give_up_waiting(&mut self, tap: &mut Tap) {
        while let Some(frame) = self.waiting.given_up() {
            self.unechoed(frame, tap);
        }
    }

    /// The next frame waiting, if the bus can be read.
    fn receive(&mut self) -> Option<Received> {
        self.bus.receive().unwrap_or_else(|_| {
            self.counts.receive_failed += 1;
            None
        })
    }

    /// A frame was sent: it is recorded now, or when its echo comes.
    fn sent(&mut self, frame: &Frame, tap: &mut Tap) {
        if !self.bus.echoes() {
            self.record(tap.record(self.truck, true, 0, *frame), tap);
        } else if let Some(oldest) = self.waiting.sent(*frame) {
            self.unechoed(oldest, tap);
        }
    }

    /// An echo of a frame that is recorded already, because it took too long, changes nothing.
    fn echoed(&mut self, echo: &Received, tap: &mut Tap) {
        if self.waiting.heard(&echo.frame) {
            self.record(tap.record(self.truck, true, echo.stamp_ns, echo.frame), tap);
        }
    }

    fn unechoed(&mut self, frame: Frame, tap: &mut Tap) {
        self.counts.unechoed += 1;
        self.record(tap.record(self.truck, true, 0, frame), tap);
    }

    fn record(&mut self, record: FrameRecord, tap: &mut Tap) {
        self.counts.unrecorded += u64::from(!tap.push(record));
    }

    /// The message of the ECU that a sound and new frame completes; otherwise `None`, and a count
    /// when the frame should not be there.
    fn check(&mut self, frame: &Frame) -> Option<Message> {
        let counts = &mut self.counts;
        let Heard { message, lost } = match self.decoder.take(frame) {
            Ok(heard) => heard,
            Err(refusal) => {
                *match refusal {
                    Refusal::Crc => &mut counts.bad_crc,
                    Refusal::UnknownId => &mut counts.unknown,
                    Refusal::Malformed => &mut counts.malformed,
                    Refusal::Repeated => &mut counts.repeated,
                } += 1;
                return None;
            }
        };
        counts.counter_jumps += u64::from(lost > 0);
        counts.missing += u64::from(lost);
        let message = message?;
        let is_of_ecu = matches!(
            message,
            Message::Actuation(_)
                | Message::V2vOut(_)
                | Message::V2vTrajectoryOut(_)
                | Message::EcuStatus(_)
        );
        counts.unknown += u64::from(!is_of_ecu);
        is_of_ecu.then_some(message)
    }
}
