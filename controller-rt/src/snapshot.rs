//! Everything later commands depend on, as bytes: guard, outbox, decoder, picture, the controller's
//! memory.

use platoon_dbc::Decoder;
use serde::{Deserialize, Serialize};

use crate::controller::Controller;
use crate::guard::Guard;
use crate::outbox::OutboxState;
use crate::picture::Picture;

/// Format of the bytes; a replay refuses another.
const VERSION: u8 = 5;
/// Room for the picture: 26 messages of at most a hundred bytes, and 16 plans of two hundred.
const PICTURE_BYTES: usize = 6144;
/// Room for a controller's memory.
const CONTROLLER_BYTES: usize = 32 * 1024;
/// Room for guard, encoder and decoder: a decoder with parts of every message in flight is largest.
const OTHER_BYTES: usize = 5120;
/// Room for all.
const ALL_BYTES: usize = PICTURE_BYTES + CONTROLLER_BYTES + OTHER_BYTES;

#[derive(Serialize, Deserialize)]
struct Layout<'bytes> {
    version: u8,
    guard: Guard,
    outbox: OutboxState,
    decoder: Decoder,
    picture: &'bytes [u8],
    controller: &'bytes [u8],
}

/// What a snapshot holds, read back.
pub struct Saved<'bytes> {
    /// The guard.
    pub guard: Guard,
    /// The outbox's counters and due times.
    pub outbox: OutboxState,
    /// What received frames are judged by.
    pub decoder: Decoder,
    /// The picture.
    pub picture: Picture,
    /// The controller's own encoding of its memory.
    pub controller: &'bytes [u8],
}

/// Buffers for writing snapshots without allocating.
pub struct SnapshotBuffer {
    picture: Box<[u8]>,
    controller: Box<[u8]>,
    all: Box<[u8]>,
}

impl SnapshotBuffer {
    /// Allocates all that snapshots will need.
    pub fn new() -> Self {
        let room = |bytes: usize| vec![0; bytes].into_boxed_slice();
        Self {
            picture: room(PICTURE_BYTES),
            controller: room(CONTROLLER_BYTES),
            all: room(ALL_BYTES),
        }
    }

    /// The snapshot's bytes; empty when something has no room.
    pub fn write(
        &mut self,
        guard: &Guard,
        outbox: OutboxState,
        decoder: &Decoder,
        picture: &Picture,
        controller: &dyn Controller,
    ) -> &[u8] {
        let Some(picture_used) = picture.save(&mut self.picture) else {
            return &[];
        };
        let Some(controller_used) = controller.save(&mut self.controller) else {
            return &[];
        };
        let layout = Layout {
            version: VERSION,
            guard: *guard,
            outbox,
            decoder: *decoder,
            picture: &self.picture[..picture_used],
            controller: &self.controller[..controller_used],
        };
        postcard::to_slice(&layout, &mut self.all).map_or(&[], |used| used)
    }
}

/// Reads a snapshot of this truck; `None` when it is damaged or of another version.
pub fn read(bytes: &[u8], truck: u8) -> Option<Saved<'_>> {
    let (layout, rest) = postcard::take_from_bytes::<Layout<'_>>(bytes).ok()?;
    if layout.version != VERSION || !rest.is_empty() {
        return None;
    }
    let picture = Picture::restore(truck, layout.picture)?;
    let Layout { guard, outbox, decoder, controller, .. } = layout;
    Some(Saved { guard, outbox, decoder, picture, controller })
}
