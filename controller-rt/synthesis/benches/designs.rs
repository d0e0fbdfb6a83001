//! What designs and proofs cost: `cargo bench -p synthesis`.
//!
//! Seconds that one core worked; no threads, and other programs count little. Every line is the
//! least of a few repetitions, and says what is asked of it. The last lines design a gain for each
//! of many trucks that differ, and prove and check it: ten times as many are to take ten times as
//! long, not more.

use certificate::{Conditions, Corner, DelayBound, Gain, Rate, library, proofs};
use rustix::time::{ClockId, clock_gettime};
use synthesis::{Platoon, analysis, complementarity, convex, fleet, wirtinger};

/// Table II of the paper.
const PUBLISHED: Gain =
    Gain { k1: [2.156, 3.175, 0.998], k2: [0.306, 0.239, 0.065], leader_feedforward: false };
const LAG_S: f64 = 0.45;
const LONGEST_S: f64 = 0.25;
const SLOW: DelayBound = DelayBound { longest_s: LONGEST_S, rate: Rate::Below(0.5) };
/// Repetitions of what takes less than a second.
const REPETITIONS: usize = 5;

fn main() {
    let alike = |followers| Platoon::alike(followers, Corner::lag(LAG_S));
    line("one follower, one program at rho 0.6", 0.05, REPETITIONS, || {
        convex::at_rho(&[alike(1)], SLOW, 0.6).expect("feasible");
    });
    line("three followers, one program at rho 0.6", 1.0, REPETITIONS, || {
        convex::at_rho(&[alike(3)], SLOW, 0.6).expect("feasible");
    });
    line("three followers, complementarity to gamma 0.5", 5.0, 1, || {
        complementarity::reach(&alike(3), SLOW, 0.5, &mut |_| ()).expect("reached");
    });
    line("one follower, search and refinement", f64::NAN, 1, || {
        convex::refined(&[alike(1)], SLOW, &mut |_, _| ()).expect("feasible");
    });
    line("one follower, Wirtinger design", f64::NAN, 1, || {
        wirtinger::search(&[alike(1)], LONGEST_S).expect("feasible");
    });
    let closed = alike(1).closed(&alike(1).k(&PUBLISHED));
    line("one follower, Jensen proof", f64::NAN, REPETITIONS, || {
        analysis::jensen(std::slice::from_ref(&closed), SLOW).expect("proven");
    });
    line("one follower, Wirtinger proof", f64::NAN, REPETITIONS, || {
        analysis::wirtinger(std::slice::from_ref(&closed), LONGEST_S).expect("proven");
    });
    let (_, published) = library::named("published").expect("built in");
    let own = Conditions::of(&published, 0.02);
    line("check of the published gain's seven proofs", f64::NAN, 1, || {
        assert!(proofs(&published, &own).is_certified());
    });
    line("its check at the start of an ECU", f64::NAN, REPETITIONS, || {
        assert!(certificate::stability(&published, &own).is_certified());
    });
    let [ten, hundred] = [10, 100].map(|trucks| {
        let limit = if trucks == 100 { 10.0 } else { f64::NAN };
        line(&format!("{trucks} trucks that differ, designed and checked"), limit, 1, || {
            checked_fleet(trucks);
        })
    });
    println!("a hundred trucks take {:.1} times as long as ten (at most 12)", hundred / ten);
}

/// Times it, prints the least time beside what is asked, and returns it \[s\].
fn line(what: &str, limit_s: f64, repetitions: usize, mut work: impl FnMut()) -> f64 {
    let mut least_s = f64::INFINITY;
    for _ in 0..repetitions {
        let began_s = cpu_s();
        work();
        least_s = least_s.min(cpu_s() - began_s);
    }
    let limit = if limit_s.is_nan() { String::new() } else { format!(", at most {limit_s} s") };
    println!("{what:50} {least_s:9.4} s{limit}");
    least_s
}

/// Time that this process had a CPU \[s\].
fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Designs a gain for each of so many trucks with lags from 0.3 to 0.6 s, and checks every proof.
fn checked_fleet(trucks: u32) {
    let steps = f64::from(trucks - 1);
    let plant = |i| Corner::lag(0.3 + 0.3 * f64::from(i) / steps);
    let plants: Vec<Corner> = (0..trucks).map(plant).collect();
    for file in fleet::design(&plants, LONGEST_S, &mut |_| ()).expect("feasible") {
        assert!(proofs(&file, &Conditions::of(&file, 0.02)).is_certified());
    }
}
