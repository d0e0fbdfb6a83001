//! The frames of one message, collected before any is emitted.

use crate::frame::Frame;

/// Frames of one message at most: those of `EgoState` with everything the rig plays beside.
const FRAMES_MAX: usize = 9;

/// Frames in sending order.
#[derive(Default)]
pub(super) struct Batch {
    frames: [Option<Frame>; FRAMES_MAX],
    count: usize,
}

impl Batch {
    pub(super) fn push(&mut self, frame: Frame) {
        self.frames[self.count] = Some(frame);
        self.count += 1;
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Frame> {
        self.frames.iter().flatten()
    }
}
