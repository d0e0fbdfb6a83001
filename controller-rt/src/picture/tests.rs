use super::*;

const MS: u64 = 1_000_000;
const NOW_NS: u64 = 10_000 * MS;

fn mission(truck: u8) -> Message {
    Message::Mission(Mission {
        truck_index: truck,
        place: truck,
        leader_truck: 0,
        predecessor_truck: truck.saturating_sub(1),
        platoon_size: 4,
        spacing_m: 25.0,
        leader_distance_m: 25.0 * f64::from(truck),
        set_speed_mps: 20.0,
        loop_period_ns: 1_000_000,
        ..Mission::default()
    })
}

fn ego_at(time_ns: u64) -> Message {
    Message::EgoState(EgoState {
        bench_time_ns: time_ns,
        position_x_m: 12.3456,
        nav_status: NavStatus::Valid,
        speed_forward_mps: 20.0,
        ..EgoState::default()
    })
}

fn v2v(source_truck: u8, generation_time_ns: u64) -> Message {
    Message::V2vState(V2vState { source_truck, generation_time_ns, ..V2vState::default() })
}

fn member(page: u8, member: u8, measured_time_ns: u64) -> Message {
    let kind = ObstacleKind::PlatoonTruck;
    Message::Obstacle(Obstacle { page, kind, member, measured_time_ns, ..Obstacle::default() })
}

fn vehicle(page: u8, measured_time_ns: u64) -> Message {
    let kind = ObstacleKind::Vehicle;
    Message::Obstacle(Obstacle { page, kind, member: 255, measured_time_ns, ..Obstacle::default() })
}

/// The picture of `truck` that knows its mission, where it is now, and these messages.
fn picture(truck: u8, messages: &[Message]) -> Picture {
    let mut picture = Picture::new(truck);
    for message in [mission(truck), ego_at(NOW_NS)].iter().chain(messages) {
        picture.note(message);
    }
    picture
}

fn pages(picture: &Picture) -> Vec<usize> {
    let seen = picture.observe(NOW_NS).expect("knows where it is");
    (0..OBSTACLES_MAX).filter(|&page| seen.obstacles[page].is_some()).collect()
}

#[test]
fn a_truck_without_mission_or_position_observes_nothing() {
    assert_eq!(Picture::new(1).observe(NOW_NS), None);
    let mut only_mission = Picture::new(1);
    only_mission.note(&mission(1));
    assert_eq!(only_mission.observe(NOW_NS), None);
    assert!(picture(1, &[]).observe(NOW_NS).is_some());
}

#[test]
fn another_trucks_mission_and_an_impossible_period_are_refused() {
    let mut picture = Picture::new(1);
    assert_eq!(picture.note(&mission(2)), Noted::NotMine);
    let Message::Mission(mut broken) = mission(1) else { unreachable!("is a mission") };
    for loop_period_ns in [0, PERIOD_MAX_NS + 1] {
        broken.loop_period_ns = loop_period_ns;
        assert_eq!(picture.note(&Message::Mission(broken)), Noted::NotMine);
    }
    assert_eq!(picture.mission(), None);
}

#[test]
fn ego_ages_from_fresh_over_stale_to_lost() {
    let picture = picture(1, &[]);
    let at = |age_ms| picture.ego_freshness(NOW_NS + age_ms * MS);
    assert_eq!([at(0), at(5)], [Freshness::Fresh; 2]);
    assert_eq!([at(6), at(100)], [Freshness::Stale; 2]);
    assert_eq!(at(101), Freshness::Lost);
    assert!(picture.own_motion(NOW_NS + 5 * MS).trusted);
    assert!(!picture.own_motion(NOW_NS + 6 * MS).trusted);
    assert_eq!(picture.observe(NOW_NS + 6 * MS), None);
}

#[test]
fn at_slow_loops_ego_stays_fresh_for_three_periods() {
    let mut picture = Picture::new(0);
    let Message::Mission(mut slow) = mission(0) else { unreachable!("is a mission") };
    slow.loop_period_ns = 10_000_000;
    picture.note(&Message::Mission(slow));
    picture.note(&ego_at(NOW_NS));
    assert_eq!(picture.ego_freshness(NOW_NS + 30 * MS), Freshness::Fresh);
    assert_eq!(picture.ego_freshness(NOW_NS + 31 * MS), Freshness::Stale);
}

