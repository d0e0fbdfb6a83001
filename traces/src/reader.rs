//! Reading traces, whole, cut or damaged.
//!
//! A damaged chunk costs that chunk, a cut file what comes after the cut; [`Reader::loss`] says
//! how much that was. Nothing in a file makes the reader panic, hang, or take memory out of
//! proportion to the file.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{Record as Raw, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use thiserror::Error;

use crate::part::{MERGED, PART};
use crate::record::Record;
use crate::scan::{self, Attachment, Layout, Loss, Span};
use crate::topic::Topic;
use crate::wire::DecodeError;

/// Largest chunk that is decompressed, and largest record in it.
const CHUNK_MAX: usize = 64 << 20;
/// Bytes of a chunk's head without the name of its compression: two times, two sizes (8 each), a
/// checksum and the length of that name (4 each).
const CHUNK_HEAD_BYTES: u64 = 40;

/// Why a trace cannot be read at all.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The operating system refuses.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// Not an MCAP file.
    #[error("{path} is not an MCAP file: it does not begin with MCAP's magic bytes")]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
}

/// A channel of a trace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Topic name.
    pub topic: String,
    /// The topic as one of ours, if it is.
    pub kind: Option<Topic>,
    /// Name of its schema; empty when it has none.
    pub schema: String,
    /// Encoding of its messages, such as `cdr` or `protobuf`.
    pub encoding: String,
    /// What its writer noted about it.
    pub metadata: BTreeMap<String, String>,
}

/// A message of a trace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// The channel it is on.
    pub channel: Arc<Channel>,
    /// Number its writer gave it; in a part file, a gap means dropped records.
    pub sequence: u32,
    /// Log time \[ns since 1970\]: wall clock at the run's start plus bench time.
    pub log_time_ns: u64,
    /// Log time of bench time 0 \[ns since 1970\].
    pub start_wall_ns: u64,
    /// The encoded record.
    pub data: Vec<u8>,
}

impl Message {
    /// Bench time \[ns\].
    #[must_use]
    pub const fn time_ns(&self) -> u64 {
        self.log_time_ns.saturating_sub(self.start_wall_ns)
    }

    /// The record that was pushed.
    ///
    /// # Errors
    /// When the topic is none a recorder writes or the bytes are not its record.
    pub fn record(&self) -> Result<Record, DecodeError> {
        Record::decode(self)
    }
}

/// Reads the messages of a trace in file order.
///
/// ```no_run
/// use traces::{Reader, Record};
///
/// let mut reader = Reader::open("run.mcap".as_ref())?;
/// for message in &mut reader {
///     if let Ok(Record::Tick(tick)) = message.record() {
///         println!("{} s: {} N", message.time_ns() as f64 * 1e-9, tick.force_n);
///     }
/// }
/// assert!(reader.loss().is_none());
/// # Ok::<(), traces::ReadError>(())
/// ```
pub struct Reader {
    source: Box<dyn Source>,
    layout: Layout,
    /// Next span to open.
    next: usize,
    wants: Box<dyn Fn(&Channel) -> bool + Send>,
    times: Range<u64>,
    start_wall_ns: Option<u64>,
    unpacker: LinearReader,
    schemas: HashMap<u16, String>,
    /// Channels by number; empty for one whose messages nobody wants.
    channels: HashMap<u16, Option<Arc<Channel>>>,
    ready: VecDeque<Message>,
}

/// Anything a trace can be read from.
trait Source: Read + Seek + Send {}
impl<T: Read + Seek + Send> Source for T {}

