//! Announced trajectories over the radio.

use super::*;

/// Four trucks behind a scripted leader for 5 s; what the last of them heard, by source.
fn heard(sets: &[(&str, &str)], announces: bool) -> [Vec<V2vTrajectory>; 4] {
    let sets: Vec<_> = sets.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let scenario = Scenario::load("platooning", &sets).expect("fits");
    let (mut rig, mut ecus) = bench(&scenario, 1, 100);
    ecus.iter_mut().for_each(|ecu| ecu.announces = announces);
    start(&mut rig, &mut ecus);
    drive(&mut rig, &mut ecus, 5.0);
    ecus[3].drain();
    std::array::from_fn(|source| {
        let of_source =
            ecus[3].plans.iter().filter(|plan| usize::from(plan.source_truck) == source);
        of_source.copied().collect()
    })
}

#[test]
fn plans_reach_followers_only_and_unchanged() {
    let [leader, first, second, own] = heard(&[], true);
    assert!(leader.len() > 40 && second.len() > 40, "{} {}", leader.len(), second.len());
    assert!(first.is_empty() && own.is_empty());
    for (n, plan) in second.iter().enumerate() {
        assert_eq!(usize::from(plan.sequence), n);
        assert_eq!(plan.generation_time_ns, n as u64 * 100_000_000);
        let start_m = -40.0 + 20.0 * 0.1 * n as f64;
        assert!((plan.position_x_m - start_m).abs() < 1.5, "{n}: {}", plan.position_x_m);
    }
}

#[test]
fn losses_take_plans_like_states() {
    let [leader, _, second, _] = heard(&[("v2v.loss", "0.4")], true);
    for plans in [leader, second] {
        assert!((15..42).contains(&plans.len()), "{}", plans.len());
    }
}

#[test]
fn a_scripted_leader_announces_its_course_to_those_who_announce_theirs() {
    assert_eq!(heard(&[], false).map(|plans| plans.len()), [0; 4]);
    let [leader, ..] = heard(&[], true);
    for plan in &leader {
        for (k, &speed_mps) in plan.speed_mps.iter().enumerate() {
            // 2 m/s2 from 1.0 to 2.2 s, -0.4 m/s2 from 2.6 to 3.6 s.
            let time_s = 1e-9 * plan.generation_time_ns as f64 + 0.1 * k as f64;
            let expected =
                20.0 + 2.0 * (time_s - 1.0).clamp(0.0, 1.2) - 0.4 * (time_s - 2.6).clamp(0.0, 1.0);
            assert!((speed_mps - expected).abs() < 0.012, "{time_s}: {speed_mps}");
        }
    }
}