#[test]
fn a_navigation_solution_its_sensor_disowns_is_lost() {
    let mut picture = picture(1, &[]);
    let Message::EgoState(mut ego) = ego_at(NOW_NS + MS) else { unreachable!("is a state") };
    ego.nav_status = NavStatus::Degraded;
    picture.note(&Message::EgoState(ego));
    assert_eq!(picture.ego_freshness(NOW_NS + MS), Freshness::Fresh);
    (ego.nav_status, ego.bench_time_ns) = (NavStatus::Lost, NOW_NS + 2 * MS);
    picture.note(&Message::EgoState(ego));
    assert_eq!(picture.ego_freshness(NOW_NS + 2 * MS), Freshness::Lost);
}

#[test]
fn v2v_is_lost_after_half_a_second() {
    for (age_ms, alive) in [(0, true), (500, true), (501, false)] {
        let sent_ns = NOW_NS - age_ms * MS;
        let seen = picture(2, &[v2v(0, sent_ns), v2v(1, sent_ns)]).observe(NOW_NS).expect("seen");
        assert_eq!(seen.leader.is_some(), alive, "{age_ms} ms");
        assert_eq!(seen.predecessor.is_some(), alive, "{age_ms} ms");
    }
}

#[test]
fn truck_one_has_its_leader_as_predecessor_and_the_leader_has_neither() {
    let seen = picture(1, &[v2v(0, NOW_NS)]).observe(NOW_NS).expect("seen");
    assert!(seen.leader.is_some());
    assert_eq!(seen.leader, seen.predecessor);
    let mut leader = picture(0, &[]);
    leader.note(&v2v(1, NOW_NS));
    assert_eq!(leader.note(&v2v(0, NOW_NS)), Noted::NotMine);
    let seen = leader.observe(NOW_NS).expect("seen");
    assert_eq!((seen.leader, seen.predecessor), (None, None));
}

#[test]
fn a_truck_follows_whom_its_mission_names_and_has_heard_it_before() {
    let heard = [v2v(0, NOW_NS - 3), v2v(1, NOW_NS - 2), v2v(2, NOW_NS - 1)];
    let mut picture = picture(3, &heard);
    let followed = |picture: &Picture| {
        let seen = picture.observe(NOW_NS).expect("knows where it is");
        [seen.leader, seen.predecessor].map(|state| state.map(|state| NOW_NS - state.generated_ns))
    };
    assert_eq!(followed(&picture), [Some(3), Some(1)]);
    let Message::Mission(told) = mission(3) else { unreachable!("is a mission") };
    let told = Mission { place: 1, leader_truck: 1, predecessor_truck: 1, ..told };
    picture.note(&Message::Mission(told));
    assert_eq!(followed(&picture), [Some(2), Some(2)]);
    let alone = Mission { place: 0, leader_truck: 3, predecessor_truck: 3, ..told };
    picture.note(&Message::Mission(alone));
    assert_eq!(followed(&picture), [None, None]);
    for source in [3, 16] {
        assert_eq!(picture.note(&v2v(source, NOW_NS)), Noted::NotMine);
    }
}

#[test]
fn a_truck_that_leads_minds_every_truck_ahead() {
    let Message::Mission(told) = mission(2) else { unreachable!("is a mission") };
    let leads = Mission { place: 0, leader_truck: 2, predecessor_truck: 2, ..told };
    let ahead = |index: u8| match member(index, index, NOW_NS) {
        Message::Obstacle(seen) => {
            Message::Obstacle(Obstacle { position_x_m: 100.0 - f64::from(index), ..seen })
        }
        other => other,
    };
    let mut picture = picture(2, &[ahead(0), ahead(1), v2v(0, NOW_NS), v2v(1, NOW_NS)]);
    picture.began_ns = Some(0);
    picture.note(&Message::Mission(leads));
    assert_eq!(pages(&picture), [0, 1]);
}

#[test]
fn a_reordered_v2v_message_is_outdated() {
    let mut picture = picture(2, &[v2v(1, NOW_NS)]);
    assert_eq!(picture.note(&v2v(1, NOW_NS - 20 * MS)), Noted::Outdated);
    assert_eq!(picture.note(&v2v(1, NOW_NS)), Noted::Outdated);
}

