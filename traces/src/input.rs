//! A part on its way into a merge, and what there is to say about it afterwards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::part::{PART, PART_END};
use crate::reader::{Message, ReadError, Reader};
use crate::record::Record;
use crate::ring::Counts;
use crate::scan::Loss;
use crate::sorted::Sorted;
use crate::topic::{Source, Topic};

/// What became of one part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartReport {
    /// The part file.
    pub path: PathBuf,
    /// Whose it is; `None` when it does not say or cannot be read.
    pub source: Option<Source>,
    /// Why it cannot be read at all.
    pub unreadable: Option<String>,
    /// Messages taken from it.
    pub messages: u64,
    /// Bench time of its last message \[ns\].
    pub last_time_ns: Option<u64>,
    /// Whether its recorder closed it; if not, its process was killed.
    pub is_finished: bool,
    /// What of it could not be read.
    pub loss: Loss,
    /// Records its ring dropped, as far as the part tells.
    pub dropped: Counts,
}

impl PartReport {
    fn of(path: &Path) -> Self {
        Self {
            path: path.into(),
            source: None,
            unreadable: None,
            messages: 0,
            last_time_ns: None,
            is_finished: false,
            loss: Loss::default(),
            dropped: Counts::default(),
        }
    }

    /// The part's file name.
    #[must_use]
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or(self.path.as_os_str()).display().to_string()
    }

    /// Whether nothing of the part is missing.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.unreadable.is_none()
            && self.is_finished
            && self.loss.is_none()
            && self.dropped.total() == 0
    }
}

impl core::fmt::Display for PartReport {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if let Some(reason) = &self.unreadable {
            return write!(f, "nothing could be read: {reason}");
        }
        write!(f, "{} messages", self.messages)?;
        if let Some(last_ns) = self.last_time_ns {
            write!(f, " up to {:.3} s", last_ns as f64 * 1e-9)?;
        }
        if !self.is_finished {
            write!(f, ", not closed: its process ended early")?;
        }
        if self.loss.bytes > 0 || self.loss.chunks > 0 || self.loss.records > 0 {
            let Loss { bytes, chunks, records, .. } = self.loss;
            write!(f, ", unreadable: {bytes} bytes, {chunks} chunks, {records} records")?;
        }
        if self.dropped.total() > 0 {
            let Counts { frames, ticks, truths, memories } = self.dropped;
            write!(f, ", dropped: {frames} frames, {ticks} ticks, {truths} world states, ")?;
            write!(f, "{memories} snapshots")?;
        }
        Ok(())
    }
}

/// One part being merged.
pub(crate) struct Input {
    messages: Option<Sorted>,
    pub(crate) report: PartReport,
}

impl Input {
    /// Opens a part; one that cannot be read becomes an empty one that says so.
    pub(crate) fn open(path: &Path) -> Self {
        let mut report = PartReport::of(path);
        let messages = match Reader::open(path) {
            Ok(reader) => {
                take_metadata(&mut report, &reader);
                Some(Sorted::new(reader))
            }
            Err(ReadError::Io { source, .. }) => {
                report.unreadable = Some(source.to_string());
                None
            }
            Err(ReadError::NotMcap { .. }) => {
                report.unreadable = Some("not an MCAP file".into());
                None
            }
        };
        Self { messages, report }
    }

    pub(crate) fn start_wall_ns(&self) -> Option<u64> {
        self.messages.as_ref()?.reader.start_wall_ns()
    }

    /// For a part too short to say when bench time 0 was.
    pub(crate) fn assume_start_wall_ns(&mut self, start_wall_ns: u64) {
        if let Some(messages) = &mut self.messages {
            messages.reader.assume_start_wall_ns(start_wall_ns);
        }
    }

    pub(crate) fn peek_ns(&mut self) -> Option<u64> {
        self.messages.as_mut()?.peek_ns()
    }

    pub(crate) fn pop(&mut self) -> Option<Message> {
        let message = self.messages.as_mut()?.pop()?;
        if let (false, Some(Topic::Dropped(_))) = (self.report.is_finished, message.channel.kind)
            && let Ok(Record::Dropped(gap)) = message.record()
        {
            let (frames, ticks) = (gap.frames, gap.ticks);
            let (truths, memories) = (gap.truths, gap.memories);
            self.report.dropped = Counts { frames, ticks, truths, memories };
        }
        Some(message)
    }

    pub(crate) fn stragglers(&self) -> u64 {
        self.messages.as_ref().map_or(0, |messages| messages.stragglers)
    }

    /// Fills in what is known only when every message has been read.
    pub(crate) fn complete(&mut self) {
        if let Some(messages) = &self.messages {
            self.report.messages = messages.taken();
            self.report.last_time_ns = messages.newest_ns();
            self.report.loss = messages.reader.loss();
        }
    }
}

fn take_metadata(report: &mut PartReport, reader: &Reader) {
    let metadata = reader.metadata();
    let source = metadata.get(PART).and_then(|part| part.get("source"));
    report.source = source.and_then(|source| Source::parse(source));
    if let Some(end) = metadata.get(PART_END) {
        report.is_finished = true;
        report.dropped = Counts {
            frames: count(end, "dropped_frames"),
            ticks: count(end, "dropped_ticks"),
            truths: count(end, "dropped_truths"),
            memories: count(end, "dropped_memories"),
        };
    }
}

fn count(pairs: &BTreeMap<String, String>, key: &str) -> u64 {
    pairs.get(key).and_then(|value| value.parse().ok()).unwrap_or(0)
}
