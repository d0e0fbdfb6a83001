//! The checks against numbers that were computed independently, in Python with cvxpy, SciPy and
//! simulations of their own; and against certificates that are wrong.

use certificate::{
    Channel, Conditions, Corner, DelayBound, Gain, GainFile, Plants, certify, check, library,
    margin, proofs, spectrum, stability, string_bound,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const LAG_S: f64 = 0.45;
const LONGEST_S: f64 = 0.25;
const PERIOD_S: f64 = 0.02;

fn published() -> GainFile {
    library::named("published").expect("built in").1
}

fn near(found: f64, wanted: f64, tolerance: f64) -> bool {
    (found - wanted).abs() <= tolerance
}

#[test]
fn every_gain_of_the_library_is_certified_for_what_it_says() {
    let all = library::all().expect("well formed");
    assert_eq!(all[0].name, "published");
    for file in all {
        let verdict = certify(&file, &Conditions::of(&file, PERIOD_S));
        let failed: Vec<_> = verdict.findings.iter().filter(|f| !f.is_passed).collect();
        assert!(verdict.is_certified(), "{}: {failed:?}", file.name);
    }
}

#[test]
fn c1_the_published_gain_is_proven_with_the_gammas_computed_elsewhere() {
    let file = published();
    for (followers, wanted) in [(1, 0.611), (2, 0.649), (3, 0.666)] {
        let proof = file.platoon.iter().find(|p| p.followers == followers).expect("in the file");
        assert!(near(proof.proof.gamma, wanted, 0.005), "{}", proof.proof.gamma);
    }
}

#[test]
fn c1_it_is_refused_for_a_short_lag_and_for_a_long_delay() {
    let file = published();
    let own = Conditions::of(&file, PERIOD_S);
    let short = Conditions { plants: Plants::only(0.1), ..own };
    let long = Conditions { longest_s: 0.5, ..own };
    for conditions in [short, long] {
        assert!(!proofs(&file, &conditions).is_certified(), "{conditions:?}");
        assert!(!certify(&file, &conditions).is_certified(), "{conditions:?}");
    }
}

#[test]
fn c2_margins_are_those_computed_elsewhere() {
    let gain = published().gain;
    assert!(near(margin::delay_margin_s(&gain, LAG_S), 0.4967, 0.0005));
    assert!(near(margin::any_rate_small_gain_s(&gain, LAG_S), 0.450, 0.002));
    let margins = [(0.02, 0.245), (0.1, 0.420), (0.3, 0.501), (1.0, 0.395), (2.0, 0.179)];
    for (lag_s, wanted) in margins {
        let found = margin::delay_margin_s(&gain, lag_s);
        assert!(near(found, wanted, 0.001), "lag {lag_s}: {found}");
    }
}

#[test]
fn the_margin_is_where_the_rightmost_root_crosses_the_axis() {
    for file in library::all().expect("well formed") {
        for corner in file.plant.corners() {
            let (gain, lag_s) = (file.gain.through(corner.gain), corner.lag_s);
            let margin_s = margin::delay_margin_s(&gain, lag_s);
            let right =
                |delay_s| spectrum::rightmost_root(&gain, lag_s, delay_s).expect("found").re;
            assert!(right(margin_s - 1e-4) < 0.0 && right(margin_s + 1e-4) > 0.0, "{}", file.name);
        }
    }
}

#[test]
fn c3_the_string_bound_is_the_one_computed_elsewhere() {
    let vehicle = published().vehicle.expect("in the file");
    let coupling = vehicle.coupling.as_ref().expect("K2 is not 0");
    assert!(near(coupling.forwarded_to_forwarded.gamma, 0.161, 0.005));
    assert!(near(string_bound(&vehicle, 0.0).expect("finite"), 0.656, 0.02));
    assert!(near(string_bound(&vehicle, 0.5).expect("finite"), 0.713, 0.02));
    // A rate at which the forwarded energy may grow more than it is damped has no bound.
    assert_eq!(string_bound(&vehicle, 0.98), None);
}

#[test]
fn c5_the_rightmost_roots_are_those_computed_elsewhere() {
    let gain = published().gain;
    for (delay_s, re, im) in [(0.25, -1.919, 2.230), (0.1, -1.272, 1.074), (0.0, -1.094, 0.965)] {
        let root = spectrum::rightmost_root(&gain, LAG_S, delay_s).expect("found");
        assert!(near(root.re, re, 0.01) && near(root.im.abs(), im, 0.01), "{delay_s}: {root}");
    }
}

#[test]
fn sampling_costs_the_delay_computed_elsewhere() {
    let gain = published().gain;
    // Longest stable latency by lag and period; the other computation had a grid of 10 ms.
    let table = [(0.1, 0.02, 0.42), (0.1, 0.1, 0.39), (0.2, 0.05, 0.46), (0.45, 0.1, 0.45)];
    for (lag_s, period_s, wanted_s) in table {
        let is_stable = |latency_s| {
            spectrum::sampled_radius(&gain, lag_s, period_s, latency_s).expect("found") < 1.0
        };
        assert!(is_stable(wanted_s - 0.02), "{lag_s} {period_s}");
        assert!(!is_stable(wanted_s + 0.02), "{lag_s} {period_s}");
    }
}

#[test]
fn a_sampled_loop_tends_to_the_continuous_one() {
    let gain = published().gain;
    let period_s = 1e-3;
    let radius = spectrum::sampled_radius(&gain, LAG_S, period_s, 0.2).expect("found");
    let root = spectrum::rightmost_root(&gain, LAG_S, 0.2 + 0.5 * period_s).expect("found");
    assert!(near(radius.ln() / period_s, root.re, 0.01), "{} {}", radius.ln() / period_s, root.re);
}

/// Numbers that look random and are the same every time.
struct Dice(ChaCha8Rng);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n as u64) as usize
    }

    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn sign(&mut self) -> f64 {
        if self.below(2) == 0 { 1.0 } else { -1.0 }
    }
}

