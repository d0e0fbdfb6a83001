//! Well-known messages of Foxglove and Lichtblick, as far as a scene needs them.
//!
//! A subset with the official names and field numbers, see
//! <https://docs.foxglove.dev/docs/sdk/schemas>. Fields that are left out have their defaults.

use crate::schema::{message, message_field};

message! {
    /// Seconds and nanoseconds since 1970.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Timestamp = "google.protobuf.Timestamp" {
        1 seconds: i64,
        2 nanos: i32,
    }
}

message! {
    /// A vector or a size \[m\].
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Vector3 = "foxglove.Vector3" {
        1 x: f64,
        2 y: f64,
        3 z: f64,
    }
}

message! {
    /// A rotation.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Quaternion = "foxglove.Quaternion" {
        1 x: f64,
        2 y: f64,
        3 z: f64,
        4 w: f64,
    }
}

message! {
    /// A position and a rotation.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Pose = "foxglove.Pose" {
        1 position: Vector3,
        2 orientation: Quaternion,
    }
}

message! {
    /// A colour, each part from 0 to 1.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub(crate) struct Color = "foxglove.Color" {
        1 r: f64,
        2 g: f64,
        3 b: f64,
        4 a: f64,
    }
}

message! {
    /// A box around its pose's origin.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct CubePrimitive = "foxglove.CubePrimitive" {
        1 pose: Pose,
        2 size: Vector3,
        3 color: Color,
    }
}

message! {
    /// A point \[m\].
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub(crate) struct Point3 = "foxglove.Point3" {
        1 x: f64,
        2 y: f64,
        3 z: f64,
    }
}

message! {
    /// A line from point to point; its first field, not written here, would make it another kind.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct LinePrimitive = "foxglove.LinePrimitive" {
        2 pose: Pose,
        3 thickness: f64,
        4 scale_invariant: bool,
        5 points: Vec<Point3>,
        6 color: Color,
    }
}

message! {
    /// A label that faces the viewer.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct TextPrimitive = "foxglove.TextPrimitive" {
        1 pose: Pose,
        2 billboard: bool,
        3 font_size: f64,
        4 scale_invariant: bool,
        5 color: Color,
        6 text: String,
    }
}

message! {
    /// One thing in the scene; without a lifetime it stays until it is replaced or deleted.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct SceneEntity = "foxglove.SceneEntity" {
        1 timestamp: Timestamp,
        2 frame_id: String,
        3 id: String,
        8 cubes: Vec<CubePrimitive>,
        11 lines: Vec<LinePrimitive>,
        13 texts: Vec<TextPrimitive>,
    }
}

message! {
    /// A thing to remove; its second field, not written here, would remove everything.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct SceneEntityDeletion = "foxglove.SceneEntityDeletion" {
        1 timestamp: Timestamp,
        3 id: String,
    }
}

message! {
    /// Things to remove, and things to add or replace.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct SceneUpdate = "foxglove.SceneUpdate" {
        1 deletions: Vec<SceneEntityDeletion>,
        2 entities: Vec<SceneEntity>,
    }
}

message! {
    /// Where one coordinate frame is in another.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct FrameTransform = "foxglove.FrameTransform" {
        1 timestamp: Timestamp,
        2 parent_frame_id: String,
        3 child_frame_id: String,
        4 translation: Vector3,
        5 rotation: Quaternion,
    }
}

message_field! {
    Timestamp, Vector3, Quaternion, Pose, Color,
}

impl Timestamp {
    /// The instant so long after 1970.
    pub(crate) const fn of(time_ns: u64) -> Self {
        let (seconds, nanos) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
        Self { seconds: seconds as i64, nanos: nanos as i32 }
    }
}
