//! The world as boxes: `foxglove.SceneUpdate`, for the 3D panels of Foxglove and Lichtblick.
//!
//! A subset of the well-known schema with its official names and field numbers, see
//! <https://docs.foxglove.dev/docs/sdk/schemas/scene-update>. Heights and colours are for the
//! eye only; nothing else in the trace has them.

use crate::schema::{message, message_field};
use crate::truth::{ObstacleKind, ObstacleTruth, TruckTruth, TruthRecord};

/// The coordinate frame of the road: X along it, Y to the left, Z up.
const FRAME: &str = "road";
/// How long a box stays without an update; a few updates, so that gone obstacles vanish.
const LIFETIME_NS: u64 = 200_000_000;
const TRUCK_HEIGHT_M: f64 = 3.5;

message! {
    /// Seconds and nanoseconds since 1970.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Timestamp = "google.protobuf.Timestamp" {
        1 seconds: i64,
        2 nanos: i32,
    }
}

message! {
    /// A span of time.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct Duration = "google.protobuf.Duration" {
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
    /// One thing in the scene.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct SceneEntity = "foxglove.SceneEntity" {
        1 timestamp: Timestamp,
        2 frame_id: String,
        3 id: String,
        4 lifetime: Duration,
        8 cubes: Vec<CubePrimitive>,
        13 texts: Vec<TextPrimitive>,
    }
}

message! {
    /// Things to add or replace.
    #[derive(Debug, Clone, PartialEq, Default)]
    pub(crate) struct SceneUpdate = "foxglove.SceneUpdate" {
        2 entities: Vec<SceneEntity>,
    }
}

message_field! {
    Timestamp, Duration, Vector3, Quaternion, Pose, Color,
}

const TRUCK_COLOR: Color = Color { r: 0.16, g: 0.42, b: 0.76, a: 1.0 };
const LEADER_COLOR: Color = Color { r: 0.10, g: 0.60, b: 0.42, a: 1.0 };
const LABEL_COLOR: Color = Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };

/// The boxes of a world state. `log_time_ns` is its time since 1970.
pub(crate) fn update(truth: &TruthRecord, log_time_ns: u64) -> SceneUpdate {
    let trucks = truth.trucks.iter().enumerate().map(|(index, truck)| {
        let color = if index == 0 { LEADER_COLOR } else { TRUCK_COLOR };
        entity(format!("truck {index}"), log_time_ns, &truck_box(truck), color)
    });
    let obstacles = truth.obstacles.iter().filter(|obstacle| obstacle.present).map(|obstacle| {
        let (height_m, color) = looks(obstacle.kind);
        let shape = obstacle_box(obstacle, height_m);
        entity(format!("obstacle {}", obstacle.number), log_time_ns, &shape, color)
    });
    SceneUpdate { entities: trucks.chain(obstacles).collect() }
}

/// A box standing on the road.
struct StandingBox {
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
    length_m: f64,
    width_m: f64,
    height_m: f64,
}

fn truck_box(truck: &TruckTruth) -> StandingBox {
    // The CG is not the middle of the box.
    let ahead_m = (truck.front_m - truck.rear_m) / 2.0;
    StandingBox {
        x_m: truck.x_m + ahead_m * truck.heading_rad.cos(),
        y_m: truck.y_m + ahead_m * truck.heading_rad.sin(),
        heading_rad: truck.heading_rad,
        length_m: truck.front_m + truck.rear_m,
        width_m: truck.width_m,
        height_m: TRUCK_HEIGHT_M,
    }
}

fn obstacle_box(obstacle: &ObstacleTruth, height_m: f64) -> StandingBox {
    StandingBox {
        x_m: obstacle.x_m,
        y_m: obstacle.y_m,
        heading_rad: obstacle.heading_rad,
        length_m: obstacle.length_m,
        width_m: obstacle.width_m,
        height_m,
    }
}

const fn looks(kind: ObstacleKind) -> (f64, Color) {
    match kind {
        ObstacleKind::Vehicle => (1.6, Color { r: 0.80, g: 0.25, b: 0.20, a: 1.0 }),
        ObstacleKind::Pedestrian => (1.8, Color { r: 0.95, g: 0.60, b: 0.10, a: 1.0 }),
        ObstacleKind::Bump => (0.1, Color { r: 0.55, g: 0.50, b: 0.45, a: 1.0 }),
    }
}

fn entity(id: String, log_time_ns: u64, shape: &StandingBox, color: Color) -> SceneEntity {
    let (seconds, nanos) = split(log_time_ns);
    let (lifetime_s, lifetime_ns) = split(LIFETIME_NS);
    let label = TextPrimitive {
        pose: pose(shape, shape.height_m + 1.0),
        billboard: true,
        font_size: 1.0,
        scale_invariant: false,
        color: LABEL_COLOR,
        text: id.clone(),
    };
    let size = Vector3 { x: shape.length_m, y: shape.width_m, z: shape.height_m };
    SceneEntity {
        timestamp: Timestamp { seconds, nanos },
        frame_id: FRAME.into(),
        id,
        lifetime: Duration { seconds: lifetime_s, nanos: lifetime_ns },
        cubes: vec![CubePrimitive { pose: pose(shape, shape.height_m / 2.0), size, color }],
        texts: vec![label],
    }
}

fn pose(shape: &StandingBox, z_m: f64) -> Pose {
    let half_rad = shape.heading_rad / 2.0;
    Pose {
        position: Vector3 { x: shape.x_m, y: shape.y_m, z: z_m },
        orientation: Quaternion { x: 0.0, y: 0.0, z: half_rad.sin(), w: half_rad.cos() },
    }
}

fn split(time_ns: u64) -> (i64, i32) {
    ((time_ns / 1_000_000_000) as i64, (time_ns % 1_000_000_000) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trucks_box_reaches_from_its_rear_to_its_front() {
        let heading_rad = core::f64::consts::FRAC_PI_2; // facing left: along Y
        let truck = TruckTruth {
            x_m: 1.0,
            heading_rad,
            front_m: 4.0,
            rear_m: 6.0,
            ..TruckTruth::default()
        };
        let shape = truck_box(&truck);
        assert!((shape.x_m - 1.0).abs() < 1e-12);
        assert!((shape.y_m + shape.length_m / 2.0 - 4.0).abs() < 1e-12);
        assert!((shape.y_m - shape.length_m / 2.0 + 6.0).abs() < 1e-12);
    }

    #[test]
    fn obstacles_that_are_not_there_are_not_shown() {
        let mut truth = TruthRecord::default();
        for (number, present) in [(1, true), (2, false)] {
            let obstacle = ObstacleTruth { number, present, ..ObstacleTruth::default() };
            truth.obstacles.push(obstacle).expect("room");
        }
        let ids: Vec<_> = update(&truth, 0).entities.into_iter().map(|thing| thing.id).collect();
        assert_eq!(ids, ["obstacle 1"]);
    }
}