/// What was done to a certificate, and the certificate.
fn damaged(dice: &mut Dice, file: &GainFile) -> (String, GainFile, Conditions) {
    let mut file = file.clone();
    let own = Conditions::of(&file, PERIOD_S);
    match dice.below(4) {
        0 => {
            let (i, share) = (dice.below(3), dice.sign() * dice.between(0.05, 0.5));
            file.gain.k1[i] *= 1.0 + share;
            (format!("k1[{i}] changed by {share}"), file, own)
        }
        1 => {
            let vehicle = file.vehicle.as_mut().expect("in every file");
            let proof = &mut vehicle.disturbance_to_error;
            // Not S: where it is next to nothing, a flipped entry leaves a proof that still holds.
            let matrix = if dice.below(2) == 0 { &mut proof.p } else { &mut proof.r };
            let n = matrix.nrows();
            let (i, j) = (dice.below(n), dice.below(n));
            matrix[(i, j)] = -matrix[(i, j)];
            if i != j {
                matrix[(j, i)] = -matrix[(j, i)];
            }
            (format!("entry ({i}, {j}) flipped"), file, own)
        }
        2 => {
            let lag_s = own.plants.lag_max_s * dice.between(1.5, 12.0);
            let plants = Plants { lag_min_s: lag_s, lag_max_s: lag_s, ..own.plants };
            (format!("{plants:?}"), file, Conditions { plants, ..own })
        }
        _ => {
            let past = margin::least_over(&own.plants, &file.gain, margin::delay_margin_s);
            let longest_s = past * dice.between(1.01, 2.0);
            (format!("delay {longest_s}"), file, Conditions { longest_s, ..own })
        }
    }
}

