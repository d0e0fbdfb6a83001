//! From the bus into the picture: bounded draining, decoding, supervision, counting.

use platoon_dbc::{Backend, Bus, Decoder, Heard, Message, Received, Refusal};
use serde::{Deserialize, Serialize};

use crate::phase_lock::Arrival;
use crate::picture::{Noted, Picture};

/// Most frames one tick takes from the bus.
///
/// A healthy tick sees one `EgoState` and at most a dozen others. 128 frames cost a fraction of a
/// millisecond, and empty what a full socket buffer of Linux's default size holds in three ticks.
pub const DRAIN_MAX: usize = 128;

/// What became of the frames received, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct InboxCounts {
    /// Messages taken into the picture.
    pub used: u64,
    /// Sound frames that are a part of a message, or only inform; none in the profile `fd`.
    pub parts: u64,
    /// Frames missing according to alive counters.
    pub lost: u64,
    /// Frames refused because their alive counter repeated the one before.
    pub repeated: u64,
    /// Frames refused because their checksum did not match.
    pub crc: u64,
    /// Frames of the contract refused for length, flags or a value outside the DBC's range.
    pub malformed: u64,
    /// Frames with an identifier outside the contract.
    pub foreign: u64,
    /// Sound messages that are not for this ECU: another node's commands, another truck's mission.
    pub not_mine: u64,
    /// Sound messages older than what the picture already holds.
    pub outdated: u64,
    /// Calls to the bus that failed.
    pub receive_errors: u64,
    /// Drains that stopped at the bound of one tick with frames possibly left.
    pub full_drains: u64,
}

/// What one drain brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Drained {
    /// Frames taken from the bus.
    pub frames: u32,
    /// Whether an `EgoState` was among those used.
    pub ego: bool,
    /// Bench time and arrival of the first `EgoState` used: the one a grid is measured by.
    pub ego_arrival: Option<(u64, Arrival)>,
    /// Arrival of the first frame of the drain, whatever it was.
    pub first_arrival: Option<Arrival>,
}

/// The receiving side of an ECU.
#[derive(Debug, Clone)]
pub struct Inbox {
    decoder: Decoder,
    counts: InboxCounts,
}

impl Inbox {
    /// An inbox that has received nothing.
    #[must_use]
    pub fn new(decoder: Decoder) -> Self {
        Self { decoder, counts: InboxCounts::default() }
    }

    /// What later frames are judged by, for a snapshot.
    #[must_use]
    pub const fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// Continues from a snapshot.
    pub fn restore(&mut self, decoder: Decoder) {
        self.decoder = decoder;
    }

    /// Totals so far.
    #[must_use]
    pub const fn counts(&self) -> InboxCounts {
        self.counts
    }

    /// Takes at most [`DRAIN_MAX`] frames from the bus into the picture.
    ///
    /// `now_ns` is the clock reading of the drain; `tap` sees every frame in order, sound or not.
    pub fn drain(
        &mut self,
        bus: &mut dyn Bus,
        picture: &mut Picture,
        now_ns: u64,
        mut tap: impl FnMut(&Received),
    ) -> Drained {
        let mut drained = Drained::default();
        // Loopback stamps are bench time, not a time of arrival.
        let stamped = bus.backend() != Backend::Loopback;
        for _ in 0..DRAIN_MAX {
            let received = match bus.receive() {
                Ok(Some(received)) => received,
                Ok(None) => return drained,
                Err(_) => {
                    self.counts.receive_errors += 1;
                    return drained;
                }
            };
            tap(&received);
            drained.frames += 1;
            let stamp_ns = if stamped { received.stamp_ns } else { 0 };
            let arrival = Arrival { now_ns, stamp_ns };
            drained.first_arrival.get_or_insert(arrival);
            if let Some(Message::EgoState(ego)) = self.take(&received, picture) {
                drained.ego = true;
                drained.ego_arrival.get_or_insert((ego.bench_time_ns, arrival));
            }
        }
        self.counts.full_drains += 1;
        drained
    }

    /// Decodes one frame and notes the message it completes; the message when the picture used it.
    fn take(&mut self, received: &Received, picture: &mut Picture) -> Option<Message> {
        let Heard { message, lost } = match self.decoder.take(&received.frame) {
            Ok(heard) => heard,
            Err(refusal) => {
                self.count_refusal(refusal);
                return None;
            }
        };
        self.counts.lost += u64::from(lost);
        let Some(message) = message else {
            self.counts.parts += 1;
            return None;
        };
        let counter = match picture.note(&message) {
            Noted::Used => {
                self.counts.used += 1;
                return Some(message);
            }
            Noted::Outdated => &mut self.counts.outdated,
            Noted::NotMine => &mut self.counts.not_mine,
        };
        *counter += 1;
        None
    }

