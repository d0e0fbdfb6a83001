//! The topics of a trace: their names, schemas and encodings.

use core::fmt;
use std::borrow::Cow;

use crate::derived::Derived;
use crate::dropped::DroppedRecord;
use crate::frame::CAN_FRAME_DEFINITION;
use crate::memory::MemoryRecord;
use crate::schema::Message;
use crate::tick::TickRecord;
use crate::truth::TruthRecord;

/// Which process a part file comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Source {
    /// The rig: tap of every bus, and the world's truth.
    Rig,
    /// The ECU of a truck, 0 is the leader.
    Ecu(u8),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rig => write!(f, "rig"),
            Self::Ecu(truck) => write!(f, "ecu{truck}"),
        }
    }
}

impl Source {
    /// The source a part file's metadata names.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        match text {
            "rig" => Some(Self::Rig),
            _ => Some(Self::Ecu(text.strip_prefix("ecu")?.parse().ok()?)),
        }
    }
}

/// A topic that a recorder writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// `/can/bus<i>/frames`: every frame the rig saw on bus i.
    Frames(u8),
    /// `/ecu<i>/rx`: the frames the ECU consumed, in order.
    Rx(u8),
    /// `/ecu<i>/tick`: the ECU's ticks.
    Tick(u8),
    /// `/ecu<i>/memory`: snapshots of the law's memory.
    Memory(u8),
    /// `/world/truth`: the rig's world.
    Truth,
    /// `/rig/dropped` and `/ecu<i>/dropped`: records missing because a ring was full.
    Dropped(Source),
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frames(bus) => write!(f, "/can/bus{bus}/frames"),
            Self::Rx(truck) => write!(f, "/ecu{truck}/rx"),
            Self::Tick(truck) => write!(f, "/ecu{truck}/tick"),
            Self::Memory(truck) => write!(f, "/ecu{truck}/memory"),
            Self::Truth => write!(f, "/world/truth"),
            Self::Dropped(source) => write!(f, "/{source}/dropped"),
        }
    }
}

impl Topic {
    /// The topic of this name; `None` when no recorder writes it.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        let mut levels = name.strip_prefix('/')?.split('/');
        let topic = match (levels.next()?, levels.next()?, levels.next()) {
            ("world", "truth", None) => Self::Truth,
            ("can", bus, Some("frames")) => Self::Frames(bus.strip_prefix("bus")?.parse().ok()?),
            (source, "dropped", None) => Self::Dropped(Source::parse(source)?),
            (ecu, leaf, None) => {
                let truck = ecu.strip_prefix("ecu")?.parse().ok()?;
                match leaf {
                    "rx" => Self::Rx(truck),
                    "tick" => Self::Tick(truck),
                    "memory" => Self::Memory(truck),
                    _ => return None,
                }
            }
            _ => return None,
        };
        levels.next().is_none().then_some(topic)
    }

    pub(crate) fn schema(self) -> Schema {
        match self {
            Self::Frames(_) | Self::Rx(_) => Schema {
                name: "platoon_msgs/msg/CanFrame".into(),
                encoding: "ros2msg",
                message_encoding: "cdr",
                data: CAN_FRAME_DEFINITION.as_bytes().to_vec(),
            },
            Self::Tick(_) => Schema::protobuf::<TickRecord>(),
            Self::Memory(_) => Schema::protobuf::<MemoryRecord>(),
            Self::Truth => Schema::protobuf::<TruthRecord>(),
            Self::Dropped(_) => Schema::protobuf::<DroppedRecord>(),
        }
    }
}

/// How a channel is announced to those who read a run while it lasts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offer {
    /// Topic name.
    pub topic: String,
    /// Encoding of its messages, such as `cdr` or `protobuf`.
    pub encoding: &'static str,
    /// Name of its schema.
    pub schema_name: String,
    /// Language of its schema, such as `ros2msg` or `protobuf`.
    pub schema_encoding: &'static str,
    /// The schema.
    pub schema: Vec<u8>,
}

impl Offer {
    fn new(topic: String, schema: Schema) -> Self {
        Self {
            topic,
            encoding: schema.message_encoding,
            schema_name: schema.name.into_owned(),
            schema_encoding: schema.encoding,
            schema: schema.data,
        }
    }
}

impl From<Topic> for Offer {
    fn from(topic: Topic) -> Self {
        Self::new(topic.to_string(), topic.schema())
    }
}

impl From<Derived> for Offer {
    fn from(derived: Derived) -> Self {
        Self::new(derived.topic(), derived.schema())
    }
}

/// What an MCAP schema record and a channel's encoding hold.
pub(crate) struct Schema {
    pub(crate) name: Cow<'static, str>,
    pub(crate) encoding: &'static str,
    pub(crate) message_encoding: &'static str,
    pub(crate) data: Vec<u8>,
}

impl Schema {
    pub(crate) fn protobuf<M: Message>() -> Self {
        Self {
            name: M::NAME.into(),
            encoding: "protobuf",
            message_encoding: "protobuf",
            data: M::descriptor_set(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topic_names_round_trip() {
        for topic in [
            Topic::Frames(0),
            Topic::Frames(12),
            Topic::Rx(3),
            Topic::Tick(0),
            Topic::Memory(1),
            Topic::Truth,
            Topic::Dropped(Source::Rig),
            Topic::Dropped(Source::Ecu(2)),
        ] {
            assert_eq!(Topic::parse(&topic.to_string()), Some(topic));
        }
    }

    #[test]
    fn foreign_topics_are_nobodys() {
        for name in ["", "/", "/can/bus0", "/can/bus0/frames/x", "/ecu/tick", "/ecu300/tick", "x"] {
            assert_eq!(Topic::parse(name), None, "{name}");
        }
    }
}
