//! The tap on every bus: what passes is recorded in the order of the wire.
//!
//! Where a bus echoes, a frame of the rig's own is recorded when its echo comes, between the frames
//! of others where it really was and with the kernel's time. Elsewhere it is recorded when sent.

use std::collections::VecDeque;

use platoon_dbc::Frame;
use traces::{FrameRecord, Recorder};

/// Most frames of the time before the run that are kept until its recording can begin.
const EARLY_MAX: usize = 8192;
/// Most frames that may wait for their echo on one bus.
const WAITING_MAX: usize = 4096;
/// How long an echo may take \[ns\]. Long: on a busy machine the kernel may deliver nothing at all
/// for as long as processes more urgent than its own thread for that (ksoftirqd) keep running.
const ECHO_WAIT_NS: u64 = 5_000_000_000;
/// Most of it that one look at the bus can use up \[ns\]: after a pause of the rig its time jumps.
const WAIT_PER_LOOK_MAX_NS: u64 = 10_000_000;

/// Records what passes the nodes, with the time it passes.
pub(crate) struct Tap {
    /// Where to, if anywhere.
    pub(crate) recorder: Option<Recorder>,
    /// Bench time \[ns\].
    pub(crate) time_ns: u64,
    /// Newest tick published.
    pub(crate) tick: u32,
    is_open: bool,
    /// What passed before the run: the recording cannot begin before bench time has.
    early: Vec<FrameRecord>,
}

impl Tap {
    /// A closed tap. One that `keeps_early` records the time before the run too, as far as there
    /// is room; a run in virtual time has none worth recording.
    pub(crate) fn new(recorder: Option<Recorder>, keeps_early: bool) -> Self {
        let early = Vec::with_capacity(if keeps_early { EARLY_MAX } else { 0 });
        Self { recorder, time_ns: 0, tick: 0, is_open: false, early }
    }

    /// Whether anything is recorded yet.
    pub(crate) const fn is_open(&self) -> bool {
        self.is_open
    }

    /// Starts recording, with what passed so far at bench time 0.
    pub(crate) fn open(&mut self) {
        self.is_open = true;
        for record in std::mem::take(&mut self.early) {
            self.push(record);
        }
    }

    /// A frame that passes now.
    pub(crate) fn record(&self, bus: usize, tx: bool, stamp_ns: u64, frame: Frame) -> FrameRecord {
        let (bus, time_ns, tick) = (bus as u8, self.time_ns, self.tick);
        FrameRecord { bus, time_ns, stamp_ns, tick, tx, frame }
    }

    /// Records a frame. False when it is one from before the run and there is no room for it;
    /// later, the recorder itself counts what it drops.
    pub(crate) fn push(&mut self, record: FrameRecord) -> bool {
        if self.is_open {
            if let Some(recorder) = &mut self.recorder {
                recorder.push(record);
            }
            return true;
        }
        let is_full = self.early.len() == self.early.capacity();
        if !is_full {
            self.early.push(record);
        }
        !is_full || self.early.capacity() == 0
    }
}

/// Frames of one node that wait for their echo, oldest first.
#[derive(Debug)]
pub(crate) struct Waiting {
    /// With the time waited so far by all when each was sent \[ns\].
    sent: VecDeque<(u64, Frame)>,
    waited_ns: u64,
    looked_ns: u64,
}

impl Waiting {
    /// None yet, with room for all there may be if the bus echoes.
    pub(crate) fn new(echoes: bool) -> Self {
        let sent = VecDeque::with_capacity(if echoes { WAITING_MAX } else { 0 });
        Self { sent, waited_ns: 0, looked_ns: 0 }
    }

    /// Whether every echo has come.
    pub(crate) fn is_empty(&self) -> bool {
        self.sent.is_empty()
    }

    /// A frame was sent. The one returned has waited longest and must make room.
    pub(crate) fn sent(&mut self, frame: Frame) -> Option<Frame> {
        let oldest = if self.sent.len() < WAITING_MAX { None } else { self.given_up() };
        self.sent.push_back((self.waited_ns, frame));
        oldest
    }

    /// An echo came; true when its frame was waiting. Hardware may send in another order.
    pub(crate) fn heard(&mut self, frame: &Frame) -> bool {
        let place = self.sent.iter().position(|(_, sent)| sent == frame);
        place.and_then(|place| self.sent.remove(place)).is_some()
    }

    /// The bus was looked at, at this bench time.
    pub(crate) fn looked(&mut self, now_ns: u64) {
        self.waited_ns += now_ns.saturating_sub(self.looked_ns).min(WAIT_PER_LOOK_MAX_NS);
        self.looked_ns = now_ns;
    }

    /// A frame whose echo is not to be expected any more.
    pub(crate) fn overdue(&mut self) -> Option<Frame> {
        let (since_ns, _) = self.sent.front()?;
        let is_overdue = self.waited_ns - since_ns > ECHO_WAIT_NS;
        if is_overdue { self.given_up() } else { None }
    }

    /// A frame whose echo nobody waits for any longer, because the run is over.
    pub(crate) fn given_up(&mut self) -> Option<Frame> {
        self.sent.pop_front().map(|(_, frame)| frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use platoon_dbc::FrameFlags;

    fn frame(number: u32) -> Frame {
        Frame::new(number, FrameFlags::default(), &[]).expect("valid")
    }

    #[test]
    fn an_echo_is_found_in_whatever_order_the_hardware_sent() {
        let mut waiting = Waiting::new(true);
        for number in 0..3 {
            assert_eq!(waiting.sent(frame(number)), None);
        }
        for number in [1, 0, 2] {
            assert!(waiting.heard(&frame(number)));
        }
        assert!(waiting.is_empty() && !waiting.heard(&frame(1)));
    }

    #[test]
    fn a_frame_without_echo_is_given_up_after_a_while() {
        let mut waiting = Waiting::new(true);
        waiting.sent(frame(1));
        waiting.looked(1_000_000);
        waiting.sent(frame(2));
        for time_ms in 2..=5000 {
            waiting.looked(time_ms * 1_000_000);
            assert_eq!(waiting.overdue(), None);
        }
        waiting.looked(5_001_000_000);
        assert_eq!(waiting.overdue(), Some(frame(1)));
        assert_eq!(waiting.overdue(), None);
        assert_eq!(waiting.given_up(), Some(frame(2)));
    }

    #[test]
    fn a_pause_of_the_rig_is_not_mistaken_for_a_lost_echo() {
        let mut waiting = Waiting::new(true);
        waiting.sent(frame(1));
        waiting.looked(30_000_000_000);
        assert_eq!(waiting.overdue(), None);
        assert!(waiting.heard(&frame(1)));
    }

    #[test]
    fn too_many_waiting_frames_push_out_the_oldest_and_allocate_nothing() {
        let mut waiting = Waiting::new(true);
        let room = waiting.sent.capacity();
        for number in 0..WAITING_MAX as u32 {
            assert_eq!(waiting.sent(frame(number % 0x700)), None);
        }
        assert_eq!(waiting.sent(frame(0x7FF)), Some(frame(0)));
        assert_eq!(waiting.sent.capacity(), room);
    }

    #[test]
    fn what_passes_before_the_run_is_kept_as_far_as_there_is_room() {
        let mut tap = Tap::new(None, true);
        let taken =
            (0..EARLY_MAX + 1).filter(|_| tap.push(tap.record(0, true, 0, frame(1)))).count();
        assert_eq!(taken, EARLY_MAX);
        tap.open();
        assert!(tap.push(tap.record(0, true, 0, frame(1))));
    }
}
