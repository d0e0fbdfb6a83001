//! `platoon compare`: what it prints, what it leaves, and that threads change nothing.

use std::fs;

use serde_json::Value;

use crate::bench::{self, Run};

/// The cheapest comparison that has a table, a picture and requirements on both plants.
fn platooning(name: &str, more: &[&str]) -> Run {
    let arguments = ["compare", "--only", "platooning", "--seeds", "2", "--rate-hz", "20"];
    bench::platoon(name, &[&arguments, more].concat())
}

#[test]
fn a_comparison_is_the_same_in_any_number_of_threads_and_leaves_what_it_says() {
    let alone = platooning("compare-alone", &["--threads", "1", "--out", "run"]);
    let together = platooning("compare-together", &["--threads", "3", "--out", "run"]);
    assert!(alone.stdout == together.stdout, "{}\n{}", alone.stdout, together.stdout);
    assert!(!alone.stdout.contains('\u{1b}'), "colours without a terminal: {}", alone.stdout);
    assert!(alone.stdout.contains("Table III"), "{}", alone.stdout);
    let text = |run: &Run, name: &str| fs::read_to_string(run.out().join(name)).expect(name);
    for name in ["results.json", "results.md", "data/fig04.csv", "pictures/fig05b.svg"] {
        assert!(text(&alone, name) == text(&together, name), "{name} differs");
    }
    let json: Value = serde_json::from_str(&text(&alone, "results.json")).expect("JSON");
    assert_eq!(json["seeds"], 2);
    assert_eq!(json["first_seed"], 1001);
    let passed = json["verdict"] == "pass";
    assert_eq!(alone.code(), Some(if passed { 0 } else { 1 }), "{}", alone.stdout);
    let fails = |requirement: &Value| {
        let judged = ["single_track", "two_track"].map(|plant| &requirement[plant]["holds"]);
        judged.contains(&&Value::Bool(false))
    };
    let requirements = json["requirements"].as_array().expect("a list");
    assert!(requirements.len() >= 7, "{requirements:?}");
    assert_eq!(requirements.iter().any(fails), !passed);
    let improvement = &json["improvements"][0];
    assert_eq!(improvement["situation"], "platooning");
    assert!(improvement["percent"]["median"].as_f64() >= Some(60.0), "{improvement}");
}

#[test]
fn what_makes_no_sense_is_refused_before_anything_runs() {
    let cases: [(&[&str], &str); 6] = [
        (&["--seeds", "0"], "--seeds"),
        (&["--only", "nosuch"], "nosuch"),
        (&["--rate-hz", "2000"], "--rate-hz"),
        (&["--json", "nosuch/results.json"], "--json nosuch/results.json"),
        (&["--markdown", "nosuch/results.md"], "--markdown nosuch/results.md"),
        (&["--tune", "--seeds", "3"], "--tune"),
    ];
    for (arguments, names) in cases {
        let run = bench::platoon("compare-refused", &[&["compare"], arguments].concat());
        run.expect_code(2);
        assert!(run.stderr.contains(names), "{arguments:?}: {}", run.stderr);
        assert_eq!(run.left_behind(), Vec::<String>::new(), "{arguments:?}");
    }
}

#[test]
#[ignore = "100 seeds of the longest scenario on both plants: ./test.sh --long"]
fn heavy_no_truck_touches_an_obstacle_in_a_hundred_seeds_on_either_plant() {
    let arguments = ["compare", "--seeds", "100", "--only", "avoidance", "--json", "r.json"];
    let run = bench::platoon_at_length("compare-heavy", &arguments);
    let path = run.out().with_file_name("r.json");
    let json: Value = serde_json::from_slice(&fs::read(path).expect("JSON")).expect("JSON");
    let requirements = json["requirements"].as_array().expect("a list").iter();
    let touched = requirements.filter(|r| r["what"] == "least clearance").filter(|r| {
        let least_m = |plant: &str| r[plant]["spread"]["min"].as_f64().unwrap_or(1.0);
        least_m("single_track") <= 0.0 || least_m("two_track") <= 0.0
    });
    assert_eq!(touched.count(), 0, "{}", run.stdout);
}