impl Reader {
    /// Opens a trace and finds its records, metadata and attachments.
    ///
    /// # Errors
    /// When the file cannot be read or does not begin as an MCAP file does. Damage further on is
    /// no error: see [`Reader::loss`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let io = |source| ReadError::Io { path: path.into(), source };
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Self::scan(Box::new(BufReader::new(file)), length)
            .map_err(io)?
            .ok_or_else(|| ReadError::NotMcap { path: path.into() })
    }

    /// Opens a trace held in memory; `None` when it is not MCAP.
    #[must_use]
    pub fn from_bytes(bytes: Vec<u8>) -> Option<Self> {
        let length = bytes.len() as u64;
        Self::scan(Box::new(io::Cursor::new(bytes)), length).ok()?
    }

    fn scan(mut source: Box<dyn Source>, length: u64) -> io::Result<Option<Self>> {
        if !scan::has_magic(&mut source)? {
            return Ok(None);
        }
        let layout = scan::scan(&mut source, length)?;
        let start_wall_ns = start_wall_ns(&layout);
        Ok(Some(Self {
            source,
            layout,
            next: 0,
            wants: Box::new(|_| true),
            times: 0..u64::MAX,
            start_wall_ns,
            unpacker: unpacker(),
            schemas: HashMap::new(),
            channels: HashMap::new(),
            ready: VecDeque::new(),
        }))
    }

    /// Finds what was written since the file was opened or last refreshed, so that a run can be
    /// read while it is recorded.
    ///
    /// # Errors
    /// When the file cannot be read any more.
    pub fn refresh(&mut self) -> io::Result<()> {
        let length = self.source.seek(SeekFrom::End(0))?;
        self.layout.resume(&mut self.source, length)?;
        self.start_wall_ns = self.start_wall_ns.or_else(|| start_wall_ns(&self.layout));
        Ok(())
    }

    /// Keeps only messages of these topics.
    #[must_use]
    pub fn with_topics<S: Into<String>>(self, topics: impl IntoIterator<Item = S>) -> Self {
        let topics: Vec<String> = topics.into_iter().map(Into::into).collect();
        self.with_channels(move |channel| topics.contains(&channel.topic))
    }

    /// Keeps only messages of the channels that `wants` accepts.
    #[must_use]
    pub fn with_channels(self, wants: impl Fn(&Channel) -> bool + Send + 'static) -> Self {
        Self { wants: Box::new(wants), ..self }
    }

    /// Keeps only messages of this span of bench time \[ns\].
    #[must_use]
    pub fn with_times(self, times: Range<u64>) -> Self {
        Self { times, ..self }
    }

    /// Metadata records by name.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.layout.metadata
    }

    /// Attached files.
    #[must_use]
    pub fn attachments(&self) -> &[Attachment] {
        &self.layout.attachments
    }

    /// Log time of bench time 0 \[ns since 1970\]; `None` when the file does not say.
    #[must_use]
    pub fn start_wall_ns(&self) -> Option<u64> {
        self.start_wall_ns
    }

    /// Supplies the log time of bench time 0 where the file does not say.
    pub(crate) fn assume_start_wall_ns(&mut self, start_wall_ns: u64) {
        self.start_wall_ns.get_or_insert(start_wall_ns);
    }

    /// What could not be read so far; final once the messages are exhausted.
    #[must_use]
    pub fn loss(&self) -> Loss {
        self.layout.loss
    }

    /// Reads the next span into `ready`.
    fn open_span(&mut self, span: Span) {
        match self.read_span(span) {
            Ok(bytes) if is_filled(span, &bytes) => self.unpack(span, &bytes),
            Ok(_) => self.lose(span),
            Err(_) => self.layout.loss.bytes += span.length,
        }
    }

    fn read_span(&mut self, span: Span) -> io::Result<Vec<u8>> {
        if span.length > CHUNK_MAX as u64 {
            return Err(io::ErrorKind::OutOfMemory.into());
        }
        let mut bytes = vec![0; span.length as usize];
        self.source.seek(SeekFrom::Start(span.offset))?;
        self.source.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    /// Takes the records of a span, those inside when it is a chunk.
    fn unpack(&mut self, span: Span, bytes: &[u8]) {
        let mut unpacker = std::mem::replace(&mut self.unpacker, LinearReader::new());
        unpacker.insert(bytes.len()).copy_from_slice(bytes);
        unpacker.notify_read(bytes.len());
        let is_whole = loop {
            match unpacker.next_event() {
                Some(Ok(LinearReadEvent::Record { data, opcode })) => self.take(opcode, data),
                // It asks for the record behind this one: this one is done.
                Some(Ok(LinearReadEvent::ReadRequest(_))) => break true,
                Some(Err(_)) | None => break false,
            }
        };
        if is_whole {
            self.unpacker = unpacker;
        } else {
            self.lose(span);
            self.unpacker = self::unpacker();
        }
    }

    fn lose(&mut self, span: Span) {
        self.layout.loss.chunks += u64::from(span.opcode == op::CHUNK);
        self.layout.loss.bytes += span.length;
    }

    /// Takes one record over into the tables or the messages.
    fn take(&mut self, opcode: u8, data: &[u8]) {
        match mcap::parse_record(opcode, data) {
            Ok(Raw::Schema { header, .. }) => {
                self.schemas.insert(header.id, header.name);
            }
            Ok(Raw::Channel(channel)) => self.take_channel(channel),
            Ok(Raw::Message { header, data }) => self.take_message(header, &data),
            Ok(_) => {}
            Err(_) => self.layout.loss.records += 1,
        }
    }

    fn take_channel(&mut self, channel: mcap::records::Channel) {
        let known = Channel {
            kind: Topic::parse(&channel.topic),
            topic: channel.topic,
            schema: self.schemas.get(&channel.schema_id).cloned().unwrap_or_default(),
            encoding: channel.message_encoding,
            metadata: channel.metadata,
        };
        let wanted = (self.wants)(&known).then(|| Arc::new(known));
        self.channels.insert(channel.id, wanted);
    }

    fn take_message(&mut self, header: mcap::records::MessageHeader, data: &[u8]) {
        let Some(channel) = self.channels.get(&header.channel_id) else {
            self.layout.loss.records += 1;
            return;
        };
        let start_wall_ns = self.start_wall_ns.unwrap_or(0);
        let time_ns = header.log_time.saturating_sub(start_wall_ns);
        let Some(channel) = channel.as_ref().filter(|_| self.times.contains(&time_ns)) else {
            return;
        };
        self.ready.push_back(Message {
            channel: Arc::clone(channel),
            sequence: header.sequence,
            log_time_ns: header.log_time,
            start_wall_ns,
            data: data.to_vec(),
        });
    }
}

impl Iterator for Reader {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        while self.ready.is_empty() {
            let span = *self.layout.spans.get(self.next)?;
            self.next += 1;
            self.open_span(span);
        }
        self.ready.pop_front()
    }
}

/// Log time of bench time 0, as the file's own notes have it.
fn start_wall_ns(layout: &Layout) -> Option<u64> {
    let note = |name| layout.metadata.get(name)?.get("start_wall_ns")?.parse().ok();
    note(PART).or_else(|| note(MERGED))
}

/// Whether a chunk fills its record; a damaged head may say that it is empty, with no checksum.
fn is_filled(span: Span, bytes: &[u8]) -> bool {
    let body = bytes.get(scan::ENVELOPE as usize..).unwrap_or(&[]);
    match mcap::parse_record(span.opcode, body) {
        Ok(Raw::Chunk { header, .. }) => {
            let head_bytes = CHUNK_HEAD_BYTES + header.compression.len() as u64;
            head_bytes.checked_add(header.compressed_size) == Some(body.len() as u64)
        }
        _ => span.opcode != op::CHUNK,
    }
}

/// A chunk's checksum is verified before its contents are believed.
fn unpacker() -> LinearReader {
    LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(CHUNK_MAX),
    )
}

#[cfg(test)]
mod tests;
