//! The world as boxes and lines: `foxglove.SceneUpdate`, for the 3D panels of Foxglove and
//! Lichtblick, and the frame by which a camera follows the platoon.
//!
//! A viewer that jumps to an instant takes the newest message of each topic and forgets all else.
//! So what is drawn at a period of its own has a topic of its own, and every message is whole.
//! Nothing has a lifetime: a viewer counts it on its own clock, of which a live view is behind.
//!
//! Heights and colours are for the eye only; nothing else in the trace has them.

use crate::foxglove::{
    Color, CubePrimitive, FrameTransform, LinePrimitive, Point3, Pose, Quaternion, SceneEntity,
    SceneEntityDeletion, SceneUpdate, TextPrimitive, Timestamp, Vector3,
};
use crate::scenery::Scenery;
use crate::truth::{ObstacleKind, ObstacleTruth, TruckTruth, TruthRecord};

/// The coordinate frame of the road: X along it, Y to the left, Z up.
const FRAME: &str = "road";
/// The frame that moves along the road with the platoon's middle.
const PLATOON_FRAME: &str = "platoon";
/// Time between two scenes: 20 Hz is smooth to the eye.
pub(crate) const PERIOD_NS: u64 = 50_000_000;
/// Time between two drawings of the road, and of the potential field.
const ROAD_PERIOD_NS: u64 = 1_000_000_000;
const FIELD_PERIOD_NS: u64 = 200_000_000;
const TRUCK_HEIGHT_M: f64 = 3.5;
/// How far the road reaches ahead of the leader and behind the last truck \[m\].
const ROAD_AHEAD_M: f64 = 250.0;
/// A dash of a lane line and the distance to the next one's start \[m\].
const DASH_M: f64 = 4.5;
const DASHES_M: f64 = 12.0;
/// Shares of the safe distance at which the potential field has a contour, and points of each.
const CONTOURS: [f64; 3] = [1.0, 0.7, 0.45];
const CONTOUR_POINTS: usize = 40;
/// Thickness of lines and height of letters on the screen.
const LINE_PX: f64 = 2.0;
const LABEL_PX: f64 = 11.0;

const TRUCK_COLOR: Color = Color { r: 0.16, g: 0.42, b: 0.76, a: 1.0 };
const LEADER_COLOR: Color = Color { r: 0.10, g: 0.60, b: 0.42, a: 1.0 };
const LABEL_COLOR: Color = Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };
const ROAD_COLOR: Color = Color { r: 0.22, g: 0.24, b: 0.27, a: 1.0 };
const MARKING_COLOR: Color = Color { r: 0.85, g: 0.85, b: 0.85, a: 1.0 };
const FIELD_COLOR: Color = Color { r: 0.95, g: 0.45, b: 0.15, a: 1.0 };

/// The trucks and the obstacles of a world state, `log_time_ns` after 1970.
pub(crate) fn traffic(truth: &TruthRecord, log_time_ns: u64) -> SceneUpdate {
    let absent = truth.obstacles.iter().filter(|obstacle| !obstacle.present);
    let deletions = absent.map(|obstacle| SceneEntityDeletion {
        timestamp: Timestamp::of(log_time_ns),
        id: obstacle_id(obstacle),
    });
    SceneUpdate { deletions: deletions.collect(), entities: boxes(truth, log_time_ns) }
}

/// The road around the platoon, when it is due.
pub(crate) fn road(
    truth: &TruthRecord,
    scenery: &Scenery,
    log_time_ns: u64,
) -> Option<SceneUpdate> {
    when_due(truth, ROAD_PERIOD_NS, || road_around(truth, scenery, log_time_ns))
}

/// The potential fields around the obstacles, when they are due.
pub(crate) fn field(
    truth: &TruthRecord,
    scenery: &Scenery,
    log_time_ns: u64,
) -> Option<SceneUpdate> {
    when_due(truth, FIELD_PERIOD_NS, || contours(truth, scenery, log_time_ns))
}

/// What is drawn alone, at the first world state shown of a period.
fn when_due(
    truth: &TruthRecord,
    period_ns: u64,
    draw: impl FnOnce() -> Option<SceneEntity>,
) -> Option<SceneUpdate> {
    let is_due = truth.time_ns % period_ns < PERIOD_NS;
    let entities = vec![is_due.then(draw).flatten()?];
    Some(SceneUpdate { entities, ..SceneUpdate::default() })
}

