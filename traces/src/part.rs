//! One process's MCAP file, as its writer thread fills it.

use std::collections::BTreeMap;
use std::io::{BufWriter, Seek, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};

use crate::dropped::DroppedRecord;
use crate::frame::FrameRecord;
use crate::memory::MemoryRecord;
use crate::ring::Counts;
use crate::schema::Message;
use crate::tick::TickRecord;
use crate::topic::{Source, Topic};
use crate::truth::TruthRecord;

/// Uncompressed bytes after which a chunk of a part file is closed.
pub(crate) const CHUNK_BYTES: u64 = 1 << 20;
/// Fast rather than small: a part is compressed beside the loops, and merged afterwards.
const COMPRESSION_LEVEL: u32 = 1;

/// Name of the metadata record a part begins with.
pub(crate) const PART: &str = "platoon.part";
/// Name of the metadata record a merged trace begins with.
pub(crate) const MERGED: &str = "platoon.merged";
/// Name of the metadata record a part that was finished ends with.
pub(crate) const PART_END: &str = "platoon.part_end";

/// Somewhere a part can be written.
pub(crate) trait Sink: Write + Seek + Send {}
impl<T: Write + Seek + Send> Sink for T {}

/// A record on its way to the file.
pub(crate) enum Item {
    Frame(FrameRecord),
    Tick(TickRecord),
    Truth(Box<TruthRecord>),
    Memory(Box<MemoryRecord>),
}

impl Item {
    pub(crate) const fn time_ns(&self) -> u64 {
        match self {
            Self::Frame(record) => record.time_ns,
            Self::Tick(record) => record.time_ns,
            Self::Truth(record) => record.time_ns,
            Self::Memory(record) => record.time_ns,
        }
    }
}

/// The MCAP writer of one part.
pub(crate) struct Part {
    writer: mcap::Writer<BufWriter<Box<dyn Sink>>>,
    source: Source,
    interfaces: Vec<String>,
    start_wall_ns: u64,
    channels: BTreeMap<Topic, u16>,
    buffer: Vec<u8>,
    has_open_chunk: bool,
}

impl Part {
    /// Writes the file's beginning, so that an unwritable one is noticed here.
    pub(crate) fn create(
        sink: Box<dyn Sink>,
        source: Source,
        interfaces: Vec<String>,
    ) -> Result<Self, McapError> {
        // A chunk is compressed in memory and written whole: a killed process leaves whole
        // chunks. No compression threads: the loops need the cores.
        let mut writer = WriteOptions::new()
            .library(concat!("platoon ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .emit_message_indexes(false)
            .compression_level(COMPRESSION_LEVEL)
            .compression_threads(0)
            .create(BufWriter::with_capacity(1 << 16, sink))?;
        writer.flush()?;
        Ok(Self {
            writer,
            source,
            interfaces,
            start_wall_ns: 0,
            channels: BTreeMap::new(),
            buffer: Vec::with_capacity(1 << 12),
            has_open_chunk: false,
        })
    }

    /// States where the part comes from and which wall clock instant was bench time 0.
    pub(crate) fn begin(&mut self, start_wall_ns: u64) -> Result<(), McapError> {
        self.start_wall_ns = start_wall_ns;
        let metadata = [
            ("source", self.source.to_string()),
            ("start_wall_ns", start_wall_ns.to_string()),
            ("version", env!("CARGO_PKG_VERSION").into()),
        ];
        self.write_metadata(PART, &metadata)?;
        self.writer.flush()
    }

    /// Appends one record.
    pub(crate) fn write(&mut self, number: u64, item: &Item) -> Result<(), McapError> {
        let log_time_ns = self.start_wall_ns.saturating_add(item.time_ns());
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let topic = match (item, self.source) {
            (Item::Frame(record), source) => {
                record.encode(log_time_ns, &mut buffer);
                match source {
                    Source::Rig => Topic::Frames(record.bus),
                    Source::Ecu(truck) => Topic::Rx(truck),
                }
            }
            (Item::Tick(record), source) => {
                record.encode(&mut buffer);
                Topic::Tick(truck_of(source, record.ecu))
            }
            (Item::Truth(record), _) => {
                record.encode(&mut buffer);
                Topic::Truth
            }
            (Item::Memory(record), source) => {
                record.encode(&mut buffer);
                Topic::Memory(truck_of(source, 0))
            }
        };
        self.buffer = buffer;
        self.put(topic, number, log_time_ns)
    }

    /// Appends a gap marker.
    pub(crate) fn write_dropped(
        &mut self,
        number: u64,
        record: &DroppedRecord,
    ) -> Result<(), McapError> {
        self.buffer.clear();
        record.encode(&mut self.buffer);
        let log_time_ns = self.start_wall_ns.saturating_add(record.time_ns);
        self.put(Topic::Dropped(self.source), number, log_time_ns)
    }

    fn put(&mut self, topic: Topic, number: u64, log_time: u64) -> Result<(), McapError> {
        let channel_id = self.channel(topic)?;
        let sequence = number as u32;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.has_open_chunk = true;
        self.writer.write_to_known_channel(&header, &self.buffer)
    }

    fn channel(&mut self, topic: Topic) -> Result<u16, McapError> {
        if let Some(channel) = self.channels.get(&topic) {
            return Ok(*channel);
        }
        let schema = topic.schema();
        let schema_id = self.writer.add_schema(&schema.name, schema.encoding, &schema.data)?;
        let metadata = self.channel_metadata(topic);
        let name = topic.to_string();
        let channel =
            self.writer.add_channel(schema_id, &name, schema.message_encoding, &metadata)?;
        self.channels.insert(topic, channel);
        Ok(channel)
    }

    fn channel_metadata(&self, topic: Topic) -> BTreeMap<String, String> {
        let bus = match topic {
            Topic::Frames(bus) => usize::from(bus),
            Topic::Rx(_) => 0, // an ECU has one bus
            _ => return BTreeMap::new(),
        };
        let interface = self.interfaces.get(bus);
        interface.map(|name| ("interface".into(), name.clone())).into_iter().collect()
    }

    /// Closes the chunk and hands it to the operating system: a killed process keeps it.
    pub(crate) fn close_chunk(&mut self) -> Result<(), McapError> {
        if self.has_open_chunk {
            self.has_open_chunk = false;
            self.writer.flush()?;
        }
        Ok(())
    }

    /// Ends the file with its counts and summary.
    pub(crate) fn finish(&mut self, written: u64, dropped: Counts) -> Result<(), McapError> {
        let metadata = [
            ("written", written.to_string()),
            ("dropped_frames", dropped.frames.to_string()),
            ("dropped_ticks", dropped.ticks.to_string()),
            ("dropped_truths", dropped.truths.to_string()),
            ("dropped_memories", dropped.memories.to_string()),
        ];
        self.write_metadata(PART_END, &metadata)?;
        self.writer.finish().map(drop)
    }

    fn write_metadata(&mut self, name: &str, pairs: &[(&str, String)]) -> Result<(), McapError> {
        let metadata = pairs.iter().map(|(key, value)| ((*key).into(), value.clone())).collect();
        self.writer.write_metadata(&Metadata { name: name.into(), metadata })
    }
}

const fn truck_of(source: Source, otherwise: u8) -> u8 {
    match source {
        Source::Rig => otherwise,
        Source::Ecu(truck) => truck,
    }
}
