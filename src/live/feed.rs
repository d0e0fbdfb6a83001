//! What rig and ECUs record, read while they do.

use std::path::{Path, PathBuf};

use traces::{Derivation, Derived, Message, Offer, Reader, Scenery, Source, Topic};

use crate::run_folder::RunFolder;
use crate::scenery::SIGNALS_PERIOD_NS;

/// Where a message of a run comes from.
#[derive(Debug, Clone, Copy)]
pub enum Origin {
    /// It was recorded.
    Recorded(Topic),
    /// It follows from what was.
    Derived(Derived),
}

impl Origin {
    /// Its topic, as in the merged trace.
    pub fn topic(self) -> String {
        match self {
            Self::Recorded(topic) => topic.to_string(),
            Self::Derived(derived) => derived.topic(),
        }
    }

    /// How its channel is announced.
    pub fn offer(self) -> Offer {
        match self {
            Self::Recorded(topic) => topic.into(),
            Self::Derived(derived) => derived.into(),
        }
    }
}

/// A part that may not be there yet.
struct Part {
    path: PathBuf,
    reader: Option<Reader>,
}

impl Part {
    /// The reader with everything in sight that has been written by now.
    fn reader(&mut self) -> Option<&mut Reader> {
        match &mut self.reader {
            Some(reader) => reader.refresh().ok()?,
            None => self.reader = Some(open(&self.path)?),
        }
        self.reader.as_mut()
    }
}

/// Opens a part once its recorder has said when the run began.
fn open(path: &Path) -> Option<Reader> {
    let reader = Reader::open(path).ok()?;
    reader.start_wall_ns()?;
    let is_shown = |topic| !matches!(topic, Topic::Rx(_) | Topic::Memory(_));
    Some(reader.with_channels(move |channel| channel.kind.is_some_and(is_shown)))
}

/// The recordings of a run that is on.
pub struct Feed {
    parts: Vec<Part>,
    derivation: Derivation,
}

impl Feed {
    /// The recordings of rig and ECUs in a run's folder.
    pub fn new(folder: &RunFolder, trucks: usize, scenery: Scenery) -> Self {
        let sources = std::iter::once(Source::Rig).chain((0..trucks as u8).map(Source::Ecu));
        let part = |source: Source| Part { path: folder.part(&source.to_string()), reader: None };
        let derivation = Derivation::new(scenery, SIGNALS_PERIOD_NS);
        Self { parts: sources.map(part).collect(), derivation }
    }

    /// Gives everything that was recorded since the last time, with its log time and what follows
    /// from it, to `take`.
    pub fn read(&mut self, mut take: impl FnMut(Origin, u64, &[u8])) {
        let mut derivation = std::mem::take(&mut self.derivation);
        self.follow(|message, time_ns| {
            let Some(topic) = message.channel.kind else { return };
            take(Origin::Recorded(topic), time_ns, &message.data);
            let derive = |derived, data: &[u8]| {
                take(Origin::Derived(derived), time_ns, data);
                Ok::<(), std::convert::Infallible>(())
            };
            // What cannot fail needs no handling.
            let Ok(()) = derivation.derive(message, time_ns, derive);
        });
        self.derivation = derivation;
    }

    /// Gives every message recorded since the last time, with its log time, to `take`.
    pub fn follow(&mut self, mut take: impl FnMut(&Message, u64)) {
        let mut start_wall_ns = None;
        for part in &mut self.parts {
            let Some(reader) = part.reader() else { continue };
            // As in the merged trace, the wall clock is that of the first part, the rig's.
            let Some(start_ns) = start_wall_ns.or(reader.start_wall_ns()) else { continue };
            start_wall_ns = Some(start_ns);
            for message in reader {
                take(&message, start_ns.saturating_add(message.time_ns()));
            }
        }
    }
}
