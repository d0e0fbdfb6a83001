//! The merged trace: copies what was recorded and adds what can be derived from it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};

use crate::derived::{Derivation, Derived};
use crate::focus::Sieve;
use crate::frame::restamped;
use crate::merge::MergeOptions;
use crate::part::MERGED;
use crate::reader::Message;
use crate::scan::Attachment;
use crate::topic::{Schema, Topic};

/// Uncompressed bytes after which a chunk is closed: larger ones would take 1 % less room, but more
/// of a run with them when they are damaged.
const CHUNK_BYTES: u64 = 1 << 20;
/// 3 % smaller than the library's default, for seconds on a thread of its own.
const COMPRESSION_LEVEL: u32 = 8;

/// The MCAP writer of a merged run.
pub(crate) struct Merged {
    writer: mcap::Writer<BufWriter<File>>,
    start_wall_ns: u64,
    copied: BTreeMap<Topic, u16>,
    /// Channels of what is derived, by its key.
    derived: BTreeMap<(u8, u32), u16>,
    derivation: Derivation,
    sieve: Sieve,
    signals_period_ns: u64,
    messages: u64,
}

impl Merged {
    /// Begins the file with the wall clock of bench time 0.
    pub(crate) fn create(
        file: BufWriter<File>,
        start_wall_ns: u64,
        options: &MergeOptions,
        signals_period_ns: u64,
    ) -> Result<Self, McapError> {
        let writer = WriteOptions::new()
            .library(concat!("platoon ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .compression_level(COMPRESSION_LEVEL)
            .compression_threads(1)
            .create(file)?;
        let mut merged = Self {
            writer,
            start_wall_ns,
            copied: BTreeMap::new(),
            derived: BTreeMap::new(),
            derivation: Derivation::new(options.scenery.clone(), signals_period_ns),
            sieve: Sieve::new(options.focus.clone()),
            signals_period_ns,
            messages: 0,
        };
        let pairs = [
            ("start_wall_ns".to_owned(), start_wall_ns.to_string()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ];
        merged.metadata(MERGED, pairs.into())?;
        Ok(merged)
    }

    pub(crate) fn metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), McapError> {
        self.writer.write_metadata(&Metadata { name: name.into(), metadata })
    }

    pub(crate) fn attach(&mut self, attachment: &Attachment) -> Result<(), McapError> {
        self.writer.attach(&mcap::Attachment {
            log_time: self.start_wall_ns,
            create_time: self.start_wall_ns,
            name: attachment.name.clone(),
            media_type: attachment.media_type.clone(),
            data: attachment.data.as_slice().into(),
        })
    }

    /// Copies a message and adds what follows from it. Topics no recorder writes are left out.
    pub(crate) fn write(&mut self, message: &Message) -> Result<(), McapError> {
        let Some(topic) = message.channel.kind else {
            return Ok(());
        };
        let log_time = self.start_wall_ns.saturating_add(message.time_ns());
        let channel_id = self.copied_channel(topic, message)?;
        let sequence = message.sequence;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        let time_ns = message.time_ns();
        if self.sieve.keeps(topic, time_ns) {
            self.put(header, &on_clock(message, log_time))?;
        }
        let mut derivation = std::mem::take(&mut self.derivation);
        let thinned_ns = self.sieve.period_ns(time_ns).unwrap_or(0);
        derivation.set_period(self.signals_period_ns.max(thinned_ns));
        let result = derivation.derive(message, log_time, |derived, data| {
            let channel_id = self.derived_channel(derived)?;
            self.put(MessageHeader { channel_id, ..header }, data)
        });
        self.derivation = derivation;
        result
    }

    fn put(&mut self, header: MessageHeader, data: &[u8]) -> Result<(), McapError> {
        self.messages += 1;
        self.writer.write_to_known_channel(&header, data)
    }

    fn copied_channel(&mut self, topic: Topic, message: &Message) -> Result<u16, McapError> {
        if let Some(channel) = self.copied.get(&topic) {
            return Ok(*channel);
        }
        let name = topic.to_string();
        let channel = self.add_channel(&name, &topic.schema(), &message.channel.metadata)?;
        self.copied.insert(topic, channel);
        Ok(channel)
    }

    fn add_channel(
        &mut self,
        topic: &str,
        schema: &Schema,
        metadata: &BTreeMap<String, String>,
    ) -> Result<u16, McapError> {
        let id = self.writer.add_schema(&schema.name, schema.encoding, &schema.data)?;
        self.writer.add_channel(id, topic, schema.message_encoding, metadata)
    }

    fn derived_channel(&mut self, derived: Derived) -> Result<u16, McapError> {
        if let Some(channel) = self.derived.get(&derived.key()) {
            return Ok(*channel);
        }
        let mut metadata = derived.metadata();
        if self.signals_period_ns > 0 && matches!(derived, Derived::Signals(..)) {
            metadata.insert("least_period_ns".into(), self.signals_period_ns.to_string());
        }
        let channel = self.add_channel(&derived.topic(), &derived.schema(), &metadata)?;
        self.derived.insert(derived.key(), channel);
        Ok(channel)
    }

    /// Ends the file; says how many messages it holds.
    pub(crate) fn finish(mut self) -> Result<u64, McapError> {
        self.writer.finish()?;
        Ok(self.messages)
    }
}

/// A message's bytes for another log time: where a frame has no kernel stamp, that stands in.
fn on_clock(message: &Message, log_time_ns: u64) -> Cow<'_, [u8]> {
    let is_frame = matches!(message.channel.kind, Some(Topic::Frames(_) | Topic::Rx(_)));
    let (data, was_ns) = (message.data.as_slice(), message.log_time_ns);
    match is_frame && was_ns != log_time_ns {
        true => restamped(data, was_ns, log_time_ns).map_or(data.into(), Cow::from),
        false => data.into(),
    }
}