#[test]
fn a_thousand_damaged_certificates_are_refused() {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(2026));
    let library = library::all().expect("well formed");
    let mut accepted = Vec::new();
    for _ in 0..1000 {
        let file = &library[dice.below(library.len())];
        let (what, file, conditions) = damaged(&mut dice, file);
        if stability(&file, &conditions).is_certified() {
            accepted.push(format!("{}: {what}", file.name));
        }
    }
    assert!(accepted.is_empty(), "{} accepted: {accepted:#?}", accepted.len());
}

#[test]
fn a_proof_for_corners_holds_at_every_plant_between() {
    for name in ["loop", "published-loop"] {
        let (_, file) = library::named(name).expect("built in");
        let proof = &file.vehicle.as_ref().expect("in the file").disturbance_to_error;
        let within = |share: f64, [least, most]: [f64; 2]| least + share * (most - least);
        let (lags_s, gains) = (
            [file.plant.lag_min_s, file.plant.lag_max_s],
            [file.plant.gain_min, file.plant.gain_max],
        );
        for (of_lag, of_gain) in [(0.0, 0.2), (0.2, 0.9), (0.5, 0.1), (0.7, 0.8), (1.0, 0.5)] {
            let (lag_s, gain) = (within(of_lag, lags_s), within(of_gain, gains));
            let plants = Plants::from(Corner { lag_s, gain });
            let part = check::Part::Vehicle(Channel::DisturbanceToError);
            let subject = check::Subject { gain: file.gain, plants, part };
            let checked = check::wirtinger(&subject, LONGEST_S, proof);
            assert!(checked.holds(), "{name}: lag {lag_s} s, gain {gain}");
        }
    }
}

/// A stronger answer of the truck is a larger gain of the loop, and a proof knows the difference.
#[test]
fn a_proof_for_gain_one_does_not_hold_for_a_stronger_plant() {
    let file = published();
    let own = Conditions::of(&file, PERIOD_S);
    let stronger = Plants { gain_max: 1.3, ..own.plants };
    assert!(!proofs(&file, &Conditions { plants: stronger, ..own }).is_certified());
}

#[test]
fn a_proof_of_a_smaller_gamma_does_not_hold() {
    let mut file = published();
    for platoon in &mut file.platoon {
        platoon.proof.gamma *= 0.99;
        let part = check::Part::Platoon(platoon.followers);
        let subject = check::Subject { gain: file.gain, plants: Plants::only(LAG_S), part };
        let checked = check::jensen(&subject, DelayBound::any_rate(LONGEST_S), &platoon.proof);
        assert!(!checked.holds(), "{} followers: {checked:?}", platoon.followers);
    }
}

#[test]
fn nonsense_in_a_file_is_named() {
    let text = published().to_toml();
    assert_eq!(GainFile::parse(&text).expect("its own text"), published());
    let cases = [
        ("version = 1", "version = 7", "version 7"),
        ("lag_max_s = 0.45", "lag_max_s = 0.1", "plant.lag_max_s"),
        ("longest_s = 0.25", "longest_s = -1.0", "delay.longest_s"),
        ("followers = 3", "followers = 99", "platoon.followers"),
        ("k1 = [2.156, 3.175, 0.998]", "k1 = [2.156, 3.175]", "invalid length"),
        ("k1 = [2.156, 3.175, 0.998]", "k1 = [2.156, nan, 0.998]", "gain"),
        ("[plant]", "[plants]", "unknown field"),
    ];
    for (old, new, word) in cases {
        let damaged = text.replacen(old, new, 1);
        assert_ne!(damaged, text, "{old}");
        let refused = GainFile::parse(&damaged).expect_err(new).to_string();
        assert!(refused.contains(word), "{refused}");
    }
}

#[test]
fn numbers_that_are_none_prove_nothing() {
    let mut file = published();
    file.vehicle.as_mut().expect("in the file").disturbance_to_error.p[(0, 0)] = f64::NAN;
    assert!(!proofs(&file, &Conditions::of(&file, PERIOD_S)).is_certified());
    let gain = Gain { k1: [f64::NAN; 3], ..Gain::default() };
    assert_eq!(margin::delay_margin_s(&gain, LAG_S), 0.0);
}