#[test]
fn obstacles_are_lost_after_200_ms_and_cleared_by_an_empty_page() {
    let mut picture = picture(0, &[vehicle(0, NOW_NS - 200 * MS), vehicle(1, NOW_NS - 201 * MS)]);
    assert_eq!(pages(&picture), [0]);
    let empty = Obstacle { page: 0, kind: ObstacleKind::None, ..Obstacle::default() };
    picture.note(&Message::Obstacle(empty));
    assert_eq!(pages(&picture), [0; 0]);
}

/// Pages that are obstacles to `truck` at X = 0, which hears `links`; truck k is at `places[k]`.
fn in_the_way(truck: u8, links: &[u8], places: [f64; 4]) -> Vec<usize> {
    in_the_way_after(V2V_LOST_NS, truck, links, places)
}

/// The same, this long after the start.
fn in_the_way_after(began_before_ns: u64, truck: u8, links: &[u8], places: [f64; 4]) -> Vec<usize> {
    let members = (0..4).map(|index| match member(index, index, NOW_NS) {
        Message::Obstacle(seen) => {
            Message::Obstacle(Obstacle { position_x_m: places[usize::from(index)], ..seen })
        }
        other => other,
    });
    let states = links.iter().map(|&source| match v2v(source, NOW_NS) {
        Message::V2vState(heard) => {
            Message::V2vState(V2vState { position_x_m: places[usize::from(source)], ..heard })
        }
        other => other,
    });
    let mut picture = picture(truck, &members.chain(states).collect::<Vec<_>>());
    picture.began_ns = Some(NOW_NS - began_before_ns);
    pages(&picture).to_vec()
}

#[test]
fn platoon_trucks_are_obstacles_only_when_nobody_looks_after_them() {
    let with = |truck: u8, links: &[u8]| {
        in_the_way(truck, links, [0, 1, 2, 3].map(|k| 50.0 * (f64::from(truck) - f64::from(k))))
    };
    assert_eq!(with(3, &[0, 2]), [0; 0], "all links alive");
    assert_eq!(with(3, &[2]), [0], "the leader's V2V is lost");
    assert_eq!(with(3, &[0]), [1, 2], "the predecessor's V2V is lost");
    assert_eq!(with(3, &[]), [0, 1, 2], "no V2V; neither itself nor trucks behind");
    assert_eq!(with(1, &[0]), [0; 0], "truck 1 with its leader's V2V");
    assert_eq!(with(1, &[]), [0], "truck 1 without");
    assert_eq!(with(0, &[]), [0; 0], "the leader ignores all who follow");
}

#[test]
fn at_the_start_nobody_has_been_heard_and_that_is_no_dead_radio() {
    let places = [100.0, 50.0, 0.0, -50.0];
    assert_eq!(in_the_way_after(V2V_LOST_NS - 1, 2, &[], places), [0; 0]);
    assert_eq!(in_the_way_after(V2V_LOST_NS, 2, &[], places), [0, 1]);
}

#[test]
fn a_platoon_truck_that_the_predecessor_has_passed_is_in_the_way() {
    // Truck 1 stands 40 m ahead of truck 3; truck 2 has just passed it.
    assert_eq!(in_the_way(3, &[0, 2], [200.0, 40.0, 39.0, -1.0]), [0; 0]);
    assert_eq!(in_the_way(3, &[0, 2], [200.0, 40.0, 41.0, -1.0]), [1]);
    // Truck 2 has passed truck 1, which still drives and must mind it.
    assert_eq!(in_the_way(1, &[0], [50.0, -1.0, 20.0, -50.0]), [2]);
}

#[test]
fn a_platoon_truck_of_unknown_index_is_a_vehicle() {
    let mut picture = picture(1, &[v2v(0, NOW_NS)]);
    picture.note(&member(3, 255, NOW_NS));
    let seen = picture.observe(NOW_NS).expect("seen");
    let kind = seen.obstacles[3].map(|obstacle| obstacle.kind);
    assert_eq!(kind, Some(law::ObstacleKind::Vehicle));
}

