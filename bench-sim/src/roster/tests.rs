//! Rosters change by events, smoothly, and every truck's distances add up.

use super::*;

fn scenario(events: &str) -> Scenario {
    let sets = [("events".to_owned(), events.to_owned())];
    Scenario::load("platooning", &sets).expect("loads")
}

fn places(roster: &Roster, time_s: f64) -> [Place; 4] {
    let mut places = [Place::default(); 4];
    roster.places(time_s, &mut places);
    places
}

#[test]
fn without_events_it_is_one_platoon_in_the_order_of_the_numbers() {
    let roster = Roster::new(&scenario("[]"));
    for (truck, place) in places(&roster, 7.0).into_iter().enumerate() {
        let expected = Place {
            place: truck,
            size: 4,
            leader: 0,
            predecessor: truck.saturating_sub(1),
            spacing_m: 20.0,
            leader_distance_m: 20.0 * truck as f64,
            speed_mps: 20.0,
            desired_y_m: 0.0,
        };
        assert_eq!(place, expected);
    }
    assert!(!roster.is_moving(0.0));
}

#[test]
fn a_truck_in_the_middle_leaves_and_those_behind_close_up() {
    let events = "[{ at_s = 2, truck = 1, leads = true, speed_mps = 24, over_s = 1 },
                   { at_s = 2, truck = 2, follows = 0, over_s = 10 }]";
    let mut roster = Roster::new(&scenario(events));
    assert!(!roster.advance(1.999, |_| 0.0));
    assert!(roster.advance(2.0, |truck| -20.5 * truck as f64));
    let [lead, gone, second, third] = places(&roster, 2.0);
    assert_eq!((lead.size, gone.size, gone.place, gone.leader), (3, 1, 0, 1));
    assert_eq!((second.predecessor, second.place, third.place), (0, 1, 2));
    // Nobody jumps: the distance asked for starts from what it is.
    assert_eq!((second.spacing_m, second.leader_distance_m), (41.0, 41.0));
    assert_eq!(third.leader_distance_m, 61.0);
    assert!(roster.is_moving(11.9) && !roster.is_moving(12.0));
    let [_, gone, second, third] = places(&roster, 12.0);
    assert_eq!((gone.speed_mps, second.speed_mps), (24.0, 20.0));
    assert_eq!((second.spacing_m, third.leader_distance_m), (20.0, 40.0));
}

#[test]
fn a_distance_to_the_same_truck_starts_from_what_was_asked() {
    let events = "[{ at_s = 1, truck = 2, spacing_m = 40, over_s = 20 }]";
    let mut roster = Roster::new(&scenario(events));
    roster.advance(1.0, |truck| -25.0 * truck as f64);
    assert_eq!(places(&roster, 1.0)[2].spacing_m, 20.0);
    let halfway = places(&roster, 11.0);
    assert_eq!((halfway[2].spacing_m, halfway[3].leader_distance_m), (30.0, 70.0));
    assert_eq!(halfway[3].spacing_m, 20.0);
}

#[test]
fn the_rear_of_a_split_has_its_own_leader() {
    let events = "[{ at_s = 1, truck = 2, leads = true, speed_mps = 18, over_s = 2 }]";
    let mut roster = Roster::new(&scenario(events));
    roster.advance(1.0, |_| 0.0);
    let [_, front, rear, last] = places(&roster, 3.0);
    assert_eq!((front.size, rear.size, last.size), (2, 2, 2));
    assert_eq!((rear.leader, last.leader, last.predecessor, last.place), (2, 2, 2, 1));
    assert_eq!((front.speed_mps, rear.speed_mps, last.speed_mps), (20.0, 18.0, 18.0));
    assert_eq!((rear.leader_distance_m, last.leader_distance_m), (0.0, 20.0));
}

#[test]
fn every_truck_hears_whom_it_follows_at_any_time() {
    assert_eq!(scenario("[]").v2v_sources(), [vec![], vec![0], vec![0, 1], vec![0, 2]]);
    let events = "[{ at_s = 0, truck = 3, leads = true },
                   { at_s = 2, truck = 2, leads = true },
                   { at_s = 3, truck = 3, follows = 2, over_s = 5 }]";
    assert_eq!(scenario(events).v2v_sources(), [vec![], vec![0], vec![0, 1], vec![2]]);
}
