use super::*;
use crate::observation::{Ego, Plans};

fn seen(ego_x_m: f64, ego_y_m: f64, obstacle: Obstacle) -> Observation {
    let mut obstacles = [None; OBSTACLES_MAX];
    obstacles[0] = Some(obstacle);
    Observation {
        time_ns: 0,
        ego: Ego { x_m: ego_x_m, y_m: ego_y_m, forward_mps: 18.0, ..Ego::default() },
        mission: Mission {
            right_edge_y_m: -1.875,
            left_edge_y_m: 5.625,
            lane_width_m: 3.75,
            ..Mission::default()
        },
        leader: None,
        predecessor: None,
        plans: Plans::default(),
        obstacles,
    }
}

fn surroundings(seen: &Observation) -> Surroundings {
    Surroundings::new(&LmlCalibration::default(), &TruckBelief::default(), seen)
}

/// The limits at a place, now.
fn limits(surroundings: &Surroundings, x_m: f64, y_m: f64) -> PositionLimits {
    surroundings.meet_at(&LmlCalibration::default(), x_m, y_m, Ahead::NOW).limits
}

fn van(y_m: f64) -> Obstacle {
    Obstacle { x_m: 50.0, y_m, vx_mps: 15.0, length_m: 6.0, width_m: 2.2, ..Obstacle::default() }
}

#[test]
fn a_truck_straight_behind_a_van_is_pushed_to_the_left() {
    let cal = LmlCalibration::default();
    let seen = seen(20.0, 0.0, van(0.0));
    let model = surroundings(&seen).potentials_now(&cal, 20.0, 0.0).next().expect("one");
    // Downhill of the potential is along (along_x, along_y), away from the van.
    assert!(model.slope < 0.0 && model.along_y > 0.0 && model.along_x < 0.0);
}

#[test]
fn a_truck_behind_a_van_in_the_left_lane_is_not_pushed_off_the_road() {
    let cal = LmlCalibration::default();
    let seen = seen(20.0, 3.75, van(3.75));
    let surroundings = surroundings(&seen);
    let model = surroundings.potentials_now(&cal, 20.0, 3.75).next().expect("one");
    assert_eq!(model.along_y, 0.0);
    let limits = limits(&surroundings, 20.0, 3.75);
    assert_eq!(limits.x_max_m, 50.0 - 9.0);
}

#[test]
fn abreast_of_a_van_the_truck_is_kept_beside_it() {
    let left = seen(50.0, 3.0, van(0.0));
    assert_eq!(limits(&surroundings(&left), 50.0, 3.0).y_min_m, 2.75);
    let right = seen(50.0, 0.0, van(3.75));
    assert_eq!(limits(&surroundings(&right), 50.0, 0.0).y_max_m, 1.0);
}

#[test]
fn limits_without_obstacles_keep_the_trucks_sides_on_the_road() {
    let far = Obstacle { x_m: -100.0, ..van(0.0) };
    let limits = limits(&surroundings(&seen(0.0, 0.0, far)), 0.0, 0.0);
    let road = PositionLimits { y_min_m: -0.6, y_max_m: 4.35, x_max_m: f64::INFINITY };
    assert!((limits.y_min_m - road.y_min_m).abs() < 1e-12);
    assert!((limits.y_max_m - road.y_max_m).abs() < 1e-12);
    assert_eq!(limits.x_max_m, road.x_max_m);
}

#[test]
fn a_bump_limits_nothing_but_has_a_potential() {
    let cal = LmlCalibration::default();
    let bump = Obstacle { kind: ObstacleKind::Bump, vx_mps: 0.0, ..van(0.0) };
    let seen = seen(45.0, 0.0, bump);
    let surroundings = surroundings(&seen);
    assert_eq!(limits(&surroundings, 45.0, 0.0).x_max_m, f64::INFINITY);
    let model = surroundings.potentials_now(&cal, 45.0, 0.0).next().expect("one");
    assert!(model.value > 0.0 && model.curvature > 0.0);
}

#[test]
fn an_obstacle_moves_on_while_its_message_ages() {
    let cal = LmlCalibration::default();
    let mut aged = seen(20.0, 0.0, van(3.75));
    aged.time_ns = 200_000_000;
    // 0.2 s old and 1 s ahead at 15 m/s: the gap row has moved by 18 m, and fades out of the way.
    let limits = surroundings(&aged).meet(&cal, 20.0, 3.0, 9).limits;
    assert!((limits.x_max_m - (50.0 + 18.0 - 9.0)).abs() < 1e-9);
}

#[test]
fn an_obstacle_beside_the_trucks_own_path_is_felt_only_where_it_is_too_near() {
    let cal = LmlCalibration::default();
    let at = |y_m: f64| {
        let seen = seen(45.0, y_m, van(3.75));
        surroundings(&seen).potentials_now(&cal, 45.0, y_m).next().expect("one")
    };
    // Back in its lane the truck feels nothing of a van in the other one; nearer than the passing
    // distance all of it, and it grows without a jump in between.
    assert_eq!((at(0.0).slope, at(0.0).curvature), (0.0, 0.0));
    let whole = |y_m: f64| {
        let safe = SafeDistance::new(&cal, 18.0, 3.0, 0.0);
        Field::new(&cal).obstacle(ObstacleKind::Vehicle, safe, -5.0, y_m - 3.75)
    };
    assert_eq!(at(1.0 + 1e-9).slope, whole(1.0 + 1e-9).slope);
    let jump = |y_m: f64| (at(y_m + 1e-7).slope - at(y_m - 1e-7).slope).abs();
    assert!(jump(0.5) < 1.0 && jump(1.0) < 1.0);
    assert!(at(0.75).slope < 0.0 && at(0.75).slope > whole(0.75).slope);
}

#[test]
fn an_obstacle_in_the_trucks_own_path_is_felt_from_the_other_lane() {
    let cal = LmlCalibration::default();
    let seen = seen(45.0, 3.75, van(0.0));
    let model = surroundings(&seen).potentials_now(&cal, 45.0, 3.75).next().expect("one");
    assert!(model.slope < 0.0);
}
