use super::*;

/// A few seconds of the platooning scenario at a slow loop, for several seeds.
fn cells(seeds: std::ops::Range<u64>) -> Vec<Cell> {
    let sets = [("duration_s".to_owned(), "4.0".to_owned())];
    let cell = Cell::new("platooning", &sets, None, 20).expect("built in");
    let sampling = Sampling::every_ms(100);
    seeds.map(|seed| Cell { seed, sampling, ..cell.clone() }).collect()
}

fn outcomes(cells: &[Cell], threads: usize) -> Vec<Outcome> {
    let stop = Arc::new(AtomicBool::new(false));
    run(cells, threads, &stop, &|_, _| ()).expect("runs").expect("nobody stops it")
}

#[test]
fn outcomes_are_the_same_whatever_the_number_of_threads() {
    let cells = cells(1..6);
    let alone = outcomes(&cells, 1);
    for threads in [2, 5, 64] {
        let together = outcomes(&cells, threads);
        for (a, b) in alone.iter().zip(&together) {
            assert_eq!(a.results, b.results);
            // NaN is not itself, and before its first tick a law has said nothing.
            assert_eq!(format!("{:?}", a.trajectory), format!("{:?}", b.trajectory));
        }
    }
    assert_ne!(alone[0].results.trucks, alone[1].results.trucks, "the seed reached nobody");
}

#[test]
fn a_trajectory_has_the_moments_asked_for_and_the_laws_own_weight() {
    let outcome = outcomes(&cells(1..2), 1).remove(0);
    assert_eq!(outcome.trajectory.len(), 40);
    let last = outcome.trajectory.last().expect("not empty");
    assert!((last.time_s - 3.9).abs() < 1e-9);
    assert_eq!(last.trucks.len(), 4);
    assert!(last.trucks[0].q_ref.is_nan(), "a scripted leader has no law");
    assert_eq!(last.trucks[2].q_ref, 187.5, "half of Q0 without an obstacle");
}

#[test]
fn an_obstacle_on_top_of_a_truck_is_noticed_when_it_appears() {
    let spawn = |x_m: &str| {
        let sets =
            [("duration_s", "1.0"), ("obstacles.2.appears_s", "0.5"), ("obstacles.2.x_m", x_m)];
        let sets = sets.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let lane = [("obstacles.2.y_m".to_owned(), "0.0".to_owned())];
        let sets = [&sets[..], &lane].concat();
        let cell = Cell::new("obstacle-avoidance", &sets, None, 20).expect("built in");
        outcomes(&[cell], 1).remove(0).spawn_clearance_m.expect("two obstacles appear")
    };
    assert!(spawn("-50.0") < 0.0, "{}", spawn("-50.0"));
    assert!(spawn("-25.0") > 5.0, "{}", spawn("-25.0"));
}

#[test]
fn a_stopped_campaign_gives_no_outcomes() {
    let stop = Arc::new(AtomicBool::new(true));
    let outcomes = run(&cells(1..3), 2, &stop, &|_, _| ()).expect("no cell fails");
    assert!(outcomes.is_none());
}

#[test]
fn a_cell_that_makes_no_sense_is_refused_before_anything_runs() {
    let sets = [("law.nosuch".to_owned(), "1".to_owned())];
    let failure = Cell::new("platooning", &sets, None, 20).expect_err("no such key");
    assert!(failure.to_string().contains("nosuch"), "{failure}");
}
