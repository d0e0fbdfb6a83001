//! The designs against numbers that were computed independently, with cvxpy 1.9.3 and Clarabel
//! 0.11.1 in Python.

use certificate::{DelayBound, Gain, Rate};
use synthesis::{Platoon, analysis, complementarity, convex};

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
    let platoon = Platoon::alike(1, 0.43);
    let design = complementarity::reach(&platoon, SLOW, 0.67, &mut |_| ()).expect("reached");
    let k1 = design.common_gain().k1;
    println!("{k1:?} after {} linearisations, gamma {}", design.iterations, design.gamma);
    assert!(design.iterations <= 4, "{}", design.iterations);
    assert!(near(&k1, &PUBLISHED.k1, 0.02), "{k1:?}");
}

#[test]
fn s2_complementarity_reaches_half_and_leaves_the_trucks_uncoupled() {
    for followers in [1, 3] {
        let platoon = Platoon::alike(followers, LAG_S);
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
        .map(|n| convex::at_rho(&[Platoon::alike(n, LAG_S)], SLOW, 0.6).expect("feasible").gamma)
        .collect();
    println!("rho 0.6: {gammas:?}");
    assert!(gammas.iter().all(|gamma| (gamma - 0.493).abs() < 0.005), "{gammas:?}");
    let platoon = [Platoon::alike(1, LAG_S)];
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
        let platoon = Platoon::alike(followers, LAG_S);
        let closed = platoon.closed(&platoon.k(&PUBLISHED));
        let proof = analysis::jensen(&[closed], delay).expect("certified");
        println!("{followers}: {}", proof.gamma);
        assert!((proof.gamma - wanted).abs() < 0.005, "{followers}: {}", proof.gamma);
    }
}