#[test]
fn a_saved_picture_comes_back_bit_for_bit() {
    let mut drawn = picture(3, &[v2v(0, NOW_NS), v2v(2, NOW_NS - 7)]);
    for page in 0..8 {
        drawn.note(&vehicle(page, NOW_NS - u64::from(page)));
    }
    let mut bytes = [0; 1536];
    let used = drawn.save(&mut bytes).expect("fits");
    assert_eq!(Picture::restore(3, &bytes[..used]), Some(drawn));
    assert_eq!(Picture::restore(3, &bytes[..used - 1]), None);
    assert_eq!(Picture::restore(2, &bytes[..used]), None);
    assert_eq!(drawn.save(&mut [0; 100]), None);
}

#[test]
fn plans_are_heard_from_leader_and_predecessor_and_lost_at_half_their_horizon() {
    let plan = |source_truck, generation_time_ns| {
        let speed_mps = [20.0 + f64::from(source_truck); 21];
        Message::V2vTrajectory(V2vTrajectory {
            source_truck,
            generation_time_ns,
            speed_mps,
            ..V2vTrajectory::default()
        })
    };
    let made_ns = NOW_NS - 900 * MS;
    let mut picture = picture(2, &[plan(0, made_ns), plan(1, NOW_NS - PLAN_LOST_NS - 1)]);
    let plans = |picture: &Picture| picture.observe(NOW_NS).expect("knows where it is").plans;
    assert_eq!(plans(&picture).leader, Some(Plan::steady(made_ns, 0.0, 20.0)));
    assert_eq!(plans(&picture).predecessor, None);
    assert_eq!(picture.note(&plan(1, NOW_NS)), Noted::Used);
    assert_eq!(plans(&picture).predecessor.map(|p| p.speed_mps[20]), Some(21.0));
    assert_eq!(picture.note(&plan(1, NOW_NS - MS)), Noted::Outdated);
    assert_eq!(picture.note(&plan(2, NOW_NS)), Noted::NotMine);
}

#[test]
fn the_guard_is_shown_every_solid_object_however_well_looked_after() {
    let of_kind = |page, kind| {
        let seen = Obstacle { page, kind, measured_time_ns: NOW_NS, ..Obstacle::default() };
        Message::Obstacle(seen)
    };
    let looked_after = [v2v(0, NOW_NS), v2v(1, NOW_NS), member(0, 1, NOW_NS)];
    let others = [
        vehicle(1, NOW_NS),
        vehicle(2, NOW_NS - OBSTACLE_LOST_NS - 1),
        of_kind(3, ObstacleKind::Pedestrian),
        of_kind(4, ObstacleKind::Bump),
    ];
    let picture = picture(2, &[&looked_after[..], &others].concat());
    let shown: Vec<usize> =
        (0..OBSTACLES_MAX).filter(|&page| picture.objects(NOW_NS)[page].is_some()).collect();
    assert_eq!(shown, [0, 1, 3]);
}

#[test]
fn an_object_across_the_road_is_as_wide_as_it_is_long() {
    let (length_m, width_m) = (6.0, 2.0);
    let heading_rad = core::f64::consts::FRAC_PI_2;
    let Message::Obstacle(van) = vehicle(0, NOW_NS) else { unreachable!("is an obstacle") };
    let van = Obstacle { length_m, width_m, heading_rad, ..van };
    let shown = picture(1, &[Message::Obstacle(van)]).objects(NOW_NS)[0].expect("shown");
    assert!((shown.half_length_m - 1.0).abs() < 1e-9 && (shown.half_width_m - 3.0).abs() < 1e-9);
}

#[test]
fn the_guard_knows_the_motion_across_the_road() {
    let mut picture = picture(1, &[]);
    let Message::EgoState(ego) = ego_at(NOW_NS + MS) else { unreachable!("is a solution") };
    let (heading_rad, yaw_rate_radps) = (0.1, -0.05);
    picture.note(&Message::EgoState(EgoState { heading_rad, yaw_rate_radps, ..ego }));
    let own = picture.own_motion(NOW_NS + MS);
    assert!((own.left_mps - 20.0 * 0.1_f64.sin()).abs() < 1e-9 && own.left_mps2 == -1.0);
}