    fn count_refusal(&mut self, refusal: Refusal) {
        let counter = match refusal {
            Refusal::UnknownId => &mut self.counts.foreign,
            Refusal::Crc => &mut self.counts.crc,
            Refusal::Malformed => &mut self.counts.malformed,
            Refusal::Repeated => &mut self.counts.repeated,
        };
        *counter += 1;
    }
}

#[cfg(test)]
mod tests {
    use platoon_dbc::{Actuation, EgoState, Frame, FrameFlags, Loopback, Profile, Vehicle};

    use super::*;

    fn ego(n: u32) -> EgoState {
        EgoState { tick: n, bench_time_ns: u64::from(n) * 1_000_000, ..EgoState::default() }
    }

    struct Bench {
        rig: Loopback,
        ecu: Loopback,
        inbox: Inbox,
        picture: Picture,
    }

    impl Bench {
        fn new() -> Self {
            let (rig, ecu) = Loopback::pair("loopback0", 1024);
            let inbox = Inbox::new(Decoder::new(Profile::Fd, Vehicle::default()));
            Self { rig, ecu, inbox, picture: Picture::new(0) }
        }

        fn send(&mut self, frame: Frame) {
            self.rig.send(&frame).expect("room");
        }

        fn drain(&mut self) -> Drained {
            self.inbox.drain(&mut self.ecu, &mut self.picture, 0, |_| {})
        }
    }

    #[test]
    fn refusals_are_counted_by_kind_and_never_reach_the_picture() {
        let mut bench = Bench::new();
        let sound = ego(1).encode(0).expect("in range");
        let mut damaged = sound.data().to_vec();
        damaged[7] ^= 1;
        bench.send(Frame::new(sound.id(), sound.flags(), &damaged).expect("a frame"));
        bench.send(Frame::new(sound.id(), sound.flags(), &damaged[..16]).expect("a frame"));
        bench.send(Frame::new(0x123, FrameFlags::default(), &[1]).expect("a frame"));
        bench.send(Actuation::default().encode(0).expect("in range"));
        let drained = bench.drain();
        assert_eq!((drained.frames, drained.ego), (4, false));
        let counts = bench.inbox.counts();
        assert_eq!((counts.crc, counts.malformed, counts.foreign, counts.not_mine), (1, 1, 1, 1));
        assert_eq!(counts.used, 0);
    }

    #[test]
    fn repeated_counters_are_refused_and_gaps_counted() {
        let mut bench = Bench::new();
        for (n, counter) in [(1, 0), (2, 0), (3, 1), (4, 5)] {
            bench.send(ego(n).encode(counter).expect("in range"));
        }
        bench.drain();
        let counts = bench.inbox.counts();
        assert_eq!((counts.used, counts.repeated, counts.lost), (3, 1, 3));
    }

    #[test]
    fn an_older_state_never_replaces_a_newer_one() {
        let mut bench = Bench::new();
        for (counter, n) in [5, 3].into_iter().enumerate() {
            bench.send(ego(n).encode(counter as u8).expect("in range"));
        }
        bench.drain();
        assert_eq!(bench.inbox.counts().outdated, 1);
        assert_eq!(bench.picture.ego().map(|ego| ego.tick), Some(5));
    }

    #[test]
    fn a_flood_costs_a_bounded_drain_and_the_newest_state_wins_in_the_end() {
        let mut bench = Bench::new();
        for n in 0..300 {
            bench.send(ego(n).encode(n as u8).expect("in range"));
        }
        let frames = [(); 3].map(|()| bench.drain().frames);
        assert_eq!(frames, [DRAIN_MAX as u32, DRAIN_MAX as u32, 300 - 2 * DRAIN_MAX as u32]);
        assert_eq!(bench.inbox.counts().full_drains, 2);
        assert_eq!(bench.picture.ego().map(|ego| ego.tick), Some(299));
    }

    #[test]
    fn the_tap_sees_every_frame_in_order_sound_or_not() {
        let mut bench = Bench::new();
        bench.send(Frame::new(0x7, FrameFlags::default(), &[]).expect("a frame"));
        bench.send(ego(1).encode(0).expect("in range"));
        let mut ids = Vec::new();
        let Bench { ecu, inbox, picture, .. } = &mut bench;
        inbox.drain(ecu, picture, 0, |received| ids.push(received.frame.id()));
        assert_eq!(ids, [0x7, EgoState::ID]);
    }
}
