//! The designs against numbers that were computed independently, with cvxpy 1.9.3 and Clarabel
//! 0.11.1 in Python.

use certificate::{Conditions, Corner, DelayBound, Gain, Rate, mixed_string_bound, string_bound};
use synthesis::{Platoon, analysis, complementarity, convex, fleet, wirtinger};

/// Table II of the paper.
const PUBLISHED: Gain =
    Gain { k1: [2.156, 3.175, 0.998], k2: [0.306, 0.239, 0.065], leader_feedforward: false };
/// The lag that fits the paper's figures, and its delay bound.
const LAG_S: f64 = 0.45;
const LONGEST_S: f64 = 0.25;
const SLOW: DelayBound = DelayBound { longest_s: LONGEST_S, rate: Rate::Below(0.5) };

fn near(found: &[f64; 3], wanted: &[f64; 3], relative: f64) -> bool {
    found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= relative * b.abs())
}

#[test]
fn s1_complementarity_finds_the_published_gain() {
    let platoon = Platoon::alike(1, Corner::lag(0.43));
    let design = complementarity::reach(&platoon, SLOW, 0.67, &mut |_| ()).expect("reached");
    let k1 = design.common_gain().k1;
    println!("{k1:?} after {} linearisations, gamma {}", design.iterations, design.gamma);
    assert!(design.iterations <= 4, "{}", design.iterations);
    assert!(near(&k1, &PUBLISHED.k1, 0.02), "{k1:?}");
}

#[test]
fn s2_complementarity_reaches_half_and_leaves_the_trucks_uncoupled() {
    for followers in [1, 3] {
        let platoon = Platoon::alike(followers, Corner::lag(LAG_S));
        let design = complementarity::reach(&platoon, SLOW, 0.5, &mut |_| ()).expect("reached");
        let gain = design.common_gain();
        println!("{followers}: {gain:?} after {}, gamma {}", design.iterations, design.gamma);
        assert!(design.iterations <= 8);
        assert!(near(&gain.k1, &[3.12, 4.28, 1.26], 0.03), "{gain:?}");
        assert!(gain.k2.iter().all(|k| k.abs() < 1e-2), "{gain:?}");
    }
}

#[test]
fn s3_the_search_over_rho_and_its_refinement_are_better() {
    let gammas: Vec<f64> = (1..=3)
        .map(|n| {
            convex::at_rho(&[Platoon::alike(n, Corner::lag(LAG_S))], SLOW, 0.6)
                .expect("feasible")
                .gamma
        })
        .collect();
    println!("rho 0.6: {gammas:?}");
    assert!(gammas.iter().all(|gamma| (gamma - 0.493).abs() < 0.005), "{gammas:?}");
    let platoon = [Platoon::alike(1, Corner::lag(LAG_S))];
    let reanalysed = convex::RHO_GRID.iter().filter_map(|rho| {
        let tangent = convex::at_rho(&platoon, SLOW, *rho).ok()?;
        println!("rho {rho}: {}", tangent.gamma);
        convex::confirmed(&platoon, SLOW, tangent.k, 1).ok().map(|design| design.gamma)
    });
    let best = reanalysed.fold(f64::INFINITY, f64::min);
    assert!(best <= 0.42, "{best}");
    let refined =
        convex::refined(&platoon, SLOW, &mut |i, g| println!("step {i}: {g}")).expect("feasible");
    println!("best of rho {best}, refined {} {:?}", refined.gamma, refined.common_gain());
    assert!(refined.gamma <= 0.38, "{}", refined.gamma);
}

#[test]
fn c1_the_published_gain_has_the_gammas_computed_elsewhere() {
    let delay = DelayBound::any_rate(LONGEST_S);
    for (followers, wanted) in [(1, 0.612), (2, 0.649), (3, 0.666)] {
        let platoon = Platoon::alike(followers, Corner::lag(LAG_S));
        let closed = platoon.closed(&platoon.k(&PUBLISHED));
        let proof = analysis::jensen(&[closed], delay).expect("certified");
        println!("{followers}: {}", proof.gamma);
        assert!((proof.gamma - wanted).abs() < 0.005, "{followers}: {}", proof.gamma);
    }
}

#[test]
fn c1_a_common_disturbance_costs_more_and_a_short_lag_has_no_proof() {
    for (followers, wanted) in [(2, 0.816), (3, 0.985)] {
        let common = synthesis::Disturbance::Common;
        let platoon =
            Platoon { disturbance: common, ..Platoon::alike(followers, Corner::lag(LAG_S)) };
        let closed = platoon.closed(&platoon.k(&PUBLISHED));
        let gamma = analysis::jensen_gamma(&[closed], SLOW).expect("certified");
        assert!((gamma - wanted).abs() < 0.01, "{followers}: {gamma}");
    }
    let short = Platoon::alike(1, Corner::lag(0.1));
    let closed = [short.closed(&short.k(&PUBLISHED))];
    assert!(analysis::jensen(&closed, SLOW).is_err());
    assert!(analysis::wirtinger(&closed, LONGEST_S).is_err());
}

