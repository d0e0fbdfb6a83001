//! The merged trace: copies what was recorded and adds what can be derived from it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};
use platoon_dbc::MessageInfo;

use crate::frame::FrameRecord;
use crate::part::MERGED;
use crate::reader::Message;
use crate::scan::Attachment;
use crate::scene::{self, SceneUpdate};
use crate::schema::Message as _;
use crate::signals;
use crate::topic::{Schema, Topic};
use crate::truth::TruthRecord;

const CHUNK_BYTES: u64 = 1 << 20;
/// Time between two scenes: 20 Hz is smooth to the eye.
const SCENE_PERIOD_NS: u64 = 50_000_000;
const SCENE_TOPIC: &str = "/scene";

/// A channel of decoded signals.
#[derive(Clone, Copy)]
struct Decoded {
    channel: u16,
    /// Bench time of its newest message \[ns\].
    newest_ns: Option<u64>,
}

impl Decoded {
    /// Whether a message at `time_ns` is to be written. The pages of a multiplexed message come
    /// at one instant and stay together.
    fn is_due(&self, time_ns: u64, period_ns: u64) -> bool {
        self.newest_ns.is_none_or(|newest_ns| {
            time_ns == newest_ns || time_ns >= newest_ns.saturating_add(period_ns)
        })
    }
}

/// The MCAP writer of a merged run.
pub(crate) struct Merged {
    writer: mcap::Writer<BufWriter<File>>,
    start_wall_ns: u64,
    copied: BTreeMap<Topic, u16>,
    /// Channels of decoded signals by bus and identifier.
    decoded: BTreeMap<(u8, u32), Decoded>,
    decoded_period_ns: u64,
    scene: Option<u16>,
    scene_due_ns: u64,
    messages: u64,
    buffer: Vec<u8>,
}

impl Merged {
    /// Begins the file with the wall clock of bench time 0.
    pub(crate) fn create(
        file: BufWriter<File>,
        start_wall_ns: u64,
        decoded_period_ns: u64,
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
            decoded: BTreeMap::new(),
            decoded_period_ns,
            scene: None,
            scene_due_ns: 0,
            messages: 0,
            buffer: Vec::new(),
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
        match topic {
            Topic::Frames(bus) => self.write_signals(bus, message, header),
            Topic::Truth => self.write_scene(message, header),
            _ => Ok(()),
        }
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

    /// Adds the signals of a frame of the contract on `/bus<i>/<Message>`.
    fn write_signals(
        &mut self,
        bus: u8,
        message: &Message,
        header: MessageHeader,
    ) -> Result<(), McapError> {
        let Ok(record) = FrameRecord::decode(&message.data, 0, 0, 0) else {
            return Ok(());
        };
        let Some(info) = signals::message(&record.frame) else {
            return Ok(());
        };
        let decoded = self.decoded(bus, info)?;
        if !decoded.is_due(message.time_ns(), self.decoded_period_ns) {
            return Ok(());
        }
        let newest_ns = Some(message.time_ns());
        self.decoded.insert((bus, info.id), Decoded { newest_ns, ..decoded });
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        signals::encode(info, &record.frame, &mut buffer);
        let result = self.put(MessageHeader { channel_id: decoded.channel, ..header }, &buffer);
        self.buffer = buffer;
        result
    }

    fn decoded(&mut self, bus: u8, info: &MessageInfo) -> Result<Decoded, McapError> {
        if let Some(decoded) = self.decoded.get(&(bus, info.id)) {
            return Ok(*decoded);
        }
        let schema = Schema {
            name: signals::schema_name(info).into(),
            encoding: "protobuf",
            message_encoding: "protobuf",
            data: signals::descriptor_set(info),
        };
        let mut metadata = signals::channel_metadata(info);
        if self.decoded_period_ns > 0 {
            metadata.insert("least_period_ns".into(), self.decoded_period_ns.to_string());
        }
        let topic = format!("/bus{bus}/{}", info.name);
        let channel = self.add_channel(&topic, &schema, &metadata)?;
        let decoded = Decoded { channel, newest_ns: None };
        self.decoded.insert((bus, info.id), decoded);
        Ok(decoded)
    }

    /// Adds the scene, when it is time for one.
    fn write_scene(&mut self, message: &Message, header: MessageHeader) -> Result<(), McapError> {
        let time_ns = message.time_ns();
        if time_ns < self.scene_due_ns {
            return Ok(());
        }
        let Ok(truth) = TruthRecord::decode(&message.data) else {
            return Ok(());
        };
        self.scene_due_ns = (time_ns / SCENE_PERIOD_NS + 1).saturating_mul(SCENE_PERIOD_NS);
        let mut buffer = Vec::new();
        scene::update(&truth, header.log_time).encode(&mut buffer);
        let channel_id = self.scene_channel()?;
        self.put(MessageHeader { channel_id, ..header }, &buffer)
    }

    fn scene_channel(&mut self) -> Result<u16, McapError> {
        if let Some(channel) = self.scene {
            return Ok(channel);
        }
        let schema = Schema::protobuf::<SceneUpdate>();
        let channel = self.add_channel(SCENE_TOPIC, &schema, &BTreeMap::new())?;
        self.scene = Some(channel);
        Ok(channel)
    }

    /// Ends the file; says how many messages it holds.
    pub(crate) fn finish(mut self) -> Result<u64, McapError> {
        self.writer.finish()?;
        Ok(self.messages)
    }
}
