//! Recording without waiting: a loop pushes, a thread of its own writes.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use mcap::McapError;
use thiserror::Error;

use crate::part::{Part, Sink};
use crate::ring::{Capacity, Counts, Recordable, Rings};
use crate::topic::Source;
use crate::writer::{Writer, Written};

/// What a push does when its ring is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overflow {
    /// Real time: the record is dropped and counted.
    #[default]
    DropNewest,
    /// Virtual time: the pusher waits for the writer and nothing is dropped.
    Wait,
}

/// How to record.
#[derive(Debug, Clone)]
pub struct RecorderOptions {
    /// The process this is.
    pub source: Source,
    /// Wall clock at bench time 0 \[ns since 1970\]; 0 in virtual time.
    pub start_wall_ns: u64,
    /// What a push does when its ring is full.
    pub overflow: Overflow,
    /// Room in the rings.
    pub capacity: Capacity,
    /// Names of the interfaces behind the buses, by bus number; noted on the channels.
    pub interfaces: Vec<String>,
}

impl RecorderOptions {
    /// Real-time recording with the usual room, bench time 0 at 1970.
    #[must_use]
    pub fn new(source: Source) -> Self {
        Self {
            source,
            start_wall_ns: 0,
            overflow: Overflow::DropNewest,
            capacity: Capacity::of(source),
            interfaces: Vec::new(),
        }
    }
}

/// Why recording cannot start.
#[derive(Debug, Error)]
pub enum RecorderError {
    /// The part file cannot be made.
    #[error("cannot create {path}: {source}; choose a folder that exists and can be written")]
    Create {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The part file's first bytes cannot be written.
    #[error("cannot write {path}: {source}; choose a folder with room that can be written")]
    Write {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: McapError,
    },
    /// No thread for the writer.
    #[error("cannot start the thread that writes {path}: {source}; allow this user more threads")]
    Thread {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
}

/// What became of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Finished {
    /// Records in the file.
    pub written: u64,
    /// Records that did not fit the rings.
    pub dropped: Counts,
    /// Records that reached the writer but not the file.
    pub lost: u64,
    /// Why records were lost: the first write error, in the operating system's words.
    pub error: Option<String>,
}

/// Takes records from one loop and has a thread write them to an MCAP part file.
///
/// ```no_run
/// use traces::{Recorder, RecorderOptions, Source, TickRecord};
///
/// let path = std::path::Path::new("ecu0.part.mcap");
/// let mut recorder = Recorder::start(path, RecorderOptions::new(Source::Ecu(0)))?;
/// recorder.push(TickRecord { time_ns: 1_000_000, tick: 1, ..TickRecord::default() });
/// let finished = recorder.finish();
/// assert_eq!((finished.written, finished.dropped.total()), (1, 0));
/// # Ok::<(), traces::RecorderError>(())
/// ```
pub struct Recorder {
    rings: Arc<Rings>,
    overflow: Overflow,
    writer: Option<JoinHandle<Written>>,
}

impl Recorder {
    /// Creates the file and starts the writer.
    ///
    /// The writer's thread inherits the caller's scheduling policy and CPUs: start the recorder
    /// before raising the loop's own priority.
    ///
    /// # Errors
    /// When the file cannot be created or written, or the thread not started.
    pub fn start(path: &Path, options: RecorderOptions) -> Result<Self, RecorderError> {
        let path = path.to_path_buf();
        match File::create(&path) {
            Ok(file) => Self::start_into(Box::new(file), path, options),
            Err(source) => Err(RecorderError::Create { path, source }),
        }
    }

    /// Starts the writer on any sink; `path` only names it in errors.
    pub(crate) fn start_into(
        sink: Box<dyn Sink>,
        path: PathBuf,
        options: RecorderOptions,
    ) -> Result<Self, RecorderError> {
        let RecorderOptions { source, start_wall_ns, overflow, capacity, interfaces } = options;
        let part = Part::create(sink, source, interfaces)
            .map_err(|source| RecorderError::Write { path: path.clone(), source })?;
        let rings = Arc::new(Rings::new(capacity, start_wall_ns));
        let writer = Writer::new(part, Arc::clone(&rings));
        let writer = thread::Builder::new()
            .name(format!("{source}-recorder"))
            .spawn(move || writer.run())
            .map_err(|source| RecorderError::Thread { path, source })?;
        Ok(Self { rings, overflow, writer: Some(writer) })
    }

    /// Sets the wall clock at bench time 0 \[ns since 1970\], for a process that learns it only
    /// when the run starts. Has no effect after the first push.
    pub fn set_start_wall_ns(&mut self, start_wall_ns: u64) {
        if self.rings.numbered() == 0 {
            self.rings.set_start_wall_ns(start_wall_ns);
        }
    }

    /// Hands a record over; `false` when it was dropped.
    ///
    /// With [`Overflow::DropNewest`] this neither allocates nor locks nor waits. After a drop the
    /// file has a gap marker in front of the next record that fits, and an ECU should push a
    /// snapshot of its memory.
    pub fn push<T: Recordable>(&mut self, record: T) -> bool {
        if self.overflow == Overflow::Wait {
            self.wait_for_room::<T>();
        }
        self.rings.push(record)
    }

    /// Records dropped so far.
    #[must_use]
    pub fn dropped(&self) -> Counts {
        self.rings.dropped()
    }

    /// Writes what is queued, closes the file and says what became of the records.
    #[must_use = "it says whether records were dropped or lost"]
    pub fn finish(mut self) -> Finished {
        self.join()
    }

    /// Returns when there is room, or nobody left to make some.
    fn wait_for_room<T: Recordable>(&self) {
        let Some(writer) = &self.writer else { return };
        while !self.rings.has_room::<T>() && !writer.is_finished() {
            writer.thread().unpark();
            thread::yield_now();
        }
    }

    fn join(&mut self) -> Finished {
        self.rings.stop();
        let dropped = self.rings.dropped();
        let queued = self.rings.numbered() - dropped.total();
        match self.writer.take().map(JoinHandle::join) {
            Some(Ok(Written { written, error })) => {
                Finished { written, dropped, lost: queued - written.min(queued), error }
            }
            Some(Err(_)) | None => Finished {
                written: 0,
                dropped,
                lost: queued,
                error: Some("the recorder's thread ended early".into()),
            },
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if self.writer.is_some() {
            self.join();
        }
    }
}

#[cfg(test)]
mod tests;
