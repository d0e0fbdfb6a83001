//! The merged trace: copies what was recorded and adds what can be derived from it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};

use crate::derived::{Derivation, Derived};
use crate::part::MERGED;
use crate::reader::Message;
use crate::scan::Attachment;
use crate::scenery::Scenery;
use crate::topic::{Schema, Topic};

const CHUNK_BYTES: u64 = 1 << 20;
/// The MCAP writer of a merged run.
pub(crate) struct Merged {
    writer: mcap::Writer<BufWriter<File>>,
    start_wall_ns: u64,
    copied: BTreeMap<Topic, u16>,
    /// Channels of what is derived, by its key.
    derived: BTreeMap<(u8, u32), u16>,
    derivation: Derivation,
    signals_period_ns: u64,
    messages: u64,
}

impl Merged {
    /// Begins the file with the wall clock of bench time 0.
    pub(crate) fn create(
        file: BufWriter<File>,
        start_wall_ns: u64,
        scenery: Scenery,
        signals_period_ns: u64,
    ) -> Result<Self, McapError> {
        let writer = WriteOptions::new()
            .library(concat!("platoon ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .compression_threads(1)
            .create(file)?;
        let mut merged = Self {
            writer,
            start_wall_ns,
            copied: BTreeMap::new(),
            derived: BTreeMap::new(),
            derivation: Derivation::new(scenery, signals_period_ns),
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
        let is_stamped = message.publish_time_ns != message.log_time_ns;
        let publish_time = if is_stamped { message.publish_time_ns } else { log_time };
        let channel_id = self.copied_channel(topic, message)?;
        let sequence = message.sequence;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        self.put(header, &message.data)?;
        let mut derivation = std::mem::take(&mut self.derivation);
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
