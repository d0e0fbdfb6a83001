//! A message of a trace as the record it holds.

use crate::dropped::DroppedRecord;
use crate::frame::FrameRecord;
use crate::memory::MemoryRecord;
use crate::reader::Message;
use crate::schema::Message as _;
use crate::tick::TickRecord;
use crate::topic::Topic;
use crate::truth::TruthRecord;
use crate::wire::DecodeError;

/// A record read back from a trace.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// A frame on a bus.
    Frame(FrameRecord),
    /// An ECU's tick.
    Tick(Box<TickRecord>),
    /// The world's true state.
    Truth(Box<TruthRecord>),
    /// A snapshot of the law's memory.
    Memory(Box<MemoryRecord>),
    /// A gap in a recording.
    Dropped(DroppedRecord),
}

impl Record {
    pub(crate) fn decode(message: &Message) -> Result<Self, DecodeError> {
        let data = &message.data;
        Ok(match message.channel.kind.ok_or(DecodeError::UnknownSchema)? {
            Topic::Frames(_) | Topic::Rx(_) => {
                Self::Frame(FrameRecord::decode(data, message.log_time_ns, message.start_wall_ns)?)
            }
            Topic::Tick(_) => Self::Tick(Box::new(TickRecord::decode(data)?)),
            Topic::Truth => Self::Truth(Box::new(TruthRecord::decode(data)?)),
            Topic::Memory(_) => Self::Memory(Box::new(MemoryRecord::decode(data)?)),
            Topic::Dropped(_) => Self::Dropped(DroppedRecord::decode(data)?),
        })
    }
}