/// Where the platoon is on the road; none without trucks.
pub(crate) fn transform(truth: &TruthRecord, log_time_ns: u64) -> Option<FrameTransform> {
    let (rear_m, front_m) = extent(truth)?;
    Some(FrameTransform {
        timestamp: Timestamp::of(log_time_ns),
        parent_frame_id: FRAME.into(),
        child_frame_id: PLATOON_FRAME.into(),
        translation: Vector3 { x: (rear_m + front_m) / 2.0, y: 0.0, z: 0.0 },
        rotation: Quaternion { w: 1.0, ..Quaternion::default() },
    })
}

/// From the last truck to the first along the road \[m\].
fn extent(truth: &TruthRecord) -> Option<(f64, f64)> {
    let places = || truth.trucks.iter().map(|truck| truck.x_m);
    Some((places().reduce(f64::min)?, places().reduce(f64::max)?))
}

/// Edges, lane lines and surface of the road around the platoon.
fn road_around(truth: &TruthRecord, scenery: &Scenery, log_time_ns: u64) -> Option<SceneEntity> {
    let [right_m, left_m] = scenery.edges_m?;
    let (rear_m, front_m) = extent(truth)?;
    let (from_m, to_m) = (rear_m - ROAD_AHEAD_M, front_m + ROAD_AHEAD_M);
    let edge = |y_m: f64| line(MARKING_COLOR, [(from_m, y_m), (to_m, y_m)]);
    let first = (from_m / DASHES_M).floor() as i64;
    let dashes = ((to_m - from_m) / DASHES_M) as i64;
    let dash = |y_m: f64, number: i64| CubePrimitive {
        pose: flat(number as f64 * DASHES_M + DASH_M / 2.0, y_m, 0.0),
        size: Vector3 { x: DASH_M, y: 0.15, z: 0.02 },
        color: MARKING_COLOR,
    };
    let surface = CubePrimitive {
        pose: flat((from_m + to_m) / 2.0, (right_m + left_m) / 2.0, -0.06),
        size: Vector3 { x: to_m - from_m, y: left_m - right_m, z: 0.1 },
        color: ROAD_COLOR,
    };
    let lanes = scenery.lane_lines_m.iter();
    let dashed = lanes.flat_map(|y_m| (first..first + dashes).map(|number| dash(*y_m, number)));
    Some(SceneEntity {
        cubes: std::iter::once(surface).chain(dashed).collect(),
        lines: vec![edge(right_m), edge(left_m)],
        ..empty("road".into(), log_time_ns)
    })
}

/// Contours of the potential field around each obstacle, as the truck nearest behind feels it.
fn contours(truth: &TruthRecord, scenery: &Scenery, log_time_ns: u64) -> Option<SceneEntity> {
    let reach = scenery.reach.as_ref()?;
    let present = truth.obstacles.iter().filter(|obstacle| obstacle.present);
    let lines = present.filter_map(|obstacle| {
        let gap_m = |truck: &&TruckTruth| (obstacle.x_m - truck.x_m).abs();
        let nearest = truth.trucks.iter().min_by(|a, b| gap_m(a).total_cmp(&gap_m(b)))?;
        let [x_m, y_m] = reach.of(nearest, obstacle);
        Some(CONTOURS.map(|share| contour(obstacle, share, [share * x_m, share * y_m])))
    });
    let lines: Vec<LinePrimitive> = lines.flatten().collect();
    Some(SceneEntity { lines, ..empty("potential field".into(), log_time_ns) })
}

/// An ellipse around an obstacle: there, the normalised distance of Eq. 20 is `share`.
fn contour(obstacle: &ObstacleTruth, share: f64, half_m: [f64; 2]) -> LinePrimitive {
    let point = |number: usize| {
        let turn = core::f64::consts::TAU * number as f64 / CONTOUR_POINTS as f64;
        (obstacle.x_m + half_m[0] * turn.cos(), obstacle.y_m + half_m[1] * turn.sin())
    };
    let color = Color { a: 1.45 - share, ..FIELD_COLOR };
    line(color, (0..=CONTOUR_POINTS).map(point))
}

/// A line on the road, from whatever distance as thick.
fn line(color: Color, points: impl IntoIterator<Item = (f64, f64)>) -> LinePrimitive {
    LinePrimitive {
        pose: flat(0.0, 0.0, 0.0),
        thickness: LINE_PX,
        scale_invariant: true,
        points: points.into_iter().map(|(x, y)| Point3 { x, y, z: 0.05 }).collect(),
        color,
    }
}

