//! The outer frame of an MCAP file: which records stand where, without looking into chunks.
//!
//! Reference: <https://mcap.dev/spec>. An MCAP file is a row of records, each an opcode, a
//! 64-bit length and a body. The scan walks that row as far as it goes, so a file whose writer
//! was killed is read up to its last whole record, and no length is believed beyond the file.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};

use mcap::MAGIC;
use mcap::records::{Record, op};

/// Bytes of a record's opcode and length.
pub(crate) const ENVELOPE: u64 = 9;
/// Where a statistics record has its number of chunks: behind the numbers of messages (8 bytes),
/// schemas (2), channels, attachments and metadata records (4 each).
const CHUNK_COUNT: std::ops::Range<usize> = 22..26;
/// Body of a footer: two offsets (8 bytes each) and a checksum (4).
const FOOTER_BYTES: u64 = 20;
/// Largest attachment or metadata record that is read into memory.
const SIDE_RECORD_MAX: u64 = 256 << 20;

/// A file that came with a trace, such as the `.dbc`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// File name.
    pub name: String,
    /// Media type, such as `text/plain`.
    pub media_type: String,
    /// Contents.
    pub data: Vec<u8>,
}

/// What could not be read of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loss {
    /// The file ends before its end mark: its writer was killed or the file cut.
    pub is_truncated: bool,
    /// Bytes that belong to no readable record.
    pub bytes: u64,
    /// Chunks with a wrong checksum or undecodable contents.
    pub chunks: u64,
    /// Other records that do not parse, or messages on no known channel.
    pub records: u64,
}

impl Loss {
    /// Whether everything was read.
    #[must_use]
    pub const fn is_none(&self) -> bool {
        !self.is_truncated && self.bytes == 0 && self.chunks == 0 && self.records == 0
    }
}

/// A record's place in the file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub(crate) opcode: u8,
    /// Where its opcode stands.
    pub(crate) offset: u64,
    /// Bytes with the envelope.
    pub(crate) length: u64,
}

/// What the scan found.
#[derive(Debug, Default)]
pub(crate) struct Layout {
    /// Chunks, and schemas, channels and messages outside chunks, in file order.
    pub(crate) spans: Vec<Span>,
    pub(crate) metadata: BTreeMap<String, BTreeMap<String, String>>,
    pub(crate) attachments: Vec<Attachment>,
    pub(crate) loss: Loss,
    /// Behind the last whole record.
    end: u64,
    /// Bytes behind it.
    rest: u64,
    in_summary: bool,
    /// Whether the chunks were counted against the writer's own count.
    is_counted: bool,
}

/// Whether the file begins as an MCAP file does.
pub(crate) fn has_magic(source: &mut impl Read) -> io::Result<bool> {
    let mut magic = [0; MAGIC.len()];
    match source.read_exact(&mut magic) {
        Ok(()) => Ok(magic == *MAGIC),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Walks the records from behind the magic bytes to the footer.
pub(crate) fn scan(source: &mut (impl Read + Seek), file_length: u64) -> io::Result<Layout> {
    let mut layout = Layout { end: MAGIC.len() as u64, ..Layout::default() };
    layout.resume(source, file_length)?;
    Ok(layout)
}

/// The next record's opcode and body length, if such a record fits into the `rest` of the file.
fn envelope(source: &mut impl Read, rest: u64) -> io::Result<Option<(u8, u64)>> {
    if rest < ENVELOPE {
        return Ok(None);
    }
    let mut bytes = [0; ENVELOPE as usize];
    source.read_exact(&mut bytes)?;
    let [opcode, length @ ..] = bytes;
    let length = u64::from_le_bytes(length);
    let is_record = opcode != 0 && length <= rest - ENVELOPE;
    Ok(is_record.then_some((opcode, length)))
}

fn read_body(source: &mut impl Read, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; length as usize];
    source.read_exact(&mut bytes)?;
    Ok(bytes)
}

impl Layout {
    /// Walks on from where the file ended before.
    pub(crate) fn resume(
        &mut self,
        source: &mut (impl Read + Seek),
        file_length: u64,
    ) -> io::Result<()> {
        self.loss.is_truncated = false;
        self.loss.bytes -= std::mem::take(&mut self.rest);
        loop {
            source.seek(SeekFrom::Start(self.end))?;
            let rest = file_length.saturating_sub(self.end);
            let Some((opcode, body)) = envelope(source, rest)? else {
                self.loss.is_truncated = true;
                self.loss.bytes += rest;
                self.rest = rest;
                return Ok(());
            };
            let span = Span { opcode, offset: self.end, length: ENVELOPE + body };
            match opcode {
                // Elsewhere it is a chunk whose opcode was damaged, and more comes behind it.
                op::FOOTER if rest == ENVELOPE + FOOTER_BYTES + MAGIC.len() as u64 => {
                    self.loss.records += u64::from(!self.is_counted);
                    return Ok(());
                }
                op::DATA_END => self.in_summary = true,
                op::STATISTICS if self.in_summary => {
                    self.compare_statistics(&read_body(source, body.min(64))?)
                }
                op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE if !self.in_summary => {
                    self.spans.push(span);
                }
                op::METADATA | op::ATTACHMENT if body <= SIDE_RECORD_MAX => {
                    let bytes = read_body(source, body)?;
                    self.take_side_record(opcode, &bytes);
                }
                _ => {}
            }
            self.end += span.length;
        }
    }

    fn take_side_record(&mut self, opcode: u8, bytes: &[u8]) {
        match mcap::parse_record(opcode, bytes) {
            Ok(Record::Metadata(record)) => {
                self.metadata.entry(record.name).or_default().extend(record.metadata);
            }
            Ok(Record::Attachment { header, data, .. }) => self.attachments.push(Attachment {
                name: header.name,
                media_type: header.media_type,
                data: data.into_owned(),
            }),
            _ => self.loss.records += 1,
        }
    }

    /// Notices chunks that a damaged opcode has hidden, by the count the writer left.
    fn compare_statistics(&mut self, body: &[u8]) {
        self.is_counted = true;
        let Some(count) = body.get(CHUNK_COUNT).and_then(|bytes| bytes.try_into().ok()) else {
            self.loss.records += 1;
            return;
        };
        let found = self.spans.iter().filter(|span| span.opcode == op::CHUNK).count() as u64;
        self.loss.chunks += u64::from(u32::from_le_bytes(count)).saturating_sub(found);
    }
}