/// The longest delay that a proof exists for.
fn longest_proven(proves: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.25, 0.6);
    while high - low > 1e-3 {
        let middle = 0.5 * (low + high);
        if proves(middle) { low = middle } else { high = middle }
    }
    low
}

#[test]
fn c2_the_longest_delays_are_those_computed_elsewhere() {
    let platoon = Platoon::alike(1, Corner::lag(LAG_S));
    let closed = [platoon.closed(&platoon.k(&PUBLISHED))];
    let gamma = analysis::wirtinger_gamma(&closed, LONGEST_S).expect("certified");
    assert!((gamma - 0.551).abs() < 0.01, "{gamma}");
    let any = DelayBound::any_rate;
    let jensen = longest_proven(|h| analysis::jensen(&closed, any(h)).is_ok());
    let wirtinger = longest_proven(|h| analysis::wirtinger(&closed, h).is_ok());
    println!("longest delay: Jensen {jensen}, Wirtinger {wirtinger}");
    assert!((jensen - 0.449).abs() < 0.005, "{jensen}");
    assert!((wirtinger - 0.467).abs() < 0.005, "{wirtinger}");
}

#[test]
fn wirtinger_designs_beat_jensens_for_delays_of_any_rate() {
    let platoon = [Platoon::alike(1, Corner::lag(LAG_S))];
    let wirtinger = wirtinger::search(&platoon, LONGEST_S).expect("feasible");
    let tangent = convex::search(&platoon, DelayBound::any_rate(LONGEST_S)).expect("feasible");
    let closed = [platoon[0].closed(&tangent.k)];
    let jensen = analysis::wirtinger_gamma(&closed, LONGEST_S).expect("certified");
    println!("Wirtinger design {} {:?}, Jensen design {jensen}", wirtinger.gamma, wirtinger.k);
    assert!(wirtinger.gamma < jensen, "{} {jensen}", wirtinger.gamma);
}

#[test]
fn a_design_for_a_range_of_lags_is_proven_over_all_of_it() {
    let corners = [Platoon::alike(1, Corner::lag(0.15)), Platoon::alike(1, Corner::lag(0.27))];
    let delay = DelayBound::any_rate(LONGEST_S);
    let design = convex::refined(&corners, delay, &mut |_, _| ()).expect("feasible");
    let middle = Platoon::alike(1, Corner::lag(0.2));
    let inside = analysis::jensen_gamma(&[middle.closed(&design.k)], delay).expect("certified");
    assert!(inside <= design.gamma * 1.0001, "{inside} {}", design.gamma);
}

/// So many plants with lags from 0.3 to 0.6 s, and gains from 0.95 to 1.05.
fn different(trucks: u32) -> Vec<Corner> {
    let share = |i: u32| f64::from(i) / f64::from(trucks - 1);
    let plant =
        |i| Corner { lag_s: 0.3 + 0.3 * share(i), gain: 0.95 + 0.1 * share(i * 7 % trucks) };
    (0..trucks).map(plant).collect()
}

/// Designs so many, has every proof checked exactly, and holds the bound against 0.56.
fn all_are_proven(trucks: u32) {
    let files = fleet::design(&different(trucks), LONGEST_S, &mut |_| ()).expect("feasible");
    assert_eq!(files.len(), trucks as usize);
    for file in &files {
        let conditions = Conditions::of(file, 0.02);
        assert!(certificate::proofs(file, &conditions).is_certified(), "{}", file.name);
    }
    let bound = fleet::bound(&files).expect("a proof each");
    assert!(bound < 0.56, "{bound}");
}

#[test]
fn ten_trucks_that_differ_have_a_gain_and_a_proof_each() {
    all_are_proven(10);
}

/// As many as the paper's remark worries about: the work is the same for every truck, so a hundred
/// differ from ten by a factor of ten; `cargo bench -p synthesis` has the times.
#[test]
#[ignore = "a hundred designs take a while without optimisation; ./test.sh --long runs it"]
fn heavy_a_hundred_trucks_that_differ_have_a_gain_and_a_proof_each() {
    all_are_proven(100);
}

/// Trucks with 0.4 to 0.5 s under the published gain, K2 and all: the bound for any order and any
/// number of them is finite, and no less than that of the worst truck among its likes.
#[test]
fn trucks_that_differ_and_are_coupled_have_one_bound() {
    let plants = [0.4, 0.45, 0.5].map(Corner::lag);
    let proofs = fleet::shared(&PUBLISHED, &plants, LONGEST_S, &mut |_| ()).expect("proven");
    let mixed = mixed_string_bound(&proofs, 0.0).expect("finite");
    let worst = proofs.iter().filter_map(|one| string_bound(one, 0.0)).fold(0.0, f64::max);
    println!("mixed {mixed}, worst alone {worst}");
    assert!((worst..1.0).contains(&mixed), "{mixed} {worst}");
}