/// A pose along the road.
fn flat(x: f64, y: f64, z: f64) -> Pose {
    Pose {
        position: Vector3 { x, y, z },
        orientation: Quaternion { w: 1.0, ..Quaternion::default() },
    }
}

/// A thing without shape yet.
fn empty(id: String, log_time_ns: u64) -> SceneEntity {
    SceneEntity {
        timestamp: Timestamp::of(log_time_ns),
        frame_id: FRAME.into(),
        id,
        ..SceneEntity::default()
    }
}

/// The trucks and the obstacles that are there.
fn boxes(truth: &TruthRecord, log_time_ns: u64) -> Vec<SceneEntity> {
    let trucks = truth.trucks.iter().enumerate().map(|(index, truck)| {
        let color = if index == 0 { LEADER_COLOR } else { TRUCK_COLOR };
        entity(format!("truck {index}"), log_time_ns, &truck_box(truck), color)
    });
    let obstacles = truth.obstacles.iter().filter(|obstacle| obstacle.present).map(|obstacle| {
        let (height_m, color) = looks(obstacle.kind);
        let shape = obstacle_box(obstacle, height_m);
        entity(obstacle_id(obstacle), log_time_ns, &shape, color)
    });
    trucks.chain(obstacles).collect()
}

fn obstacle_id(obstacle: &ObstacleTruth) -> String {
    format!("obstacle {}", obstacle.number)
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
    let label = TextPrimitive {
        pose: pose(shape, shape.height_m + 2.0),
        billboard: true,
        font_size: LABEL_PX,
        scale_invariant: true,
        color: LABEL_COLOR,
        text: id.clone(),
    };
    let size = Vector3 { x: shape.length_m, y: shape.width_m, z: shape.height_m };
    SceneEntity {
        cubes: vec![CubePrimitive { pose: pose(shape, shape.height_m / 2.0), size, color }],
        texts: vec![label],
        ..empty(id, log_time_ns)
    }
}

fn pose(shape: &StandingBox, z_m: f64) -> Pose {
    let half_rad = shape.heading_rad / 2.0;
    Pose {
        position: Vector3 { x: shape.x_m, y: shape.y_m, z: z_m },
        orientation: Quaternion { x: 0.0, y: 0.0, z: half_rad.sin(), w: half_rad.cos() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenery::Reach;

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
        let update = traffic(&truth, 0);
        let shown: Vec<_> = update.entities.into_iter().map(|thing| thing.id).collect();
        let gone: Vec<_> = update.deletions.into_iter().map(|thing| thing.id).collect();
        assert_eq!((shown, gone), (vec!["obstacle 1".into()], vec!["obstacle 2".into()]));
    }

    #[test]
    fn road_and_field_are_around_the_platoon_and_not_in_every_scene() {
        let mut truth = TruthRecord::default();
        for x_m in [500.0, 450.0] {
            truth.trucks.push(TruckTruth { x_m, ..TruckTruth::default() }).expect("room");
        }
        let obstacle = ObstacleTruth { x_m: 520.0, present: true, ..ObstacleTruth::default() };
        truth.obstacles.push(obstacle).expect("room");
        // The nearest truck is the first one, 20 m behind.
        let scenery = Scenery {
            edges_m: Some([-2.0, 6.0]),
            lane_lines_m: vec![2.0],
            reach: Some(Reach::new(|truck, obstacle| [obstacle.x_m - truck.x_m, 3.0])),
        };
        let of_road = road(&truth, &scenery, 0).expect("a road").entities;
        assert!((of_road[0].cubes[0].pose.position.x - 475.0).abs() < 1e-9, "around the platoon");
        let of_field = field(&truth, &scenery, 0).expect("a field").entities;
        let outermost = &of_field[0].lines[0].points;
        assert!((outermost[0].x - 540.0).abs() < 1e-9, "as far as the nearest truck feels it");
        truth.time_ns = 50_000_000;
        assert!(road(&truth, &scenery, 0).is_none() && field(&truth, &scenery, 0).is_none());
        assert_eq!(traffic(&truth, 0).entities.len(), 3, "trucks and obstacle");
        let moved = transform(&truth, 0).expect("trucks");
        assert!((moved.translation.x - 475.0).abs() < 1e-9);
    }
}
