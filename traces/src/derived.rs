//! What follows from recorded messages: decoded signals, the scene, and the frame that moves along.
//!
//! A merged trace holds these beside what was recorded; a live view is sent them.

use std::collections::BTreeMap;

use platoon_dbc::MessageInfo;

use crate::foxglove::{FrameTransform, SceneUpdate};
use crate::frame::FrameRecord;
use crate::reader::Message;
use crate::scene;
use crate::scenery::Scenery;
use crate::schema::Message as _;
use crate::signals;
use crate::topic::{Schema, Topic};
use crate::truth::TruthRecord;

/// A channel that no recorder writes.
#[derive(Debug, Clone, Copy)]
pub enum Derived {
    /// `/bus<i>/<Message>`: signals of the frames of bus i.
    Signals(u8, &'static MessageInfo),
    /// `/scene`: trucks and obstacles.
    Scene,
    /// `/scene/road`.
    Road,
    /// `/scene/field`: the potential fields.
    Field,
    /// `/tf`.
    Transform,
}

impl Derived {
    /// Its topic.
    #[must_use]
    pub fn topic(self) -> String {
        match self {
            Self::Signals(bus, info) => format!("/bus{bus}/{}", info.name),
            Self::Scene => "/scene".into(),
            Self::Road => "/scene/road".into(),
            Self::Field => "/scene/field".into(),
            Self::Transform => "/tf".into(),
        }
    }

    /// What tells it from others.
    pub(crate) const fn key(self) -> (u8, u32) {
        match self {
            Self::Signals(bus, info) => (bus, info.id),
            Self::Scene => (u8::MAX, 0),
            Self::Road => (u8::MAX, 1),
            Self::Field => (u8::MAX, 2),
            Self::Transform => (u8::MAX, 3),
        }
    }

    pub(crate) fn schema(self) -> Schema {
        match self {
            Self::Signals(_, info) => Schema {
                name: signals::schema_name(info).into(),
                encoding: "protobuf",
                message_encoding: "protobuf",
                data: signals::descriptor_set(info),
            },
            Self::Scene | Self::Road | Self::Field => Schema::protobuf::<SceneUpdate>(),
            Self::Transform => Schema::protobuf::<FrameTransform>(),
        }
    }

    pub(crate) fn metadata(self) -> BTreeMap<String, String> {
        match self {
            Self::Signals(_, info) => signals::channel_metadata(info),
            Self::Scene | Self::Road | Self::Field | Self::Transform => BTreeMap::new(),
        }
    }
}

/// Derives messages from the recorded ones of a run, in their order.
#[derive(Debug, Default)]
pub struct Derivation {
    scenery: Scenery,
    signals_period_ns: u64,
    /// Bench time of the newest signals by bus and identifier \[ns\].
    newest_ns: BTreeMap<(u8, u32), u64>,
    scene_due_ns: u64,
    buffer: Vec<u8>,
}

impl Derivation {
    /// With at least `signals_period_ns` between two messages of one kind on one bus.
    #[must_use]
    pub fn new(scenery: Scenery, signals_period_ns: u64) -> Self {
        Self { scenery, signals_period_ns, ..Self::default() }
    }

    /// From now on, with at least `signals_period_ns` between two messages of one kind on one bus.
    pub(crate) fn set_period(&mut self, signals_period_ns: u64) {
        self.signals_period_ns = signals_period_ns;
    }

    /// Gives everything that follows from a message, logged at `log_time_ns`, to `take`.
    ///
    /// # Errors
    /// The first one of `take`.
    pub fn derive<E>(
        &mut self,
        message: &Message,
        log_time_ns: u64,
        mut take: impl FnMut(Derived, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let result = match message.channel.kind {
            Some(Topic::Frames(bus)) => match self.signals(bus, message, &mut buffer) {
                Some(info) => take(Derived::Signals(bus, info), &buffer),
                None => Ok(()),
            },
            Some(Topic::Truth) => self.world(message, log_time_ns, &mut buffer, &mut take),
            _ => Ok(()),
        };
        self.buffer = buffer;
        result
    }

    /// The signals of a frame of the contract, when they are due. The pages of a multiplexed
    /// message come at one instant and stay together.
    fn signals(
        &mut self,
        bus: u8,
        message: &Message,
        buffer: &mut Vec<u8>,
    ) -> Option<&'static MessageInfo> {
        let record = FrameRecord::decode(&message.data, 0, 0).ok()?;
        let info = signals::message(&record.frame)?;
        let time_ns = message.time_ns();
        let newest_ns = self.newest_ns.get(&(bus, info.id));
        let is_due = newest_ns.is_none_or(|newest_ns| {
            time_ns == *newest_ns || time_ns >= newest_ns.saturating_add(self.signals_period_ns)
        });
        if !is_due {
            return None;
        }
        self.newest_ns.insert((bus, info.id), time_ns);
        signals::encode(info, &record.frame, buffer);
        Some(info)
    }

    /// The scene and where the platoon is, when it is time for them.
    fn world<E>(
        &mut self,
        message: &Message,
        log_time_ns: u64,
        buffer: &mut Vec<u8>,
        take: &mut impl FnMut(Derived, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let time_ns = message.time_ns();
        if time_ns < self.scene_due_ns {
            return Ok(());
        }
        let Ok(truth) = TruthRecord::decode(&message.data) else {
            return Ok(());
        };
        self.scene_due_ns = (time_ns / scene::PERIOD_NS + 1).saturating_mul(scene::PERIOD_NS);
        if let Some(transform) = scene::transform(&truth, log_time_ns) {
            transform.encode(buffer);
            take(Derived::Transform, buffer)?;
        }
        let updates = [
            (Derived::Scene, Some(scene::traffic(&truth, log_time_ns))),
            (Derived::Road, scene::road(&truth, &self.scenery, log_time_ns)),
            (Derived::Field, scene::field(&truth, &self.scenery, log_time_ns)),
        ];
        for (derived, update) in updates {
            let Some(update) = update else { continue };
            buffer.clear();
            update.encode(buffer);
            take(derived, buffer)?;
        }
        Ok(())
    }
}
